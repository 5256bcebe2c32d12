"""Figures are counted page by page where no chapter's number stands before them."""

import importlib.util
from pathlib import Path

PATH = Path(__file__).parents[2] / "book" / "extensions" / "figure_numbers.py"


def test_pages_without_a_number_begin_with_figure_1():
    spec = importlib.util.spec_from_file_location("figure_numbers", PATH)
    extension = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(extension)
    numbers = {
        "index": {"figure": {"a": (1,)}},
        "chapter": {"figure": {"c": (3, 1), "d": (3, 2)}, "table": {}},
        "page": {"figure": {"late": (12,), "early": (2,)}, "table": {"t": (4,)}},
    }
    extension.restart(numbers)
    assert numbers == {
        "index": {"figure": {"a": (1,)}},
        "chapter": {"figure": {"c": (3, 1), "d": (3, 2)}, "table": {}},
        "page": {"figure": {"late": (2,), "early": (1,)}, "table": {"t": (1,)}},
    }

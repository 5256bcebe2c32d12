"""A chapter gives the same numbers, words and pictures when it is executed twice."""

import json
from pathlib import Path

import nbformat
import pytest

from hadr.press.chapters import run_notebooks

ROOT = Path(__file__).resolve().parents[2]
#: The quickest chapter; it draws, computes with a network, and has exercises.
CHAPTER = ROOT / "notebooks" / "00_introduction.ipynb"


def shown(path):
    """What a reader sees of each cell: text, HTML and pictures, but not what goes to stderr."""
    cells = []
    for cell in nbformat.read(path, 4).cells:
        outputs = cell.get("outputs", [])
        seen = [o.text if o.output_type == "stream" else dict(o.get("data", {})) for o in outputs
                if o.get("name") != "stderr"]  # fmt: skip
        for data in (each for each in seen if isinstance(each, dict)):
            data.pop("application/vnd.jupyter.widget-view+json", None)  # a random name
        cells.append(seen)
    return cells


@pytest.mark.long
def test_a_chapter_gives_the_same_twice(tmp_path):
    results, cells = [], []
    for name in ("first", "second"):
        (run,) = run_notebooks([CHAPTER], tmp_path / name, say=lambda line: None)
        measured = tmp_path / name / "results" / CHAPTER.stem / "results.json"
        results.append(json.loads(measured.read_text())["results"])
        cells.append(shown(run.notebook))
    assert results[0] == results[1]
    assert len(results[0]) > 0
    assert sum(bool(seen) for seen in cells[0]) > 5
    for one, other in zip(*cells, strict=True):
        assert one == other

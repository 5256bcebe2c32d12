"""The pages on the library: every module on one of them, every argument of every command."""

import argparse
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.typing import ArrayLike, NDArray

from hadr.cli import COMMANDS, command_parser

ROOT = Path(__file__).resolve().parents[2]
BOOK = ROOT / "book"
PAGES = sorted((BOOK / "library").glob("*.md"))


def modules_on(page):
    found = re.search(r"^```\{modules\}\n(.*?)^```$", page.read_text(), re.DOTALL | re.MULTILINE)
    return found.group(1).split() if found else []


def modules_of_the_library():
    """All of them but packages that only hold a line of text."""
    names = set()
    for path in (ROOT / "hadr").rglob("*.py"):
        if path.name == "__init__.py" and " = " not in path.read_text():
            continue
        parts = path.relative_to(ROOT).with_suffix("").parts
        names.add(".".join(parts).removesuffix(".__init__"))
    return names


def test_every_module_stands_on_exactly_one_page():
    """A new module goes on the page of its part, book/library/PART.md, in the fence {modules}.

    Figures of one chapter alone are on none.
    """
    named = [name for page in PAGES for name in modules_on(page)]
    assert len(named) == len(set(named))
    assert set(named) <= modules_of_the_library()
    left_out = modules_of_the_library() - set(named)
    assert [name for name in left_out if not name.startswith("hadr.figures.")] == []


def test_the_contents_and_the_overview_name_every_page():
    contents = yaml.safe_load((BOOK / "_toc.yml").read_text())
    entries = [entry for part in contents["parts"] for entry in part["chapters"]]
    (library,) = [entry for entry in entries if entry["file"] == "library/index"]
    listed = {entry["file"] for entry in library["sections"]} | {"library/index"}
    assert listed == {f"library/{page.stem}" for page in PAGES}
    linked = set()
    for page in PAGES:
        linked |= set(re.findall(r"\]\(([a-z_]+)\.md\)", page.read_text()))
    main_pages = {page.stem for page in PAGES if "_" not in page.stem} - {"index"}
    assert main_pages <= linked
    overview = (BOOK / "library" / "index.md").read_text()
    assert main_pages <= set(re.findall(r"\]\(([a-z_]+)\.md\)", overview))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_each_page_begins_with_an_orientation(page):
    prose = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
    assert prose.startswith("# ")
    assert len(prose.split()) >= 20


def test_modules_become_a_list_and_sections(extension):
    text = extension.expand("# Page\n\n```{modules}\nhadr.camera\nhadr.hand\n```\n")
    assert "- [`hadr.camera`](#hadr.camera): The pinhole camera: intrinsics" in text
    assert text.count(".. automodule:: hadr.hand\n") == 1
    assert text.index("# Page") < text.index("## hadr.camera") < text.index("## hadr.hand")
    alone = extension.expand("```{modules}\nhadr.hand\n```")
    assert "- [" not in alone
    assert "## hadr.hand" in alone
    assert extension.expand("no fence") == "no fence"


def test_a_module_that_is_not_there_is_told(extension):
    with pytest.raises(ValueError, match=r"no module 'hadr\.weather'"):
        extension.expand("```{modules}\nhadr.weather\n```")


def shown(annotation, extension):
    """A type as a page shows it: without the modules that stand after a tilde."""
    typing = pytest.importorskip(
        "sphinx.util.typing", reason="needs the extra: pip install -e '.[book]'"
    )
    text = extension.readable_types(typing.stringify_annotation(annotation, "smart"))
    return re.sub(r"~(?:\w+\.)+", "", text)


def test_array_types_read_as_the_code_says_them(extension):
    assert shown(NDArray[np.float64] | None, extension) == "NDArray[float64] | None"
    assert shown(tuple[NDArray[np.bool_], int], extension) == "tuple[NDArray[bool], int]"
    assert shown(NDArray[np.floating], extension) == "NDArray[floating]"
    assert shown(ArrayLike, extension) == "ArrayLike"
    assert extension.readable_types("(n: int)") == "(n: int)"
    assert extension.readable_types("(n: A = <factory>)") == "(n: A = ...)"
    assert extension.readable_types(None) is None


def test_docstrings_become_what_sphinx_wants(extension):
    told = ["1 - |A| / 2", "and ``|B|``, `C`, :mod:`hadr.hand`, `D <d>`_ and --only-e."]
    assert extension.sphinx_text(told) == [
        r"1 - \|A\| / 2",
        "and ``|B|``, ``C``, :mod:`hadr.hand`, `D <d>`_ and ``--only-e``.",
    ]


def test_a_parser_becomes_text(extension):
    parser = argparse.ArgumentParser(prog="brew", description="Make tea.", epilog="a  b")
    parser.add_argument("pot", type=Path, help="which pot")
    parser.add_argument("--minutes", type=int, default=3, metavar="M", help="how long")
    parser.add_argument("--leaves", required=True, choices=("green", "black"), help="which")
    parser.add_argument("--secret", help=argparse.SUPPRESS)
    text = extension.parser_text(parser)
    assert text.startswith("Make tea.\n\n```text\nbrew [-h]")
    assert "`pot`\n: which pot\n" in text
    assert "`--minutes M`\n: how long (default: `3`)\n" in text
    assert "`--leaves {green,black}`\n: which (required)" in text
    assert "secret" not in text
    assert text.endswith("```text\na  b\n```")


@pytest.mark.parametrize("name", COMMANDS)
def test_every_argument_of_every_command_is_explained(extension, name):
    text = extension.commands_text()
    section = text.split(f"(hadr-{name})=")[1].split("\n(hadr-")[0]
    actions = [a for a in command_parser(name)._actions if a.help is not argparse.SUPPRESS]
    options = [string for action in actions for string in action.option_strings]
    for option in set(options) - {"-h", "--help"}:
        assert re.search(rf"^`(.*, )?{option}\b", section, re.MULTILINE), option
    assert "/home" not in section
    assert "See above" not in section


def test_the_built_pages_hold_names_hints_and_links(html):
    camera = (html / "library" / "camera.html").read_text()
    assert 'id="hadr.camera.back_project"' in camera
    assert "Lift a depth image to points" in camera
    assert "property" in camera
    text = re.sub(r"<[^>]+>", "", camera)
    assert "NDArray[float64]" in text
    assert "ndarray[" not in text
    assert "_SupportsArray" not in text
    assert "Raises" in camera
    chapter = (html / "notebooks" / "03_ray_voxels.html").read_text()
    assert 'href="../library/ray_voxels.html#module-hadr.ray_voxels"' in chapter
    assert 'href="../glossary.html#term-occupied-voxel"' in chapter


def test_prose_is_prose_and_columns_stay(extension):
    text = extension._free_text(
        "Two *words*\nof prose.\n\npots\n  red    large\n\n  blue   small\n\nEnd."
    )
    assert text == (
        "Two \\*words\\*\nof prose.\n\n```text\npots\n  red    large\n\n  blue   small\n```\n\nEnd."
    )
    assert extension._free_text(None) == ""

"""Every chapter has the same form: what a reader meets, and in which order."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any

import nbformat
import pytest

NOTEBOOKS = Path(__file__).resolve().parents[2] / "notebooks"
CHAPTERS = sorted(NOTEBOOKS.glob("*.ipynb"))

pytestmark = pytest.mark.skipif(not CHAPTERS, reason="no notebooks here: run `make notebooks`")


@pytest.fixture(params=CHAPTERS, ids=lambda path: path.stem)
def chapter(request: pytest.FixtureRequest) -> Path:
    return Path(request.param)


@pytest.fixture
def cells(chapter: Path) -> list[Any]:
    return list(nbformat.read(chapter, 4).cells)


def prose(cells: list[Any]) -> str:
    """The Markdown of a notebook without what stands in fences of code."""
    text = "\n\n".join(cell.source for cell in cells if cell.cell_type == "markdown")
    return re.sub(r"^(`{3,}).*?^\1[ \t]*$", "", text, flags=re.M | re.S)


def tags(cell: Any) -> list[str]:
    return list(cell.metadata.get("tags", []))


def section(text: str, heading: str) -> str:
    """What stands below a heading of the second level, up to the next."""
    return re.split(r"^## ", text.split(f"\n## {heading}\n", 1)[1], maxsplit=1, flags=re.M)[0]


def test_begins_with_its_question_goals_and_needs(cells: list[Any]) -> None:
    title, _, rest = cells[0].source.partition("\n")
    assert title.startswith("# ")
    places = [
        re.search(pattern, rest, re.M)
        for pattern in (
            r"^\*\*You will be able to\*\*",
            r"^\*\*Before you start:\*\* \S",
            r"^\*\*Measured run time:\*\* \S",
        )
    ]
    assert None not in places
    starts = [place.start() for place in places if place]
    assert starts == sorted(starts)
    opening = rest[: starts[0]].strip()
    assert opening
    assert not re.search(r"^\s*([-*]|\d+\.) ", opening, re.M)
    assert "\n\n" not in opening
    assert len(re.findall(r"[.?!](?=\s|$)", opening)) <= 3


def test_the_last_sections_are_in_order(cells: list[Any]) -> None:
    headings = re.findall(r"^## (.+)$", prose(cells), re.M)
    last = ["What goes wrong?", "Exercises", "Summary"]
    assert [heading for heading in headings if heading in last] == last
    assert headings[-2:] == last[-2:]
    assert not [h for h in headings if re.match(r"(?i)what goes wrong", h) and h not in last]


def test_what_goes_wrong_has_a_paragraph(cells: list[Any]) -> None:
    assert len(section(prose(cells), "What goes wrong?").split()) >= 30


def test_ends_with_a_summary_the_library_and_what_to_read(cells: list[Any]) -> None:
    end = section(prose(cells), "Summary")
    summary, _, rest = end.partition("**In the library:** ")
    assert rest, "no line '**In the library:** '"
    library, _, after = rest.partition("\n\n**Read next:** ")
    assert after.strip(), "no paragraph '**Read next:** ' behind the library's"
    assert 20 <= len(summary.split()) <= 250
    assert not re.search(r"^\s*([-*]|\d+\.) ", summary, re.M)
    assert re.search(r"\[`hadr[\w.]+`\]\(#hadr", library)
    assert "\n\n" not in after.strip()


def test_the_next_chapter_is_linked(chapter: Path, cells: list[Any]) -> None:
    after = section(prose(cells), "Summary").partition("**Read next:** ")[2]
    place = CHAPTERS.index(chapter) + 1
    name = CHAPTERS[place].name if place < len(CHAPTERS) else "../"
    assert f"]({name}" in after


def test_parameters_and_imports_are_folded(cells: list[Any]) -> None:
    code = [cell for cell in cells if cell.cell_type == "code"]
    (place,) = [number for number, cell in enumerate(code) if "parameters" in tags(cell)]
    assert "hide-input" in tags(code[place])
    imports = code[place + 1]
    source = "\n".join(line for line in imports.source.splitlines() if line[:1] not in "%!")
    assert isinstance(ast.parse(source).body[0], (ast.Import, ast.ImportFrom))
    assert "hide-input" in tags(imports)


def test_the_last_cell_keeps_the_results_and_shows_nothing(chapter: Path, cells: list[Any]) -> None:
    last = cells[-1]
    assert last.cell_type == "code"
    calls = [
        node
        for node in ast.walk(ast.parse(last.source))
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "write_results"
    ]
    assert len(calls) == 1
    folder, name, _ = (ast.unparse(word) for word in calls[0].args)
    assert (folder, name) == ("out_dir", repr(chapter.stem))
    given = {word.arg: ast.unparse(word.value) for word in calls[0].keywords}
    assert given == {"preset": "preset", "seed": "seed"}
    assert "remove-output" in tags(last)

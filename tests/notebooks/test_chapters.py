"""The chapters as they are committed: twins in step, and the agreed form."""

import ast
import re
from pathlib import Path

import nbformat
import pytest
import yaml

from hadr.press.notebook_twins import twin_problems

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = ROOT / "notebooks"
CHAPTERS = sorted(NOTEBOOKS.glob("*.ipynb"))

pytestmark = pytest.mark.skipif(not CHAPTERS, reason="no notebooks here: run `make notebooks`")


@pytest.fixture(params=CHAPTERS, ids=lambda path: path.stem)
def chapter(request):
    return request.param


@pytest.fixture
def notebook(chapter):
    return nbformat.read(chapter, 4)


def tags(cell):
    return cell.metadata.get("tags", [])


def cells_of(notebook, kind):
    return [cell for cell in notebook.cells if cell.cell_type == kind]


def prose_of(notebook, fences=True):
    """The Markdown of a notebook, with or without what stands in fences of code."""
    text = "\n\n".join(cell.source for cell in cells_of(notebook, "markdown"))
    return text if fences else re.sub(r"^(`{3,}).*?^\1[ \t]*$", "", text, flags=re.M | re.S)


def test_twins_are_in_step():
    assert twin_problems(NOTEBOOKS) == []


def test_the_book_names_every_chapter_in_order():
    contents = yaml.safe_load((ROOT / "book" / "_toc.yml").read_text(encoding="utf-8"))
    files = [entry["file"] for part in contents["parts"] for entry in part["chapters"]]
    assert [f for f in files if f.startswith("notebooks/")] == [
        f"notebooks/{path.stem}" for path in CHAPTERS
    ]


def test_index_and_readme_link_every_chapter():
    index = (ROOT / "book" / "index.md").read_text(encoding="utf-8")
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    for path in CHAPTERS:
        assert f"notebooks/{path.stem}.ipynb" in index
        assert f"notebooks/{path.stem}.ipynb" in readme


def test_one_cell_of_typed_parameters(notebook):
    tagged = [cell for cell in cells_of(notebook, "code") if "parameters" in tags(cell)]
    assert len(tagged) == 1
    tree = ast.parse(tagged[0].source)
    typed = {node.target.id: ast.unparse(node.annotation) for node in ast.walk(tree)
             if isinstance(node, ast.AnnAssign)}  # fmt: skip
    assert typed.items() >= {"preset": "str", "seed": "int", "out_dir": "str"}.items()


def test_the_parameters_are_used(notebook):
    """A parameter that no cell reads is a promise to papermill that is not kept."""
    code = [cell for cell in cells_of(notebook, "code") if "parameters" not in tags(cell)]
    names = set()
    for cell in code:
        nodes = ast.walk(ast.parse(cell.source))
        names |= {node.id for node in nodes if isinstance(node, ast.Name)}
    assert {"out_dir", "seed"} <= names


def test_cells_are_short_and_prose_stands_between(notebook):
    code = [cell for cell in cells_of(notebook, "code") if "colab" not in tags(cell)]
    lengths = [len(cell.source.splitlines()) for cell in code]
    assert 5 <= len(lengths) <= 45
    assert max(lengths) <= 25
    words = re.findall(r"[A-Za-z]{2,}", re.sub(r"```.*?```", "", prose_of(notebook)))
    assert len(words) >= 400


def test_pictures_are_described(notebook):
    """Every cell that draws a figure of its own carries alternative text."""
    for cell in cells_of(notebook, "code"):
        draws = re.search(r"plt\.(subplots|figure)\(|plt\.show\(", cell.source)
        if draws and "interactive" not in tags(cell):
            alt = cell.metadata.get("mystnb", {}).get("image", {}).get("alt", "")
            assert len(alt) > 10, cell.source[:80]


def test_no_cell_defines_what_a_second_notebook_might_need(notebook):
    """Classes belong into the library; short local functions are fine."""
    for cell in cells_of(notebook, "code"):
        nodes = ast.walk(ast.parse(cell.source))
        assert not [node for node in nodes if isinstance(node, ast.ClassDef)]


def test_names_no_path_of_a_machine(notebook):
    text = nbformat.writes(notebook)
    assert not re.search(r"(/home/|/root/|/work/|/tmp/|C:\\\\Users)", text)


def test_citations_are_in_the_bibliography(notebook):
    known = re.findall(r"^@\w+\{([^,]+),", (ROOT / "book/references.bib").read_text(), re.MULTILINE)
    for keys in re.findall(r"\{cite(?::\w+)?\}`([^`]+)`", prose_of(notebook)):
        for key in keys.split(","):
            assert key.strip() in known


def section(text, heading):
    """What stands below a heading of the second level, up to the next."""
    return re.split(r"^## ", text.split(f"\n## {heading}\n", 1)[1], maxsplit=1, flags=re.M)[0]


def test_begins_with_its_question_goals_and_needs(notebook):
    title, _, rest = notebook.cells[0].source.partition("\n")
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


def test_the_last_sections_are_in_order_and_what_goes_wrong_has_a_paragraph(notebook):
    prose = prose_of(notebook, fences=False)
    headings = re.findall(r"^## (.+)$", prose, re.M)
    last = ["What goes wrong?", "Exercises", "Summary"]
    assert [heading for heading in headings if heading in last] == last
    assert headings[-2:] == last[-2:]
    assert not [h for h in headings if re.match(r"(?i)what goes wrong", h) and h not in last]
    assert len(section(prose, "What goes wrong?").split()) >= 30


def test_ends_with_a_summary_the_library_and_what_to_read(chapter, notebook):
    end = section(prose_of(notebook, fences=False), "Summary")
    summary, _, rest = end.partition("**In the library:** ")
    assert rest, "no line '**In the library:** '"
    library, _, after = rest.partition("\n\n**Read next:** ")
    assert after.strip(), "no paragraph '**Read next:** ' behind the library's"
    assert 20 <= len(summary.split()) <= 250
    assert not re.search(r"^\s*([-*]|\d+\.) ", summary, re.M)
    assert re.search(r"\[`hadr[\w.]+`\]\(#hadr", library)
    assert "\n\n" not in after.strip()
    following = CHAPTERS[CHAPTERS.index(chapter) + 1 :]
    assert f"]({following[0].name if following else '../'}" in after


def test_parameters_and_imports_are_folded(notebook):
    code = cells_of(notebook, "code")
    (place,) = [number for number, cell in enumerate(code) if "parameters" in tags(cell)]
    assert "hide-input" in tags(code[place])
    imports = code[place + 1]
    assert isinstance(ast.parse(imports.source).body[0], (ast.Import, ast.ImportFrom))
    assert "hide-input" in tags(imports)


def test_the_last_cell_keeps_the_results_and_no_page_shows_it(chapter, notebook):
    last = notebook.cells[-1]
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
    assert "remove-cell" in tags(last)

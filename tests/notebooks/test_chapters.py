"""The chapters as they are committed: twins in step, no outputs, the agreed form."""

import ast
import re
from pathlib import Path

import nbformat
import pytest
import yaml

from hadr.press.notebook_twins import notebook_from_text, twin_problems

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


def cells_of(notebook, kind):
    return [cell for cell in notebook.cells if cell.cell_type == kind]


def prose_of(notebook):
    return "\n\n".join(cell.source for cell in cells_of(notebook, "markdown"))


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
    tagged = [c for c in cells_of(notebook, "code") if "parameters" in c.metadata.get("tags", [])]
    assert len(tagged) == 1
    tree = ast.parse(tagged[0].source)
    typed = {node.target.id: ast.unparse(node.annotation) for node in ast.walk(tree)
             if isinstance(node, ast.AnnAssign)}  # fmt: skip
    assert typed.items() >= {"preset": "str", "seed": "int", "out_dir": "str"}.items()


def test_the_parameters_are_used(notebook):
    """A parameter that no cell reads is a promise to papermill that is not kept."""
    code = [c for c in cells_of(notebook, "code") if "parameters" not in c.metadata.get("tags", [])]
    names = set()
    for cell in code:
        source = "\n".join(line for line in cell.source.splitlines() if line[:1] not in "%!")
        names |= {node.id for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Name)}
    assert {"out_dir", "seed"} <= names


def test_writes_its_results(chapter, notebook):
    code = "\n".join(cell.source for cell in cells_of(notebook, "code"))
    found = re.findall(r"write_results\(\s*out_dir,\s*[\"']([^\"']+)[\"']", code)
    assert found == [chapter.stem]


def test_cells_are_short_and_prose_stands_between(notebook):
    code = [c for c in cells_of(notebook, "code") if "colab" not in c.metadata.get("tags", [])]
    lengths = [len(cell.source.splitlines()) for cell in code]
    assert 5 <= len(lengths) <= 45
    assert max(lengths) <= 25
    words = re.findall(r"[A-Za-z]{2,}", re.sub(r"```.*?```", "", prose_of(notebook)))
    assert len(words) >= 400


def test_pictures_are_described(notebook):
    """Every cell that draws a figure of its own carries alternative text."""
    for cell in cells_of(notebook, "code"):
        draws = re.search(r"plt\.(subplots|figure)\(|plt\.show\(", cell.source)
        if draws and "interactive" not in cell.metadata.get("tags", []):
            alt = cell.metadata.get("mystnb", {}).get("image", {}).get("alt", "")
            assert len(alt) > 10, cell.source[:80]


def test_no_cell_defines_what_a_second_notebook_might_need(notebook):
    """Classes belong into the library; short local functions are fine."""
    for cell in cells_of(notebook, "code"):
        source = "\n".join(line for line in cell.source.splitlines() if line[:1] not in "%!")
        tree = ast.parse(source)
        assert not [node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]


def test_names_no_path_of_a_machine(notebook):
    text = nbformat.writes(notebook)
    assert not re.search(r"(/home/|/root/|/work/|/tmp/|C:\\\\Users)", text)


def test_citations_are_in_the_bibliography(notebook):
    known = re.findall(r"^@\w+\{([^,]+),", (ROOT / "book/references.bib").read_text(), re.MULTILINE)
    for keys in re.findall(r"\{cite(?::\w+)?\}`([^`]+)`", prose_of(notebook)):
        for key in keys.split(","):
            assert key.strip() in known

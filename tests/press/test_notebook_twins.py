"""Text twins: what comes out is always the same, and a check sees every kind of difference."""

import json

import nbformat
import pytest

from hadr.press.notebook_twins import main, notebook_from_text, text_from_notebook, twin_problems

TEXT = """---
jupytext:
  text_representation:
    extension: .md
    format_name: myst
kernelspec:
  display_name: Python 3
  language: python
  name: python3
---

# Title

Prose with $x$.

```{code-cell} ipython3
:tags: [parameters]

seed: int = 0
```

```{code-cell} ipython3
---
mystnb:
  image:
    alt: A line
---
plot()
```
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "text").mkdir()
    (tmp_path / "text" / "00_a.md").write_text(TEXT, encoding="utf-8")
    assert main(["--notebooks", str(tmp_path)]) == 0
    return tmp_path


def test_cells_ids_and_metadata_come_through():
    notebook = json.loads(notebook_from_text(TEXT))
    prose, colab, parameters, figure = notebook["cells"]
    assert [cell["id"] for cell in notebook["cells"]] == [f"cell-{n:03d}" for n in range(4)]
    assert (prose["cell_type"], figure["cell_type"]) == ("markdown", "code")
    assert "colab" in colab["metadata"]["tags"]
    assert parameters["metadata"] == {"tags": ["parameters"]}
    assert figure["metadata"] == {"mystnb": {"image": {"alt": "A line"}}}
    assert "".join(parameters["source"]) == "seed: int = 0"
    nbformat.validate(notebook)


def test_there_and_back():
    notebook = notebook_from_text(TEXT)
    text = text_from_notebook(notebook)
    assert "alt: A line" in text
    assert "colab" not in text
    assert notebook_from_text(text) == notebook


def test_what_jupyter_notes_does_not_reach_the_text():
    notebook = json.loads(notebook_from_text(TEXT))
    notebook["cells"][2]["metadata"]["collapsed"] = True
    assert text_from_notebook(json.dumps(notebook)) == text_from_notebook(notebook_from_text(TEXT))


def test_writing_again_touches_nothing(folder):
    notebook = folder / "00_a.ipynb"
    before = notebook.stat().st_mtime_ns
    assert main(["--notebooks", str(folder)]) == 0
    assert notebook.stat().st_mtime_ns == before


def test_an_edited_notebook_is_noticed_and_can_be_taken_over(folder, capsys):
    path = folder / "00_a.ipynb"
    path.write_text(path.read_text().replace("Prose with", "Better prose with"))
    assert main(["--notebooks", str(folder), "--check"]) == 1
    assert "00_a: notebook and text differ" in capsys.readouterr().err
    assert main(["--notebooks", str(folder), "--from-notebooks"]) == 0
    assert "Better prose with" in (folder / "text" / "00_a.md").read_text()


def test_lonely_files_are_noticed(folder):
    (folder / "text" / "00_a.md").rename(folder / "text" / "01_b.md")
    assert twin_problems(folder) == [
        "00_a.ipynb has no text twin text/00_a.md",
        "text/01_b.md has no notebook 01_b.ipynb",
    ]

"""Text twins of the chapters: notebooks/text/NN_name.md <-> notebooks/NN_name.ipynb.

The text (MyST, written by jupytext) is what a reviewer reads; the notebook, without outputs, is
what Colab and Binder open. Both are committed, so a check regenerates one from the other and
compares, instead of trusting time stamps: ``python -m hadr.press.notebook_twins --check``.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import nbformat
import yaml

from hadr.records.checkout import checkout_root
from hadr.records.writing import write_whole

KERNELSPEC = {"display_name": "Python 3", "language": "python", "name": "python3"}
COLAB = """\
# On Colab only: fetch the book, install its library, compare its samples with their checksums.
import os
import subprocess
import sys

if "google.colab" in sys.modules:
    if not os.path.isdir("hadr-book"):
        fetch = ["git", "clone", "-q", "--depth", "1", "-b", "{branch}", "{url}", "hadr-book"]
        subprocess.run(fetch, check=True)
    subprocess.run([sys.executable, "-m", "pip", "install", "-q", "-e", "hadr-book[handover]"], check=True)
    sys.path.insert(0, os.path.abspath("hadr-book"))
    from hadr.data.samples import verify_manifest
    assert verify_manifest().ok, "a sample differs from its checksum: delete hadr-book, run this again"
"""  # noqa: E501
"""Every notebook's first code cell, with the repository of book/_config.yml; no text has it."""


def repository(book: Path) -> dict[str, str]:
    """Address and branch of the repository, which stand in book/_config.yml and nowhere else."""
    config = yaml.safe_load((book / "_config.yml").read_text(encoding="utf-8"))["repository"]
    return {"url": str(config["url"]), "branch": str(config.get("branch", "main"))}


def notebook_from_text(text: str) -> str:
    """Turn the MyST text of a chapter into its notebook as JSON, without outputs.

    The first code cell, which the text has not, sets the library up on Colab.
    """
    import jupytext

    notebook = jupytext.reads(text, fmt="md:myst")
    kinds = [cell.cell_type for cell in notebook.cells]
    if "code" in kinds:
        source = COLAB.format(**repository(checkout_root() / "book")).rstrip()
        cell = nbformat.v4.new_code_cell(source, metadata={"tags": ["colab", "remove-cell"]})
        notebook.cells.insert(kinds.index("code"), cell)
    return serialise(notebook)


def serialise(notebook: Any) -> str:
    """Write a notebook in the committed form: no outputs, numbered cell ids, fixed metadata."""
    cells = []
    for number, cell in enumerate(notebook.cells):
        kept = ("tags", "mystnb", "jupyter", "editable")
        metadata = {key: value for key, value in cell.metadata.items() if key in kept}
        entry: dict[str, Any] = {"cell_type": cell.cell_type, "id": f"cell-{number:03d}"}
        if cell.cell_type == "code":
            entry |= {"execution_count": None, "metadata": metadata, "outputs": []}
        else:
            entry["metadata"] = metadata
        entry["source"] = cell.source.splitlines(keepends=True)
        cells.append(entry)
    about = {
        "jupytext": {"text_representation": {"extension": ".md", "format_name": "myst"}},
        "kernelspec": KERNELSPEC,
        "language_info": {"name": "python"},
    }
    content = {"cells": cells, "metadata": about, "nbformat": 4, "nbformat_minor": 5}
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def text_from_notebook(notebook_json: str) -> str:
    """Turn a notebook's JSON into its MyST text, for chapters that were edited in Jupyter."""
    import jupytext

    notebook = nbformat.reads(serialise(nbformat.reads(notebook_json, 4)), 4)
    notebook.cells = [c for c in notebook.cells if "colab" not in c.metadata.get("tags", [])]
    notebook.metadata["kernelspec"] = dict(KERNELSPEC)
    notebook.metadata.pop("language_info", None)
    text: str = jupytext.writes(notebook, fmt="md:myst")
    lines = [line for line in text.splitlines() if not line.startswith("    jupytext_version:")]
    return "\n".join(lines) + "\n"


def twin_problems(notebooks: Path) -> list[str]:
    """Compare every chapter with its text twin."""
    texts = {path.stem: path for path in sorted((notebooks / "text").glob("*.md"))}
    books = {path.stem: path for path in sorted(notebooks.glob("*.ipynb"))}
    problems = [f"{stem}.ipynb has no text twin text/{stem}.md" for stem in books.keys() - texts]
    problems += [f"text/{stem}.md has no notebook {stem}.ipynb" for stem in texts.keys() - books]
    for stem in sorted(texts.keys() & books.keys()):
        generated = notebook_from_text(texts[stem].read_text(encoding="utf-8"))
        if generated != books[stem].read_text(encoding="utf-8"):
            problems.append(
                f"{stem}: notebook and text differ; `make notebooks` takes the text, "
                "`make texts` takes the notebook"
            )
        elif generated != notebook_from_text(text_from_notebook(generated)):
            problems.append(f"{stem}: text -> notebook -> text does not come back the same")
    return sorted(problems)


def _write_if_changed(path: Path, content: str) -> None:
    if path.exists() and path.read_text(encoding="utf-8") == content:
        return
    write_whole(path, content)
    print(f"written: {path}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Write or check the twins; the exit status is 1 where a check fails."""
    parser = argparse.ArgumentParser(
        prog="python -m hadr.press.notebook_twins",
        description="Keep notebooks/NN_name.ipynb and notebooks/text/NN_name.md in step.",
    )
    parser.add_argument("--notebooks", type=Path, default=Path("notebooks"), metavar="DIR")
    mode = parser.add_mutually_exclusive_group()
    mode.add_argument("--check", action="store_true", help="compare only, write nothing")
    help_text = "write the texts from the notebooks"
    mode.add_argument("--from-notebooks", action="store_true", help=help_text)
    options = parser.parse_args(arguments)
    folder: Path = options.notebooks
    if options.from_notebooks:
        for source in sorted(folder.glob("*.ipynb")):
            text = text_from_notebook(source.read_text(encoding="utf-8"))
            _write_if_changed(folder / "text" / f"{source.stem}.md", text)
    if not options.check:
        for source in sorted((folder / "text").glob("*.md")):
            content = notebook_from_text(source.read_text(encoding="utf-8"))
            _write_if_changed(folder / f"{source.stem}.ipynb", content)
    problems = twin_problems(folder)
    for problem in problems:
        print(problem, file=sys.stderr)
    if not problems:
        print(f"{len(list(folder.glob('*.ipynb')))} notebooks and their texts are in step")
    return 1 if problems else 0


if __name__ == "__main__":
    raise SystemExit(main())

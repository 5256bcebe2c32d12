"""Staging the book: what a page without a kernel shows, and where the sources stand."""

import json
from pathlib import Path

import nbformat
import pytest
import yaml

from hadr.cli import main
from hadr.press import book, book_command
from hadr.press.chapters import ChapterRun
from hadr.records.result_file import write_sealed

ROOT = Path(__file__).resolve().parents[2]


def executed():
    new = nbformat.v4
    stderr = new.new_output("stream", name="stderr", text="warning: litter")
    stdout = new.new_output("stream", name="stdout", text="a number")
    view = {"application/vnd.jupyter.widget-view+json": {"model_id": "1"}, "text/plain": "slider"}
    widget = new.new_output("display_data", data=view)
    notebook = new.new_notebook(
        cells=[
            new.new_markdown_cell(
                "# A *title*\n\n**Measured run time:** *stands here in the built book*"
            ),
            new.new_code_cell("seed = 0", metadata={"tags": ["parameters"]}),
            new.new_code_cell("seed = 1", metadata={"tags": ["injected-parameters"]}),
            new.new_code_cell("work()", outputs=[stderr, stdout]),
            new.new_code_cell("bar()", outputs=[widget, stdout]),
            new.new_code_cell("slide()", outputs=[stdout], metadata={"tags": ["interactive"]}),
            new.new_code_cell("print(1)", outputs=[stdout], metadata={"tags": ["hide-input"]}),
            new.new_code_cell("answer = ..."),
            new.new_code_cell("check(\n    answer, 3)", outputs=[stdout]),
            new.new_code_cell("check(solution, 3)", outputs=[stdout]),
        ]
    )
    notebook.metadata["widgets"] = {"application/vnd.jupyter.widget-state+json": {}}
    return notebook


def test_a_page_shows_what_needs_no_kernel():
    staged = book.stage_notebook(executed(), "3 s")
    sources = [cell.source for cell in staged.cells]
    assert sources[0].endswith("**Measured run time:** 3 s")
    assert sources[1:5] == ["seed = 0", "work()", "bar()", "slide()"]
    assert len(sources) == 9
    assert [output.text for output in staged.cells[2].outputs] == ["a number"]
    assert [output.output_type for output in staged.cells[3].outputs] == ["stream"]
    assert staged.cells[4].outputs == []
    assert "widgets" not in staged.metadata
    nbformat.validate(staged)


def test_what_a_page_cannot_run_is_folded_and_folds_say_what_is_in_them():
    folds = {
        cell.source.replace("\n    ", ""): (cell.metadata["tags"][-1], shown["code_prompt_show"])
        for cell in book.stage_notebook(executed(), "3 s").cells
        if (shown := cell.metadata.get("mystnb"))
    }
    assert folds == {
        "slide()": ("hide-input", book.CONTROL),
        "print(1)": ("hide-input", "Code: these numbers"),
        "check(answer, 3)": ("hide-cell", book.CHECK),
    }


def test_only_the_picture_of_a_captioned_cell_is_a_figure():
    new = nbformat.v4
    kinds = ("image/png", "text/markdown")
    outputs = [new.new_output("display_data", data={kind: "AA"}) for kind in kinds]
    outputs.append(new.new_output("stream", name="stdout", text="a number"))
    cell = new.new_code_cell("draw()", outputs=outputs)
    notebook = new.new_notebook(cells=[cell])
    assert len(book.stage_notebook(notebook, "3 s").cells) == 1
    cell.metadata["mystnb"] = {"figure": {"caption": "What to look at."}}
    drawn, beside = book.stage_notebook(notebook, "3 s").cells
    assert (drawn.outputs, beside.outputs) == ([outputs[0], outputs[2]], [outputs[1]])
    assert beside.metadata["tags"] == ["remove-input"]
    assert beside.source  # of a cell without one the page shows nothing
    nbformat.validate(notebook)


def test_a_table_gets_the_caption_of_its_cell_and_its_own_note():
    new = nbformat.v4
    table = new.new_output(
        "display_data", data={"text/markdown": "| a |\n|---|\n| 1 |\n\nOf 2 frames."}
    )
    words = new.new_output("display_data", data={"text/markdown": "No table."})
    cell = new.new_code_cell("show()", outputs=[words, table])
    with pytest.raises(ValueError, match="no caption: show"):
        book.stage_notebook(new.new_notebook(cells=[cell]), "3 s")
    cell.metadata["mystnb"] = {"table": {"caption": "What\nto see.", "name": "table-a"}}
    shown = book.stage_notebook(new.new_notebook(cells=[cell]), "3 s").cells[0].outputs
    assert shown[0].data["text/markdown"] == "No table."
    assert shown[1].data["text/markdown"].splitlines() == [
        ":::{table} What to see. Of 2 frames.", ":name: table-a", "",
        "| a |", "|---|", "| 1 |", ":::",
    ]  # fmt: skip


def test_a_film_is_named_by_the_words_before_it():
    new = nbformat.v4
    outputs = []
    for words in ('**success** after 7.1 s: "raw" depth', "**contact** after 3 s"):
        outputs.append(new.new_output("display_data", data={"text/markdown": words}))
        film = '<video controls muted src="data:video/mp4;base64,AA"></video>'
        outputs.append(new.new_output("display_data", data={"text/html": film}))
    notebook = new.new_notebook(cells=[new.new_code_cell("films()", outputs=outputs)])
    first, second = book.stage_notebook(notebook, "3 s").cells[0].outputs
    assert first.data["text/html"].startswith(
        '<figure class="film"><video aria-label="Film: success after 7.1 s: &quot;raw&quot; depth"'
    )
    caption = "<figcaption><strong>contact</strong> after 3 s</figcaption></figure>"
    assert second.data["text/html"].endswith(caption)
    again = book.stage_notebook(notebook, "3 s").cells[0].outputs
    assert [output.data for output in again] == [first.data, second.data]


@pytest.fixture
def small_book(tmp_path):
    pages = tmp_path / "book"
    pages.mkdir()
    (pages / "_config.yml").write_text("repository:\n  url: https://example.org/a\n")
    contents = {
        "root": "index",
        "parts": [
            {"caption": "A", "chapters": [{"file": "notebooks/00_a"}, {"file": "notebooks/01_b"}]},
            {"caption": "B", "chapters": [{"file": "notebooks/02_c"}]},
            {"caption": "C", "chapters": [{"file": "more"}]},
        ],
    }
    (pages / "_toc.yml").write_text(yaml.safe_dump(contents))
    (pages / "index.md").write_text("clone {{REPOSITORY}}\n\n{{RUNTIME_TABLE}}")
    (pages / "more.md").write_text("# More")
    (tmp_path / "executed").mkdir()
    path = tmp_path / "executed" / "00_a.ipynb"
    nbformat.write(executed(), path)
    return pages, [ChapterRun(path, 12.3)]


def test_staging_puts_notebooks_where_the_repository_has_them(small_book, tmp_path):
    pages, runs = small_book
    staged = book.stage_book(pages, runs, tmp_path / "staged")
    assert (staged / "notebooks" / "00_a.ipynb").is_file()
    index = (staged / "index.md").read_text()
    assert "clone https://example.org/a" in index
    assert "| 0. [A *title*](notebooks/00_a.ipynb) | 12 s |" in index
    contents = yaml.safe_load((staged / "_toc.yml").read_text())
    parts = {part["caption"]: part["chapters"] for part in contents["parts"]}
    assert parts == {"A": [{"file": "notebooks/00_a"}], "C": [{"file": "more"}]}
    assert "{{REPOSITORY}}" in (pages / "index.md").read_text()
    (staged / "notebooks" / "99_old.ipynb").write_text("{}")
    book.stage_book(pages, runs, tmp_path / "staged")
    assert not (staged / "notebooks" / "99_old.ipynb").exists()


def test_staging_replaces_no_folder_that_it_did_not_make(small_book, tmp_path):
    pages, runs = small_book
    own = tmp_path / "staged" / "thesis.md"
    own.parent.mkdir()
    own.write_text("years of work")
    with pytest.raises(ValueError, match="staged was not made by hadr"):
        book.stage_book(pages, runs, tmp_path / "staged")
    assert [path.name for path in own.parent.iterdir()] == [own.name]


def test_staging_refuses_a_word_that_nothing_fills_and_leaves_no_half(small_book, tmp_path):
    pages, runs = small_book
    (pages / "more.md").write_text("# More\n\n{{WEATHER}}\n")
    with pytest.raises(ValueError, match=r"more.md has \{\{WEATHER\}\}, which nothing fills"):
        book.stage_book(pages, runs, tmp_path / "staged")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["book", "executed"]


def test_the_readme_takes_measured_times(tmp_path):
    readme = tmp_path / "README.md"
    readme.write_text(f"before\n{book.TABLE_BEGIN}\nold\n{book.TABLE_END}\nafter\n")
    book.update_readme(readme, "| new |")
    once = f"before\n{book.TABLE_BEGIN}\n| new |\n{book.TABLE_END}\nafter\n"
    assert readme.read_text() == once
    readme.write_text("no markers")
    with pytest.raises(ValueError, match="has no lines"):
        book.update_readme(readme, "| new |")


def test_the_readme_table_comes_from_the_measurement(tmp_path):
    (tmp_path / "notebooks").mkdir()
    nbformat.write(executed(), tmp_path / "notebooks" / "00_a.ipynb")
    with pytest.raises(FileNotFoundError, match="run `make book` first"):
        book.readme_table(tmp_path, tmp_path)
    gone = {"duration_s": 5.0, "machine": "four cores"}  # a chapter that was renamed since
    chapters = {"00_a": {"duration_s": 61.2, "machine": "two cores"}, "00_old": gone}
    record = {"parameters": {"preset": "tiny"}, "chapters": chapters, "provenance": {}}
    write_sealed(tmp_path / "results.json", record)
    table = book.readme_table(tmp_path, tmp_path)
    assert "00_old" not in table
    assert "| 0. [A *title*](notebooks/00_a.ipynb) | 1 min 01 s |" in table
    assert table.endswith("Measured on two cores.")
    record["chapters"]["00_a"]["duration_s"] = 1.0
    (tmp_path / "results.json").write_text(json.dumps(record))
    with pytest.raises(ValueError, match=r"provenance: lacks sha256: run `make book` first"):
        book.readme_table(tmp_path, tmp_path)


@pytest.mark.parametrize(
    ("preset", "chapters", "says"),
    [
        ("mini", {"00_a": "one core"}, "has times of preset mini, README those of tiny"),
        ("tiny", {"01_b": "one core"}, "results.json has no time of 00_a: run `make book` first"),
        ("tiny", {"00_a": "one core", "01_b": "two cores"}, "of one core and of two cores: run"),
    ],
)
def test_times_of_some_chapters_or_of_two_machines_are_no_table(
    tmp_path, monkeypatch, capsys, preset, chapters, says
):
    (tmp_path / "notebooks").mkdir()
    for name in ("00_a", "01_b"):
        nbformat.write(executed(), tmp_path / "notebooks" / f"{name}.ipynb")
    readme = f"{book.TABLE_BEGIN}\nold\n{book.TABLE_END}\n"
    (tmp_path / "README.md").write_text(readme)
    (tmp_path / "build").mkdir()
    timed = {name: {"duration_s": 1.0, "machine": where} for name, where in chapters.items()}
    record = {"parameters": {"preset": preset}, "chapters": timed, "provenance": {}}
    write_sealed(tmp_path / "build" / "results.json", record)
    monkeypatch.setattr(book_command, "checkout_root", lambda: tmp_path)
    assert main(["book", "--build", str(tmp_path / "build"), "--readme-times"]) == 2
    told = capsys.readouterr().err
    assert told.startswith("hadr book: error: ")
    assert says in told
    assert (tmp_path / "README.md").read_text() == readme


def test_a_warning_stops_the_build_and_is_told_and_the_earlier_book_stays(tmp_path):
    pytest.importorskip("jupyter_book", reason="needs the extra: pip install -e '.[book]'")
    pages = tmp_path / "pages"
    pages.mkdir()
    (pages / "_config.yml").write_text("title: t\nauthor: a\nexecute:\n  execute_notebooks: off\n")
    (pages / "_toc.yml").write_text("format: jb-book\nroot: index\n")
    (pages / "index.md").write_text("# Title\n\n{ref}`nowhere`\n")
    earlier = tmp_path / "out/_build/html/index.html"
    earlier.parent.mkdir(parents=True)
    earlier.write_text("earlier")
    with pytest.raises(RuntimeError, match=r"WARNING: undefined label: 'nowhere'"):
        book.build_html(pages, tmp_path / "out", strict=True)
    assert earlier.read_text() == "earlier"
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["_build", "build.log"]
    assert book.build_html(pages, tmp_path / "out", strict=False) == earlier
    assert "Title" in earlier.read_text()

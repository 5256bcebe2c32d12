"""Running notebooks with papermill: parameters in, results and times out, failures told well."""

import json
from pathlib import Path

import nbformat
import numpy as np
import pytest

from hadr.press import chapters
from hadr.press.chapter_record import keep_results
from hadr.press.chapters import ChapterError, ChapterRun


def test_parameters_reach_the_notebook_and_results_come_back(folder, tmp_path, monkeypatch):
    home = tmp_path / "home"
    home.mkdir()
    kernel = home / ".local" / "share" / "jupyter" / "kernels" / "python3"
    kernel.mkdir(parents=True)  # a user's own python3 kernel, which must not be taken
    (kernel / "kernel.json").write_text('{"argv": ["/does/not/exist"], "display_name": "x"}')
    monkeypatch.setenv("HOME", str(home))
    told = []
    paths = chapters.chapter_paths(folder, ["0"])
    # papermill would fill in the seed.
    out = tmp_path / "out{seed}"
    runs = chapters.run_notebooks(paths, out, preset="mini", seed=4, say=told.append)
    assert [run.name for run in runs] == ["00_good"]
    assert 0 < runs[0].duration_s < 120
    assert len(told) == 1
    assert "00_good" in told[0]
    results = json.loads((out / "results" / "00_good" / "results.json").read_text())
    assert results["results"] == {"seed": 4, "preset": "mini"}
    assert results["provenance"]["versions"]["numpy"] == np.__version__
    assert nbformat.read(folder / "00_good.ipynb", 4).cells[2].outputs == []
    assert nbformat.read(runs[0].notebook, 4).cells[3].outputs[0]["data"]["text/plain"] == "2"
    collected = keep_results(out, paths, "mini", 4, told.append)
    assert collected["parameters"] == {"preset": "mini", "seed": 4}
    assert "CPU cores" in collected["machine"]
    assert collected["chapters"]["00_good"]["results"] == {"seed": 4, "preset": "mini"}
    assert collected["chapters"]["00_good"]["duration_s"] == round(runs[0].duration_s, 3)


def test_a_failure_names_notebook_cell_and_traceback_and_keeps_the_rest(folder, tmp_path):
    paths = chapters.chapter_paths(folder, ["01"])
    with pytest.raises(ChapterError) as caught:
        chapters.run_notebooks(paths, tmp_path / "out", say=lambda line: None)
    text = str(caught.value)
    assert "01_bad.ipynb failed in cell " in text
    assert "    ratio = 1 / 0" in text
    assert "ZeroDivisionError: division by zero" in text
    assert "\x1b" not in text
    kept = tmp_path / "out" / "executed" / "01_bad.ipynb"
    assert str(kept) in text
    assert "before" in nbformat.writes(nbformat.read(kept, 4))


def test_a_kernel_that_dies_is_told_with_its_cell(notebook_of, tmp_path):
    source = notebook_of("import os\nos._exit(1)", "never = 1")
    nbformat.write(source, tmp_path / "00_dies.ipynb")
    with pytest.raises(ChapterError, match=r"00_dies.ipynb failed in cell \d") as caught:
        chapters.run_notebooks([tmp_path / "00_dies.ipynb"], tmp_path, say=lambda line: None)
    assert "os._exit(1)" in str(caught.value)
    assert "died" in str(caught.value).lower()


def test_what_a_widgets_function_prints_is_output_of_its_cell(notebook_of, tmp_path):
    """Only so is nothing sent on the socket on which the cell's reply is awaited."""
    widget = "import ipywidgets\nipywidgets.interactive(lambda x: print(f'drawn at {x}'), x=(3, 3))"
    nbformat.write(notebook_of(widget), tmp_path / "00_widget.ipynb")
    (run,) = chapters.run_notebooks([tmp_path / "00_widget.ipynb"], tmp_path / "out")
    printed, widget = nbformat.read(run.notebook, 4).cells[-1].outputs
    assert "drawn at 3" in printed.text
    assert "application/vnd.jupyter.widget-view+json" in widget.data


def test_a_chapter_that_failed_is_not_finished(notebook_of, folder, tmp_path):
    paths = chapters.chapter_paths(folder, ["0"])
    said = []
    chapters.run_notebooks(paths, tmp_path / "out", say=said.append, resume=True)
    nbformat.write(notebook_of("1 / 0"), paths[0])
    for _ in range(2):
        with pytest.raises(ChapterError):
            chapters.run_notebooks(paths, tmp_path / "out", say=said.append, resume=True)
    assert len(said) == 1


def test_two_at_a_time_come_in_the_books_order(notebook_of, tmp_path):
    """The first waits for what the second leaves, so one after the other they would hang."""
    there = tmp_path / "there"
    wait = f"import pathlib, time\nwhile not pathlib.Path({str(there)!r}).exists(): time.sleep(.05)"
    for name, cell in (("00_waits", wait), ("01_leaves", f"open({str(there)!r}, 'w').close()")):
        nbformat.write(notebook_of(cell), tmp_path / f"{name}.ipynb")
    said = []
    paths = chapters.chapter_paths(tmp_path)
    runs = chapters.run_notebooks(paths, tmp_path / "out", say=said.append, jobs=2)
    assert [run.name for run in runs] == ["00_waits", "01_leaves"]
    assert [line.split()[1] for line in said] == ["1/2]", "2/2]"]


def test_a_failure_ends_the_chapter_beside_it(notebook_of, tmp_path):
    """It would go on for an hour."""
    nbformat.write(notebook_of("1 / 0"), tmp_path / "00_fails.ipynb")
    nbformat.write(notebook_of("import time\ntime.sleep(3600)"), tmp_path / "01_sleeps.ipynb")
    paths = chapters.chapter_paths(tmp_path)
    with pytest.raises(ChapterError, match="00_fails"):
        chapters.run_notebooks(paths, tmp_path / "out", say=lambda line: None, jobs=2)


@pytest.mark.parametrize(
    ("wish", "names"),
    [
        ([], ["00_a", "03_b", "10_c"]),
        (["3"], ["03_b"]),
        (["03", "10"], ["03_b", "10_c"]),
        (["10_c", "0"], ["00_a", "10_c"]),
    ],
)
def test_choosing_chapters(tmp_path, wish, names):
    for name in ("00_a", "03_b", "10_c"):
        (tmp_path / f"{name}.ipynb").write_text("{}")
    (tmp_path / "scratch.ipynb").write_text("{}")
    assert [path.stem for path in chapters.chapter_paths(tmp_path, wish)] == names


def test_choosing_from_nothing(tmp_path):
    with pytest.raises(ValueError, match=r"no notebook named NN_name.ipynb in "):
        chapters.chapter_paths(tmp_path)


def test_an_empty_wish_is_refused(tmp_path):
    (tmp_path / "01_ray.ipynb").write_text("{}")
    with pytest.raises(ValueError, match="empty word"):
        chapters.chapter_paths(tmp_path, [""])


@pytest.mark.parametrize(
    "text", ["", "null", "[]", '{"nbformat": 99, "cells": []}', "[" * 100_000, "\x00",
             '{"nbformat": 4, "nbformat_minor": 5, "metadata": {}, "cells": 7}']
)  # fmt: skip
def test_what_is_no_notebook_is_named(tmp_path, text, capsys):
    path = tmp_path / "03_x.ipynb"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"03_x\.ipynb is ") as error:
        chapters.read_notebook(path)
    assert len(str(error.value)) < 500
    assert capsys.readouterr().err == ""


def test_table_of_run_times():
    runs = [ChapterRun(Path("00_a.ipynb"), 1.0), ChapterRun(Path("01_b.ipynb"), 70.0)]
    table = chapters.run_time_table(runs, {"00_a": "[A](a)"}).splitlines()
    assert table[2:] == ["| [A](a) | 1.0 s |", "| 01_b | 1 min 10 s |", "| together | 1 min 11 s |"]

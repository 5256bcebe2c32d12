"""A finished chapter is known by what it was made from."""

import json
from pathlib import Path

import pytest

from hadr.press import chapter_record
from hadr.press.chapter_record import (
    RECORD,
    chapter_configuration,
    finished_chapter,
    keep_changed,
    keep_chapter,
    keep_results,
    keep_unfinished,
)
from hadr.records.dependencies import modules_behind, named_modules

CHAPTERS = sorted((Path(__file__).resolve().parents[2] / "notebooks").glob("[0-9][0-9]_*.ipynb"))


@pytest.fixture
def notebook(tmp_path):
    path = tmp_path / "00_a.ipynb"
    path.write_text("{}")
    return path


def test_a_chapter_is_finished_for_its_own_parameters_alone(notebook, tmp_path):
    configuration = chapter_configuration(notebook, "tiny", 0)
    assert finished_chapter(tmp_path, configuration) is None
    keep_chapter(tmp_path, configuration, 12.5)
    assert finished_chapter(tmp_path, configuration) == 12.5
    assert finished_chapter(tmp_path, chapter_configuration(notebook, "mini", 0)) is None
    assert finished_chapter(tmp_path, chapter_configuration(notebook, "tiny", 1)) is None
    executed = tmp_path / "executed.ipynb"
    executed.write_text("{}")
    keep_chapter(tmp_path, configuration, 12.5, executed, tmp_path / "results.json")
    assert finished_chapter(tmp_path, configuration, executed) == 12.5
    executed.write_text("my notes")
    assert finished_chapter(tmp_path, configuration, executed) is None
    keep_changed(tmp_path, executed)
    assert not executed.exists()
    assert executed.with_name("executed.ipynb.changed").read_text() == "my notes"
    executed.write_text("half")
    keep_unfinished(tmp_path, executed)
    assert finished_chapter(tmp_path, configuration, executed) is None
    keep_changed(tmp_path, executed)
    assert executed.read_text() == "half"
    (tmp_path / "chapter.json").unlink()
    keep_changed(tmp_path, executed)
    assert executed.with_name("executed.ipynb.changed2").read_text() == "half"
    assert finished_chapter(tmp_path, configuration, executed) is None
    notebook.write_text("{ }")
    assert finished_chapter(tmp_path, chapter_configuration(notebook, "tiny", 0)) is None


def test_a_change_of_the_data_makes_it_unfinished(notebook, tmp_path, monkeypatch):
    results = tmp_path / "root" / "results"
    results.mkdir(parents=True)
    (tmp_path / "root" / "data_samples").mkdir()
    manifest = tmp_path / "root" / "data_samples" / "manifest.json"
    monkeypatch.setattr(chapter_record, "checkout_root", lambda: tmp_path / "root")
    keep_chapter(tmp_path, {}, 1.0)
    for file in (manifest, results / "pictures.npz", results / "deep.json"):
        for text in ("one", "two"):
            manifest.touch()
            file.write_text(text)
            chapter_record._data.cache_clear()
            configuration = chapter_configuration(notebook, "tiny", 0)
            assert finished_chapter(tmp_path, configuration) is None
            keep_chapter(tmp_path, configuration, 1.0)
            assert finished_chapter(tmp_path, configuration) == 1.0
    chapter_record._data.cache_clear()


def test_a_chapter_depends_on_the_code_that_its_cells_name(notebook, tmp_path, library):
    cells = [
        {"cell_type": "markdown", "source": "import hadr.beside"},
        {"cell_type": "code", "source": ["import hadr.top\n", "x = 1"]},
    ]
    notebook.write_text(json.dumps({"cells": cells}))
    configuration = chapter_configuration(notebook, "tiny", 0)
    keep_chapter(tmp_path, configuration, 1.0)
    (library / "beside.py").write_text("VALUE = 2\n")
    assert chapter_configuration(notebook, "tiny", 0) == configuration
    (library / "deep.py").write_text("VALUE = 2\n")
    assert finished_chapter(tmp_path, chapter_configuration(notebook, "tiny", 0)) is None


@pytest.mark.parametrize("path", CHAPTERS, ids=lambda path: path.stem)
def test_no_chapter_depends_on_the_commands_that_run_it(path):
    code = chapter_record._code(path)
    assert "hadr." in code
    behind = modules_behind(*named_modules(code))
    above = {
        "hadr.press.chapters",
        "hadr.press.book_command",
        "hadr.cli",
        "hadr.press.chapter_record",
    }
    assert not above & behind


def executed(out, name, preset="tiny", seed=0, duration=1.0, **results):
    """What an executed chapter leaves."""
    notebook = out / f"{name}.ipynb"
    notebook.write_text("{}")
    folder = out / "results" / name
    folder.mkdir(parents=True, exist_ok=True)
    if results:
        (folder / "results.json").write_text(json.dumps({"results": results}))
    keep_chapter(folder, chapter_configuration(notebook, preset, seed), duration)
    return notebook


def test_results_of_earlier_calls_stay_and_new_ones_take_their_place(tmp_path):
    said = []
    notebooks = [executed(tmp_path, name, value=1) for name in ("00_a", "01_b")]
    executed(tmp_path, "02_gone", value=1)  # of a chapter that was renamed since
    notebooks.append(executed(tmp_path, "03_plain"))
    keep_results(tmp_path, notebooks, "tiny", 0, said.append)
    executed(tmp_path, "01_b", duration=2.5, value=2)  # --only 1
    kept = keep_results(tmp_path, notebooks, "tiny", 0, said.append)
    assert kept == json.loads((tmp_path / "results.json").read_text())
    found = {name: (c["duration_s"], c["results"]) for name, c in kept["chapters"].items()}
    assert found == {
        "00_a": (1.0, {"value": 1}),
        "01_b": (2.5, {"value": 2}),
        "03_plain": (1, None),
    }
    assert said == []


def test_results_of_two_presets_or_seeds_are_not_mixed(tmp_path):
    notebooks = [executed(tmp_path, name, value=1) for name in ("00_a", "01_b", "02_c")]
    executed(tmp_path, "01_b", preset="mini", value=5)
    for preset, seed, names in (("mini", 0, ["01_b"]), ("tiny", 0, ["00_a", "02_c"])):
        said = []
        kept = keep_results(tmp_path, notebooks, preset, seed, said.append)
        assert list(kept["chapters"]) == names
        assert kept["parameters"] == {"preset": preset, "seed": seed}
        (line,) = said
        assert f"has {len(names)} of 3 chapters: the others were not executed" in line
    assert keep_results(tmp_path, notebooks, "tiny", 1, said.append)["chapters"] == {}


def test_results_say_the_machine_of_each_chapter(tmp_path, monkeypatch):
    monkeypatch.setattr(chapter_record, "machine_text", lambda: "another machine")
    notebooks = [executed(tmp_path, "00_a")]
    monkeypatch.undo()
    notebooks.append(executed(tmp_path, "01_b"))
    chapters = keep_results(tmp_path, notebooks, "tiny", 0)["chapters"]
    assert chapters["00_a"]["machine"] == "another machine"
    assert "CPU cores" in chapters["01_b"]["machine"]


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"configuration": {"preset": "tiny", "seed": 0}}']
)
def test_results_without_a_whole_record_do_not_count(tmp_path, text):
    notebooks = [executed(tmp_path, "00_a")]
    (tmp_path / "results" / "00_a" / RECORD).write_text(text)
    assert keep_results(tmp_path, notebooks, "tiny", 0)["chapters"] == {}

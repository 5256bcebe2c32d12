"""A finished chapter is known by what it was made from."""

import json

import pytest

from hadr import chapter_record
from hadr.chapter_record import RECORD, chapter_configuration, finished_chapter, keep_chapter


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
    assert finished_chapter(tmp_path, configuration, tmp_path / "gone.ipynb") is None
    notebook.write_text("{ }")
    assert finished_chapter(tmp_path, chapter_configuration(notebook, "tiny", 0)) is None


def test_a_change_of_the_library_or_the_data_makes_it_unfinished(notebook, tmp_path, monkeypatch):
    configuration = chapter_configuration(notebook, "tiny", 0)
    assert {"library", "results", "samples"} <= set(configuration)
    keep_chapter(tmp_path, configuration, 1.0)
    monkeypatch.setattr(chapter_record, "_surroundings", lambda: {"library": "another"})
    assert finished_chapter(tmp_path, chapter_configuration(notebook, "tiny", 0)) is None


def test_an_edited_record_counts_for_nothing(notebook, tmp_path):
    configuration = chapter_configuration(notebook, "tiny", 0)
    keep_chapter(tmp_path, configuration, 1.0)
    path = tmp_path / RECORD
    path.write_text(json.dumps(json.loads(path.read_text()) | {"duration_s": 2.0}))
    assert finished_chapter(tmp_path, configuration) is None

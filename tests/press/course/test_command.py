import json

import nbformat
import pytest

from hadr.cli import main
from hadr.press.course.command import MANIFEST, written_whole


def content(folder):
    return {p.relative_to(folder).as_posix(): p.read_bytes()
            for p in folder.rglob("*") if p.is_file()}  # fmt: skip


def test_writes_a_course_and_the_same_again(tmp_path, capsys):
    out = tmp_path / "course"
    words = ["course", "--out", str(out), "--only", "3", "13", "--no-slides", "--preset", "mini"]
    assert main(words) == 0
    assert "2 chapters, 5 exercises" in capsys.readouterr().out
    first = content(out)
    assert set(first) == {
        "course.json", "instructor.md", "nbgrader_config.py",
        "student/03_ray_voxels.ipynb", "student/13_handover_experiment.ipynb",
        "solutions/03_ray_voxels.ipynb", "solutions/13_handover_experiment.ipynb",
        "tests/03_ray_voxels/ex-03-1.py", "tests/03_ray_voxels/ex-03-2.py",
        "tests/03_ray_voxels/ex-03-3.py", "tests/13_handover_experiment/ex-13-1.py",
        "tests/13_handover_experiment/ex-13-2.py",
    }  # fmt: skip
    for name, data in first.items():
        assert b"{cite}" not in data, name
    about = json.loads(first["course.json"])
    assert (about["preset"], about["chapters"]) == (
        "mini",
        ["03_ray_voxels", "13_handover_experiment"],
    )
    for name, data in first.items():
        if name.endswith(".ipynb"):
            notebook = nbformat.reads(data.decode(), 4)
            nbformat.validate(notebook)
            assert 'preset: str = "mini"' in data.decode().replace('\\"', '"')
            assert all(not cell.get("outputs") for cell in notebook.cells)
    assert main(words) == 0
    assert content(out) == first


def test_slides_without_their_package_say_so_before_anything_runs(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("hadr.press.course.command.missing_packages", lambda: ["sphinx-revealjs"])
    assert main(["course", "--out", str(tmp_path / "c")]) == 2
    assert "slides need sphinx-revealjs" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("executed", ["", "nowhere"])
def test_executed_chapters_that_are_missing_are_named(tmp_path, capsys, monkeypatch, executed):
    monkeypatch.setattr("hadr.press.course.command.missing_packages", list)
    words = ["course", "--out", str(tmp_path / "c"), "--only", "3"]
    assert main([*words, "--executed", str(tmp_path / executed)]) == 2
    assert "03_ray_voxels.ipynb is missing: run `hadr book` first" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def write(out, **files):
    with written_whole(out, {"preset": "tiny"}) as folder:
        (folder / "part").mkdir()
        for name, text in files.items():
            (folder / "part" / name).write_text(text)


def test_a_new_an_empty_and_an_own_folder(tmp_path):
    out = tmp_path / "deep" / "course"
    write(out, a="1", b="2")
    first = content(out)
    assert set(first) == {"part/a", "part/b", MANIFEST}
    write(out, a="1", b="2")
    assert content(out) == first  # the same bytes, the list of checksums included
    write(out, a="1")
    assert "part/b" not in content(out)
    (tmp_path / "empty").mkdir()
    write(tmp_path / "empty", a="1")
    assert [p.name for p in out.parent.iterdir()] == ["course"]  # nothing left beside it
    assert json.loads((out / MANIFEST).read_text())["preset"] == "tiny"


def test_a_foreign_folder_is_left_alone(tmp_path):
    before = {"thesis.tex": b"years of work", MANIFEST: b'{"made_by": "hadr course", "files": {}}'}
    for name, data in before.items():
        (tmp_path / name).write_bytes(data)
        with pytest.raises(ValueError, match="is not empty, and `hadr course` did not write it"):
            write(tmp_path, a="1")
    assert content(tmp_path) == before


@pytest.mark.parametrize("name", ["a", "notes.md"])
def test_changed_and_added_files_are_named(tmp_path, name):
    out = tmp_path / "course"
    write(out, a="1")
    (out / "part" / name).write_text("my own words")
    with pytest.raises(ValueError, match=f"added or changed since .*: part/{name}"):
        write(out, a="1")
    assert (out / "part" / name).read_text() == "my own words"

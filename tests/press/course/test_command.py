import json

import nbformat
import pytest

from hadr.cli import main


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

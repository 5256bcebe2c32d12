import json

import pytest

from hadr.press.course.folder import MANIFEST, check_target, written_whole


def write(out, **files):
    with written_whole(out, {"preset": "tiny"}) as folder:
        (folder / "part").mkdir()
        for name, text in files.items():
            (folder / "part" / name).write_text(text)


def content(folder):
    return {p.relative_to(folder).as_posix(): p.read_bytes()
            for p in folder.rglob("*") if p.is_file()}  # fmt: skip


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
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(ValueError, match="is not empty, and `hadr course` did not write it"):
        write(tmp_path, a="1")
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize("text", ["", "[]", '{"files": {}}', '{"made_by": "x", "files": {}}',
                                  '{"made_by": "hadr course", "files": []}'])  # fmt: skip
def test_a_list_of_checksums_that_is_not_ours(tmp_path, text):
    (tmp_path / MANIFEST).write_text(text)
    with pytest.raises(ValueError, match="did not write it"):
        check_target(tmp_path)


@pytest.mark.parametrize("name", ["a", "notes.md"])
def test_changed_and_added_files_are_named(tmp_path, name):
    out = tmp_path / "course"
    write(out, a="1")
    (out / "part" / name).write_text("my own words")
    with pytest.raises(ValueError, match=f"added or changed since .*: part/{name}"):
        write(out, a="1")
    assert (out / "part" / name).read_text() == "my own words"

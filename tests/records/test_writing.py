"""What is written is whole or not there, and is one run's at a time."""

import errno
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from hadr.records import writing
from hadr.records.output_folder import MARKER
from hadr.records.writing import (
    LOCK,
    PART,
    sole_owner,
    whole_file,
    whole_folder,
    write_arrays,
    write_whole,
)


def names(folder):
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*"))


def test_a_file_is_whole_or_the_old_one(tmp_path, monkeypatch):
    path = tmp_path / "new" / "file.txt"
    write_whole(path, "ü\n")
    write_arrays(path.with_suffix(".npz"), one=np.ones(2))
    assert np.load(path.with_suffix(".npz"))["one"].sum() == 2
    monkeypatch.setattr("os.replace", None)
    with pytest.raises(TypeError):
        write_whole(path, b"other")
    assert path.read_text(encoding="utf-8") == "ü\n"
    assert names(tmp_path) == ["new", "new/file.npz", "new/file.txt"]


def test_a_folder_is_whole_or_the_old_one(tmp_path):
    target = tmp_path / "deep" / "out"

    def write(text, check=lambda: None, fail=False):
        with whole_folder(target, "test", check) as folder:
            (folder / "a.txt").write_text(text)
            assert not fail

    with pytest.raises(AssertionError):
        write("0", fail=True)
    assert names(tmp_path) == []
    write("1")
    assert target.stat().st_mode & 0o777 == target.parent.stat().st_mode & 0o777
    write("2")
    with pytest.raises(AssertionError):
        write("3", fail=True)

    def check():
        if (target.parent / "now").exists():
            raise ValueError("filled meanwhile")
        (target.parent / "now").touch()

    with pytest.raises(ValueError, match="filled meanwhile"):
        write("4", check)
    assert (target / "a.txt").read_text() == "2"
    assert names(tmp_path) == ["deep", "deep/now", "deep/out", "deep/out/a.txt"]


def test_a_result_is_there_again_after_a_kill_between_the_renames(tmp_path):
    workshop = tmp_path / ".out.hadr"
    (workshop / "former").mkdir(parents=True)
    (workshop / "former" / "a.txt").write_text("1")
    (workshop / "draft").mkdir()
    (workshop / MARKER).touch()
    with (
        pytest.raises(RuntimeError),
        whole_folder(tmp_path / "out", "test", lambda: None),
    ):
        raise RuntimeError
    assert names(tmp_path) == ["out", "out/a.txt"]


def test_somebody_s_folder_of_a_workshop_s_name_and_the_current_folder_stay(tmp_path, monkeypatch):
    own = tmp_path / "docs" / "draft" / "thesis.txt"
    own.parent.mkdir(parents=True)
    own.write_text("1")
    (tmp_path / ".out.hadr").symlink_to("docs")
    own.parents[1].rename(tmp_path / ".other.hadr")
    for name in ("out", "other"):
        with (
            pytest.raises(ValueError, match="is somebody's own: move it away"),
            whole_folder(tmp_path / name, "test", lambda: None),
        ):
            pass
    assert (tmp_path / ".other.hadr" / "draft" / "thesis.txt").read_text() == "1"
    (tmp_path / "here").mkdir(mode=0o700)
    with whole_folder(tmp_path / "here", "test", lambda: None):
        pass
    assert (tmp_path / "here").stat().st_mode & 0o777 == 0o700
    monkeypatch.chdir(tmp_path / "here")
    with (
        pytest.raises(ValueError, match="is the current folder"),
        whole_folder(tmp_path / "here", "test", lambda: None),
    ):
        pass


def test_a_folder_has_one_owner_and_a_killed_one_leaves_it(tmp_path):
    pytest.importorskip("fcntl", reason="folders are locked on POSIX systems alone")
    folder = tmp_path / "run"
    code = (
        "import sys, time; from pathlib import Path; from hadr.records.writing import *\n"
        "with sole_owner(sys.argv[1], 'hadr train') as folder, whole_file(folder / 'a' / 'b'):\n"
        "    (folder / 'a' / f'{PART}7').write_text('half'); print('has it', flush=True)\n"
        "    time.sleep(60)"
    )
    first = subprocess.Popen([sys.executable, "-c", code, folder], stdout=subprocess.PIPE)
    try:
        assert first.stdout.readline() == b"has it\n"
        with (
            pytest.raises(ValueError, match=rf"run is taken by hadr train, process {first.pid} on"),
            sole_owner(folder, "hadr generate"),
        ):
            pass
    finally:
        first.kill()
        first.communicate()
    assert names(folder) == [LOCK, "a", f"a/{PART}7"]
    (folder / "other").mkdir()
    for name in (LOCK, f"{PART}8"):  # another run's folder in ours
        (folder / "other" / name).touch()
    (folder / "mine.txt").touch()
    with sole_owner(folder, "hadr train"):
        assert names(folder) == [LOCK, "a", "mine.txt", "other", f"other/{LOCK}", f"other/{PART}8"]
    assert names(folder) == ["a", "mine.txt", "other", f"other/{LOCK}", f"other/{PART}8"]


def test_an_owner_that_wrote_nothing_leaves_nothing(tmp_path):
    with sole_owner(tmp_path / "a" / "b", "test") as folder:
        (folder / f"{PART}9").touch()  # such as a process leaves that it started
    assert names(tmp_path) == []
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / LOCK).touch()  # a run was killed
    with sole_owner(tmp_path / "a", "test"):
        pass
    assert names(tmp_path) == []


def test_errors_name_what_was_to_be_written(tmp_path):
    said = r"the output can't be written \(No such file or directory\): '{}'$"

    def refused(name):
        return pytest.raises(FileNotFoundError, match=said.format(tmp_path / name))

    with refused("a.txt"), whole_file(tmp_path / "a.txt"):
        pass  # there is nothing to take its place
    with refused("b"), whole_folder(tmp_path / "b", "test", lambda: None) as draft:
        (draft / "no" / "file").touch()
    with (
        pytest.raises(FileNotFoundError, match=r"No such .*: '/other'"),
        whole_file(tmp_path / "c"),
    ):
        Path("/other").read_text()
    assert names(tmp_path) == []


def test_where_there_are_no_locks_it_is_said_once(tmp_path, monkeypatch, capsys):
    fcntl = pytest.importorskip("fcntl", reason="folders are locked on POSIX systems alone")

    def flock(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", flock)
    writing._say_unlocked.cache_clear()
    for name in "ab":
        with sole_owner(tmp_path / name, "test"):
            pass
    told = capsys.readouterr().err
    assert told.startswith("hadr: there are no locks on this system or disk")
    assert told.count("\n") == 1

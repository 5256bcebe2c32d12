"""Where commands may write, and what of it they may remove again."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from hadr.cli import main
from hadr.press import book_command, reproduce
from hadr.press.course import command as course_command
from hadr.records import output_folder
from hadr.records.output_folder import (
    MARKER,
    SOURCES,
    check_apart,
    check_file,
    check_folder,
    check_free,
    check_output_folder,
    check_removable,
    make_output_folder,
    remove_output_folder,
)
from hadr.records.result_file import seal_row, write_sealed
from hadr.records.writing import sole_owner

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def checkout(tmp_path, monkeypatch):
    """A small checkout with a file in each of its folders; the working folder is in it."""
    root = tmp_path / "outer" / "checkout"
    for name in SOURCES:
        (root / name).mkdir(parents=True)
        (root / name / "file").write_text(name)
    (root / "executed").mkdir()
    for folder in ("notebooks", "executed"):
        (root / folder / "00_a.ipynb").write_text('{"cells": [], "metadata": {}, "nbformat": 4}')
    (root / "mine").mkdir()
    (root / "mine" / "file").write_text("years of work")
    (root / "link").symlink_to("book")
    (tmp_path / "outer" / "beside").symlink_to("checkout")
    for module in (output_folder, book_command, reproduce, course_command):
        monkeypatch.setattr(module, "checkout_root", lambda: root)
    monkeypatch.chdir(root)
    return root


def content(folder):
    return {path.relative_to(folder).as_posix(): path.read_bytes()
            for path in sorted(folder.rglob("*")) if path.is_file()}  # fmt: skip


AMONG_SOURCES = {
    ".": "contains",
    "..": "contains",
    "../beside": "contains",
    "/": "contains",
    "book": "is",
    "./book/": "is",
    "link": "is",
    "notebooks/text/../": "is",
    "results/new": "lies in",
    "link/new": "lies in",
    "../beside/hadr/a/b": "lies in",
    ".git/new": "lies in",
}


@pytest.mark.parametrize(("folder", "word"), AMONG_SOURCES.items())
def test_a_folder_among_the_sources_is_refused(checkout, folder, word):
    with pytest.raises(ValueError, match=rf"^{folder} can't take what is made: it {word} /"):
        check_output_folder(folder)
    for use in (make_output_folder, check_removable, remove_output_folder):
        with pytest.raises(ValueError, match="can't take what is made"):
            use(folder)


def test_the_installed_library_is_a_source_as_well(checkout):
    for folder in (ROOT / "hadr", ROOT / "hadr" / "new", ROOT):
        with pytest.raises(ValueError, match=rf"{ROOT / 'hadr'}, which is no output"):
            check_output_folder(folder)


def test_what_is_no_folder_is_refused(checkout, tmp_path):
    with pytest.raises(ValueError, match=r"expected the name of a folder .* got an empty one"):
        check_output_folder(" ")
    (tmp_path / "file").touch()
    for path in ("file", "file/new"):
        with pytest.raises(ValueError, match=r"can't be a folder: .*file is a file"):
            check_output_folder(tmp_path / path)
        with pytest.raises(ValueError, match=r"can't be a folder: .*file is a file"):
            check_folder(tmp_path / path)
    with pytest.raises(ValueError, match="is a folder, expected the name of a file"):
        check_file(tmp_path)
    (tmp_path / "loop").symlink_to("loop")
    for check in (check_folder, check_output_folder):
        with pytest.raises(ValueError, match="loop is a link that leads nowhere"):
            check(tmp_path / "loop" / "new")


def test_nothing_is_written_among_the_frames_of_a_data_set(tmp_path):
    made = tmp_path / "made"
    for split, rgb in (("train", "depth/rgb"), ("val", "rgb")):
        (made / split / "0000" / rgb).mkdir(parents=True)
    (tmp_path / "link").symlink_to(made / "train")
    check_file(made / "result.json")
    check_folder(made / "runs")
    for check, place in (
        (check_folder, made / "val" / "run"),
        (check_folder, made / "train"),
        (check_output_folder, made / "train" / "0000"),
        (check_file, made / "train" / "result.json"),
        (check_file, tmp_path / "link" / "result.json"),
    ):
        with pytest.raises(ValueError, match=r"lies among the frames of .*made, which could"):
            check(place)
    check_folder(made / "test" / "run")  # no frames are there
    check_folder(tmp_path / "train" / "run")


def test_nothing_is_written_into_a_result_but_its_page(tmp_path):
    result = tmp_path / "restored"
    result.mkdir()
    seal_row(result / "report.json", {"command": "hadr restore"})
    (tmp_path / "link").symlink_to(result)
    for check, place in (
        (check_folder, result),
        (check_folder, result / "deeper"),
        (check_folder, tmp_path / "link" / "deeper"),
        (check_file, result / "t.json"),
    ):
        with pytest.raises(ValueError, match="restored, a result of 'hadr restore', which"):
            check(place)
    check_apart(result)
    check_file(result / "view.html")


def test_only_a_file_of_the_same_command_is_replaced(tmp_path):
    own = tmp_path / "own.json"
    seal_row(own, {"what": "Confidence of net", "rows": []})
    check_file(own, what="Confidence of", rows="")
    check_file(tmp_path / "new.json", what="Confidence of")
    sealed, row = tmp_path / "sealed.json", tmp_path / "row.json"
    write_sealed(sealed, {"what": "Confidence of net", "provenance": {"commit": "a"}})
    seal_row(row, {"what": "Confidence of net"})
    (tmp_path / "bare.json").write_text('{"what": "Confidence of net"}')
    for path in (sealed, row):
        check_file(path, what="Confidence of")
        path.write_text(path.read_text().replace("of net", "of nets"))
    (tmp_path / "link.json").symlink_to(own)
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "net.safetensors").write_bytes(b"\x80 years of work")
    (tmp_path / "list.json").write_text("[]")
    for path, fields, says in (
        (own, {"what": "handover attempts"}, "is not replaced: no earlier run"),
        (own, {"what": "", "split": ""}, "is not replaced: no earlier run"),
        (tmp_path / "bare.json", {"what": ""}, "is not replaced: no earlier run"),
        (sealed, {"what": ""}, "is not replaced: .* or it was changed since"),
        (row, {"what": ""}, "is not replaced: .* or it was changed since"),
        (tmp_path / "net.safetensors", {"what": ""}, "is not replaced: no earlier run"),
        (tmp_path / "list.json", {"what": ""}, "is not replaced: no earlier run"),
        (tmp_path / "link.json", {"what": ""}, "is a link or a device"),
        (tmp_path / "fifo", {}, "is a link or a device"),
    ):
        with pytest.raises(ValueError, match=says):
            check_file(path, **fields)


@pytest.mark.parametrize("folder", ["build", "bookish", "out put/ü", "../build"])
def test_other_folders_are_made_marked_and_removed(checkout, folder):
    before = content(checkout.parent)
    assert check_output_folder(folder) == (checkout / folder).resolve()
    made = make_output_folder(folder)
    assert [path.name for path in made.iterdir()] == [MARKER]
    (made / "deep").mkdir()
    (made / "deep" / "file").write_text("")
    make_output_folder(folder)
    remove_output_folder(folder)
    assert not made.exists()
    remove_output_folder(folder)
    assert content(checkout.parent) == before


def test_somebodys_folder_is_filled_and_never_removed(checkout):
    make_output_folder("mine")
    before = content(checkout)
    assert not Path("mine", MARKER).exists()
    with pytest.raises(ValueError, match=r"mine was not made by hadr \(no .* lies in it\)"):
        remove_output_folder("mine")
    assert content(checkout) == before


def test_folders_of_caches_and_of_what_was_made_count_as_made(checkout):
    (checkout / "made" / "hadr-cache").mkdir(parents=True)
    check_removable("made")
    make_output_folder("made/mini")  # `make reproduce PRESET=mini BUILD=made`
    with pytest.raises(ValueError, match="was not made by hadr"):
        check_removable("made")
    make_output_folder("made")
    assert Path("made", MARKER).is_file()
    check_removable("made")
    (checkout / "made" / "book").mkdir()  # somebody's own, in a folder that hadr made
    (checkout / "made" / "book" / "novel.txt").write_text("years of work")
    with pytest.raises(ValueError, match="was not made by hadr"):
        remove_output_folder("made/book")
    (checkout / "empty").mkdir()
    with pytest.raises(ValueError, match="was not made by hadr"):
        remove_output_folder("empty")


def test_the_checkouts_own_build_folder_needs_no_marker(checkout):
    (checkout / "build" / "handover").mkdir(parents=True)
    (checkout / "build" / "handover" / "0004-902.json").write_text("{}")
    remove_output_folder("build")
    assert not Path("build").exists()


def test_a_link_goes_with_the_folder_that_was_made(checkout, tmp_path):
    (tmp_path / "disk").mkdir()
    Path("build").symlink_to(tmp_path / "disk")
    make_output_folder("build")
    remove_output_folder("build/")
    assert not Path("build").is_symlink()
    assert not (tmp_path / "disk").exists()


COMMANDS = {
    "book": ("--build",),
    "book --html-only": ("--html-only", "--build"),
    "reproduce": ("--only", "0", "--out"),
    "course": ("--out",),
}


@pytest.mark.parametrize(
    ("command", "folder"),
    [
        ("book", "."),
        ("book", "book"),
        ("book --html-only", "results/"),
        ("reproduce", "link/new"),
        ("reproduce", "results/new"),
        ("course", ".."),
    ],
)
def test_commands_refuse_it_before_anything_is_touched(checkout, capsys, command, folder):
    before = content(checkout)
    assert main([command.split()[0], *COMMANDS[command], folder]) == 2
    assert "can't take what is made" in capsys.readouterr().err
    assert content(checkout) == before


def test_the_book_leaves_somebodys_book_alone(checkout, capsys):
    (checkout / "mine" / "book").mkdir()
    (checkout / "mine" / "book" / "thesis.md").write_text("years of work")
    before = content(checkout)
    assert main(["book", "--build", "mine"]) == 2
    assert "mine was not made by hadr" in capsys.readouterr().err
    assert content(checkout) == before


def test_every_folder_of_the_checkout_is_known():
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        pytest.skip("needs git and its checkout: clone the repository")
    words = ["git", "-C", ROOT, "ls-files", "-z"]
    files = subprocess.run(words, capture_output=True, text=True, check=True).stdout.split("\0")
    assert {Path(name).parts[0] for name in files if "/" in name} <= set(SOURCES)


@pytest.fixture
def make(checkout):
    """Calls the project's Makefile in the small checkout, whose library removes folders alone."""
    if shutil.which("make") is None:
        pytest.skip("make is not installed")
    shutil.copy(ROOT / "Makefile", checkout)
    shutil.copy(ROOT / "hadr" / "__init__.py", checkout / "hadr")
    (checkout / "hadr" / "records").mkdir()
    for name in ("__init__.py", "output_folder.py", "checkout.py"):
        shutil.copy(ROOT / "hadr" / "records" / name, checkout / "hadr" / "records")

    def call(*words):
        outer = ("PYTHONPATH", "MAKEFLAGS", "MAKELEVEL", "BUILD")
        kept = {k: v for k, v in os.environ.items() if k not in outer}
        kept["PYTHONDONTWRITEBYTECODE"] = "1"
        return subprocess.run(["make", *words], env=kept, capture_output=True, text=True,
                              check=False)  # fmt: skip

    return call


@pytest.mark.parametrize("build", [" ", "results", "mine"])
def test_make_clean_refuses_what_was_not_built(checkout, make, build):
    before = content(checkout)
    done = make("clean", f"BUILD={build}")
    assert done.returncode != 0
    words = ("can't take what is made", "was not made by hadr", "BUILD is empty: name a folder")
    assert any(word in done.stderr for word in words)
    assert content(checkout) == before


def test_make_clean_removes_what_was_built(checkout, make):
    before = content(checkout)
    assert make("clean").returncode == 0  # nothing was built, and there is no environment
    for build in ("build", "my build ü", checkout.parent / "else where"):
        make_output_folder(build)
        Path(build, "file").write_text("")
        done = make("clean", f"BUILD={build}")
        assert (done.returncode, done.stderr) == (0, "")
        assert not Path(build).exists()
    assert content(checkout) == before


@pytest.mark.parametrize("build", ["build", "my build", "{root}/a b"])
def test_caches_go_into_the_build_folder_whatever_its_name(checkout, make, build):
    build = build.format(root=checkout)
    (checkout / "Makefile").open("a").write(
        "\nshow:\n\t@echo $$MPLCONFIGDIR; echo $$XDG_CACHE_HOME\n"
    )
    cache = (checkout / build).absolute() / output_folder.CACHE
    said = make("show", f"BUILD={build}").stdout
    assert said.splitlines() == [str(cache / "matplotlib"), str(cache)]


def test_a_file_in_a_folder_that_a_run_has_to_itself_is_left_alone(tmp_path):
    check_free(None)
    check_free(tmp_path / "nowhere" / "out.json")
    with sole_owner(tmp_path / "run", "hadr train"):
        with pytest.raises(ValueError, match=r"run is taken by hadr train, process \d+ on"):
            check_free(tmp_path / "run" / "last.json")
        check_free(tmp_path / "out.json")
    check_free(tmp_path / "run" / "last.json")

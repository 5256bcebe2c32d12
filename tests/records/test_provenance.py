"""Where a number comes from: the library's own commit, or none."""

import importlib.util
import math
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from hadr.records import provenance
from hadr.records.provenance import plain, write_results

SOURCE = Path(provenance.__file__)
UNKNOWN = {"commit": None, "uncommitted_changes": None}


@pytest.fixture
def project(tmp_path):
    """A repository with one commit."""
    if shutil.which("git") is None:
        pytest.skip("git is not installed")
    root = tmp_path / "project"
    root.mkdir()
    git(root, "init", "--quiet")
    (root / "own.py").write_text("VALUE = 1\n")
    commit(root)
    return root


def git(root, *words):
    who = ("-c", "user.name=a", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false")
    done = subprocess.run(
        ["git", "-C", root, *who, *words], capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


def commit(root):
    git(root, "add", "--all")
    git(root, "commit", "--quiet", "--message", "one")
    return git(root, "rev-parse", "HEAD")


def copied(root):
    """The module in a copy of the library in a folder."""
    path = root / "hadr" / "records" / "provenance.py"
    if not path.exists():
        path.parent.mkdir(parents=True)
        shutil.copy(SOURCE, path)
    spec = importlib.util.spec_from_file_location("copied_provenance", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def told(root):
    """What a copy of the library in a folder says of its commit."""
    whole = copied(root).provenance()
    return {name: whole[name] for name in UNKNOWN}


@pytest.mark.parametrize("place", [".venv/lib/python3.11/site-packages", "third_party", "."])
def test_a_library_in_somebodys_project_has_no_commit(project, place):
    assert told(project / place) == UNKNOWN


def test_a_library_that_a_project_keeps_in_a_folder_has_not_the_projects_commit(project):
    told(project / "third_party")
    commit(project)
    assert told(project / "third_party") == UNKNOWN


def test_a_checkout_tells_its_commit_and_whether_code_was_changed(project):
    told(project)
    head = commit(project)
    assert told(project) == {"commit": head, "uncommitted_changes": False}
    (project / "notes.txt").write_text("no code")
    assert told(project) == {"commit": head, "uncommitted_changes": False}
    for name in ("own.py", "hadr/page.html"):
        (project / name).write_text("VALUE = 2\n")
        assert told(project) == {"commit": head, "uncommitted_changes": True}
        git(project, "stash", "--quiet", "--include-untracked", "--", name)


def test_what_is_committed_while_a_process_runs_is_not_its_code(project):
    copied(project)
    head, begun = commit(project), copied(project)
    assert begun.provenance()["commit"] == head
    (project / "own.py").write_text("VALUE = 2\n")
    assert commit(project) != head
    assert begun.provenance()["commit"] == head


def test_without_git_nothing_is_known(project, monkeypatch, tmp_path):
    told(project)
    commit(project)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert told(project) == UNKNOWN


def test_write_results_without_a_folder_writes_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    content = write_results("", "03_x", {"rmse_m": np.float32(0.5)}, preset="tiny")
    assert content["chapter"] == "03_x"
    assert content["results"] == {"rmse_m": 0.5}
    assert content["parameters"] == {"preset": "tiny"}
    assert list(tmp_path.iterdir()) == []


@dataclass(frozen=True)
class Row:
    name: str
    value: np.ndarray


def test_plain_takes_what_chapters_measure():
    torch = pytest.importorskip("torch", reason="torch is not installed")
    told = {
        "array": np.arange(3, dtype=np.int64),
        "scalar": np.float64(0.25),
        "nan": [math.nan, np.inf],
        "row": Row("a", np.eye(2)),
        "path": Path("a/b"),
        3: (True, None),
        "tensor": torch.tensor([1.5]),
        "flag": np.bool_(True),
    }
    assert plain(told) == {
        "array": [0, 1, 2],
        "scalar": 0.25,
        "nan": [None, None],
        "row": {"name": "a", "value": [[1.0, 0.0], [0.0, 1.0]]},
        "path": "a/b",
        "3": [True, None],
        "tensor": [1.5],
        "flag": True,
    }


def test_plain_names_what_it_cannot_hold():
    with pytest.raises(TypeError, match=r"results.a\[1\] is a set, which JSON cannot hold"):
        plain({"a": [1, {2}]})

"""Where a number comes from: the library's own commit, or none."""

import importlib.util
import shutil
import subprocess
from pathlib import Path

import pytest

from hadr.records import provenance

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


def told(root):
    """What a copy of the library in a folder says of its commit."""
    path = root / "hadr" / "provenance.py"
    if not path.exists():
        path.parent.mkdir(parents=True)
        shutil.copy(SOURCE, path)
    spec = importlib.util.spec_from_file_location("copied_provenance", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    whole = module.provenance()
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


def test_without_git_nothing_is_known(project, monkeypatch, tmp_path):
    told(project)
    commit(project)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert told(project) == UNKNOWN

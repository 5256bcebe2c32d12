"""The first code cell of each chapter: a whole set-up on Colab, and nothing anywhere else."""

import ast
import re
import subprocess
import sys
import types
from pathlib import Path

import nbformat
import pytest
import yaml

from hadr.data import samples
from hadr.press.notebook_twins import repository

ROOT = Path(__file__).resolve().parents[2]
CHAPTERS = sorted((ROOT / "notebooks").glob("*.ipynb"))
REPOSITORY = repository(ROOT / "book")


@pytest.fixture
def source():
    cells = nbformat.read(CHAPTERS[0], 4).cells
    return next(cell.source for cell in cells if cell.cell_type == "code")


def test_elsewhere_it_does_nothing(source, monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(subprocess, "run", lambda *a, **k: pytest.fail("it runs a program"))
    before = list(sys.path)
    names = {}
    exec(source, names)
    assert set(names) - {"__builtins__"} == {"os", "subprocess", "sys"}
    assert sys.path == before
    assert list(tmp_path.iterdir()) == []
    assert capsys.readouterr().out == ""


class Colab:
    """As far as the cell can see: the module, and what was run."""

    def __init__(self, monkeypatch, folder):
        self.commands = []
        self.manifest = samples.ManifestReport(3, (), (), ())
        monkeypatch.chdir(folder)
        monkeypatch.setitem(sys.modules, "google.colab", types.ModuleType("google.colab"))
        monkeypatch.setattr(sys, "path", list(sys.path))
        monkeypatch.setattr(subprocess, "run", self.run)
        monkeypatch.setattr(samples, "verify_manifest", lambda: self.manifest)

    def run(self, command, check):
        assert check
        self.commands.append(command)
        if "clone" in command:
            Path(command[-1]).mkdir()


def test_on_colab_it_fetches_installs_and_checks(source, monkeypatch, tmp_path):
    colab = Colab(monkeypatch, tmp_path)
    exec(source, {})
    clone, install = colab.commands
    assert clone[:2] == ["git", "clone"]
    assert clone[-2:] == [REPOSITORY["url"], "hadr-book"]
    assert clone[clone.index("-b") + 1] == REPOSITORY["branch"]
    assert install[0] == sys.executable
    assert install[-2:] == ["-e", "hadr-book[handover]"]
    assert sys.path[0] == str(tmp_path / "hadr-book")
    colab.commands.clear()
    exec(source, {})
    assert [command[0] for command in colab.commands] == [sys.executable], "fetched twice"


def test_a_damaged_sample_is_told(source, monkeypatch, tmp_path):
    colab = Colab(monkeypatch, tmp_path)
    colab.manifest = samples.ManifestReport(2, ("frames/a.png",), (), ())
    with pytest.raises(AssertionError, match="a sample differs from its checksum"):
        exec(source, {})


@pytest.mark.parametrize("path", CHAPTERS, ids=lambda path: path.stem)
def test_chapters_import_only_what_every_environment_has(path):
    """What Binder, Colab and conda install: the base and the extra "handover"."""
    environment = yaml.safe_load((ROOT / "environment.yml").read_text())["dependencies"]
    lines = [line for line in environment if isinstance(line, str)]
    lines += next(entry["pip"] for entry in environment if isinstance(entry, dict))
    there = {re.split(r"[<>=]", line)[0].lower() for line in lines} | {"hadr", "ipython", "google"}
    called = {"torch": "pytorch", "matplotlib": "matplotlib-base", "cv2": "opencv-python-headless"}
    for cell in nbformat.read(path, 4).cells:
        if cell.cell_type != "code":
            continue
        for node in ast.walk(ast.parse(cell.source)):
            names = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                names = [node.module]
            for name in {name.split(".")[0] for name in names} - set(sys.stdlib_module_names):
                assert called.get(name, name).lower() in there, f"{path.name} imports {name}"

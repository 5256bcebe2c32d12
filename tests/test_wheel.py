"""The book against the built wheel: chapters run in a foreign folder, with the installed library.

A small notebook runs with every test run, three chapters with `make test-long`: one restores, one
reads results, one simulates. The wheel has every file of the library, so the others add nothing.
"""

import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import nbformat
import pytest

from hadr.cli import COMMANDS

ROOT = Path(__file__).resolve().parents[1]
CHAPTERS = sorted((ROOT / "notebooks").glob("[0-9][0-9]_*.ipynb"))

RUN = """
import sys
from pathlib import Path
from hadr.press.chapters import run_notebooks
run_notebooks([Path(name) for name in sys.argv[2:]], Path(sys.argv[1]), preset="tiny", seed=0)
"""
HELP = """
import sys
from hadr.cli import main
for name in sys.argv[1:]:
    try:
        main([name, "--help"])
    except SystemExit as end:
        assert not end.code, name
"""


def call(*words, cwd, **environment):
    """A Python process that knows the wheel alone, and nothing of the checkout."""
    kept = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "HADR_SAMPLES")}
    return subprocess.run(
        [sys.executable, *map(str, words)],
        cwd=cwd,
        env=kept | {k: str(v) for k, v in environment.items()},
        capture_output=True,
        text=True,
        check=False,
        timeout=3600,
    )


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel, built without a network from a copy of what it is made of."""
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    litter = shutil.ignore_patterns("__pycache__", "*.pyc")
    shutil.copytree(ROOT / "hadr", source / "hadr", ignore=litter)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    words = ["-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--no-index"]
    done = call(*words, "--wheel-dir", folder, source, cwd=folder)
    assert done.returncode == 0, done.stderr[-2000:]
    (made,) = folder.glob("hadr-*.whl")
    return made


@pytest.fixture(scope="module")
def installed(wheel):
    """The folder that the wheel was installed into; what it depends on comes from the tests'."""
    target = wheel.parent / "site"
    words = ["-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--target", target]
    done = call(*words, wheel, cwd=wheel.parent)
    assert done.returncode == 0, done.stderr[-2000:]
    return target


@pytest.fixture
def elsewhere(tmp_path):
    """A working folder that is in no checkout."""
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    return folder


def test_the_wheel_holds_the_whole_library_and_nothing_else(wheel):
    held = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    own = {
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "hadr").rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert held == own


def test_every_command_explains_itself_without_a_checkout(installed, elsewhere):
    done = call("-c", HELP, *COMMANDS, cwd=elsewhere, PYTHONPATH=installed)
    assert done.returncode == 0, done.stderr[-2000:]
    assert [name for name in COMMANDS if f"usage: hadr {name} " not in done.stdout] == []


def test_what_needs_the_checkout_says_how_to_get_it(installed, elsewhere):
    words = ["reproduce", "--dry-run", "--only", "chapters", "--out", "out"]
    code = f"from hadr.cli import main; main({words})"
    done = call("-c", code, cwd=elsewhere, PYTHONPATH=installed)
    assert "set HADR_SAMPLES to its folder data_samples" in done.stderr
    assert "Traceback" not in done.stderr
    whole = call(
        "-c", code, cwd=elsewhere, PYTHONPATH=installed, HADR_SAMPLES=ROOT / "data_samples"
    )
    assert CHAPTERS[-1].stem in whole.stdout, whole.stderr[-2000:]


@pytest.mark.parametrize(
    "chapters",
    [
        pytest.param([], id="none"),
        pytest.param([CHAPTERS[n] for n in (0, 9, 13)], id="three", marks=pytest.mark.long),
    ],
)
def test_chapters_run_with_the_wheel(installed, elsewhere, chapters):
    """A first notebook tells which library the kernel has: with the checkout's, all were vain."""
    probe = nbformat.v4.new_notebook(
        cells=[
            nbformat.v4.new_code_cell("seed = 0", metadata={"tags": ["parameters"]}),
            nbformat.v4.new_code_cell("import hadr\nprint(hadr.__file__)"),
        ]
    )
    nbformat.write(probe, elsewhere / "probe.ipynb")
    for path in chapters:
        shutil.copy(path, elsewhere)
    out = elsewhere / "out"
    names = ["probe.ipynb", *(path.name for path in chapters)]
    done = call(
        "-c", RUN, out, *names, cwd=elsewhere, PYTHONPATH=installed,
        HADR_SAMPLES=ROOT / "data_samples",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-4000:]
    told = nbformat.read(out / "executed" / "probe.ipynb", 4).cells[-1].outputs[0].text.strip()
    assert Path(told) == installed / "hadr" / "__init__.py"
    for path in chapters:
        kept = json.loads((out / "results" / path.stem / "results.json").read_text())
        assert kept["chapter"] == path.stem
        assert kept["results"]
        assert kept["provenance"]["commit"] is None  # the wheel lies in no checkout

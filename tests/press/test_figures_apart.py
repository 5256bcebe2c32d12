"""Every file in results/ has a command: `hadr reproduce`, or the one that the table names."""

from __future__ import annotations

import argparse
import re
import shlex
from pathlib import Path

import pytest

from hadr.press.figures_apart import APART, BY_REPRODUCE, Apart, figures_apart_table
from hadr.simulation.trials.command import add_arguments, check_arguments

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "results"
COMMANDS = [command for one in APART for command in one.commands]


def test_every_result_file_is_made_by_reproduce_or_stands_in_the_table() -> None:
    there = {
        path.relative_to(RESULTS).as_posix()
        for path in RESULTS.rglob("*")
        if path.is_file() and not path.name.startswith("LICENSE")
    }
    apart = [file for one in APART for file in one.files]
    assert len(apart) == len(set(apart))
    assert not set(apart) & set(BY_REPRODUCE)
    assert there == {*apart, *BY_REPRODUCE}


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_exist_and_take_these_options(command: str) -> None:
    program, *words = shlex.split(command)
    if program == "hadr":
        assert words[0] == "handover"
        parser = argparse.ArgumentParser()
        add_arguments(parser)
        check_arguments(parser.parse_args(words[1:]))
        return
    assert program == "python"
    text = (ROOT / words[0]).read_text(encoding="utf-8")
    if "import arguments" in text:
        text += (ROOT / "benchmarks" / "finished_runs.py").read_text(encoding="utf-8")
    options = [word for word in words[1:] if word.startswith("--")]
    assert [option for option in options if f'"{option}"' not in text] == []


@pytest.mark.parametrize("one", [one for one in APART if one.commands], ids=lambda o: o.files[0])
def test_the_last_command_writes_the_files(one: Apart) -> None:
    for file in one.files:
        command = one.commands[-1]
        if "--json" in command:
            assert command.endswith(f"--json results/{file}")
            continue
        script = (ROOT / shlex.split(command)[1]).read_text(encoding="utf-8")
        name = Path(file)
        assert name.name in script or f'"{name.stem}"' in script or name.stem in command


def test_the_table_has_a_line_for_each() -> None:
    lines = figures_apart_table().splitlines()[2:]
    assert len(lines) == len(APART)
    for one, line in zip(APART, lines, strict=True):
        assert all(f"`{file}`" in line for file in one.files)
        assert one.what in line
        assert all(f"`{command}`" in line for command in one.commands)
        assert one.note in line
        assert len(re.findall(r" \| ", line)) == 2

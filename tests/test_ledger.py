"""The ledger names options that exist, and has every row."""

import importlib
import inspect
import re
from dataclasses import fields, is_dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
TEXT = (ROOT / "book" / "ledger.md").read_text(encoding="utf-8")
NAMED = sorted(set(re.findall(r"`(hadr(?:\.\w+)+)(?:\(([\w, ]+)\))?`", TEXT)))


def resolve(path):
    parts = path.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        for name in parts[cut:]:
            found = getattr(found, name)
        return found
    raise ModuleNotFoundError(path)


@pytest.mark.parametrize(("path", "options"), NAMED, ids=[path for path, _ in NAMED])
def test_every_switch_exists(path, options):
    found = resolve(path)
    if not options:
        return
    if is_dataclass(found):
        known = {item.name for item in fields(found)}
    else:
        known = set(inspect.signature(found).parameters)
    assert set(options.split(", ")) <= known


def test_all_rows_are_there_with_their_four_parts():
    rows = re.findall(r"^## (\d+)\. \S", TEXT, re.MULTILINE)
    assert [int(row) for row in rows] == list(range(1, 28))
    for part in ("The paper", "The published code", "What we do, and why", "The switch"):
        assert len(re.findall(rf"^{part}\n: \S", TEXT, re.MULTILINE)) == 27


def test_the_library_points_to_rows_that_exist():
    for path in (ROOT / "hadr").rglob("*.py"):
        for first, last in re.findall(
            r"ledger(?:'s)?,? rows? (\d+)(?: to (\d+))?", path.read_text(encoding="utf-8")
        ):
            assert 1 <= int(first) <= 27
            assert not last or int(last) <= 27

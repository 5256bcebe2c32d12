"""What CONTRIBUTING names as the place for an addition is there."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
TABLE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").split("## Where to add what")[1]
NAMED = sorted(set(re.findall(r"`((?:hadr|notebooks)/[\w/.]*)`", TABLE.split("\n## ")[0])))


@pytest.mark.parametrize("name", NAMED)
def test_a_named_place_exists(name: str) -> None:
    assert (ROOT / name.replace("NAME.py", "")).exists()

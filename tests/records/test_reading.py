"""Files that others wrote: one sentence names file, field and value, whatever stands there."""

import math
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import pytest

from hadr.records.provenance import IF_CHANGED
from hadr.records.reading import parse_json, read_bytes, read_json, structured


@dataclass(frozen=True)
class Part:
    size: int

    def __post_init__(self) -> None:
        if self.size < 1:
            raise ValueError(f"size must be at least 1, got {self.size}")


@dataclass(frozen=True)
class Whole:
    name: str
    part: Part
    numbers: tuple[float, ...]
    kind: Literal["a", "b"] = "a"
    more: float | None = None
    late: bool = field(default=False, metadata=IF_CHANGED)


GOOD: dict[str, Any] = {
    "name": "n", "part": {"size": 2}, "numbers": [1, 2.5], "kind": "b", "more": None,
}  # fmt: skip


def test_what_is_right_is_built() -> None:
    assert structured(GOOD, Whole, "f") == Whole("n", Part(2), (1.0, 2.5), "b", None)
    assert structured(GOOD | {"late": True, "x": 1}, Whole, "f", further=True).late
    assert structured({"a": [1]}, dict[str, list[int]], "f") == {"a": [1]}
    assert structured(math.inf, float, "f", infinite=True) == math.inf


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"name": 7}, "f.json: name: must be text, got 7"),
        ({"part": 7}, "f.json: part: must be named values, got 7"),
        ({"part": {}}, "f.json: part: lacks size"),
        ({"part": {"size": 2.0}}, "f.json: part.size: must be a whole number, got 2.0"),
        ({"part": {"size": True}}, "f.json: part.size: must be a whole number, got True"),
        ({"part": {"size": 10**400}}, "f.json: part.size: must be a whole number, got 1000000"),
        ({"part": {"size": 0}}, "f.json: part: size must be at least 1, got 0"),
        ({"numbers": "12"}, "f.json: numbers: must be a list, got '12'"),
        ({"numbers": [1, "2"]}, "f.json: numbers[1]: must be a number, got '2'"),
        ({"numbers": [math.nan]}, "f.json: numbers[0]: must be a number, got nan"),
        ({"numbers": [math.inf]}, "f.json: numbers[0]: must be a number, got inf"),
        ({"numbers": [10**400]}, "f.json: numbers[0]: must be a number, got 1000000"),
        ({"kind": []}, "f.json: kind: must be one of 'a', 'b', got []"),
        ({"more": "x"}, "f.json: more: must be a number, got 'x'"),
        ({"late": 1}, "f.json: late: must be true or false, got 1"),
        ({"luck": 1}, "f.json: has the unknown field luck"),
    ],
)
def test_what_is_wrong_is_named(change: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError) as error:  # noqa: PT011
        structured(GOOD | change, Whole, "f.json")
    assert str(error.value).startswith(said)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is not valid JSON"),
        ("[" * 100_000, "nested too deeply"),
        ('{"a": 1, "a": 2}', "the name 'a' stands there twice"),
        (b"\xff", "is not valid JSON"),
    ],
)
def test_text_that_is_no_json_names_the_file(text: str | bytes, said: str) -> None:
    with pytest.raises(ValueError, match=rf"f\.json .*{said}"):
        parse_json(text, "f.json")


def test_what_is_no_file_is_never_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for name in (tmp_path, tmp_path / "pipe", Path("/dev/zero")):
        with pytest.raises(ValueError, match=rf"{name} is no regular file"):
            read_bytes(name)
    with pytest.raises(FileNotFoundError):
        read_json(tmp_path / "none.json")

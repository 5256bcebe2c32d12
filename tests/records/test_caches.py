"""What is kept cannot be spoiled, and what a file says is read again when the file has changed."""

import copy
import os
import pickle
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from hadr.figures.solids.turntable import _simple_glass
from hadr.records.caches import kept, kept_by_file, read_only
from hadr.simulation.camera.room import make_room
from hadr.simulation.world.object_parts import mass_properties, stacked_rings
from hadr.synthesis.depth_sensor.infrared import Projector
from hadr.synthesis.generation.frames import recipe_hold
from hadr.synthesis.generation.settings import GenerationSettings
from hadr.synthesis.glass.objects import bodies, glass_object
from hadr.synthesis.glass.shape import profile
from hadr.synthesis.hand.finger_skin import skin_normals
from hadr.synthesis.hand.template import hand_template
from hadr.synthesis.holding.clearance import clearance_table
from hadr.synthesis.holding.hold import make_hold
from hadr.synthesis.recordings.recording import recording_text
from hadr.synthesis.textures.families import pyramid


def arrays(value: Any) -> Iterator[np.ndarray]:
    """All arrays in a result."""
    if isinstance(value, np.ndarray):
        yield value
    elif is_dataclass(value):
        for field in fields(value):
            yield from arrays(getattr(value, field.name))
    elif isinstance(value, tuple | list | Mapping):
        for part in value.values() if isinstance(value, Mapping) else value:
            yield from arrays(part)


GLASS = glass_object("0000")
KEPT: dict[str, Callable[[], Any]] = {
    "profile": lambda: profile(GLASS),
    "bodies": lambda: bodies(GLASS),
    "hand_template": hand_template,
    "make_hold": lambda: make_hold("0000", 0),
    "skin_normals": skin_normals,
    "clearance_table": lambda: clearance_table("0000"),
    "directions": lambda: Projector().directions(),
    "pyramid": lambda: pyramid(0),
    "make_room": lambda: make_room(0),
    "mass_properties": lambda: mass_properties(GLASS),
    "stacked_rings": lambda: stacked_rings(GLASS),
    "simple_glass": lambda: _simple_glass("0000", 0.001),
}


@pytest.mark.parametrize("name", KEPT)
def test_what_the_library_keeps_cannot_be_changed_in_place(name: str) -> None:
    found = list(arrays(KEPT[name]()))
    assert found
    for array in found:
        with pytest.raises(ValueError, match="read-only"):
            array *= 2


def test_the_dictionaries_of_a_kept_hold_cannot_be_changed_in_place() -> None:
    hold = make_hold("0000", 0)
    for words in (hold.gaps, hold.shape.roots, hold.shape.lengths, hold.shape.fan):
        with pytest.raises(TypeError, match="does not support item assignment"):
            words["thumb"] = 1  # type: ignore[index]


def test_a_kept_hold_goes_to_other_processes_and_its_copy_is_ones_own() -> None:
    hold = make_hold("0000", 0)
    for other in (copy.deepcopy(hold), pickle.loads(pickle.dumps(hold))):
        assert other.gaps == hold.gaps
        other.gaps.clear()
    assert hold.gaps


@dataclass(frozen=True)
class Pair:
    first: Any
    second: Any


def test_arrays_are_found_wherever_they_are() -> None:
    parts = [np.zeros(2) for _ in range(5)]
    value = Pair((parts[0], [parts[1]]), {"a": Pair(parts[2], "text"), "b": (parts[3], None)})
    assert read_only(value) is value
    assert [part.flags.writeable for part in parts] == [False] * 4 + [True]


def test_a_kept_result_is_computed_once_and_its_copy_is_ones_own() -> None:
    calls = []

    @kept(2)
    def double(number: float) -> np.ndarray:
        """Twice."""
        calls.append(number)
        return np.full(3, 2 * number)

    first = double(1.0)
    assert double(1.0) is first
    own = first.copy()
    own *= 1000
    assert double(1.0).tolist() == [2.0, 2.0, 2.0]
    assert calls == [1.0]
    assert (double.__name__, double.__doc__) == ("double", "Twice.")
    double.cache_clear()
    assert double(1.0) is not first


def test_a_changed_file_is_read_again(tmp_path: Path) -> None:
    calls = []

    @kept_by_file(4)
    def content(path: Path, *_: Path) -> tuple[str]:
        calls.append(path.name)
        return (path.read_text(),)

    path, beside = tmp_path / "a", tmp_path / "b"
    with pytest.raises(FileNotFoundError):
        content(path, beside)
    path.write_text("one")
    first = content(path, beside)
    assert first == ("one",)
    assert content(path, beside) is first
    before = path.stat()
    path.write_text("two")  # as long as it was, at another time
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns + 1))
    assert content(path, beside) == ("two",)
    path.write_text("three")  # at the time it was, but longer
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns + 1))
    assert content(path, beside) == ("three",)
    calls.clear()
    content(path, beside)
    assert not calls
    beside.write_text("")  # has come
    content(path, beside)
    assert calls == ["a"]


def test_a_changed_photograph_is_seen(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    for level in (50, 200):
        cv2.imwrite(str(path), np.full((20, 20 + level, 3), level, np.uint8))
        assert pyramid(-1, (path,))[0][0, 0].tolist() == [level] * 3


def test_a_changed_recording_is_read_again(tmp_path: Path) -> None:
    from hadr.data.samples import samples_dir
    from hadr.synthesis.recordings.recording import find_recordings, read_recording

    recipe = next(
        recipe
        for recipe in (GenerationSettings().recipe(index) for index in range(100))
        if recipe.object_id == "0000" and recipe.hold_number == 0
    )
    recording = read_recording(find_recordings(samples_dir() / "recordings" / "0000")[0])
    path = tmp_path / "mine-0.csv"  # its name does not say which object it holds
    for scale in (1.1, 0.9):
        text = re.sub("^# scale: .*$", f"# scale: {scale}", recording_text(recording), flags=re.M)
        path.write_text(text)
        assert (
            recipe_hold(recipe, GenerationSettings(recordings=str(tmp_path))).shape.scale == scale
        )

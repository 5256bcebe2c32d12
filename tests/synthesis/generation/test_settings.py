"""What a frame of a data set shows, and which settings there are."""

import math
from dataclasses import replace

import pytest

from hadr.synthesis.generation.settings import PRESETS, GenerationSettings

SETTINGS = GenerationSettings(width=64, height=36, quality="fast")


def test_presets_say_what_the_data_card_promises():
    samples, mini, paper = (PRESETS[name] for name in ("samples", "mini", "paper"))
    assert samples.frames == 480
    assert (samples.settings.width, samples.settings.height) == (320, 180)
    holds = {(r.object_id, r.hold_number) for r in map(samples.settings.recipe, range(480))}
    assert len(holds) == 240
    assert max(number for _, number in holds) == 29
    recipes = [mini.settings.recipe(i) for i in range(mini.frames)]
    holds = {(r.object_id, r.hold_number) for r in recipes}
    assert mini.frames >= 6000
    assert len(holds) >= 3000
    assert mini.settings.seed != samples.settings.seed
    assert (paper.frames, paper.settings.width, paper.settings.height) == (14100, 1280, 720)
    gallery = PRESETS["gallery"]
    kinds = [gallery.settings.recipe(i).hold_number % 8 for i in range(gallery.frames)]
    assert len(set(kinds)) == 8
    for preset in PRESETS.values():
        numbers = [preset.settings.recipe(i) for i in range(preset.frames)]
        split = {}
        for recipe in numbers:
            split.setdefault((recipe.object_id, recipe.hold_number), set()).add(recipe.split)
        assert all(len(s) == 1 for s in split.values())


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ({"engine": "blender"}, "engine must be 'photo' or 'raycast', got 'blender'"),
        ({"normals": "some"}, "normals must be 'all', 'held', 'object' or 'none'"),
        ({"jpeg_quality": 0}, r"jpeg_quality must lie in 1\.\.100, got 0"),
        ({"seed": -1}, "seed must lie in 0.*, got -1"),
        ({"seed": 1.5}, "seed must be a whole number, got 1.5"),
        ({"hold_shift": math.nan}, "hold_shift must be a whole number, got nan"),
        ({"recordings": ""}, "recordings must not be empty"),
        ({"samples": 0}, "samples must lie in 1"),
        ({"frames_per_hold": 0.5}, "frames_per_hold must lie in 1"),
        ({"frames_per_hold": math.nan}, "frames_per_hold must .* got nan"),
        ({"objects": ("0002",)}, "no object '0002'"),
        ({"objects": ()}, "at least one"),
        ({"objects": ("0000", "0000")}, "different ones"),
        ({"width": 4, "height": 4}, r"width must lie in 16\.\.8192, got 4"),
        ({"height": 10_000_000}, r"height must lie in 9\.\.8192, got 10000000"),
        ({"rest_step": 0.0}, r"rest_step must lie in 0\.0001\.\.0\.1, got 0\.0"),
        ({"rest_step": math.nan}, "rest_step must .* got nan"),
    ],
)
def test_errors_name_the_value(value, message):
    with pytest.raises(ValueError, match=message):
        replace(SETTINGS, **value)


def test_frames_are_counted_from_0():
    with pytest.raises(ValueError, match="frames are counted from 0, got -1"):
        SETTINGS.recipe(-1)


def test_splits_by_frame_holding_and_object():
    by_hold = [replace(SETTINGS, objects=("0000",)).recipe(i) for i in range(40)]
    holds = {}
    for recipe in by_hold:
        holds.setdefault(recipe.hold_number, set()).add(recipe.split)
    assert all(len(s) == 1 for s in holds.values())
    assert [r.split for r in by_hold].count("train") == 28
    by_object = [replace(SETTINGS, split_by="object").recipe(i) for i in range(16)]
    assert {r.object_id for r in by_object if r.split == "test"} == {"0004", "0007"}
    by_frame = [replace(SETTINGS, split_by="frame").recipe(i).split for i in range(1000)]
    assert by_frame.count("train") == pytest.approx(700, abs=50)
    assert by_frame.count("test") == pytest.approx(100, abs=35)


def test_frames_per_hold_may_be_two_and_three_in_turn():
    more = replace(SETTINGS, objects=("0000",), frames_per_hold=2.5)
    assert [more.recipe(i).hold_number for i in range(10)] == [0, 0, 0, 1, 1, 2, 2, 2, 3, 3]
    assert [
        replace(SETTINGS, objects=("0000", "0004"), hold_shift=3).recipe(i).hold_number
        for i in (0, 1)
    ] == [0, 3]

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch

from hadr.corruption import CORRUPTIONS, Corruption
from hadr.data.frame import Frame
from hadr.training.frames.batches import FrameTensors, load_frames


def test_oracle_erases_the_object_and_nothing_else(glass_frame: Callable[..., Frame]) -> None:
    loaded = load_frames([glass_frame()], (32, 24))
    assert loaded.stems == ("0004/000001",)
    mask = loaded.inputs.mask[0]
    assert mask.sum() == 4 * 10
    assert torch.all(loaded.inputs.depth[0][mask] == 0)
    assert torch.equal(loaded.inputs.depth[0][~mask], loaded.true_depth[0][~mask])
    assert torch.all(loaded.true_depth[0][mask] == 0.5)
    assert loaded.hand_mask.sum() == 5 * 5


def test_the_analytic_models_keep_some_depth_and_follow_the_seed(glass_frame):
    one, two, three = (
        load_frames([glass_frame()], (32, 24), "analytic", seed) for seed in (1, 1, 2)
    )
    assert torch.equal(one.inputs.depth, two.inputs.depth)
    assert not torch.equal(one.inputs.depth, three.inputs.depth)
    inside = one.inputs.depth[0][one.inputs.mask[0]]
    assert 0 < (inside > 0.9).float().mean() < 1  # the background shows through


def test_the_sensor_is_the_frames_raw_depth_and_erased_is_it_without_the_object(glass_frame):
    frame = glass_frame()
    raw = np.where(frame.depth > 0, frame.depth + np.float32(0.003), 0).astype(np.float32)
    raw[frame.object_mask] = 0.83
    raw[:3] = np.nan
    measured = np.nan_to_num(raw)
    erased = np.where(frame.object_mask, 0, measured)
    expected: dict[Corruption, np.ndarray] = {"sensor": measured, "erased": erased}
    for corruption, depth in expected.items():
        loaded = load_frames([replace(frame, raw_depth=raw)], frame.camera.shape[::-1], corruption)
        np.testing.assert_array_equal(loaded.inputs.depth[0].numpy(), depth)
        np.testing.assert_array_equal(loaded.true_depth[0].numpy(), frame.depth)


@pytest.mark.parametrize(
    ("corruption", "missing"),
    [("sensor", "raw"), ("erased", "raw"), ("analytic", "background")],
)
def test_a_frame_without_the_depth_that_a_corruption_takes_is_named(
    glass_frame, corruption, missing
):
    told = {"raw": "raw depth", "background": "depth without the object"}[missing]
    frame = replace(glass_frame(), **{f"{missing}_depth": None})
    with pytest.raises(ValueError, match=rf"0004/000001 has no {told}, .* '{corruption}' takes"):
        load_frames([frame], (32, 24), corruption)


def test_frames_without_object_are_skipped_and_none_at_all_is_an_error(glass_frame):
    loaded = load_frames([glass_frame("1", 0), glass_frame("2")], (32, 24))
    assert loaded.stems == ("0004/2",)
    assert loaded.object_mask.sum() == loaded.inputs.mask.sum() == 4 * 10
    assert len(loaded.inputs.color) == len(loaded.true_depth) == 1
    with pytest.raises(ValueError, match="no frames"):
        load_frames([glass_frame("1", 0)], (32, 24))
    with pytest.raises(ValueError, match=rf"one of {re.escape(str(sorted(CORRUPTIONS)))}, got"):
        load_frames([glass_frame()], (32, 24), "rain")  # type: ignore[arg-type]


def test_colour_is_kept_as_bytes_and_taken_as_floats(glass_frame: Callable[..., Frame]) -> None:
    frame = glass_frame()
    loaded = load_frames([frame], frame.camera.shape[::-1])
    assert loaded.inputs.color.dtype == torch.uint8
    expected = frame.color.transpose(2, 0, 1)
    np.testing.assert_array_equal(loaded.inputs.color[0].numpy(), expected)
    for color in (loaded.take([0]).inputs.color, loaded.inputs.take(slice(0, 1)).color):
        np.testing.assert_array_equal(color[0].numpy(), expected.astype(np.float32) / 255)


def test_taking_and_joining_frames(frames: FrameTensors) -> None:
    some = frames.take([4, 1])
    assert some.stems == ("0000/004", "0000/001")
    assert torch.equal(some.true_keypoints, frames.true_keypoints[[4, 1]])
    both = FrameTensors.join([some, frames.take(torch.tensor([0]))])
    assert both.stems == ("0000/004", "0000/001", "0000/000")
    assert torch.equal(both.inputs.depth, frames.inputs.depth[[4, 1, 0]])
    assert torch.equal(both.object_mask, frames.object_mask[[4, 1, 0]])


def test_threads_keep_order_and_chance(glass_frame: Callable[..., Frame]) -> None:
    many = [glass_frame(f"{n:06d}") for n in range(20)]
    together = load_frames(many, (32, 24), "analytic", seed=3)
    assert together.stems == tuple(f"0004/{n:06d}" for n in range(20))
    assert not torch.equal(together.inputs.depth[0], together.inputs.depth[1])
    again = load_frames((frame for frame in many), (32, 24), "analytic", seed=3)
    assert torch.equal(together.inputs.depth, again.inputs.depth)


def test_frames_without_object_stay_where_all_are_asked_for(glass_frame):
    frames = [glass_frame("1", 0), glass_frame("2")]
    loaded = load_frames(frames, (32, 24), keep_all=True)
    assert loaded.stems == ("0004/1", "0004/2")
    assert not loaded.object_mask[0].any()

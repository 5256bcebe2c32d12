from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch

from hadr.data.transhand import Frame
from hadr.training.batches import FrameTensors, augment_batch, batches, load_frames


def test_oracle_erases_the_object_and_nothing_else(glass_frame: Callable[..., Frame]) -> None:
    loaded = load_frames([glass_frame()], (32, 24))
    assert loaded.stems == ("0004/000001",)
    mask = loaded.inputs.mask[0]
    assert mask.sum() == 4 * 10
    assert torch.all(loaded.inputs.depth[0][mask] == 0)
    assert torch.equal(loaded.inputs.depth[0][~mask], loaded.true_depth[0][~mask])
    assert torch.all(loaded.true_depth[0][mask] == 0.5)
    assert loaded.hand_mask.sum() == 5 * 5


def test_the_analytic_models_keep_some_depth_and_follow_the_seed(
    glass_frame: Callable[..., Frame],
) -> None:
    one, two, three = (
        load_frames([glass_frame()], (32, 24), "analytic", seed) for seed in (1, 1, 2)
    )
    assert torch.equal(one.inputs.depth, two.inputs.depth)
    assert not torch.equal(one.inputs.depth, three.inputs.depth)
    inside = one.inputs.depth[0][one.inputs.mask[0]]
    assert 0 < (inside > 0.9).float().mean() < 1  # the background shows through


def test_the_sensor_is_the_frames_raw_depth_as_it_was_measured(
    glass_frame: Callable[..., Frame],
) -> None:
    frame = glass_frame()
    raw = np.where(frame.depth > 0, frame.depth + np.float32(0.003), 0).astype(np.float32)
    raw[frame.object_mask] = 0.83
    raw[:3] = np.nan
    loaded = load_frames([replace(frame, raw_depth=raw)], frame.camera.shape[::-1], "sensor")
    expected = np.nan_to_num(raw)
    np.testing.assert_array_equal(loaded.inputs.depth[0].numpy(), expected)
    np.testing.assert_array_equal(loaded.true_depth[0].numpy(), frame.depth)


def test_a_frame_without_raw_depth_is_named(glass_frame: Callable[..., Frame]) -> None:
    with pytest.raises(ValueError, match="frame 0004/000001 has no raw depth"):
        load_frames([glass_frame()], (32, 24), "sensor")


def test_frames_without_object_are_skipped_and_none_at_all_is_an_error(
    glass_frame: Callable[..., Frame],
) -> None:
    loaded = load_frames([glass_frame("1", 0), glass_frame("2")], (32, 24))
    assert loaded.stems == ("0004/2",)
    with pytest.raises(ValueError, match="no frames"):
        load_frames([glass_frame("1", 0)], (32, 24))
    with pytest.raises(ValueError, match=r"one of \['analytic', 'oracle', 'sensor'\], got 'rain'"):
        load_frames([glass_frame()], (32, 24), "rain")  # type: ignore[arg-type]


def test_batches_serve_each_frame_once(frames: FrameTensors) -> None:
    generator = torch.Generator().manual_seed(0)
    served = list(batches(frames, 4, generator))
    assert [len(inputs) for inputs, _ in served] == [4, 2]
    depths = torch.cat([truth[:, 10, 15] for _, truth in served])
    expected = frames.true_depth[:, 10, 15]
    assert sorted(depths.tolist()) == sorted(expected.tolist())
    assert depths.tolist() != expected.tolist()
    in_order = torch.cat([truth[:, 10, 15] for _, truth in batches(frames, 4)])
    assert torch.equal(in_order, expected)


def test_augmentation_changes_some_colours_and_follows_the_generator() -> None:
    color = torch.rand(16, 3, 24, 32, generator=torch.Generator().manual_seed(1))
    one = augment_batch(color, torch.Generator().manual_seed(5))
    two = augment_batch(color, torch.Generator().manual_seed(5))
    assert torch.equal(one, two)
    assert one.shape == color.shape
    assert one.min() >= 0
    assert one.max() <= 1
    changed = (one - color).abs().amax(dim=(1, 2, 3)) > 0.01
    assert 0 < changed.sum() < 16

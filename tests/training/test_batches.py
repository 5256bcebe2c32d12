from __future__ import annotations

import numpy as np
import pytest
import torch

from hadr.camera import Intrinsics
from hadr.data.transhand import Frame
from hadr.training.batches import FrameTensors, augment_batch, batches, load_frames

CAMERA = Intrinsics(60.0, 60.0, 31.5, 23.5, 64, 48)


def frame(stem: str = "000001", object_rows: int = 8) -> Frame:
    rng = np.random.default_rng(0)
    depth = np.full(CAMERA.shape, 1.0, np.float32)
    glass = np.zeros(CAMERA.shape, bool)
    glass[20 : 20 + object_rows, 20:40] = True
    hand = np.zeros(CAMERA.shape, bool)
    hand[20:30, 10:20] = True
    depth[glass | hand] = 0.5
    return Frame(
        stem=stem,
        object_id="0004",
        split="train",
        color=rng.integers(0, 256, (*CAMERA.shape, 3), dtype=np.uint8),
        depth=depth,
        hand_mask=hand,
        object_mask=glass,
        keypoints=rng.normal(0, 0.03, (21, 3)) + np.array([0, 0, 0.5]),
        keypoints_uv=np.zeros((21, 2)),
        camera=CAMERA,
        world_from_camera=np.eye(4),
        background_depth=np.full(CAMERA.shape, 1.0, np.float32),
    )


def test_oracle_erases_the_object_and_nothing_else() -> None:
    loaded = load_frames([frame()], (32, 24))
    assert loaded.stems == ("0004/000001",)
    mask = loaded.inputs.mask[0]
    assert mask.sum() == 4 * 10
    assert torch.all(loaded.inputs.depth[0][mask] == 0)
    assert torch.equal(loaded.inputs.depth[0][~mask], loaded.true_depth[0][~mask])
    assert torch.all(loaded.true_depth[0][mask] == 0.5)
    assert loaded.hand_mask.sum() == 5 * 5


def test_the_simulated_sensor_keeps_some_depth_and_follows_the_seed() -> None:
    one, two, three = (load_frames([frame()], (32, 24), "sensor", seed) for seed in (1, 1, 2))
    assert torch.equal(one.inputs.depth, two.inputs.depth)
    assert not torch.equal(one.inputs.depth, three.inputs.depth)
    inside = one.inputs.depth[0][one.inputs.mask[0]]
    assert 0 < (inside > 0.9).float().mean() < 1  # the background shows through


def test_frames_without_object_are_skipped_and_none_at_all_is_an_error() -> None:
    loaded = load_frames([frame("1", 0), frame("2")], (32, 24))
    assert loaded.stems == ("0004/2",)
    with pytest.raises(ValueError, match="no frames"):
        load_frames([frame("1", 0)], (32, 24))
    with pytest.raises(ValueError, match=r"one of \['oracle', 'sensor'\], got 'rain'"):
        load_frames([frame()], (32, 24), "rain")  # type: ignore[arg-type]


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

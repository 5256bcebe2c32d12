"""A micro network and six little frames, made of a wall, a hand's strip and a glass's square."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from hadr.camera import Intrinsics
from hadr.data.frame import Frame
from hadr.models.backbone import BackboneConfig
from hadr.models.hadr import HADRConfig
from hadr.models.network_input import HADRInput
from hadr.training.frames.batches import FrameTensors
from hadr.training.loop import Trained, train
from hadr.training.recipe import Preset

MICRO = Preset(
    name="micro",
    width=32,
    height=24,
    model=HADRConfig(
        backbone=BackboneConfig(embed_dim=8, depths=(1, 1), heads=(1, 2), window=4, drop_path=0.3),
        decoder_widths=(32, 16),
        voxel_width=24,
        max_points=200,
    ),
    epochs=4,
    drop_epoch=3,
    batch_size=4,
    true_voxel_epochs=1,
)


@pytest.fixture(scope="session")
def micro() -> Preset:
    return MICRO


def little_frames(count: int = 6, seed: int = 0) -> FrameTensors:
    """Frames, each with its distance of hand and glass, and noise for colour."""
    generator = torch.Generator().manual_seed(seed)
    height, width = 24, 32
    near = torch.linspace(0.45, 0.7, count)
    depth = torch.full((count, height, width), 1.1)
    mask = torch.zeros(count, height, width, dtype=torch.bool)
    hand = torch.zeros_like(mask)
    mask[:, 8:16, 12:20] = True
    hand[:, 8:16, 8:12] = True
    depth = torch.where(mask | hand, near[:, None, None], depth)
    keypoints = 0.03 * torch.randn(count, 21, 3, generator=generator)
    keypoints[..., 2] += near[:, None]
    keypoints[..., 0] -= 0.08
    uv = 40 * keypoints[..., :2] / keypoints[..., 2:] + torch.tensor([15.5, 11.5])
    color = torch.rand(count, 3, height, width, generator=generator)
    intrinsics = torch.tensor([[40.0, 40.0, 15.5, 11.5]]).repeat(count, 1)
    inputs = HADRInput(color, depth * ~mask, mask, intrinsics, keypoints, uv)
    stems = tuple(f"0000/{n:03d}" for n in range(count))
    return FrameTensors(inputs, depth, hand, mask, keypoints, stems)


@pytest.fixture(scope="session")
def make_frames() -> Callable[..., FrameTensors]:
    """Builds little frames: (count, seed)."""
    return little_frames


@pytest.fixture(scope="session")
def frames() -> FrameTensors:
    return little_frames()


@pytest.fixture(scope="session")
def through(
    micro: Preset, frames: FrameTensors, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Trained, Path]:
    """A whole training of the micro network with seed 3, and its folder, which is only read."""
    folder = tmp_path_factory.mktemp("through")
    return train(micro, frames, frames, folder=folder, seed=3, progress=False), folder


CAMERA = Intrinsics(60.0, 60.0, 31.5, 23.5, 64, 48)


def _frame(stem: str = "000001", object_rows: int = 8) -> Frame:
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


@pytest.fixture(scope="session")
def glass_frame() -> Callable[..., Frame]:
    """Builds a frame with a glass's block and a hand's beside it: (stem, object_rows)."""
    return _frame

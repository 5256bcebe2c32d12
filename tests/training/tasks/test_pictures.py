from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import torch
from torch import nn

from hadr.models.network_input import HADRInput
from hadr.training.frames.batches import FrameTensors
from hadr.training.tasks.pictures import _window, depth_picture, save_png


class Off(nn.Module):
    """Restores the truth of the little frames but for an offset."""

    def __init__(self, frames: FrameTensors, offset_m: float) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.zeros(1))
        self.frames, self.offset_m = frames, offset_m

    def forward(self, inputs: HADRInput) -> SimpleNamespace:
        near = inputs.keypoints.median(dim=1).values[:, 2]
        rows = [int((self.frames.inputs.keypoints.median(1).values[:, 2] - z).abs().argmin())
                for z in near]  # fmt: skip
        return SimpleNamespace(depth=self.frames.true_depth[rows] + self.offset_m)


def error_panel(picture: np.ndarray) -> np.ndarray:
    return picture[22:, -picture.shape[1] // 5 :].reshape(-1, 3).astype(int)


def test_errors_behind_are_red_and_errors_in_front_blue(frames: FrameTensors) -> None:
    behind, front = (error_panel(depth_picture(Off(frames, o), frames)) for o in (0.05, -0.05))
    red, blue = (200, 30, 30), (30, 60, 200)
    assert (behind == red).all(axis=1).mean() > 0.2
    assert not (behind == blue).all(axis=1).any()
    assert (front == blue).all(axis=1).mean() > 0.2
    right = error_panel(depth_picture(Off(frames, 0.0), frames))
    assert not (right == red).all(axis=1).any()
    assert not (right == blue).all(axis=1).any()


def test_the_window_is_the_half_around_the_mask() -> None:
    mask = np.zeros((10, 20), bool)
    mask[4:6, 15:18] = True
    assert _window(mask) == (slice(3, 8), slice(10, 20))
    mask[0] = True
    assert _window(mask) == (slice(None), slice(None))


def test_a_png_is_written_whole(tmp_path: Path) -> None:
    picture = np.zeros((4, 5, 3), np.uint8)
    picture[..., 0] = 200
    save_png(tmp_path / "new" / "a.png", picture)
    read = cv2.imread(str(tmp_path / "new" / "a.png"))
    assert read is not None
    assert read[0, 0].tolist() == [0, 0, 200]  # BGR
    assert [p.name for p in (tmp_path / "new").iterdir()] == ["a.png"]

"""`benchmarks/networks/frame_errors.py`: the parts of an error, by hand."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest
import torch


@pytest.fixture
def errors(load_benchmark: Callable[[str], ModuleType]) -> ModuleType:
    return load_benchmark("networks/frame_errors")


def test_place_shape_and_tilt_by_hand(errors: ModuleType) -> None:
    truth = np.full((5, 7), 0.7)
    mask = np.zeros((5, 7), bool)
    mask[1:4, 2:5] = True
    _, column = np.indices((5, 7))
    shifted = errors.frame_error("0001", truth + 0.02, truth, mask)
    assert (shifted.rmse_m, shifted.place_m) == pytest.approx((0.02, 0.02))
    assert (shifted.shape_m, shifted.tilt_m) == pytest.approx((0, 0), abs=1e-9)
    tilted = errors.frame_error("0001", truth - 0.01 + 0.03 * (column - 3), truth, mask)
    assert tilted.place_m == pytest.approx(0.01)
    assert (shifted.bias_m, tilted.bias_m) == pytest.approx((0.02, -0.01))
    assert tilted.shape_m == pytest.approx(0.03 * (2 / 3) ** 0.5)
    assert tilted.tilt_m == pytest.approx(0, abs=1e-9)
    bent = errors.frame_error("0001", truth + 0.03 * (column == 3), truth, mask)
    assert bent.place_m == pytest.approx(0)
    assert bent.shape_m == pytest.approx(0.03 / 3**0.5)
    assert bent.tilt_m == pytest.approx(0.03 * (1 / 3 * 2 / 3) ** 0.5)  # its own deviation


def test_an_empty_mask_is_refused(errors: ModuleType) -> None:
    with pytest.raises(ValueError, match="no pixel of the object"):
        errors.frame_error("0001", np.ones((2, 2)), np.ones((2, 2)), np.zeros((2, 2), bool))


def test_distance_from_the_nearest_pose_counts_mirrored_ones(errors: ModuleType) -> None:
    learned = torch.zeros(2, 21, 3)
    learned[0, :, 0], learned[1, :, 1] = 0.05, 0.2
    asked = torch.zeros(3, 21, 3)
    asked[0, :, 0], asked[1, :, 1], asked[2, :, 0] = 0.06, 0.17, -0.05
    found = errors.pose_distance(asked.flatten(1), learned.flatten(1))
    assert found.tolist() == pytest.approx([0.01, 0.03, 0.0], abs=1e-6)
    with pytest.raises(ValueError, match="no learned pose"):
        errors.pose_distance(asked.flatten(1), learned[:0].flatten(1))


def test_a_summary_by_object_and_pose(errors: ModuleType) -> None:
    frames = [
        errors.FrameError(f"000{n % 2}", 0.01 * (n + 1), 0.0, -0.002 * n, 0.0, 0.0)
        for n in range(6)
    ]
    found = errors.summary(frames, torch.tensor([0.6, 0.5, 0.4, 0.3, 0.2, 0.1]))
    assert found["rmse_m"] == pytest.approx(0.035)
    assert found["by_object"]["0000"]["rmse_m"] == pytest.approx(0.03)
    assert found["by_object"]["0001"]["frames"] == 3
    assert found["by_object"]["0000"]["bias_m"] == pytest.approx(-0.004)
    assert [part["rmse_m"] for part in found["by_pose"]] == pytest.approx([0.055, 0.035, 0.015])
    assert found["rank_correlation"] == pytest.approx(-1)

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from hadr.models.hadr import HADR
from hadr.training.evaluation import averages, compare, evaluate, predict_depth, score
from hadr.training.frames.batches import FrameTensors
from hadr.training.recipe import Preset


def test_score_is_over_the_objects_pixels_and_a_hole_is_scored_as_zero(frames):
    depth = frames.true_depth.numpy().copy()
    mask = frames.inputs.mask.numpy()
    depth[~mask] = 9.0  # outside: does not matter
    depth[0][mask[0]] += 0.02
    depth[1][mask[1]] = 0
    found = score(depth, frames)
    assert found[0].rmse_m == pytest.approx(0.02, abs=1e-6)
    assert found[1].mae_m == pytest.approx(float(frames.true_depth[1][mask[1]].mean()), abs=1e-6)
    assert (found[1].coverage, found[1].delta_125) == (0.0, 0.0)
    assert found[2].rmse_m == pytest.approx(0, abs=1e-7)


def test_predicted_depth_keeps_what_was_measured(micro: Preset, frames: FrameTensors) -> None:
    torch.manual_seed(0)
    model = HADR(micro.model)
    model.train()
    depth = predict_depth(model, frames, batch_size=4)
    assert model.training
    outside = ~frames.inputs.mask.numpy()
    np.testing.assert_array_equal(depth[outside], frames.true_depth.numpy()[outside])
    assert (depth[~outside] > 0).all()
    again = evaluate(model, frames, batch_size=1)
    for a, b in zip(again, score(depth, frames), strict=True):
        assert a.rmse_m == pytest.approx(b.rmse_m, abs=1e-5)


def test_the_truth_has_no_say_in_a_prediction(micro: Preset, frames: FrameTensors) -> None:
    torch.manual_seed(0)
    model = HADR(micro.model)
    lie = replace(
        frames,
        true_depth=frames.true_depth.flip(0),
        true_keypoints=frames.true_keypoints + 1,
        object_mask=~frames.object_mask,
        hand_mask=~frames.hand_mask,
    )
    np.testing.assert_array_equal(predict_depth(model, lie), predict_depth(model, frames))


def test_comparison_on_frames_whose_baselines_are_known(micro, frames):
    rows = averages(compare(frames, {"hadr": HADR(micro.model)}))
    assert list(rows) == ["raw", "inpainting", "nearest", "hand-median", "hadr"]
    # The hand has exactly the glass's depth in these frames, and raw depth is missing.
    assert rows["hand-median"].rmse_m == pytest.approx(0, abs=1e-6)
    assert rows["raw"].coverage == 0.0
    assert rows["raw"].rmse_m == pytest.approx(float(frames.true_depth[:, 10, 15].mean()), abs=1e-6)
    assert rows["nearest"].rmse_m > 0.1
    assert rows["hadr"].frames == 6

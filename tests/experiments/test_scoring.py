from dataclasses import replace

import numpy as np
import pytest
import torch

from hadr.data.samples import open_samples
from hadr.experiments.scoring import (
    EVALUATION_SIZE,
    cheap_depth,
    hand_offset,
    score_cheap,
    score_depth,
    score_network,
)
from hadr.metrics import frame_metrics
from hadr.training.frames.batches import load_frames


@pytest.fixture(scope="module")
def truth():
    return load_frames(open_samples("test")[:3], EVALUATION_SIZE, keep_all=True)


def test_missing_pixels_count_as_zero_and_are_told_apart(truth):
    depth = truth.true_depth.numpy().copy()
    rows, columns = np.nonzero(truth.object_mask[0].numpy())
    depth[0, rows[::2], columns[::2]] = 0
    scores = score_depth(depth, truth)
    expected = frame_metrics(
        depth[0], truth.true_depth[0].numpy(), truth.object_mask[0].numpy(), missing="zero"
    )
    assert scores.frames[0].rmse_m == pytest.approx(expected.rmse_m)
    found = scores.columns()
    assert found["rmse_m"] == pytest.approx(expected.rmse_m / 3)
    assert found["restored"]["rmse_m"] == 0
    assert found["coverage"] == pytest.approx((expected.coverage + 2) / 3)


def test_what_learns_nothing_answers_in_the_given_mask_and_is_filled_around_it(truth):
    narrow = truth.object_mask.clone()
    narrow[:, ::2] = False  # of each second row no pixel was found
    found = score_cheap(replace(truth, inputs=replace(truth.inputs, mask=narrow)), "hand-median")
    whole = score_cheap(truth, "hand-median")  # one depth in the whole mask
    for some, all_of_it in zip(found.frames, whole.frames, strict=True):
        assert some.rmse_m == pytest.approx(all_of_it.rmse_m, rel=1e-5)
    share = (narrow & truth.object_mask).sum() / truth.object_mask.sum()
    assert found.columns()["coverage"] == pytest.approx(float(share), abs=0.05)


def test_the_hands_offset_is_the_mean_over_frames_of_what_lies_behind_its_median_depth(truth):
    """Frames of which the glass is put 1, 3 and 5 cm behind the hand: 3 cm, whatever their size."""
    hand = torch.from_numpy(cheap_depth(truth, "hand-median"))
    behind = replace(truth, true_depth=hand + torch.tensor([0.01, 0.03, 0.05])[:, None, None])
    assert hand_offset(behind) == pytest.approx(0.03, abs=1e-6)


def test_pooled_weighs_by_pixels(truth):
    depth = truth.true_depth.numpy().copy()
    depth[0] += 0.03
    counts = truth.object_mask.numpy().sum(axis=(1, 2))
    found = score_depth(depth, truth).columns()
    assert found["mae_m"] == pytest.approx(0.01, rel=1e-4)
    assert found["pooled"]["mae_m"] == pytest.approx(0.03 * counts[0] / counts.sum(), rel=1e-4)


def test_the_pooled_coverage_is_the_pixels_share_and_not_the_frames_mean(truth):
    """The first glass is restored whole, of the second, a single row of it, nothing."""
    two = truth.take([0, 1])
    two.object_mask[1] &= torch.arange(126)[:, None] == two.object_mask[1].nonzero()[0, 0]
    depth = two.true_depth.numpy().copy()
    depth[1] = 0
    counts = (two.object_mask & (two.true_depth > 0)).sum(dim=(1, 2)).tolist()
    for scores in (score_depth(depth, two), score_depth(two.true_depth.numpy(), two, depth > 0)):
        assert scores.columns()["coverage"] == 0.5
        assert scores.pooled.coverage == counts[0] / sum(counts) > 0.9


def test_frames_that_show_nothing_are_left_out(truth):
    hidden = truth.object_mask.clone()
    hidden[1] = False
    scores = score_depth(truth.true_depth.numpy(), replace(truth, object_mask=hidden))
    assert scores.stems == (truth.stems[0], truth.stems[2])
    with pytest.raises(ValueError, match="none of the 3 frames shows an object"):
        score_depth(truth.true_depth.numpy(), replace(truth, object_mask=hidden & False))


class Oracle(torch.nn.Module):
    """Gives the true depth of the frames it is called with, at their size."""

    def __init__(self, frames, gap):
        super().__init__()
        self.frames, self.gap, self.weight = frames, gap, torch.nn.Parameter(torch.zeros(1))

    def forward(self, inputs):
        depth = self.frames.true_depth * self.frames.object_mask
        depth[:, :: self.gap] = 0
        return type("Output", (), {"depth": depth, "restored": depth > 0})()


def test_a_network_is_scored_at_the_common_size(truth):
    """A network of another size that is right there has the error of enlarging only."""
    given = load_frames(open_samples("test")[:3], (256, 144), keep_all=True)
    found = score_network(Oracle(given, 1000), given, truth).columns()
    cheap = score_depth(cheap_depth(truth, "hand-median"), truth).columns()
    assert found["coverage"] == 1
    assert found["mae_m"] < 0.004 < cheap["mae_m"]
    assert found["delta_105"] > 97


def test_what_a_network_leaves_out_is_filled_in_one_number_and_left_out_in_the_other(truth):
    """Every third row has no answer: two thirds are its own, all of them have a depth."""
    given = load_frames(open_samples("test")[:3], (224, 126), keep_all=True)
    found = score_network(Oracle(given, 3), given, truth).columns()
    assert found["restored"]["rmse_m"] == pytest.approx(0, abs=1e-6)
    assert 0.6 < found["coverage"] < 0.72
    assert 0 < found["rmse_m"] < 0.01, "filled from the rows beside it, not 0 metres away"


def test_other_frames_are_refused(truth):
    given = load_frames(open_samples("test")[1:3], (128, 72), keep_all=True)
    with pytest.raises(ValueError, match="not those at the evaluation size"):
        score_network(Oracle(given, 2), given, truth)
    with pytest.raises(ValueError, match=r"shape \(3, 72, 128\)"):
        score_depth(np.ones((3, 72, 128), np.float32), truth)

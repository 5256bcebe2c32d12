"""A depth network on one frame: networks whose answer is known stand in for trained ones."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor, nn

from hadr.camera import Intrinsics, resize_mask
from hadr.confidence.calibration import Calibration, ConfidenceRule
from hadr.models.network_input import enlarge_restored
from hadr.trained_finders import HandKeypoints, Segmentation
from hadr.trained_networks import DepthNetwork
from hadr.training.checkpoints import trained_corruption

CAMERA = Intrinsics(fx=100, fy=100, cx=39.5, cy=29.5, width=80, height=60)
SMALL = (20, 15)  # four times smaller


@dataclass
class Images:
    depth: Tensor
    confidence: Tensor
    restored: Tensor
    spread: Tensor


class StandIn(nn.Module):
    """Answers what it was told to, and keeps what it was given."""

    def __init__(self, depth, confidence=0.5, restored=None, spread=0.01) -> None:
        super().__init__()
        image = np.broadcast_to(np.asarray(depth, np.float32), (SMALL[1], SMALL[0]))
        self.depth = torch.from_numpy(image.copy())[None]
        self.confidence = torch.full_like(self.depth, confidence)
        self.spread = torch.full_like(self.depth, spread)
        self.restored = self.depth > 0 if restored is None else torch.from_numpy(restored)[None]
        self.given = self.cut = None

    def forward(self, inputs) -> Images:
        self.given = inputs
        answer = Images(self.depth, self.confidence, self.restored, self.spread)
        if self.cut is not None:
            answer.clamped = self.cut
        return answer


def network(model: nn.Module, **changes) -> DepthNetwork:
    plain = DepthNetwork(
        model=model,
        kind="hadr-plus",
        size=SMALL,
        needs_hand=False,
        corruption="oracle",
        rule=None,
        learned_range_m=None,
        ground=None,
        name="stand-in",
        trained="never",
    )
    return replace(plain, **changes)


def ask(answer: DepthNetwork, mask: np.ndarray):
    color = np.full((60, 80, 3), 99, np.uint8)
    depth = np.where(mask, 0, 0.8).astype(np.float32)
    return answer.restore(color, depth, CAMERA, mask, None)


def box() -> np.ndarray:
    mask = np.zeros((60, 80), bool)
    mask[16:40, 20:60] = True
    return mask


def test_the_answer_comes_back_at_full_size_inside_the_mask_only() -> None:
    found = ask(network(StandIn(0.7, 0.25)), box())
    np.testing.assert_array_equal(found.restored, box())
    np.testing.assert_allclose(found.depth, np.where(box(), 0.7, 0), rtol=1e-6)
    np.testing.assert_allclose(found.confidence, np.where(box(), 0.25, 0))
    assert (found.no_answer, found.out_of_range) == (0, 0)


def test_a_hole_in_the_answer_stays_a_hole() -> None:
    """No answer left of column 10 of 20: half of the mask is missing, and not filled."""
    answer = np.where(np.indices((15, 20))[1] < 10, 0, 0.7)
    found = ask(network(StandIn(answer)), box())
    right = box() & (np.indices((60, 80))[1] >= 40)
    np.testing.assert_array_equal(found.restored, right)
    np.testing.assert_allclose(found.depth[right], 0.7, rtol=1e-6)
    assert (found.depth[~right] == 0).all()
    assert (found.confidence[~right] == 0).all()
    assert found.no_answer == 0.5


def test_beyond_the_learned_range_is_not_restored() -> None:
    answer = np.where(np.indices((15, 20))[1] < 10, 3.0, 0.7)
    free = ask(network(StandIn(answer)), box())
    assert free.restored.sum() == box().sum()
    held = ask(network(StandIn(answer), learned_range_m=(0.4, 1.2)), box())
    np.testing.assert_array_equal(held.restored, box() & (np.indices((60, 80))[1] >= 40))
    np.testing.assert_allclose(held.depth[held.restored], 0.7, rtol=1e-6)
    assert (held.no_answer, held.cut_off, held.out_of_range) == (0, 0, 0.5)
    model = StandIn(answer)
    model.cut = torch.from_numpy(answer < 1)[None]
    cut = ask(network(model, kind="hadr", learned_range_m=(0.4, 1.2)), box())
    assert (cut.no_answer, cut.cut_off, cut.out_of_range) == (0, 0.5, 0.5)


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.floats(0, 1), st.floats(0, 1))
def test_what_is_restored_has_a_depth_in_range_and_nothing_else_has(seed, answers, shape) -> None:
    """Whatever a network says: holes, zeros marked as restored, negative and far depth."""
    rng = np.random.default_rng(seed)
    depth = rng.choice([-1.0, 0.0, 0.5, 0.9, 4.0], size=(15, 20))
    restored = rng.random((15, 20)) < answers
    mask = rng.random((60, 80)) < shape**3
    mask[int(rng.integers(60)), int(rng.integers(80))] = True
    held = network(StandIn(depth, 0.9, restored), learned_range_m=(0.4, 1.2))
    found = ask(held, mask)
    assert not (found.restored & ~mask).any()
    assert (found.depth[found.restored] >= 0.5 - 1e-6).all()
    assert (found.depth[found.restored] <= 0.9 + 1e-6).all()
    assert (found.depth[~found.restored] == 0).all()
    assert (found.confidence[~found.restored] == 0).all()
    good = restored & (depth > 0.4) & (depth < 1.2)
    if not good.any():
        assert not found.restored.any()


def test_a_rule_turns_the_score_into_a_probability() -> None:
    """A spread of 99 mm has the signal -log 0.1; there the score is 1/2."""
    calibration = Calibration((0.0, 0.5, 1.0), (0.1, 0.3, 0.9))
    rule = ConfidenceRule(-float(np.log(0.1)), 0.2, calibration)
    found = ask(network(StandIn(0.7, spread=0.099), rule=rule), box())
    np.testing.assert_allclose(found.confidence[box()], 0.3, atol=1e-4)
    found = ask(network(StandIn(0.7, spread=0.0), rule=rule), box())
    np.testing.assert_allclose(found.confidence[box()], 0.9, atol=1e-3)


def test_a_network_whose_score_says_nothing_gets_no_confidence() -> None:
    """HADR's probability is that of a voxel; a rule that an older checkpoint holds is left."""
    silent = network(StandIn(0.7, 0.9), kind="hadr")
    assert not silent.can_say
    assert (ask(silent, box()).confidence == 0).all()
    model = StandIn(0.7)
    model.config = None
    stored = {"signals": ["network", "neighbours"], "center": [0, 0], "scale": [1, 1]}
    record = {"network": "hadr", "width": 20, "height": 15, "confidence": stored}
    assert DepthNetwork.of(model, record, "old.safetensors").rule is None


def test_a_thin_mask_is_seen_and_answered() -> None:
    mask = np.zeros((60, 80), bool)
    mask[31, 41] = True
    model = StandIn(0.7)
    found = ask(network(model), mask)
    assert model.given.mask.any()
    assert (model.given.depth[model.given.mask] == 0).all()
    np.testing.assert_array_equal(found.restored, mask)


def test_enlarged_rims_follow_the_neighbour_in_the_mask() -> None:
    """At the rim a full-size pixel may fall on a small one outside of the mask."""
    asked = np.zeros((5, 5), bool)
    asked[1:4, 1:4] = True
    known = asked.copy()
    known[:, 1] = False
    (values,), restored = enlarge_restored(np.full((1, 5, 5), 2.0), known, asked, (20, 20))
    np.testing.assert_allclose(values, 2.0)
    assert restored[10, 19], "beyond the right rim the restored neighbour decides"
    assert not restored[10, 0], "beyond the left rim the hole does"
    assert not restored[10, 6], "a hole stays a hole"
    (values,), restored = enlarge_restored(np.ones((1, 5, 5)), ~asked & False, asked, (20, 20))
    assert not restored.any()
    assert (values == 0).all()


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(1, 12), st.integers(1, 50), st.integers(1, 50))
def test_enlarging_is_the_common_resizing_of_values_and_masks(seed, small, height, width) -> None:
    """Bilinear as OpenCV's, nearest as the masks'; a window is a part of the whole."""
    rng = np.random.default_rng(seed)
    values = rng.random((small, small + 1)).astype(np.float32)
    all_known = np.ones(values.shape, bool)
    expected = cv2.resize(values, (width, height), interpolation=cv2.INTER_LINEAR)
    (whole,), _ = enlarge_restored(values[None], all_known, all_known, (height, width))
    np.testing.assert_allclose(whole, expected, atol=1e-5)
    known = rng.random(values.shape) < 0.5
    _, restored = enlarge_restored(values[None], known, all_known, (height, width))
    if known.any():
        np.testing.assert_array_equal(restored, resize_mask(known, width, height))
    window = (slice(height // 3, height), slice(0, width // 2 + 1))
    whole = enlarge_restored(values[None], known, all_known, (height, width))
    part = enlarge_restored(values[None], known, all_known, (height, width), window)
    np.testing.assert_array_equal(part[0], whole[0][:, *window])
    np.testing.assert_array_equal(part[1], whole[1][window])


def test_enlarging_is_bilinear_inside_and_nearest_outside() -> None:
    known = np.zeros((10, 10), bool)
    known[2:8, 2:8] = True
    v, u = np.indices((10, 10))
    values = np.where(known, 1.0 + 0.1 * u + 0.01 * v, 99.0)
    (large,), _ = enlarge_restored(values[None], known, known, (40, 40))
    v, u = np.indices((40, 40))
    exact = 1.0 + 0.1 * ((u + 0.5) / 4 - 0.5) + 0.01 * ((v + 0.5) / 4 - 0.5)
    np.testing.assert_allclose(large[12:28, 12:28], exact[12:28, 12:28], atol=1e-5)
    assert large.max() < 1.8, "unknown pixels must not bleed in"
    np.testing.assert_allclose(large[0, 0], values[2, 2], rtol=1e-6)
    np.testing.assert_allclose(large[39, 39], values[7, 7], rtol=1e-6)


@pytest.mark.parametrize(
    ("meta", "corruption"),
    [
        ({}, "oracle"),
        ({"corruption": "oracle: depth erased in the object's mask; true keypoints"}, "oracle"),
        ({"data": {"corruption": "sensor"}}, "sensor"),
        ({"data": {"corruption": "analytic"}}, "analytic"),
        ({"data": {"corruption": "erased"}}, "erased"),
        ({"data": {"folder": "somewhere"}, "corruption": "oracle: erased"}, "oracle"),
    ],
)
def test_what_the_record_says_about_depth_in_the_mask(meta, corruption) -> None:
    assert trained_corruption(meta) == corruption


def test_only_depth_networks_restore_depth() -> None:
    model = StandIn(1.0)
    model.config = None
    with pytest.raises(ValueError, match=r"x.safetensors holds a network of kind 'segmentation'"):
        DepthNetwork.of(model, {"network": "segmentation"}, "x.safetensors")


def test_a_missing_or_wrong_checkpoint_is_named(tmp_path) -> None:
    from hadr.rivals.unet_hand import UNetHand, UNetHandConfig
    from hadr.training.checkpoints import save_checkpoint

    for kind in (DepthNetwork, Segmentation, HandKeypoints):
        with pytest.raises(FileNotFoundError, match=r"no checkpoint at .*gone.safetensors"):
            kind.load(tmp_path / "gone.safetensors")
    path = tmp_path / "depth.safetensors"
    save_checkpoint(path, UNetHand(UNetHandConfig(width=4, levels=2)), {"width": 64, "height": 40})
    loaded = DepthNetwork.load(path)
    assert (loaded.kind, loaded.size) == ("unet-hand", (64, 40))
    assert loaded.title == "U-Net with the hand"
    with pytest.raises(ValueError, match="of kind 'unet-hand', expected 'segmentation'"):
        Segmentation.load(path)
    with pytest.raises(ValueError, match="of kind 'unet-hand', expected 'hand-keypoints'"):
        HandKeypoints.load(path)

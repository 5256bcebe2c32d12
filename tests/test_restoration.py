import dataclasses
import re

import numpy as np
import pytest

from hadr import restoration
from hadr.camera import Intrinsics
from hadr.confidence.calibration import Calibration, ConfidenceRule
from hadr.data.samples import open_samples
from hadr.hand import forward_kinematics, keypoints_from_skeleton
from hadr.models.hand.plausible import NoHandError
from hadr.models.networks import DEPTH_NETWORKS
from hadr.restoration import Restorer, restore
from hadr.trained_finders import SeenMasks

RULE = ConfidenceRule(0.0, 1.0, Calibration((0.2, 0.8), (0.3, 0.3))).to_dict()
CAMERA = Intrinsics(fx=100, fy=100, cx=39.5, cy=29.5, width=80, height=60)


def frame() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Colour, depth with a hole and a mask twice as wide as the hole."""
    color = np.full((60, 80, 3), (150, 128, 100), np.uint8)  # as skin is
    depth = np.full((60, 80), 0.8, np.float32)
    mask = np.zeros((60, 80), bool)
    mask[20:40, 30:50] = True
    depth[20:40, 30:40] = 0.0
    depth[20:40, 40:50] = 1.5  # the wall behind the glass
    return color, depth, mask


def hand(z: float = 0.81) -> np.ndarray:
    """An adult's flat hand at depth z, fingers up, its thumb at column 31 beside the mask."""
    flat = keypoints_from_skeleton(forward_kinematics(np.zeros(20)).joints) * [1, -1, 0]
    return flat + np.array([-8.5 / 100 * abs(z) - flat[:, 0].max(), 0.1, z])


def notes_of(result: restoration.Restoration) -> str:
    """All notes of a result, one a line."""
    return "\n".join(result.notes)


def test_nearest_changes_only_the_mask_and_fills_it() -> None:
    color, depth, mask = frame()
    result = restore(color, depth, CAMERA, mask, method="nearest")
    np.testing.assert_array_equal(result.depth[~mask], depth[~mask])
    np.testing.assert_allclose(result.depth[mask], 0.8)
    np.testing.assert_array_equal(result.restored, mask)
    np.testing.assert_array_equal(result.confidence, np.where(mask, 0, 1))
    assert result.method == "nearest"
    assert result.depth.dtype == result.confidence.dtype == np.float32
    assert "200 of the mask's 400 pixels had a measured depth" in notes_of(result)


def test_without_mask_the_missing_pixels_are_restored_and_it_says_so() -> None:
    color, depth, _ = frame()
    result = restore(color, depth, CAMERA, method="nearest")
    np.testing.assert_array_equal(result.restored, depth == 0)
    np.testing.assert_array_equal(result.depth[depth > 0], depth[depth > 0])
    assert "no mask given: the 200 pixels without depth" in notes_of(result)


def test_a_complete_frame_without_mask_comes_back_unchanged() -> None:
    color, depth, _ = frame()
    depth[depth == 0] = 0.8
    result = restore(color, depth, CAMERA)
    np.testing.assert_array_equal(result.depth, depth)
    assert result.method == "none"
    assert not result.restored.any()
    assert "nothing to restore" in notes_of(result)


def test_auto_without_hand_says_that_it_is_not_hadr() -> None:
    color, depth, mask = frame()
    result = restore(color, depth, CAMERA, mask)
    assert result.method == "nearest"
    assert re.search(
        "^no checkpoint fits: .* nearest valid depth, not HADR$", notes_of(result), re.M
    )
    with pytest.raises(ValueError, match=r"method hadr: no checkpoint fits: .*21 hand keypoints"):
        restore(color, depth, CAMERA, mask, method="hadr")


def test_auto_without_a_checkpoint_file_says_so(monkeypatch) -> None:
    monkeypatch.setattr(restoration, "CHECKPOINT_NAME", "gone.safetensors")
    color, depth, mask = frame()
    result = restore(color, depth, CAMERA, mask, hand())
    assert result.method == "nearest"
    assert re.search("^no checkpoint fits: .* not HADR$", notes_of(result), re.M)
    with pytest.raises(FileNotFoundError, match=r"no checkpoint at mine.safetensors"):
        restore(color, depth, CAMERA, mask, hand(), checkpoint="mine.safetensors")


def test_inpaint_and_hand_median() -> None:
    color, depth, mask = frame()
    before = depth.copy()
    inpainted = restore(color, depth, CAMERA, mask, method="inpaint")
    np.testing.assert_array_equal(depth, before)
    np.testing.assert_allclose(inpainted.depth[mask], 0.8, atol=1e-3)
    depth[:, :30] = np.where(np.indices((60, 30))[1] > 5, 0.72, 0.8)  # the hand's skin
    median = restore(color, depth, CAMERA, mask, hand(0.7), method="hand-median")
    np.testing.assert_allclose(median.depth[mask], 0.72, atol=1e-6)
    assert (median.confidence[mask] == 0).all()
    with pytest.raises(ValueError, match="hand-median needs 21 hand keypoints"):
        restore(color, depth, CAMERA, mask, method="hand-median")


def test_nan_and_infinity_count_as_missing_and_are_noted() -> None:
    color, depth, mask = frame()
    depth[0, :3] = np.nan
    depth[1, 0] = np.inf
    result = restore(color, depth, CAMERA, mask, method="nearest")
    assert (result.depth[0, :3] == 0).all()
    assert result.depth[1, 0] == 0
    assert "3 pixels of the depth are NaN and count as missing" in result.notes
    assert "1 pixels of the depth are infinite and count as missing" in result.notes
    assert "4 pixels outside the mask have no depth and stay missing" in notes_of(result)


@pytest.mark.parametrize("factor", [0.1, 1, 10])
def test_a_glass_of_an_impossible_size_is_noted(factor: float) -> None:
    color, depth, mask = frame()
    notes = restore(color, depth * np.float32(factor), CAMERA, mask, method="nearest").notes
    expected = f"the glass would measure {16 * factor:.2g} cm, if it is as near as"
    assert any(note.startswith(expected) for note in notes) == (factor != 1)
    assert not any("would measure" in note for note in restore(color, 0.1 * depth, CAMERA).notes)


def test_the_bundled_glasses_have_a_glass_s_size_and_a_picture() -> None:
    for one in open_samples("train")[::20]:
        for depth in (one.raw_depth, one.depth):
            notes = restore(one.color, depth, one.camera, one.object_mask, method="nearest").notes
            assert not any("would measure" in n or "shows nothing" in n for n in notes)


@pytest.mark.parametrize("value", [0, 128])
def test_a_picture_of_nothing_is_noted(value: int) -> None:
    color, depth, mask = frame()
    color[:] = value
    notes = restore(color, depth, CAMERA, mask).notes
    expected = f"shows nothing (98 % of its values lie between {value} and {value} of 255)"
    assert any(expected in note for note in notes)
    color[:30] = 255 - value // 2
    assert not any("shows nothing" in note for note in restore(color, depth, CAMERA, mask).notes)


BAD = {
    "colour is grey": (dict(color=np.zeros((60, 80), np.uint8)), r"colour must be .*\(60, 80\) ui"),
    "colour is float": (dict(color=np.zeros((60, 80, 3))), r"uint8 RGB, got .*float64"),
    "depth is whole numbers": (
        dict(depth=np.full((60, 80), 800, np.uint16)),
        r"depth must be \(H, W\) float metres, got \(60, 80\) uint16",
    ),
    "another size": (
        dict(depth=np.ones((30, 40), np.float32)),
        "depth is 40x30 pixels but colour is 80x60; expected the same size",
    ),
    "another camera": (
        dict(camera=Intrinsics(100, 100, 20, 15, 40, 30)),
        "intrinsics are of a 40x30 image but colour and depth are 80x60",
    ),
    "all missing": (
        dict(depth=np.zeros((60, 80), np.float32)),
        "depth is missing everywhere: all 4800 pixels",
    ),
    "all NaN": (dict(depth=np.full((60, 80), np.nan)), "missing everywhere: all 4800 pixels"),
    "millimetres": (
        dict(depth=np.full((60, 80), 800.0)),
        r"depth has a median of 800, expected metres .* 0.8 m with a scale 1000 times smaller",
    ),
    "tenths of a millimetre": (
        dict(depth=np.full((60, 80), 8000.0)),
        "it would be 0.8 m with a scale 10000 times smaller",
    ),
    "centimetres": (dict(depth=np.full((60, 80), 80.0)), "0.8 m with a scale 100 times smaller"),
    "scaled twice": (
        dict(depth=np.full((60, 80), 0.0008)),
        "median of 0.0008, .* 0.8 m with a scale 1000 times larger",
    ),
    "one mask twice": (
        dict(mask=np.ones((60, 80), bool), hand_mask=np.ones((60, 80), bool)),
        "mask and hand mask share 4800 of the mask's 4800 pixels",
    ),
    "far": (dict(depth=np.where(np.eye(60, 80) > 0, 1e30, 0.8)), "depth is beyond 30 m in 60 pix"),
    "negative": (dict(depth=np.full((60, 80), -0.8)), "depth must not be negative, got -0.8 m in"),
    "empty mask": (dict(mask=np.zeros((60, 80), bool)), "mask is empty: none of its 4800 pixels"),
    "mask of another size": (
        dict(mask=np.ones((30, 40), bool)),
        "mask is 40x30 pixels but depth is 80x60",
    ),
    "mask of bytes": (
        dict(mask=np.ones((60, 80), np.uint8)),
        r"mask must be \(H, W\) bool, got \(60, 80\) uint8",
    ),
    "mask over everything": (dict(mask=np.ones((60, 80), bool)), "the mask covers 100 % of the"),
    "mask inverted": (dict(mask=~frame()[2]), "the mask covers 92 % of the .* is it inverted"),
    "a network without use": (dict(checkpoint="net", method="nearest"), "method nearest uses no"),
    "20 keypoints": (dict(keypoints=hand()[:20]), r"21 keypoints.*got \(20, 3\)"),
    "NaN in the hand": (
        dict(keypoints=np.where(np.arange(21)[:, None] == 4, np.nan, hand())),
        "thumb_tip",
    ),
    "hand behind": (
        dict(keypoints=hand(-0.7)),
        r"hand keypoint 0 \(wrist\) has z = -0.7 m, expected .* in front",
    ),
    "hand in millimetres": (
        dict(keypoints=1000 * hand()),
        r"100(\.\d+)? m from the wrist|141|are the keypoints in metres\?",
    ),
    "method": (dict(method="magic"), "method must be one of auto, hadr.*got 'magic'"),
    "corruption": (dict(corruption="fog"), r"corruption must be one of oracle, .*, got 'fog'"),
    "hand mask": (dict(hand_mask=np.ones((3, 3), bool)), "hand mask is 3x3 pixels but depth is"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_clear_sentence(case: str) -> None:
    color, depth, mask = frame()
    arguments = dict(color=color, depth=depth, camera=CAMERA, mask=mask) | BAD[case][0]
    with pytest.raises(ValueError, match=BAD[case][1]) as caught:
        restore(**arguments)
    assert "\n" not in str(caught.value)


def test_a_hand_beside_the_picture_is_noted() -> None:
    color, depth, mask = frame()
    result = restore(color, depth, CAMERA, mask, hand() + np.array([3, 0, 0]), method="nearest")
    assert "project outside of the image" in notes_of(result)


def checkpoint_file(folder, kind: str = "hadr", **record):
    """An untrained network of a kind, at its smallest, as a checkpoint."""
    import torch

    from hadr.models.networks import NETWORKS
    from hadr.training.checkpoints import save_checkpoint
    from hadr.training.presets import preset

    torch.manual_seed(0)
    model = preset("tiny", kind).model
    if hand := record.pop("hand", None):
        model = dataclasses.replace(model, hand=hand)
    path = folder / f"{kind}.safetensors"
    meta = {"width": 64, "height": 40, "preset": {"name": "tiny"}, "epochs": 0} | record
    save_checkpoint(path, NETWORKS[kind].network_class()(model), meta)
    return path


def test_hadr_restores_only_the_mask_at_full_size_with_its_probability(tmp_path) -> None:
    color, depth, mask = frame()
    path = checkpoint_file(tmp_path)
    result = restore(color, depth, CAMERA, mask, hand(), checkpoint=path)
    assert result.method == "hadr"
    np.testing.assert_array_equal(result.depth[~mask], depth[~mask])
    np.testing.assert_array_equal(result.restored, mask)
    assert (result.depth[mask] > 0).all()
    # A ray ends in an occupied voxel, and all points lie at 0.8 m: cell 0.625 to 0.875 m deep.
    assert result.depth[mask].min() > 0.6
    assert result.depth[mask].max() < 1.4  # plus the leaky clamp's margin along the diagonal
    np.testing.assert_array_equal(result.confidence, ~mask)
    assert "HADR cannot say how sure it is: its confidence is 0" in result.notes
    assert "hadr.safetensors (preset tiny, 0 epochs) ran at 64x40" in notes_of(result)
    again = restore(color, depth, CAMERA, mask, hand(), checkpoint=path)
    np.testing.assert_array_equal(result.depth, again.depth)


def test_a_checkpoint_without_hand_fits_a_frame_without_hand(tmp_path) -> None:
    color, depth, mask = frame()
    with_hand = checkpoint_file(tmp_path)
    result = restore(color, depth, CAMERA, mask, checkpoint=with_hand)
    assert result.method == "nearest"
    assert any(
        "no checkpoint fits: hadr.safetensors needs 21 hand keypoints" in n for n in result.notes
    )
    without_hand = checkpoint_file(tmp_path, hand="none")
    assert restore(color, depth, CAMERA, mask, checkpoint=without_hand).method == "hadr"


def test_a_scene_out_of_the_grid_is_left_missing_and_said_so(tmp_path) -> None:
    """Nothing lies within 2.1 m, so no ray meets an occupied voxel."""
    color, depth, mask = frame()
    depth[depth > 0] = 5.0
    result = restore(color, depth, CAMERA, mask, hand(), checkpoint=checkpoint_file(tmp_path))
    assert not result.restored.any()
    assert (result.depth[mask] == 0).all()
    assert (result.confidence[mask] == 0).all()
    assert "HADR restored nothing" in notes_of(result)
    assert "400 of 400 pixels of the mask could not be restored" in result.notes


def test_measured_depth_in_the_mask_counts_where_it_is_trusted(tmp_path) -> None:
    color, depth, mask = frame()
    path = checkpoint_file(tmp_path)
    other = np.where(mask & (depth > 0), 0.7, depth).astype(np.float32)
    first, second = (
        restore(color, image, CAMERA, mask, hand(), checkpoint=path, corruption="sensor")
        for image in (depth, other)
    )
    assert (first.depth != second.depth).any()
    assert "learned from frames without measured depth" in notes_of(first)
    assert "pixels had a measured depth; it is trusted" in notes_of(first)
    # A checkpoint that learned so takes it without being told.
    path = checkpoint_file(tmp_path, data={"corruption": "sensor"})
    told = restore(color, depth, CAMERA, mask, hand(), checkpoint=path)
    np.testing.assert_array_equal(told.depth, first.depth)
    assert "learned from" not in notes_of(told)
    assert "pixels had a measured depth; it is trusted" in notes_of(told)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        (dict(fx=75.0), r"not be square \(fy is 1.33 times fx\)"),
        (dict(fx=50.0, cx=80.0), r"not be square \(fy is 2.00 times fx\); cx = 80 is 51 %"),
        (dict(cx=30.0, cy=42.0), "camera: cy = 42 is 21 % of the picture off center; are"),
        (dict(fx=160.0, fy=160.0), "would see 28 degrees across, expected 40 to 125"),
        ({}, None),
    ],
)
def test_an_odd_camera_is_noted_whatever_the_method(changed: dict, says: str | None) -> None:
    color, depth, mask = frame()
    camera = dataclasses.replace(CAMERA, **changed)
    notes = [n for n in restore(color, depth, camera, mask, method="nearest").notes if "odd" in n]
    assert len(notes) == (says is not None)
    assert says is None or re.search(says, notes[0])


def test_skin_that_is_gray_or_blue_gives_no_probability(tmp_path) -> None:
    color, depth, mask = frame()
    ground = ground_of_frame(checkpoint_file(tmp_path, "hadr-plus"))
    path = checkpoint_file(tmp_path, "hadr-plus", confidence=RULE, ground=ground)
    said = {}
    gray = np.repeat(color[..., 1:2], 3, axis=2)
    for name, picture in (
        ("as it is", color),
        ("swapped", color[..., ::-1].copy()),
        ("gray", gray),
    ):
        result = restore(picture, depth, CAMERA, mask, hand(), checkpoint=path)
        said[name] = result.tolerance_m, [n for n in result.notes if "redder than blue" in n]
    assert said["as it is"] == (0.02, [])
    for name in ("swapped", "gray"):
        assert said[name][0] is None
        assert "only 0 % of the picture is redder than blue" in said[name][1][0]


def test_what_is_given_and_not_used_is_named() -> None:
    color, depth, mask = frame()
    arm = np.zeros_like(mask)
    arm[50:, 10:40] = True

    def notes(method: str, **more) -> str:
        return "; ".join(restore(color, depth, CAMERA, mask, method=method, **more).notes)

    assert "does not look at" not in notes("nearest")
    assert "nearest does not look at the hand" in notes("nearest", keypoints=hand())
    assert "inpaint does not look at the hand mask" in notes("inpaint", hand_mask=arm)
    assert "does not look at" not in notes("hand-median", keypoints=hand(), hand_mask=arm)
    said = notes("nearest", keypoints=hand())
    assert "redder than blue" not in said
    color = color[..., ::-1].copy()
    assert "only 0 % of the picture is redder than blue" in notes("nearest", keypoints=hand())


@pytest.mark.parametrize("method", ["nearest", "inpaint", "hand-median"])
def test_without_learning_trust_means_to_keep_what_was_measured(method: str) -> None:
    color, depth, mask = frame()
    result = restore(color, depth, CAMERA, mask, hand(), method=method, corruption="sensor")
    np.testing.assert_array_equal(result.depth[depth > 0], depth[depth > 0])
    np.testing.assert_array_equal(result.restored, mask & (depth == 0))
    assert (result.depth > 0).all()
    np.testing.assert_array_equal(result.confidence, depth > 0)
    np.testing.assert_array_equal(result.mask, mask)


def ground_of_frame(path) -> dict:
    """The ground of a network that has learned from `frame` alone."""
    from hadr.camera import resize_depth
    from hadr.confidence.known_ground import Field, Ground
    from hadr.confidence.sight import Sight, observe
    from hadr.models.network_input import frame_to_input
    from hadr.trained_networks import DepthNetwork

    (color, depth, mask), network = frame(), DepthNetwork.load(path)
    given = np.where(mask, 0, depth)
    inputs = frame_to_input(color, given, mask, hand(), CAMERA, network.size)
    small = resize_depth(depth, *network.size)
    one = observe(network.model.requires_grad_(False), "unet", inputs, small, None, color, mask)
    sight = Sight.fit(np.stack((one.seen, one.seen + 1)))
    features = [sight.with_strangeness(one)]
    return Ground({"measured depth": Field.fit(features, features)}, sight).to_dict()


def test_a_calibrated_checkpoint_says_what_its_confidence_means_where_it_holds(tmp_path) -> None:
    """The rule says 0.3 whatever the network's score; the raw score is another."""
    from hadr.press.own_frames.restore_command import Made
    from hadr.press.own_frames.restore_report import confidence_means, report

    color, depth, mask = frame()
    path = checkpoint_file(tmp_path, "hadr-plus")
    plain = restore(color, depth, CAMERA, mask, hand(), checkpoint=path)
    assert plain.tolerance_m is None
    assert "never calibrated" in notes_of(plain)
    checkpoint_file(tmp_path, "hadr-plus", confidence=RULE)
    unknown = restore(color, depth, CAMERA, mask, hand(), checkpoint=path)
    assert unknown.tolerance_m is None
    assert (unknown.confidence[mask] == 0).all()
    assert "plus.safetensors does not say which frames it learned from" in notes_of(unknown)
    assert confidence_means(unknown).startswith("no probability: it is not known")
    checkpoint_file(tmp_path, "hadr-plus", confidence=RULE, ground=ground_of_frame(path))
    sure = restore(color, depth, CAMERA, mask, hand(), checkpoint=path)
    assert sure.ground.inside
    assert sure.tolerance_m == 0.02
    assert "never calibrated" not in notes_of(sure)
    np.testing.assert_allclose(sure.confidence[sure.restored], 0.3, rtol=1e-6)
    assert (sure.confidence[~mask] == 1).all()
    np.testing.assert_array_equal(sure.depth, plain.depth)
    assert not np.allclose(plain.confidence[sure.restored], 0.3)
    assert "does not fit" not in notes_of(sure)
    # A hand that lies 60 cm behind what the camera measured there is used, and says so.
    behind = hand() + np.array([0, 0, 0.59])
    away = restore(color, depth, CAMERA, mask, behind, checkpoint=path)
    assert away.tolerance_m is None
    assert (away.confidence[mask] == 0).all()
    (note,) = (n for n in away.notes if n.startswith("the given hand does not fit this frame"))
    assert "60.0 cm behind the depth that was measured" in note
    np.testing.assert_array_equal(away.keypoints, behind)
    # The frame lies on its ground, but what is given is not what was given in training.
    odd = restore(color, depth, CAMERA, None, hand(), checkpoint=path)
    assert odd.ground.inside is False
    assert odd.ground.why[0].startswith("the mask is not given")
    assert odd.tolerance_m is None
    assert (odd.confidence[odd.restored] == 0).all()
    oblong = dataclasses.replace(CAMERA, fy=1.1 * CAMERA.fy)
    stretched = restore(color, depth, oblong, mask, hand(), checkpoint=path)
    assert stretched.ground.why[0] == "fy is 1.10 times fx, in training pixels were square"
    assert stretched.tolerance_m is None
    # HADR-plus looks at no depth in the mask, so it is the same to it whether that is kept.
    kept = restore(color, depth, CAMERA, mask, hand(), checkpoint=path, corruption="sensor")
    assert kept.ground.inside
    np.testing.assert_array_equal(kept.depth, sure.depth)
    assert "it is not used: HADR-plus looks at none there" in notes_of(kept)
    assert "learned from frames without" not in notes_of(kept)
    far = restore(color, 2 * depth, CAMERA, mask, hand(1.4), checkpoint=path)
    assert far.ground.inside is False
    assert far.ground.features["distance"] == pytest.approx(1.4)
    assert (far.confidence[mask] == 0).all()
    assert far.tolerance_m is None
    said = next(n for n in far.notes if "is unlike those that HADR-plus learned from" in n)
    assert ", so there is no probability of being right: " in said
    assert said.count(", in training ") == len(far.ground.why)
    assert confidence_means(far).startswith("no probability: ")
    listed = report(Made(color, depth, CAMERA, None, {}, far, {}))["ground"]
    assert listed["inside"] is False
    assert listed["features"]["distance"] == pytest.approx(1.4)


def test_hadr_plus_keeps_its_depth_beyond_the_learned_range_without_probability(tmp_path) -> None:
    color, depth, mask = frame()
    results = {}
    for far in (5.0, 0.3):
        path = checkpoint_file(tmp_path, "hadr-plus", learned_range={"depth_m": [0.2, far]})
        results[far] = restore(color, depth, CAMERA, mask, hand(), checkpoint=path)
    free, held = results.values()
    assert held.restored.any()
    np.testing.assert_array_equal(held.depth, free.depth)
    assert free.confidence[free.restored].max() > 0
    assert (held.confidence[mask] == 0).all()
    assert "outside of what it has learned" not in notes_of(free)
    assert "outside of what it has learned (0.20 to 0.30 m), and no probability" in notes_of(held)
    assert "at the edge of what it has learned" in notes_of(held)


@pytest.mark.parametrize("kind", DEPTH_NETWORKS)
def test_each_kind_of_checkpoint_restores(tmp_path, kind: str) -> None:
    path = checkpoint_file(tmp_path, kind)
    color, depth, mask = frame()
    result = restore(color, depth, CAMERA, mask, hand(), checkpoint=path)
    assert result.method == kind
    assert result.restored.any()
    np.testing.assert_array_equal(result.depth[~mask], depth[~mask])
    assert (result.depth[result.restored] > 0).all()
    assert (result.confidence[result.restored] >= 0).all()
    assert (result.confidence <= 1).all()
    insisted = restore(color, depth, CAMERA, mask, hand(), method=kind, checkpoint=path)
    np.testing.assert_array_equal(insisted.depth, result.depth)
    other = "unet-hand" if kind == "hadr" else "hadr"
    with pytest.raises(ValueError, match=f"method {other}: .*holds a network of kind {kind}"):
        restore(color, depth, CAMERA, mask, hand(), method=other, checkpoint=path)


class ByColor:
    """A segmentation network that takes blue for glass and red for skin."""

    name = "masks.safetensors"
    presence = 0.97

    def masks(self, color):
        return SeenMasks(color[..., 2] > 128, color[..., 0] > 128, self.presence)


class SameHand:
    """A keypoint network that always finds the same hand, and keeps what it was asked."""

    name = "hand.safetensors"
    needs_hand_mask = True

    def __init__(self, keypoints: np.ndarray | None = None) -> None:
        self.asked = []
        self.keypoints = hand(0.71) if keypoints is None else keypoints

    def find(self, color, depth, camera, mask, hand_mask):
        self.asked.append((depth, mask, hand_mask))
        if not hand_mask.any():
            raise NoHandError("none is seen in the picture")
        return self.keypoints


def colored() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Colour, depth, and where glass and hand are."""
    glass, skin = np.zeros((2, 60, 80), bool)
    glass[20:40, 32:52] = True
    skin[24:44, 12:28] = True
    color = np.zeros((60, 80, 3), np.uint8)
    color[glass], color[skin] = (0, 0, 255), (255, 0, 0)
    depth = np.where(glass, 1.5, np.where(skin, 0.7, 0.9)).astype(np.float32)
    return color, depth, glass, skin


def test_mask_and_keypoints_are_predicted_and_it_says_so() -> None:
    color, depth, glass, skin = colored()
    before, finder = depth.copy(), SameHand()
    restorer = Restorer("hand-median", segmentation=ByColor(), keypoint_network=finder)
    result = restorer(color, depth, CAMERA)
    np.testing.assert_array_equal(result.mask, glass)
    np.testing.assert_array_equal(result.hand_mask, skin)
    np.testing.assert_array_equal(result.keypoints, hand(0.71))
    np.testing.assert_allclose(result.depth, np.where(glass, 0.7, before), atol=1e-6)
    np.testing.assert_array_equal(depth, before)
    assert "the mask is not given but predicted by masks.safetensors" in result.notes
    assert "the hand's keypoints are not given but predicted by hand.safetensors" in result.notes
    ((seen, mask, hand_mask),) = finder.asked
    assert (seen[glass] == 0).all(), "the keypoints must not come from the wall behind the glass"
    np.testing.assert_array_equal(seen[~glass], before[~glass])
    np.testing.assert_array_equal(mask, glass)
    np.testing.assert_array_equal(hand_mask, skin)


def test_what_is_given_is_not_predicted() -> None:
    color, depth, glass, skin = colored()
    finder = SameHand()
    restorer = Restorer("nearest", segmentation=ByColor(), keypoint_network=finder)
    mine = glass & (np.indices(glass.shape)[1] < 40)
    result = restorer(color, depth, CAMERA, mine, hand())
    assert not finder.asked
    np.testing.assert_array_equal(result.restored, mine)
    assert result.hand_mask is None, "nobody needed it"
    result = restorer(color, depth, CAMERA, mine, hand_mask=skin & mine)
    np.testing.assert_array_equal(result.restored, mine)
    assert result.keypoints is None
    assert "no hand found by hand.safetensors: none is seen in the picture" in result.notes
    blind = Restorer(keypoint_network=finder)
    with pytest.raises(
        ValueError, match=r"hand.safetensors needs to know where .* \(--hand-mask\)"
    ):
        blind(color, depth, CAMERA, glass)


def test_no_glass_and_no_hand_are_said_and_nothing_is_made_up(tmp_path) -> None:
    color, depth, glass, skin = colored()
    path = checkpoint_file(tmp_path)
    finds = {"segmentation": ByColor(), "keypoint_network": SameHand()}
    no_glass = np.where(glass[..., None], 0, color).astype(np.uint8)
    result = Restorer("auto", path, **finds)(no_glass, depth, CAMERA)
    np.testing.assert_array_equal(result.depth, depth)
    assert result.method == "none"
    assert "the mask is empty: no glass was found by masks.safetensors" in result.notes
    no_hand = np.where(skin[..., None], 0, color).astype(np.uint8)
    result = Restorer("auto", path, **finds)(no_hand, depth, CAMERA)
    assert (result.method, result.keypoints) == ("nearest", None)
    assert "needs 21 hand keypoints and there are none" in notes_of(result)
    with pytest.raises(ValueError, match=r"no checkpoint fits: .*needs 21 hand keypoints"):
        Restorer("hadr", path, **finds)(no_hand, depth, CAMERA)


@pytest.mark.parametrize(
    ("keypoints", "presence", "reason"),
    [
        (hand(0.71) * 1.6, 0.97, "43.6 cm behind the depth that was measured"),
        (hand(0.71) - [0.1, 0, 0], 0.97, "cm away from the glass in the picture"),
        ((hand(0.71) - hand(0.71)[5]) * [1, 0.4, 1] + hand(0.71)[5], 0.97, "its palm has 4"),
        (hand(0.71), 0.82, "a mean probability of 0.82 of being a hand's"),
        (hand(0.71) - [0, 0, 1], 0.97, "a keypoint lies -0.29 m before the camera"),
    ],
)
def test_a_found_hand_that_can_t_be_one_is_none(tmp_path, keypoints, presence, reason) -> None:
    color, depth, glass, _ = colored()
    masks = ByColor()
    masks.presence = presence
    finds = {"segmentation": masks, "keypoint_network": SameHand(keypoints)}
    path = checkpoint_file(tmp_path)
    result = Restorer("auto", path, **finds)(color, depth, CAMERA, glass)
    assert (result.method, result.keypoints) == ("nearest", None)
    assert any(n.startswith("no hand found") and reason in n for n in result.notes), result.notes
    if result.hand is not None:  # what was found can be looked at
        assert not result.hand.accepted
        np.testing.assert_array_equal(result.hand.keypoints, keypoints)
    without = restore(color, depth, CAMERA, glass, checkpoint=path)
    np.testing.assert_array_equal(result.depth, without.depth)
    with pytest.raises(ValueError, match=r"method hadr: no checkpoint.*are none; no hand found"):
        Restorer("hadr", path, **finds)(color, depth, CAMERA, glass)


def test_what_needs_no_hand_mask_is_not_asked_for_one() -> None:
    color, depth, glass, _ = colored()
    finder = SameHand()
    finder.needs_hand_mask = False
    finder.find = lambda color, depth, camera, mask, hand_mask: {None: hand(0.71)}[hand_mask]
    result = Restorer("hand-median", keypoint_network=finder)(color, depth, CAMERA, glass)
    np.testing.assert_array_equal(result.keypoints, hand(0.71))
    doubting = ByColor()
    doubting.presence = 0.1
    restorer = Restorer("nearest", segmentation=doubting, keypoint_network=finder)
    assert restorer(color, depth, CAMERA).hand.accepted


def test_networks_are_read_once_and_keypoints_see_what_the_network_sees(tmp_path) -> None:
    """The short form and one restorer for many frames give the same."""
    color, depth, glass, _ = colored()
    for learned in ("oracle", "sensor"):
        path = checkpoint_file(tmp_path, data={"corruption": learned})
        finder = SameHand()
        restorer = Restorer("auto", path, segmentation=ByColor(), keypoint_network=finder)
        first = restorer(color, depth, CAMERA)
        network = restorer.network
        second = restorer(color, depth, CAMERA)
        assert restorer.network is network
        np.testing.assert_array_equal(first.depth, second.depth)
        np.testing.assert_array_equal(finder.asked[0][0] == 0, glass & (learned == "oracle"))
        short = restore(color, depth, CAMERA, glass, hand(0.71), checkpoint=path)
        for name in ("depth", "confidence", "restored", "method"):
            np.testing.assert_array_equal(getattr(first, name), getattr(short, name), name)


def test_untrained_networks_of_all_kinds_work_together(tmp_path) -> None:
    """Shapes, sizes and files fit; what untrained networks see is of no matter."""
    import torch

    from hadr.models.blocks.resnet import UNetConfig
    from hadr.models.hand.keypoints import HandKeypointConfig, HandKeypointNet
    from hadr.models.segmentation import SegmentationConfig, SegmentationNet
    from hadr.training.checkpoints import save_checkpoint

    torch.manual_seed(0)
    unet = UNetConfig((1, 1, 1, 1), (4, 4, 4, 4), (4, 4, 4, 4))
    parts = {
        "masks": SegmentationNet(SegmentationConfig(unet)),
        "hand": HandKeypointNet(HandKeypointConfig(unet, crop=32)),
    }
    for name, model in parts.items():
        save_checkpoint(tmp_path / f"{name}.safetensors", model, {"width": 64, "height": 40})
    restorer = Restorer(
        "auto",
        checkpoint_file(tmp_path),
        segmentation=tmp_path / "masks.safetensors",
        keypoint_network=tmp_path / "hand.safetensors",
    )
    color, depth, glass, skin = colored()
    masks = restorer.segmentation.masks(color)
    assert [(mask.shape, mask.dtype) for mask in masks[:2]] == [((60, 80), bool)] * 2
    assert 0 <= masks.presence <= 1
    found = restorer(color, depth, CAMERA, glass, hand_mask=skin)
    points = found.hand.keypoints
    assert points.shape == (21, 3)
    assert np.abs(points - points.mean(axis=0)).max() < 0.6
    assert 0.4 < points[:, 2].mean() < 1.0, "in the cube around the hand at 0.7 m"
    assert found.hand.source == "hand.safetensors"
    assert "has learned from computed pictures" in notes_of(found)
    np.testing.assert_array_equal(found.restored, glass)
    blind = restorer(color, np.where(skin, 0, depth), CAMERA, glass, hand_mask=skin)
    assert blind.keypoints is None
    assert "the pixels in which one is seen have no depth" in notes_of(blind)

"""A network's ground: frames whose features are known by hand, and clouds of known form."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from hadr.camera import Intrinsics
from hadr.confidence.calibration import Calibration, ConfidenceRule
from hadr.confidence.frame_features import FEATURES, frame_features, outline_features, torn
from hadr.confidence.known_ground import BEYOND, Field, Ground, shrunk_covariance
from hadr.confidence.sight import Observation, Sight
from hadr.data.samples import open_samples
from hadr.restoration import Restorer

CAMERA = Intrinsics(fx=100, fy=100, cx=39.5, cy=29.5, width=80, height=60)


def mask() -> np.ndarray:
    found = np.zeros(CAMERA.shape, bool)
    found[20:40, 30:50] = True
    return found


def hand(z: float = 0.7) -> np.ndarray:
    """21 points on a line of 10 cm, 1 to 11 pixels left of the mask."""
    points = np.zeros((21, 3))
    points[:, 0] = (np.linspace(19, 29, 21) - CAMERA.cx) / CAMERA.fx * z
    points[:, 2] = z
    return points


def scene(scale: float = 1.0, rng: np.random.Generator | None = None) -> dict[str, float]:
    """The features of a glass at 0.7 m before a wall, of all of it farther, or of noisy ones."""
    z = 0.7 * scale * (1 if rng is None else rng.uniform(0.9, 1.1))
    noise = 0.001 * (0 if rng is None else 1)
    depth = np.full(CAMERA.shape, 1.2 * z)
    depth[:, :30] = z - 0.01  # the hand's skin
    depth[20:40, 30:40] = 0
    if rng is not None:
        depth += noise * rng.standard_normal(depth.shape) * (depth > 0)
        depth[rng.random(depth.shape) < rng.uniform(0.02, 0.1)] = 0
    shift = 0 if rng is None else rng.normal(0, 0.004, 3)
    return frame_features(depth, np.where(mask(), z - 0.02, 0), CAMERA, mask(), hand(z) + shift)


def ground(rule: ConfidenceRule | None = None) -> Ground:
    rng = np.random.default_rng(0)
    training, validation = ([scene(rng=rng) for _ in range(n)] for n in (200, 60))
    seen = rng.normal(size=(50, 12))
    sight = Sight.fit(seen)
    for part in (training, validation):
        for one in part:
            one["seen"] = sight.strangeness(rng.normal(size=12))
    return Ground({"measured": Field.fit(training, validation, rule)}, sight)


def judged(known: Ground, features: dict[str, float], seen: np.ndarray):
    return known.judge(Observation(None, features, seen))


def test_features_of_a_frame_that_can_be_computed_by_hand() -> None:
    found = scene()
    expected = {
        "distance": 0.7,
        "size": 0.14,  # 20 of 100 pixels of focal length, at 0.7 m
        "lens": 1.25,
        "known_around": 1.0,
        "even": 1.0,  # the one jump is seen from few pixels
        "known_in": 0.5,
        "near_in": 0.0,
        "behind_in": 1.0,
        "spread_in": 0.0,
        "tilt": 0.0,
        "behind": -0.02,
        "off": 0.01,
        "agree": 1.0,
    }
    for name, value in expected.items():
        assert found[name] == pytest.approx(value, abs=0.03 if name == "even" else 1e-6), name
    assert set(found) <= set(FEATURES)
    # The three points next to the glass are 1, 1.5 (its pixel's: 1 or 2) and 2 pixels from it.
    assert 1 / 100 * 0.7 <= found["touch"] <= 2 / 100 * 0.7


def test_without_hand_or_depth_in_the_glass_their_features_are_left_out() -> None:
    depth = np.where(mask(), 0, 0.9)
    found = frame_features(depth, np.where(mask(), 0.7, 0), CAMERA, mask())
    assert found["distance"] == pytest.approx(0.7)
    assert {"known_in", "near_in", "off", "agree", "touch"}.isdisjoint(found)
    blind = frame_features(depth, np.zeros(CAMERA.shape), CAMERA, mask())
    assert "distance" not in blind


def test_a_hand_that_is_not_there_agrees_with_nothing() -> None:
    depth = np.full(CAMERA.shape, 2.0)
    found = frame_features(depth, np.where(mask(), 0.7, 0), CAMERA, mask(), hand())
    assert found["agree"] == 0
    assert found["off"] == pytest.approx(-1.3)
    away = frame_features(
        depth, np.where(mask(), 0.7, 0), CAMERA, mask(), hand() + np.array([5, 0, 0])
    )
    assert away["touch"] > 4
    assert "agree" not in away, "no keypoint is in the picture"


@pytest.mark.parametrize("times", [1, 3])
def test_a_mask_follows_the_steps_of_brightness_or_not(times: int) -> None:
    color, glass = np.full((112, 224, 3), 60, np.uint8), np.zeros((112, 224), bool)
    glass[40:80, 90:120] = True
    color[glass] = 150
    color, glass = (np.repeat(np.repeat(one, times, 0), times, 1) for one in (color, glass))
    right = outline_features(color, glass)
    assert right["outline"] == pytest.approx(1, abs=0.02)
    assert right["clear_in"] > 10
    wide = outline_features(color, ndimage.maximum_filter(glass, 4 * times + 1))
    assert wide["outline"] < 0.3
    assert (right["faint"], wide["faint"]) == (0, pytest.approx(1, abs=0.2))
    assert outline_features(0 * color, glass) == {"faint": 1, "across": 0, "clear_in": 0}
    assert outline_features(color, ~glass & glass) == {}
    assert set(right) <= set(FEATURES)


def test_a_cut_through_the_glass_is_the_weakest_stretch_of_the_outline() -> None:
    """Every second pixel of the glass's rows is darker, so that nothing changes along its columns.

    A cut along a row meets changes along itself alone; one along a column changes across alone.
    """
    color, glass = np.full((224, 448, 3), 60, np.uint8), np.zeros((224, 448), bool)
    glass[80:140, 180:260] = True
    color[glass] = 220
    color[80:140, 180:260:8] = 140
    color[80:140, 181:260:8] = 140
    whole = outline_features(color, glass)["across"]
    rows, columns = np.indices(glass.shape)
    assert whole > 0.8
    assert outline_features(color, glass & (rows < 110))["across"] < 0.5
    assert outline_features(color, glass & (columns < 221))["across"] == pytest.approx(
        whole, abs=0.1
    )


def test_a_torn_mask_is_named_with_its_pieces_and_holes() -> None:
    whole = np.zeros((40, 60), bool)
    whole[10:30, 10:50] = True
    assert torn(whole) == ()
    whole[12:28:2, 12:32:4] = False  # 8 rows of 5 holes
    whole[0, 0] = whole[39, 59] = True
    assert torn(whole) == ("the mask is torn: 3 pieces and 40 holes, expected a handful",)
    whole[12:28, 16:32] = True  # 8 holes are left
    assert torn(whole) == ()
    whole[12:28, 12:48] = False
    assert torn(whole) == ("the mask is hollow: 28 % of what its outline holds is in it",)


@pytest.mark.parametrize("split", ["train", "val"])
def test_no_bundled_glass_has_a_torn_mask(split: str) -> None:
    assert not any(torn(frame.object_mask) for frame in open_samples(split))


def test_a_mask_that_is_torn_or_three_pixels_wider_than_the_glass_gets_no_probability() -> None:
    frame = open_samples("val")[3]
    networks = Restorer("hadr-plus")
    seen, mask = (frame.color, frame.raw_depth, frame.camera), frame.object_mask
    assert networks(*seen, mask, frame.keypoints).tolerance_m == 0.02
    torn_mask = mask & (np.random.default_rng(0).random(mask.shape) >= 0.3)
    wide = ndimage.distance_transform_edt(~mask) <= 3
    for wrong, said in ((torn_mask, "is torn: "), (wide, "may not follow the glass: ")):
        answer = networks(*seen, wrong, frame.keypoints)
        assert answer.tolerance_m is None
        assert any(f"the mask {said}" in note for note in answer.notes)


@pytest.mark.parametrize(
    ("name", "value", "learned", "said"),
    [
        (
            "behind",
            -0.122,
            (-0.03, 0.05),
            "12.2 cm before the hand, in training 3 cm before to 5 cm behind",
        ),
        (
            "tilt",
            0.25,
            (-0.03, 0.05),
            "points 0.25 of its length away from the camera, in training 0.03 of its",
        ),
        ("distance", 3.0, (-0.03, 0.05), "the glass is 3 m away, in training -0.03 to 0.05 m"),
        ("lens", 0.5, (0.8889, 0.8889), "50 % of the picture's width, in training 88.9 %"),
    ],
)
def test_a_value_is_said_in_the_units_of_readers_with_its_side_not_its_sign(
    name: str, value: float, learned: tuple[float, float], said: str
) -> None:
    assert said in FEATURES[name].said(value, *learned)


def test_frames_of_the_training_are_inside_and_thrice_the_distance_is_not() -> None:
    known, rng = ground(), np.random.default_rng(1)
    verdicts = [judged(known, scene(rng=rng), rng.normal(size=12)) for _ in range(100)]
    assert sum(bool(one.inside) for one in verdicts) >= 90
    far = judged(known, scene(3.0, rng=rng), np.zeros(12))
    assert far.inside is False
    assert far.score > 1
    assert known.fields["measured"].beyond(far.features)["distance"] > BEYOND
    assert 1 <= len(far.why) <= 3


def test_what_is_outside_is_said_in_words_that_a_user_can_act_on() -> None:
    field = Field.fit(
        [{"distance": z} for z in np.linspace(0.375, 0.915, 100)] * 2, [{"distance": 0.6}]
    )
    assert field.why({"distance": 1.44}) == (
        "the glass is 1.44 m away, in training 0.38 to 0.91 m",
    )


def test_a_combination_that_was_never_seen_is_outside_of_no_range() -> None:
    rng = np.random.default_rng(2)
    one = rng.normal(size=(300, 1))
    tilt, behind = np.tanh(one), 0.05 * np.sinh(one + 0.05 * rng.normal(size=one.shape))
    frames = [
        {"tilt": float(a), "behind": float(b)} for (a,), (b,) in zip(tilt, behind, strict=True)
    ]
    field = Field.fit(frames[:200], frames[200:])
    assert field.score(frames[0]) <= 1
    odd = {"tilt": 0.7, "behind": -0.05}
    assert max(field.beyond(odd).values()) < 1
    assert field.score(odd) > 1
    assert field.why(odd)[0].startswith("no such combination of measurements was learned")


def test_what_is_not_known_does_not_count_and_nothing_known_is_outside() -> None:
    field = ground().fields["measured"]
    whole = scene(rng=np.random.default_rng(3))
    part = {name: whole[name] for name in ("distance", "size", "touch")}
    assert field.score(part) <= 1
    assert field.score({}) == np.inf


def test_the_nearest_field_decides_and_says_which_it_was() -> None:
    near = [{"distance": z} for z in np.linspace(0.4, 0.5, 50)]
    far = [{"distance": z} for z in np.linspace(1.4, 1.5, 50)]
    both = Ground(
        {"learned": Field.fit(near, near), "measured": Field.fit(far, far)},
        Sight.fit(np.random.default_rng(0).normal(size=(20, 3))),
    )
    assert judged(both, {"distance": 0.45}, np.zeros(3)).field == "learned"
    assert judged(both, {"distance": 1.45}, np.zeros(3)).field == "measured"
    between = judged(both, {"distance": 0.9}, np.zeros(3))
    assert between.inside is False


def test_a_ground_survives_its_record() -> None:
    rule = ConfidenceRule(4.0, 0.5, Calibration((0.1, 0.9), (0.2, 0.8)))
    known = ground(rule)
    text = json.dumps(known.to_dict())
    assert len(text) < 20_000
    again = Ground.from_dict(json.loads(text))
    assert again.fields["measured"].rule == rule
    rng = np.random.default_rng(4)
    for scale in (1.0, 1.3, 3.0):
        features, seen = scene(scale, rng), rng.normal(size=12)
        old, new = judged(known, features, seen), judged(again, features, seen)
        assert new.inside == old.inside
        assert new.score == pytest.approx(old.score, rel=0.01)
    json.dumps(old.to_dict())


def test_a_record_with_an_unknown_feature_is_refused() -> None:
    record = ground().fields["measured"].to_dict()
    record["features"][0] = "weight"
    with pytest.raises(ValueError, match=r"a ground has the features .*, got \['weight'\]"):
        Field.from_dict(record)


def test_sight_measures_what_lies_off_the_main_directions() -> None:
    rng = np.random.default_rng(5)
    basis = np.linalg.qr(rng.normal(size=(20, 20)))[0]
    seen = rng.normal(size=(400, 8)) @ basis[:8] + 3.0
    sight = Sight.fit(seen)
    assert sight.strangeness(seen[0]) < 1e-6
    assert sight.strangeness(seen[0] + 2 * basis[9]) > 0.5


def test_a_shrunk_covariance_is_plain_for_many_values_and_round_for_few() -> None:
    rng = np.random.default_rng(6)
    true = np.diag([4.0, 1.0, 0.25])
    many = rng.normal(size=(20_000, 3)) @ np.sqrt(true)
    np.testing.assert_allclose(shrunk_covariance(many), true, atol=0.1)
    few = rng.normal(size=(4, 30))
    found = shrunk_covariance(few)
    assert np.linalg.eigvalsh(found).min() > 0.1, "a plain covariance of 4 values is singular"
    assert np.trace(found) == pytest.approx((few**2).sum() / 4)


def test_a_ground_without_frames_is_refused() -> None:
    with pytest.raises(ValueError, match="needs training and validation frames, got 1 and 0"):
        Field.fit([{"distance": 1.0}], [])


def test_a_network_that_restores_nothing_in_validation_has_a_ground_all_the_same() -> None:
    """No feature is known there, so the distances are infinite; the limit stays a number."""
    training = [{"distance": 0.5 + 0.01 * n} for n in range(8)]
    field = Field.fit(training, [{}, {}])
    assert field.limit == 1.0
    assert Field.from_dict(field.to_dict()).limit == 1.0


def test_features_that_always_go_together_are_no_error() -> None:
    training = [{"distance": 0.5 + 0.1 * n, "size": 0.05 + 0.01 * n} for n in range(3)]
    field = Field.fit(training, training)
    whole = replace(field, correlation=np.ones((2, 2)))
    assert np.isfinite(whole.distance(training[0]))

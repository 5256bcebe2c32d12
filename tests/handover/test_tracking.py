"""The rigid motion of the hand: exact recovery, proper rotations, what cannot be determined."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hadr.hand import FINGERS, KEYPOINT_NAMES, forward_kinematics, keypoints_from_skeleton
from hadr.handover.tracking import (
    FARTHEST_STEP,
    FULL_PLACE,
    FULL_TURN,
    HandFilter,
    best_rotation,
    best_similarity,
    hand_motion,
)

HAND = np.random.default_rng(7).normal(size=(21, 3)) * 0.05 + [0.1, -0.05, 0.7]


@settings(max_examples=80)
@given(st.integers(0, 2**32 - 1))
def test_recovers_any_rigid_motion(seed: int) -> None:
    rng = np.random.default_rng(seed)
    hand = rng.normal(size=(21, 3)) * 0.06 + rng.normal(size=3)
    rotation, shift = Rotation.random(rng=rng).as_matrix(), rng.normal(size=3)
    motion = hand_motion(hand, hand @ rotation.T + shift)
    np.testing.assert_allclose(motion.rotation, rotation, atol=1e-9)
    points = rng.normal(size=(5, 3))
    moved = points @ rotation.T + shift
    np.testing.assert_allclose(motion.move_points(points), moved, atol=1e-9)
    grasp = np.eye(4)
    grasp[:3, 3] = points[0]
    expected = np.column_stack([rotation, moved[0]])
    np.testing.assert_allclose(motion.move_pose(grasp)[:3], expected, atol=1e-9)
    assert motion.residual < 1e-9


def test_quarter_turn_by_hand() -> None:
    # a quarter turn about z at the wrist (1, 0, 0), which then moves to (1, 2, 0)
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    hand = HAND - HAND[0] + [1.0, 0, 0]
    now = (hand - hand[0]) @ quarter.T + [1.0, 2, 0]
    motion = hand_motion(hand, now)
    # one metre in front of the wrist along x: afterwards one metre along y
    np.testing.assert_allclose(motion.move_points(np.array([2.0, 0, 0])), [1, 3, 0], atol=1e-12)
    assert motion.angle == pytest.approx(np.pi / 2)
    origin = hand_motion(hand, now, about="origin")
    # R X + T: (2, 0, 0) -> (0, 2, 0) + (0, 2, 0)
    np.testing.assert_allclose(origin.move_points(np.array([2.0, 0, 0])), [0, 4, 0], atol=1e-12)


def test_about_the_centroid_an_error_of_the_wrist_shifts_by_a_21st() -> None:
    rotation = Rotation.from_euler("xyz", [0.3, -0.4, 1.0]).as_matrix()
    now = HAND @ rotation.T + [0.1, 0.2, -0.3]
    true = hand_motion(HAND, now, about="centroid")
    np.testing.assert_allclose(true.current_from_initial[:3, :3], rotation, atol=1e-9)
    np.testing.assert_allclose(true.current_from_initial[:3, 3], [0.1, 0.2, -0.3], atol=1e-9)
    off = now.copy()
    off[0] += [0.021, 0.0, 0.0]
    middle = HAND.mean(axis=0)
    shifts = {
        about: hand_motion(HAND, off, about=about).move_points(middle) - now.mean(axis=0)
        for about in ("wrist", "centroid")
    }
    np.testing.assert_allclose(shifts["centroid"], [0.001, 0.0, 0.0], atol=1e-9)
    assert np.linalg.norm(shifts["wrist"]) > 0.01
    # the least squares of all: no other motion leaves less, the wrist's not either
    residual = hand_motion(HAND, off, about="centroid").residual
    assert 0 < residual < hand_motion(HAND, off).residual


def test_flipping_v_is_the_best_rotation_and_flipping_r_is_not() -> None:
    before = HAND - HAND[0]
    after = before * [-1.0, 1.0, 1.0]

    def misfit(rotation: np.ndarray) -> float:
        return float(((before @ rotation.T - after) ** 2).sum())

    by_v, by_r = (best_rotation(before, after, flip=flip) for flip in ("v", "r"))
    for rotation in (by_v, by_r):
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(rotation) == pytest.approx(1.0)
    best = misfit(by_v)
    assert misfit(by_r) > 1.05 * best
    drawn = Rotation.random(2000, rng=np.random.default_rng(0)).as_matrix()
    assert best <= min(misfit(rotation) for rotation in drawn)
    kabsch = Rotation.align_vectors(after, before)[0].as_matrix()
    np.testing.assert_allclose(best_rotation(before, after), kabsch, atol=1e-6)


def test_planar_hand_is_recovered() -> None:
    flat = HAND * [1.0, 1.0, 0.0]
    rotation = Rotation.from_euler("xyz", [0.5, 0.2, -0.9]).as_matrix()
    motion = hand_motion(flat, flat @ rotation.T)
    np.testing.assert_allclose(motion.rotation, rotation, atol=1e-9)


def test_residual_by_hand() -> None:
    # no rotation is better than none: two opposite points move apart by 1 cm each
    before = np.zeros((21, 3))
    before[1:7] = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]
    after = before.copy()
    after[1, 0], after[2, 0] = 1.01, -1.01
    motion = hand_motion(before, after)
    np.testing.assert_allclose(motion.rotation, np.eye(3), atol=1e-12)
    assert motion.residual == pytest.approx(np.sqrt(2 * 0.01**2 / 21))


def test_degenerate_hands_are_refused() -> None:
    line = np.linspace(0, 1, 21)[:, None] * [1.0, 2.0, 0.5]
    with pytest.raises(ValueError, match="not determined"):
        hand_motion(line, line)
    with pytest.raises(ValueError, match="not determined"):
        hand_motion(np.ones((21, 3)), np.ones((21, 3)))


def test_bad_keypoints_are_named() -> None:
    with pytest.raises(ValueError, match=r"\(20, 3\)"):
        hand_motion(HAND[:20], HAND[:20])
    broken = HAND.copy()
    broken[8, 1] = np.nan
    with pytest.raises(ValueError, match="index_tip"):
        hand_motion(HAND, broken)
    with pytest.raises(ValueError, match="finite"):
        hand_motion(HAND, HAND).move_pose(np.eye(3))


def moved_hand(bent: tuple[str, ...], seed: int = 3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A hand, the same moved rigidly with some fingers bent by 50 degrees, and the true motion."""
    angles = np.zeros(20)
    before = keypoints_from_skeleton(forward_kinematics(angles).joints)
    for finger in bent:
        first = 4 * list(FINGERS).index(finger)
        angles[first + 1 : first + 4] = np.deg2rad(50)
    bent_hand = keypoints_from_skeleton(forward_kinematics(angles).joints)
    transform = np.eye(4)
    transform[:3, :3] = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    transform[:3, 3] = [0.03, -0.02, 0.05]
    return before, bent_hand @ transform[:3, :3].T + transform[:3, 3], transform


def turned_by(found: np.ndarray, true: np.ndarray) -> float:
    """Angle between two rotations, degrees."""
    return float(np.rad2deg(Rotation.from_matrix(found.T @ true).magnitude()))


@pytest.mark.parametrize("bent", [("index",), ("index", "little"), tuple(FINGERS)[1:]])
def test_robust_form_is_exact_where_fingers_move_and_the_paper_s_is_not(
    bent: tuple[str, ...],
) -> None:
    before, now, true = moved_hand(bent)
    robust = hand_motion(before, now, robust=True)
    np.testing.assert_allclose(robust.current_from_initial, true, atol=1e-9)
    assert robust.residual < 1e-9
    # each bent finger's joints beyond its root are named, and nothing else
    expected = {KEYPOINT_NAMES[i] for finger in bent for i in FINGERS[finger][1:]}
    assert set(robust.outliers) == expected
    paper = hand_motion(before, now)
    assert turned_by(paper.rotation, true[:3, :3]) > 2.0
    assert paper.residual > 0.005
    assert paper.outliers == ()


def test_robust_form_is_not_moved_by_a_wrong_wrist() -> None:
    before, now, true = moved_hand(())
    now[0] += [0.0, 0.03, 0.0]
    robust = hand_motion(before, now, robust=True)
    np.testing.assert_allclose(robust.current_from_initial, true, atol=1e-9)
    assert robust.outliers == ("wrist",)
    np.testing.assert_allclose(robust.current_wrist, (true @ [*before[0], 1])[:3], atol=1e-9)


def test_robust_form_keeps_a_hand_with_noise_whole() -> None:
    before, now, true = moved_hand(())
    seen = now + np.random.default_rng(0).normal(0, 0.001, now.shape)
    robust = hand_motion(before, seen, robust=True)
    assert robust.outliers == ()
    assert turned_by(robust.rotation, true[:3, :3]) < 0.6
    assert 0.001 < robust.residual < 0.0025


def test_robust_form_falls_back_where_only_a_straight_finger_moves_as_one() -> None:
    rng = np.random.default_rng(1)
    hand, _, _ = moved_hand(())
    along = (hand[6] - hand[5]) / np.linalg.norm(hand[6] - hand[5])
    hand[6:9] = hand[5] + np.array([[0.04], [0.065], [0.085]]) * along
    jumps = np.ones((21, 1))
    jumps[5:9] = 0.0
    for _ in range(50):
        hand_motion(hand, hand + jumps * rng.normal(0, 0.03, hand.shape), robust=True)


@pytest.mark.parametrize("sigma", [0.03, 0.1])
def test_robust_form_falls_back_to_the_plain_one_where_no_group_moves_as_one(sigma: float) -> None:
    before, now, _ = moved_hand(())
    plain = 0
    for seed in range(40):
        seen = now + np.random.default_rng(seed).normal(0, sigma, now.shape)
        robust = hand_motion(before, seen, robust=True)
        assert np.isfinite(robust.current_from_initial).all()
        if not robust.robust:
            plain += 1
            assert robust.outliers == ()
            np.testing.assert_array_equal(robust.rotation, hand_motion(before, seen).rotation)
    assert plain > 0
    assert hand_motion(before, now, robust=True).robust
    assert not hand_motion(before, now).robust


@pytest.mark.parametrize(("factor", "unit"), [(100, "centimetres"), (1000, "millimetres")])
def test_keypoints_in_another_unit_are_noticed(factor: float, unit: str) -> None:
    before, now, _ = moved_hand(())
    with pytest.raises(ValueError, match=f"must be metres: a palm of .* looks like {unit}"):
        hand_motion(before, factor * now)


def horn(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Rotation by the eigenvector of Horn's matrix of 1987: no singular values are used."""
    s = (before - before.mean(axis=0)).T @ (after - after.mean(axis=0))
    cross = np.array([s[1, 2] - s[2, 1], s[2, 0] - s[0, 2], s[0, 1] - s[1, 0]])
    matrix = np.empty((4, 4))
    matrix[0, 0], matrix[0, 1:], matrix[1:, 0] = np.trace(s), cross, cross
    matrix[1:, 1:] = s + s.T - np.trace(s) * np.eye(3)
    w, *xyz = np.linalg.eigh(matrix)[1][:, -1]
    return Rotation.from_quat([*xyz, w]).as_matrix()


@pytest.mark.parametrize("mirrored", [False, True])
def test_similarity_is_that_of_horn_s_quaternion_and_of_derivatives_that_vanish(
    mirrored: bool,
) -> None:
    rng = np.random.default_rng(5)
    turn = Rotation.random(rng=rng).as_matrix()
    before = rng.normal(size=(30, 3))
    after = 1.7 * before @ turn.T + [0.4, -2.0, 3.0] + rng.normal(0, 0.2, (30, 3))
    if mirrored:
        after[:, 1] *= -1
    for scaled in (False, True):
        scale, rotation, shift = best_similarity(before, after, scaled=scaled)
        np.testing.assert_allclose(rotation, horn(before, after), atol=1e-9)

        def misfit(s: float, t: np.ndarray, rotation: np.ndarray = rotation) -> float:
            return float(((s * before @ rotation.T + t - after) ** 2).sum())

        best = misfit(scale, shift)
        for way in np.eye(3):
            assert misfit(scale, shift + 1e-3 * way) > best < misfit(scale, shift - 1e-3 * way)
        if scaled:
            assert misfit(scale + 1e-3, shift) > best < misfit(scale - 1e-3, shift)
        else:
            assert scale == 1.0


def test_similarity_of_a_triangle_by_hand() -> None:
    # a quarter turn about z, twice as large, moved by (1, 2, 3)
    before = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0]])
    after = np.array([[1.0, 2, 3], [1, 4, 3], [-3, 2, 3]])
    scale, rotation, shift = best_similarity(before, after, scaled=True)
    assert scale == pytest.approx(2.0)
    np.testing.assert_allclose(rotation, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12)
    np.testing.assert_allclose(shift, [1, 2, 3], atol=1e-12)
    # without a scale the centroids still meet: (1/3, 2/3, 0) -> (-1/3, 8/3, 3)
    plain = best_similarity(before, after)
    np.testing.assert_allclose(plain.shift, [1 / 3, 7 / 3, 3], atol=1e-12)


#: Where a camera was, by ORB-SLAM without a scale and by RGBD-SLAM in metres, in the sequence
#: freiburg1_xyz of the TUM RGB-D benchmark (CC BY 4.0): every key frame of the one with the other's
#: picture of the same time, within 12 ms, but for some beside each other. As evo 1.x ships them.
FREIBURG1_XYZ = """
0.0000000 0.0000000 0.0000000 1.293527 0.551059 1.586675
-0.2066195 0.0058942 0.0193612 1.256694 0.311319 1.555201
-0.2087584 0.0090197 0.0199990 1.255807 0.306215 1.553067
-0.1614287 0.0073436 0.0243542 1.252055 0.359046 1.551359
0.2260392 -0.0078281 0.0022477 1.291565 0.782220 1.581513
0.2659973 -0.0192802 0.0074831 1.277026 0.837864 1.595359
0.3064566 -0.0183126 0.0036555 1.279501 0.875847 1.603818
0.3249032 -0.0187679 0.0036909 1.279700 0.897103 1.606601
0.3788669 -0.0145191 -0.0012441 1.302869 0.957072 1.600585
0.3657528 -0.0065232 0.0087311 1.297744 0.949116 1.590002
0.2220759 -0.0152686 -0.0001081 1.291007 0.787533 1.600962
-0.2207480 -0.0060303 0.0498116 1.232139 0.303276 1.543475
0.3268469 -0.0069696 0.0788839 1.250934 0.915962 1.519006
0.2590157 -0.0010426 0.0707565 1.249941 0.843338 1.529529
0.1420837 0.0024402 0.0650192 1.249989 0.698951 1.534107
0.0153449 0.1887853 0.0408669 1.394211 0.553731 1.423486
0.0289175 -0.2433002 0.1266889 1.016164 0.584832 1.663585
0.0169097 0.1911397 0.0551786 1.378320 0.551872 1.413153
0.0242387 0.2408000 0.0495608 1.429063 0.560895 1.361889
0.0299273 -0.1633672 0.1288760 1.066625 0.581103 1.605036
0.0268792 -0.2026180 0.1351542 1.033086 0.573705 1.627428
0.0436686 0.1179784 0.0843946 1.308077 0.583457 1.434424
"""


@pytest.mark.parametrize(
    ("scaled", "scale", "shift", "error"),
    [
        (True, 1.0912638, [1.283784, 0.541236, 1.583524], 0.0126661),
        (False, 1.0, [1.281666, 0.550581, 1.580645], 0.0240323),
    ],
)
def test_similarity_of_published_trajectories(
    scaled: bool, scale: float, shift: list[float], error: float
) -> None:
    """The values are an iterative fit's (scipy's least_squares from eight random rotations)."""
    points = np.array(FREIBURG1_XYZ.split(), dtype=np.float64).reshape(-1, 6)
    before, after = points[:, :3], points[:, 3:]
    found = best_similarity(before, after, scaled=scaled)
    assert found.scale == pytest.approx(scale, abs=1e-7)
    np.testing.assert_allclose(found.shift, shift, atol=1e-6)
    turn = [[0.06157, 0.717975, -0.693341], [0.99799, -0.033859, 0.053561]]
    np.testing.assert_allclose(found.rotation[:2], turn, atol=1e-6)
    misses = found.scale * before @ found.rotation.T + found.shift - after
    assert np.sqrt((misses**2).sum(axis=1).mean()) == pytest.approx(error, abs=1e-7)


def test_points_of_no_weight_do_not_turn_the_similarity() -> None:
    before = np.vstack([np.eye(3), np.zeros(3)])
    after = before.copy()
    after[3] += [5.0, -2.0, 1.0]
    found = best_similarity(before, after, weights=np.array([1.0, 1.0, 1.0, 0.0]))
    np.testing.assert_allclose(found.rotation, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(found.shift, 0.0, atol=1e-12)


def steady_hand() -> np.ndarray:
    """A hand of a random form about the origin, metres."""
    shape: np.ndarray = np.random.default_rng(5).normal(0, 0.04, (21, 3))
    return shape - shape.mean(axis=0)


def test_filter_follows_a_hand_that_drifts_and_turns_evenly() -> None:
    steadies, shape = HandFilter(), steady_hand()
    for number in range(60):
        time = 0.1 * number
        turn = Rotation.from_rotvec([0, 0, np.deg2rad(20) * time]).as_matrix()
        true = shape @ turn.T + [0.1 * time, 0.02 * time, 0.5]
        found = steadies.steadied(time, true)
    np.testing.assert_allclose(found, true, atol=1e-4)


def test_filter_of_one_picture_s_error_by_hand() -> None:
    steadies, shape = HandFilter(), steady_hand()
    for number in range(50):  # never twice the same: that is a camera that hangs
        steadies.steadied(0.1 * number, shape + 1e-12 * number)
    turn = Rotation.from_rotvec([0, 0, np.deg2rad(8)]).as_matrix()
    found = steadies.steadied(5.0, shape @ turn.T + [0.004, 0, 0])
    motion = hand_motion(shape, found, about="centroid")
    assert np.rad2deg(motion.angle) == pytest.approx(2.0, abs=1e-6)  # a quarter of the turn
    np.testing.assert_allclose(found.mean(axis=0), [0.002, 0, 0], atol=1e-9)  # half of the way


@settings(deadline=None)
@given(st.integers(0, 10_000))
def test_filter_hides_no_more_of_a_hand_s_motion_than_it_says(seed: int) -> None:
    rng, steadies, shape = np.random.default_rng(seed), HandFilter(), steady_hand()
    for number in range(15):
        turn = Rotation.from_rotvec(rng.normal(0, 0.4, 3)).as_matrix()
        seen = shape @ turn.T + rng.normal(0, 0.02, 3)
        found = steadies.steadied(0.1 * number, seen)
        off = np.linalg.norm(found.mean(axis=0) - seen.mean(axis=0))
        assert off <= FULL_PLACE / 4 + 1e-9
        assert hand_motion(seen, found, about="centroid").angle <= FULL_TURN / 4 + 1e-6


def test_filter_gives_a_hand_that_jumps_as_it_is_seen_and_then_begins_anew() -> None:
    steadies, shape = HandFilter(), steady_hand()
    for number in range(5):
        steadies.steadied(0.1 * number, shape)
    away = shape + np.array([2 * FARTHEST_STEP, 0, 0])
    np.testing.assert_array_equal(steadies.steadied(0.5, away), away)
    np.testing.assert_allclose(steadies.steadied(0.6, shape), shape, atol=1e-9)
    for number in range(7, 12):  # it stays there
        np.testing.assert_array_equal(steadies.steadied(0.1 * number, away), away)
    np.testing.assert_allclose(steadies.steadied(1.2, away), away, atol=1e-9)


def test_filter_follows_a_finger_that_lets_go() -> None:
    steadies, shape = HandFilter(), steady_hand()
    for number in range(20):
        steadies.steadied(0.1 * number, shape)
    other = shape.copy()
    other[5:9] += [0.0, 0.03, 0.0]
    for number in range(20, 35):
        found = steadies.steadied(0.1 * number, other)
    assert np.linalg.norm(found - other, axis=1).max() < 0.003


def test_filter_leaves_what_is_no_hand_to_others() -> None:
    steadies, shape = HandFilter(), steady_hand()
    broken = shape.copy()
    broken[3] = np.nan
    np.testing.assert_array_equal(steadies.steadied(0.0, broken), broken)
    steadies.steadied(0.1, shape)
    np.testing.assert_array_equal(steadies.steadied(0.2, np.zeros((21, 3))), np.zeros((21, 3)))
    np.testing.assert_allclose(steadies.steadied(0.3, shape), shape, atol=1e-9)

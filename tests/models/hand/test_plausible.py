"""Checks of a hand: an adult's flat hand before a wall, and what is wrong with others."""

import re

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from hadr.camera import Intrinsics, project
from hadr.hand import BONES, forward_kinematics, keypoints_from_skeleton
from hadr.models.hand.plausible import check_hand

CAMERA = Intrinsics(200.0, 200.0, 79.5, 59.5, 160, 120)
#: Straight fingers in the plane z = 0.6 m; the wrist at the pixel (79.5, 99.5), fingers up.
FLAT = keypoints_from_skeleton(forward_kinematics(np.zeros(20)).joints)[:, :3] * [1, -1, 0]
HAND = FLAT + np.array([0, 0.12, 0.6])


def scene(wall: float = 0.6) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Depth of the skin 2 cm before the joints, before a wall; glass at the right of the fingers.

    The hand's pixels are a square of 40 x 60 pixels: 0.116 m x 0.174 m = 202 square centimetres.
    """
    depth = np.full(CAMERA.shape, wall, np.float32)
    hand, glass = np.zeros((2, *CAMERA.shape), bool)
    hand[40:100, 60:100] = True
    glass[40:80, 100:120] = True
    depth[hand] = 0.58
    depth[glass] = 1.5  # the wall behind, which does not count
    return depth, glass, hand


def test_an_adult_s_hand_on_measured_skin_is_one() -> None:
    depth, glass, hand = scene(0.9)
    found = check_hand(HAND, depth, CAMERA, glass, hand, presence=0.97)
    assert found.problems == ()
    assert found.palm == pytest.approx(1, abs=1e-6)
    # The median finger is the little one: 35 + 21 + 20 mm of hadr.hand against 66.8 mm.
    assert found.fingers == pytest.approx(0.076 / 0.0668, abs=1e-6)
    assert found.gap_m == pytest.approx(0.02, abs=1e-6)
    assert 0.02 <= found.skin_m < 0.021
    assert found.area_m2 == pytest.approx(40 * 60 * (0.58 / 200) ** 2, rel=1e-5)
    assert found.step_m == pytest.approx(0.32, abs=1e-6)
    assert (found.presence, found.glass_m) == (0.97, pytest.approx(0.0, abs=0.02))


def test_the_distance_to_the_glass_is_in_metres_at_the_hand() -> None:
    depth, glass, _ = scene()
    glass[:, 100:120] = True
    at_column_80 = HAND - [HAND[:, 0].max() - 0.5 / 200 * 0.6, 0, 0]
    found = check_hand(at_column_80, depth, CAMERA, glass)
    assert found.glass_m == pytest.approx(20 / 200 * 0.6, abs=1e-4)
    assert found.problems == ("it is 6.0 cm away from the glass in the picture",)


@pytest.mark.parametrize(
    ("factor", "words"), [(1.5, "30.0 cm behind the depth"), (0.75, "15.0 cm before the depth")]
)
def test_a_hand_off_the_measured_depth_is_named_with_its_distance(factor, words) -> None:
    depth, glass, hand = scene()
    depth[hand] = 0.6
    moved = HAND * factor  # along the rays: the same pixels at another depth
    moved = moved[:1] + (moved - moved[:1]) / factor  # and of the same size
    found = check_hand(moved, depth, CAMERA, glass, hand)
    assert any(words in why for why in found.problems), found
    assert any("cm away from the hand's pixels" in why for why in found.problems), found


MIDDLE = HAND.mean(axis=0)
OTHERS = {
    "true": HAND,
    "3 cm nearer": HAND * 0.57 / 0.6,  # along the rays
    "3 cm farther": HAND * 0.63 / 0.6,
    "turned": Rotation.from_rotvec((0, 0, -1)).apply(HAND - MIDDLE) + MIDDLE,
}


@pytest.mark.parametrize("name", OTHERS)
def test_a_given_hand_is_held_against_the_one_that_is_seen(name) -> None:
    glass = scene()[1]
    bones = np.linspace(*HAND[np.array(BONES).T], 20).reshape(-1, 3)
    away, _ = cKDTree(project(bones, CAMERA)).query(np.argwhere(np.ones(CAMERA.shape))[:, ::-1])
    depth = np.where(away < 3, 0.588, 0.9).reshape(CAMERA.shape).astype(np.float32)
    told = "".join(check_hand(OTHERS[name], depth, CAMERA, glass, given=True).problems)
    assert ("not the hand that the depth camera saw" in told) == (name != "true")
    assert check_hand(OTHERS[name], depth, CAMERA, glass).problems == (), (
        "a network errs by as much"
    )


def test_of_a_hand_without_depth_at_its_pixels_nothing_is_said() -> None:
    depth, glass, hand = scene()
    depth[:] = 0
    depth[0] = 3.0  # no keypoint is there
    found = check_hand(HAND, depth, CAMERA, glass, hand)
    assert (found.gap_m, found.skin_m, found.area_m2, found.step_m) == (None, None, None, None)
    assert found.problems == ()
    beside = check_hand(HAND + np.array([2.0, 0, 0]), np.full(CAMERA.shape, 0.6), CAMERA, glass)
    assert beside.gap_m is None


@pytest.mark.parametrize(
    ("scale", "part"), [((1, 0.3, 1), "palm has 30 % of an"), ((1, 2, 1), "palm has 200 %")]
)
def test_other_than_human_sizes_are_named(scale, part) -> None:
    depth, glass, _ = scene()
    stretched = (HAND - HAND[0]) * scale + HAND[0]
    assert part in check_hand(stretched, depth, CAMERA, glass).problems[0]


def fingers(*order: int) -> list[int]:
    """The keypoints' numbers with the fingers in another order; the thumb is 0."""
    return [0, *(4 * finger + joint for finger in order for joint in range(1, 5))]


@pytest.mark.parametrize(
    ("order", "part"),
    [
        (fingers(0, 2, 1, 3, 4), "its knuckles are not in a row from index"),
        (fingers(0, 1, 2, 4, 3), "its knuckles are not in a row"),
        (fingers(0, 4, 3, 2, 1), "its knuckles are not in a row"),
        (fingers(1, 0, 2, 3, 4), "its bones have 3. to 2.. % of a hand's proportions"),
        (fingers(4, 3, 2, 1, 0), "its bones have "),
        ([*range(5), 5, 7, 6, *range(8, 21)], "its bones have 9. to 2.. % of"),
    ],
)
def test_swapped_keypoints_are_named_where_a_hand_is_given(order: list[int], part: str) -> None:
    depth, glass, _ = scene()
    assert check_hand(HAND, depth, CAMERA, glass, given=True).problems == ()
    assert re.match(part, check_hand(HAND[order], depth, CAMERA, glass, given=True).problems[0])


@pytest.mark.parametrize(("factor", "problems"), [(3.9, 0), (4.8, 1)])
def test_a_bone_that_is_far_too_long_is_named_where_a_hand_is_found(factor, problems) -> None:
    """The little finger's last bone, drawn out along itself."""
    glass, depth, hand = scene()
    stretched = HAND.copy()
    stretched[20] = HAND[19] + factor * (HAND[20] - HAND[19])
    found = [p for p in check_hand(stretched, depth, CAMERA, glass, hand).problems if "bones" in p]
    assert len(found) == problems


def test_a_hand_s_mask_in_place_of_the_glass_s_is_named() -> None:
    depth, _, hand = scene(0.9)
    *_, why = check_hand(HAND, depth, CAMERA, hand).problems
    assert "lie in the mask: is that the hand's?" in why
    before = np.zeros(CAMERA.shape, bool)
    before[:60] = True  # a glass before the fingers
    hidden = project(HAND, CAMERA)[:, 1] < 59.5
    assert 10 < hidden.sum() <= 16
    assert not any(
        "lie in the mask" in p for p in check_hand(0.5 * HAND, depth, CAMERA, before).problems
    )


def test_a_table_a_speck_and_a_doubtful_hand_are_none() -> None:
    depth, glass, hand = scene()
    whole = ~glass
    (why,) = check_hand(HAND, depth, CAMERA, glass, whole).problems
    area = (160 * 120 - 800) * 0.36 / 200**2
    assert "its pixels cover" in why
    assert area * 1e4 == pytest.approx(float(why.split()[3]), rel=0.03)
    speck = np.zeros_like(hand)
    speck[60:64, 78:82] = True
    assert any(
        "cover 1 square" in w for w in check_hand(HAND, depth, CAMERA, glass, speck).problems
    )
    cloth, _, _ = scene(0.582)
    (why,) = check_hand(HAND, cloth, CAMERA, glass, hand).problems
    assert why == "its pixels don't stand out: what is around them lies 0.2 cm behind them"
    doubt = check_hand(HAND, depth, CAMERA, glass, hand, presence=0.81)
    assert doubt.problems == ("its pixels have a mean probability of 0.81 of being a hand's",)

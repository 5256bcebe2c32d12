import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hadr.camera import TRANSHAND_CAMERA, project, transform_points
from hadr.hand import (
    ANGLE_LIMITS,
    ANGLE_NAMES,
    FINGERS,
    KEYPOINT_NAMES,
    SKELETON_NAMES,
    SKELETON_PARENTS,
    HandShape,
    absolute_hand_feature,
    check_keypoints,
    forward_kinematics,
    keypoints_from_skeleton,
    lift_keypoints,
    relative_hand_feature,
    wrist_axes,
    wrist_depth_at,
)

LONG_FINGERS = ("index", "middle", "ring", "little")


def random_angles(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(ANGLE_LIMITS[:, 0], ANGLE_LIMITS[:, 1])


def random_motion(rng: np.random.Generator) -> np.ndarray:
    motion = np.eye(4)
    motion[:3, :3] = Rotation.random(rng=rng).as_matrix()
    motion[:3, 3] = rng.uniform(-1, 1, 3)
    return motion


def hand_in_camera(seed: int = 0, side: str = "right") -> np.ndarray:
    """A posed hand some 0.7 m in front of the camera, metres, shape (21, 3)."""
    rng = np.random.default_rng(seed)
    joints = forward_kinematics(random_angles(rng), HandShape(side=side)).joints
    camera_from_wrist = random_motion(rng)
    camera_from_wrist[:3, 3] = (0.05, -0.02, 0.7)
    return transform_points(camera_from_wrist, keypoints_from_skeleton(joints))


# Names and counts


def test_joints_and_keypoints_have_the_detectors_names_in_its_order():
    assert len(set(SKELETON_NAMES)) == len(SKELETON_NAMES) == len(SKELETON_PARENTS) == 22
    assert SKELETON_NAMES[1] == "palm"
    assert tuple(n for n in SKELETON_NAMES if n != "palm") == KEYPOINT_NAMES
    assert KEYPOINT_NAMES[4::4] == ("thumb_tip", *(f"{finger}_tip" for finger in LONG_FINGERS))
    first = [KEYPOINT_NAMES[number] for number in (0, 5, 9, 13, 17)]
    assert first == ["wrist", *(f"{finger}_mcp" for finger in LONG_FINGERS)]
    assert FINGERS["middle"] == (9, 10, 11, 12)


def test_four_fingers_hang_on_the_palm_and_the_thumb_on_the_wrist():
    children = {SKELETON_NAMES[i] for i, parent in enumerate(SKELETON_PARENTS) if parent == 1}
    assert children == {f"{finger}_mcp" for finger in LONG_FINGERS}
    assert SKELETON_NAMES[SKELETON_PARENTS[SKELETON_NAMES.index("thumb_cmc")]] == "wrist"
    assert SKELETON_PARENTS[:2] == (-1, 0)
    for i, name in enumerate(SKELETON_NAMES):
        if name.endswith(("pip", "dip", "tip", "_ip")):
            assert SKELETON_PARENTS[i] == i - 1


def test_angles_are_named_with_limits():
    assert len(set(ANGLE_NAMES)) == len(ANGLE_NAMES) == len(ANGLE_LIMITS) == 20
    parts = ("cmc_spread", "cmc_stretch", "mcp_stretch", "ip_stretch")
    assert ANGLE_NAMES[:4] == tuple(f"thumb_{part}" for part in parts)
    assert ANGLE_NAMES[5] == "index_mcp_stretch"
    assert (ANGLE_LIMITS[:, 0] < ANGLE_LIMITS[:, 1]).all()


def test_keypoints_from_skeleton_drops_the_virtual_joint():
    joints = np.arange(66.0).reshape(22, 3)
    keypoints = keypoints_from_skeleton(joints)
    assert keypoints.shape == (21, 3)
    assert keypoints[:2].tolist() == [[0, 1, 2], [6, 7, 8]]
    with pytest.raises(
        ValueError, match=r"a skeleton has 22 joints, shape \(22, 3\); got \(21, 3\)"
    ):
        keypoints_from_skeleton(keypoints)


# Forward kinematics


def test_zero_pose_is_a_flat_hand_with_straight_fingers():
    shape = HandShape()
    keypoints = keypoints_from_skeleton(forward_kinematics(np.zeros(20), shape).joints)
    np.testing.assert_allclose(keypoints[0], 0.0)
    for finger in LONG_FINGERS:
        points = keypoints[list(FINGERS[finger])]
        np.testing.assert_allclose(points[0], shape.roots[finger])
        np.testing.assert_allclose(points[:, 2], 0.0, atol=1e-15)
        steps = np.diff(points, axis=0)
        np.testing.assert_allclose(np.linalg.norm(steps, axis=1), shape.lengths[finger])
        direction = (np.sin(shape.fan[finger]), np.cos(shape.fan[finger]), 0.0)
        np.testing.assert_allclose(
            points[3] - points[0], sum(shape.lengths[finger]) * np.array(direction)
        )
    # From the wrist to the tip of the middle finger: 0.090 + 0.048 + 0.030 + 0.023.
    np.testing.assert_allclose(keypoints[12], (0.0, 0.191, 0.0), atol=1e-15)


def test_bending_a_finger_by_a_right_angle_by_hand():
    angles = np.zeros(20)
    angles[ANGLE_NAMES.index("middle_pip_stretch")] = np.pi / 2
    keypoints = keypoints_from_skeleton(forward_kinematics(angles).joints)
    # Straight to the PIP joint at 0.090 + 0.048, from there out of the palm: 0.030, 0.023.
    np.testing.assert_allclose(keypoints[10], (0.0, 0.138, 0.0), atol=1e-12)
    np.testing.assert_allclose(keypoints[11], (0.0, 0.138, 0.030), atol=1e-12)
    np.testing.assert_allclose(keypoints[12], (0.0, 0.138, 0.053), atol=1e-12)


def test_spread_turns_a_finger_to_the_thumb():
    straight = forward_kinematics(np.zeros(20)).joints
    angles = np.zeros(20)
    angles[ANGLE_NAMES.index("middle_mcp_spread")] = 0.2
    spread = forward_kinematics(angles).joints
    tip = SKELETON_NAMES.index("middle_tip")
    length = 0.048 + 0.030 + 0.023
    expected = (length * np.sin(0.2), 0.090 + length * np.cos(0.2), 0.0)
    np.testing.assert_allclose(spread[tip], expected, atol=1e-12)
    moved = np.flatnonzero(np.abs(spread - straight).max(axis=1) > 1e-12)
    assert [SKELETON_NAMES[i] for i in moved] == ["middle_pip", "middle_dip", "middle_tip"]


@given(st.integers(0, 10_000), st.sampled_from(["right", "left"]), st.floats(0.5, 1.5))
@settings(max_examples=30)
def test_bones_keep_their_lengths_in_any_pose(seed, side, scale):
    shape = HandShape(side=side, scale=scale)
    straight = forward_kinematics(np.zeros(20), shape).joints
    posed = forward_kinematics(random_angles(np.random.default_rng(seed)), shape).joints
    for child, parent in enumerate(SKELETON_PARENTS):
        if parent >= 0:
            expected = np.linalg.norm(straight[child] - straight[parent])
            assert np.linalg.norm(posed[child] - posed[parent]) == pytest.approx(expected)


@given(st.integers(0, 10_000))
@settings(max_examples=30)
def test_joint_frames_are_rigid_and_point_along_their_bone(seed):
    skeleton = forward_kinematics(random_angles(np.random.default_rng(seed)))
    turns = skeleton.frames[:, :3, :3]
    np.testing.assert_allclose(
        turns @ turns.swapaxes(1, 2), np.tile(np.eye(3), (22, 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(turns), 1.0)
    np.testing.assert_allclose(skeleton.frames[:, :3, 3], skeleton.joints)
    for child, parent in enumerate(SKELETON_PARENTS):
        if parent >= 2:
            bone = skeleton.joints[child] - skeleton.joints[parent]
            np.testing.assert_allclose(turns[parent, :, 1], bone / np.linalg.norm(bone), atol=1e-12)


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("finger", list(FINGERS))
def test_stretching_moves_each_fingertip_out_of_the_palm(side, finger):
    tip = SKELETON_NAMES.index(f"{finger}_tip")
    heights = []
    for bend in (0.0, 0.2, 0.4):
        angles = np.where([n.startswith(finger) and "stretch" in n for n in ANGLE_NAMES], bend, 0.0)
        heights.append(forward_kinematics(angles, HandShape(side=side)).joints[tip, 2])
    assert heights[0] < heights[1] < heights[2]


@given(st.integers(0, 10_000))
@settings(max_examples=20)
def test_left_hand_is_the_mirror_image(seed):
    angles = random_angles(np.random.default_rng(seed))
    right, left = (forward_kinematics(angles, HandShape(side=s)).joints for s in ("right", "left"))
    np.testing.assert_allclose(left, right * (-1.0, 1.0, 1.0))


def test_scale_multiplies_every_length():
    angles = random_angles(np.random.default_rng(7))
    adult, child = (forward_kinematics(angles, HandShape(scale=s)).joints for s in (1.0, 0.7))
    np.testing.assert_allclose(child, 0.7 * adult)


@pytest.mark.parametrize(
    ("angles", "message"),
    [
        (np.zeros(21), r"angles must be 20 finite radians, got shape \(21,\)"),
        (np.full(20, np.nan), "angles must be 20 finite radians"),
        (np.zeros((1, 20)), r"got shape \(1, 20\)"),
    ],
)
def test_bad_angles(angles, message):
    with pytest.raises(ValueError, match=message):
        forward_kinematics(angles)


def test_bad_hand_shape():
    with pytest.raises(ValueError, match="side must be 'right' or 'left', got 'both'"):
        HandShape(side="both")
    with pytest.raises(ValueError, match=r"scale must lie in \(0.3, 3\), 1 being an adult, got 19"):
        HandShape(scale=19.0)


# The wrist frame


@pytest.mark.parametrize("side", ["right", "left"])
def test_wrist_axes_recover_the_pose_that_placed_the_hand(side):
    """The flat hand's own axes are the frame's; on a left hand x and z point the other way."""
    keypoints = keypoints_from_skeleton(
        forward_kinematics(np.zeros(20), HandShape(side=side)).joints
    )
    signs = (1, 1, 1) if side == "right" else (-1, 1, -1)
    camera_from_wrist = random_motion(np.random.default_rng(8))
    for pose in (np.eye(4), camera_from_wrist):
        axes = wrist_axes(torch.tensor(transform_points(pose, keypoints))[None])[0].numpy()
        np.testing.assert_allclose(axes * signs, pose[:3, :3], atol=1e-12)


def test_check_keypoints_names_what_is_wrong():
    with pytest.raises(ValueError, match=r"21 keypoints, shape \(21, 3\) in metres; got \(20, 3\)"):
        check_keypoints(np.zeros((20, 3)))
    broken = hand_in_camera()
    broken[4, 1], broken[17, 0] = np.nan, np.inf
    with pytest.raises(ValueError, match="must be finite; not so: thumb_tip, little_mcp"):
        check_keypoints(broken)


# The two hand features


def test_translation_only_feature_ignores_a_pure_translation():
    keypoints = torch.from_numpy(hand_in_camera())
    both = torch.stack([keypoints, keypoints + torch.tensor([0.3, -0.2, 0.5])])
    feature = absolute_hand_feature(both, wrist_rotation=False)
    torch.testing.assert_close(feature[0], feature[1])
    torch.testing.assert_close(feature[0].reshape(21, 3), keypoints - keypoints[0])


def test_the_wrist_frame_ignores_that_the_camera_turns_and_translation_alone_does_not():
    keypoints = hand_in_camera()
    turned = transform_points(random_motion(np.random.default_rng(10)), keypoints)
    both = torch.from_numpy(np.stack([keypoints, turned]))
    for rotation in (True, False):
        feature = absolute_hand_feature(both, wrist_rotation=rotation)
        changed = (feature[1] - feature[0]).abs().max()
        assert changed < 1e-9 if rotation else changed > 0.01


def test_absolute_feature_is_the_hand_in_its_own_frame():
    """By hand: seen in the wrist frame, a flat hand is where forward kinematics puts it."""
    flat = keypoints_from_skeleton(forward_kinematics(np.zeros(20)).joints)
    moved = transform_points(random_motion(np.random.default_rng(10)), flat)
    feature = absolute_hand_feature(torch.from_numpy(moved)[None])
    np.testing.assert_allclose(feature[0].reshape(21, 3), flat, atol=1e-12)
    np.testing.assert_allclose(feature[0, :3], 0.0, atol=1e-12)  # the wrist itself


def test_degenerate_hand_gives_zeros_and_a_finite_gradient():
    keypoints = torch.zeros(1, 21, 3, dtype=torch.float64, requires_grad=True)
    feature = absolute_hand_feature(keypoints)
    assert (wrist_axes(keypoints) == 0).all()
    assert (feature == 0).all()
    feature.sum().backward()
    assert torch.isfinite(keypoints.grad).all()


def test_relative_feature_by_hand():
    keypoints = torch.zeros(2, 21, 3)
    keypoints[0, 0] = torch.tensor([0.1, 0.2, 0.7])
    keypoints[1, 20] = torch.tensor([0.0, 0.0, 1.0])
    centers = torch.tensor([[0.125, 0.125, 0.625], [0.0, 0.25, 0.5]])
    feature = relative_hand_feature(keypoints, centers)
    assert feature.shape == (2, 63)
    torch.testing.assert_close(feature[0, :3], torch.tensor([-0.025, 0.075, 0.075]))
    torch.testing.assert_close(feature[0, 3:6], -centers[0])
    torch.testing.assert_close(feature[1, 60:], torch.tensor([0.0, -0.25, 0.5]))
    one_hand = relative_hand_feature(keypoints[:1], centers)
    torch.testing.assert_close(one_hand[1, :3], torch.tensor([0.1, -0.05, 0.2]))


# From 2.5D to 3D


@given(st.integers(0, 10_000))
@settings(max_examples=30)
def test_lift_inverts_projection(seed):
    keypoints = hand_in_camera(seed)
    uv = project(keypoints, TRANSHAND_CAMERA)
    wrist_depth = keypoints[0, 2]
    lifted = lift_keypoints(uv, keypoints[:, 2] - wrist_depth, wrist_depth, TRANSHAND_CAMERA)
    np.testing.assert_allclose(lifted, keypoints, atol=1e-12)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"uv": np.zeros((20, 2))}, r"uv must have shape \(21, 2\) in pixels, got \(20, 2\)"),
        (
            {"relative_depth": np.zeros(20)},
            r"relative_depth must have shape \(21,\) .* got \(20,\)",
        ),
        ({"wrist_depth": 0.0}, "wrist_depth must be positive metres, got 0.0"),
        ({"wrist_depth": float("nan")}, "wrist_depth must be positive metres, got nan"),
        ({"relative_depth": np.r_[np.zeros(20), -0.8]}, "little_tip lies behind the camera: -0.1"),
        ({"uv": np.full((21, 2), np.nan)}, "must be finite; not so: wrist, thumb_cmc"),
    ],
)
def test_bad_lift(changes, message):
    values = {"uv": np.zeros((21, 2)), "relative_depth": np.zeros(21), "wrist_depth": 0.7}
    with pytest.raises(ValueError, match=message):
        lift_keypoints(**(values | changes), camera=TRANSHAND_CAMERA)


def test_wrist_depth_is_the_median_of_its_window():
    depth = np.full((20, 20), 2.0)
    depth[8:11, 8:11] = 0.7
    depth[8, 8], depth[9, 9] = 0.0, np.nan
    assert wrist_depth_at(depth, (9.2, 8.9), window=3) == pytest.approx(0.7)
    assert wrist_depth_at(depth, (9.0, 9.0), window=9) == pytest.approx(2.0)
    hand = np.zeros((20, 20), bool)
    hand[8:11, 8:11] = True
    assert wrist_depth_at(depth, (9.0, 9.0), hand, window=9) == pytest.approx(0.7)


def test_column_comes_before_row():
    depth = np.zeros((6, 12))
    depth[1, 10] = 0.8
    assert wrist_depth_at(depth, (10.0, 1.0), window=1) == pytest.approx(0.8)


def test_a_missing_wrist_falls_back_to_the_hand():
    depth = np.zeros((20, 20))
    depth[15, 12:15] = (0.6, 0.7, 0.9)
    hand = np.zeros((20, 20), bool)
    hand[15, :] = True
    assert wrist_depth_at(depth, (2.0, 2.0), hand) == pytest.approx(0.7)
    assert wrist_depth_at(depth, (-50.0, 2.0), hand) == pytest.approx(0.7)
    with pytest.raises(ValueError, match=r"no valid depth around the wrist's pixel \(2, 2\)"):
        wrist_depth_at(depth, (2.0, 2.0))
    with pytest.raises(ValueError, match="no valid depth around the wrist's pixel"):
        wrist_depth_at(np.zeros((20, 20)), (2.0, 2.0), hand)


@pytest.mark.parametrize("pixel", [(np.nan, 3.0), (1.0, 2.0, 3.0)])
def test_bad_wrist_pixel(pixel):
    with pytest.raises(ValueError, match=r"uv_wrist must be a finite pixel \(u, v\), got"):
        wrist_depth_at(np.ones((5, 5)), pixel)

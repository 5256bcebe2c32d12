from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hadr.hand import ANGLE_LIMITS, FINGERS, HandShape, forward_kinematics
from hadr.synthesis.hand import skinning
from hadr.synthesis.hand.signed_distance import rest_angles
from hadr.synthesis.hand.skinning import (
    bends,
    blend_motions,
    bone_frames,
    dual_quaternions,
    posed_vertices,
    sized_template,
    skin_vertices,
)
from hadr.synthesis.hand.template import BONE_COUNT, COARSE_STEP, hand_template


def motion(turn: list[float], move: list[float]) -> np.ndarray:
    transform = np.eye(4)
    transform[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
    transform[:3, 3] = move
    return transform


def bone_motions(number: int, transform: np.ndarray) -> np.ndarray:
    motions = np.tile(np.eye(4), (BONE_COUNT, 1, 1))
    motions[number] = transform
    return motions


def test_one_bone_moves_its_points_rigidly():
    transform = motion([0.3, -2.2, 0.8], [0.1, -0.2, 0.05])
    points = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)
    weights = np.zeros((50, BONE_COUNT), dtype=np.float32)
    weights[:, 4] = 1
    moved = blend_motions(points, weights, bone_motions(4, transform))
    np.testing.assert_allclose(moved, points @ transform[:3, :3].T + transform[:3, 3], atol=2e-6)


def test_half_way_between_two_bones_is_half_the_turn_about_their_joint():
    """Linear blending would shrink the point toward the joint by cos 45 degrees."""
    joint = np.array([0.0, 0.05, 0.0])
    transform = motion([np.pi / 2, 0, 0], [0, 0, 0])
    transform[:3, 3] = joint - transform[:3, :3] @ joint
    weights = np.zeros((1, BONE_COUNT), dtype=np.float32)
    weights[0, [0, 4]] = 0.5
    point = (joint + np.array([0.003, 0.0, -0.01]))[None].astype(np.float32)
    half = Rotation.from_rotvec([np.pi / 4, 0, 0]).as_matrix()
    expected = joint + half @ [0.003, 0.0, -0.01]
    moved = blend_motions(point, weights, bone_motions(4, transform))
    np.testing.assert_allclose(moved[0], expected, atol=1e-7)


@pytest.mark.parametrize("side", ["right", "left"])
def test_bends_are_the_stretch_angles(side):
    rng = np.random.default_rng(5)
    angles = rng.uniform(ANGLE_LIMITS[:, 0], ANGLE_LIMITS[:, 1])
    shape = HandShape(side, 0.9)
    found = bends(bone_frames(forward_kinematics(angles, shape), side)).reshape(5, 3)
    fingers = angles.reshape(5, 4)[1:]
    np.testing.assert_allclose(found[1:, 1:], fingers[:, 2:], atol=1e-9)
    np.testing.assert_allclose(found[0, 1:], angles[2:4], atol=1e-9)
    # An MCP also spreads: its bend is the angle in the plane across the palm.
    np.testing.assert_allclose(np.sign(found[1:, 0]), np.sign(fingers[:, 1]))


def test_at_rest_the_skin_is_the_template():
    shape = HandShape()
    skin, part = skin_vertices(forward_kinematics(rest_angles(), shape), shape)
    template = hand_template(COARSE_STEP)
    np.testing.assert_allclose(skin, template.vertices, atol=1e-6)
    assert (part == template.part).all()


def test_the_skin_far_from_joints_follows_its_bone():
    """The middle of each finger's last bone moves as that bone's frame does."""
    shape = HandShape(scale=0.93)
    angles = np.zeros(20)
    angles[5::4], angles[6::4], angles[7::4] = 0.8, 1.3, 0.6
    skin, part = skin_vertices(forward_kinematics(angles, shape), shape)
    rest, _ = skin_vertices(forward_kinematics(rest_angles(), shape), shape)
    before = bone_frames(forward_kinematics(rest_angles(), shape), "right")
    after = bone_frames(forward_kinematics(angles, shape), "right")
    for i, finger in enumerate(FINGERS):
        bone = 3 + 3 * i
        local = (rest - before[bone, :3, 3]) @ before[bone, :3, :3]
        rows = (part == i) & (local[:, 1] > 0.7 * 0.93 * shape.lengths[finger][2])
        assert rows.sum() > 10
        expected = local[rows] @ after[bone, :3, :3].T + after[bone, :3, 3]
        assert np.abs(skin[rows] - expected).max() < 0.0002


@pytest.mark.parametrize(
    ("angle", "bend", "most"),
    [("pip", 90, 1e-9), ("pip", 110, 0.004), ("mcp", 60, 0.001), ("mcp", 90, 0.006)],
)
def test_the_skin_is_hardly_turned_inside_out_by_a_bend(angle, bend, most):
    """Share of the hand's area whose normal is against that of the skin turned with its bones."""
    shape = HandShape()
    angles = np.zeros(20)
    angles[{"mcp": 5, "pip": 6}[angle] :: 4] = np.deg2rad(bend)
    skeleton = forward_kinematics(angles, shape)
    skin, _ = skin_vertices(skeleton, shape)
    template = hand_template(COARSE_STEP)
    _, bone_from_wrist = sized_template(shape, COARSE_STEP)
    blend = template.weights @ dual_quaternions(bone_frames(skeleton, "right") @ bone_from_wrist)
    turns = Rotation.from_quat(blend[template.faces[:, 0]][:, [1, 2, 3, 0]])

    def areas(points: np.ndarray) -> np.ndarray:
        a, b, c = (points[template.faces[:, i]] for i in range(3))
        return np.cross(b - a, c - a) / 2

    expected, found = turns.apply(areas(template.vertices)), areas(skin)
    hand = template.vertices[template.faces[:, 0], 1] > 0
    inverted = hand & ((expected * found).sum(1) < 0)
    size = np.linalg.norm(found, axis=1)
    assert size[inverted].sum() <= most * size[hand].sum()


def test_girth_thickens_the_finger_and_length_lengthens_it():
    """In the bone's own axes: a finger 1.1 times as thick and 1.2 times as long."""
    usual = HandShape()
    lengths = {**usual.lengths, "middle": tuple(1.2 * b for b in usual.lengths["middle"])}
    changed = HandShape(lengths=lengths, girth=1.1)
    sizes = []
    for shape in (usual, changed):
        skin, part = skin_vertices(forward_kinematics(np.zeros(20), shape), shape)
        finger = skin[(part == 2) & (skin[:, 1] > 0.090 + 0.6 * sum(shape.lengths["middle"]))]
        sizes.append((np.ptp(finger[:, 0]), finger[:, 1].max() - 0.090))
    assert abs(sizes[1][0] / sizes[0][0] - 1.1) < 0.01
    assert abs(sizes[1][1] / sizes[0][1] - 1.2) < 0.01


@pytest.mark.parametrize(("joint", "least", "most"), [(1, 0.0015, 0.0025), (2, 0.0008, 0.0014)])
def test_the_end_of_a_bone_lifts_the_skin_of_a_joint_that_bends(joint, least, most, monkeypatch):
    """By two millimetres over a knuckle, one over the joint after it, at a right angle."""
    angles = np.zeros(20)
    angles[4 + joint] = np.pi / 2
    bent = forward_kinematics(angles, HandShape())
    lifted = posed_vertices(bent, HandShape(), COARSE_STEP)
    template = hand_template(COARSE_STEP)
    flat = replace(template, correctives=np.zeros_like(template.correctives))
    monkeypatch.setattr(skinning, "hand_template", lambda step: flat)
    gap = np.linalg.norm(lifted - posed_vertices(bent, HandShape(), COARSE_STEP), axis=1)
    assert least < gap.max() < most

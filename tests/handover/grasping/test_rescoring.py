"""The score of a grasp by hand-computed numbers: the printed formula and the described wish."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hadr.handover.grasping.grasps import Grasps
from hadr.handover.grasping.rescoring import (
    Directions,
    Weights,
    intended_score,
    literal_at_best_turn,
    literal_score,
    rescore,
)

BASE = Directions(np.array([1.0, 0, 0]), np.array([0.0, 0, -1.0]), "base")
QUARTER_Z = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])


def one_grasp(rotation: np.ndarray, frame: str = "base", score: float = 0.5) -> Grasps:
    row = np.concatenate([[score, 0.05, 0.02, 0.02], rotation.ravel(), [0, 0, 0.5, -1]])
    return Grasps.from_rows(row[None], frame)


def test_literal_by_hand() -> None:
    # identity: 0.5 + 0.4 + 0.2; quarter turn about z: x goes to y, z stays: 0.5 + 0 + 0.2
    rotations = np.stack([np.eye(3), QUARTER_Z])
    np.testing.assert_allclose(literal_score([0.5, 0.5], rotations, BASE), [1.1, 0.7])


def test_intended_by_hand() -> None:
    approach = np.array([[1.0, 0, 0], [0, 0, -1.0], [-1.0, 0, 0], [0.6, 0, -0.8]])
    expected = [0.4, 0.2, -0.4, 0.6 * 0.4 + 0.8 * 0.2]
    np.testing.assert_allclose(intended_score(np.zeros(4), approach, BASE), expected, atol=1e-12)


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1))
def test_literal_is_largest_at_the_identity_whatever_the_directions(seed: int) -> None:
    rng = np.random.default_rng(seed)
    directions = Directions(rng.normal(size=3), rng.normal(size=3))
    rotations = Rotation.random(20, rng=rng).as_matrix()
    assert literal_score(np.zeros(1), np.eye(3)[None], directions)[0] == pytest.approx(0.6)
    assert (literal_score(np.zeros(20), rotations, directions) <= 0.6 + 1e-12).all()


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1))
def test_intended_does_not_depend_on_the_frame(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn, grasp = (Rotation.random(rng=rng).as_matrix() for _ in range(2))
    camera_from_base = np.eye(4)
    camera_from_base[:3, :3], camera_from_base[:3, 3] = turn, rng.normal(size=3)
    in_base = rescore(one_grasp(grasp), BASE)
    in_camera = rescore(
        one_grasp(grasp).in_frame(camera_from_base, "camera"), BASE.in_frame(turn, "camera")
    )
    np.testing.assert_allclose(in_camera, in_base, atol=1e-12)


def test_literal_depends_on_the_frame() -> None:
    # the same gripper and the same directions, seen from a frame turned by a quarter about z
    camera_from_base = np.eye(4)
    camera_from_base[:3, :3] = QUARTER_Z
    grasps = one_grasp(np.eye(3))
    in_base = rescore(grasps, BASE, form="literal", axes="graspnet")
    in_camera = rescore(
        grasps.in_frame(camera_from_base, "camera"),
        BASE.in_frame(QUARTER_Z, "camera"),
        form="literal",
        axes="graspnet",
    )
    np.testing.assert_allclose([in_base[0], in_camera[0]], [1.1, 0.7], atol=1e-12)


def test_literal_depends_on_the_order_of_axes_and_intended_does_not() -> None:
    # R = I in graspnet's order approaches along x; in the paper's order it is a cyclic shift
    grasps = one_grasp(np.eye(3))
    assert rescore(grasps, BASE, form="literal", axes="graspnet")[0] == pytest.approx(1.1)
    assert rescore(grasps, BASE, form="literal", axes="paper")[0] == pytest.approx(0.5)
    assert rescore(grasps, BASE, axes="graspnet") == rescore(grasps, BASE, axes="paper")


def test_facing_the_human_beats_facing_the_robot() -> None:
    toward, back = one_grasp(np.eye(3)), one_grasp(QUARTER_Z @ QUARTER_Z)
    assert rescore(toward, BASE)[0] == pytest.approx(0.9)
    assert rescore(back, BASE)[0] == pytest.approx(0.1)


def test_mixed_frames_and_bad_directions_are_refused() -> None:
    with pytest.raises(ValueError, match=r"'camera'.*'base'"):
        rescore(one_grasp(np.eye(3), frame="camera"), BASE)
    with pytest.raises(ValueError, match="robot_to_human must be a direction"):
        Directions(np.zeros(3))
    with pytest.raises(ValueError, match="form must be"):
        rescore(one_grasp(np.eye(3)), BASE, form="other")  # type: ignore[arg-type]


@pytest.mark.parametrize("axes", ["paper", "graspnet"])
def test_best_turn_is_the_best_of_many_turns(axes):
    rng = np.random.default_rng(3)
    approach = rng.normal(size=(20, 3))
    approach /= np.linalg.norm(approach, axis=1, keepdims=True)
    directions = Directions(rng.normal(size=3), rng.normal(size=3))
    weights = Weights(1.0, 0.7, 0.3)
    found = literal_at_best_turn(approach, directions, axes=axes, weights=weights)
    for a, best in zip(approach, found, strict=True):
        side = np.cross(a, [0.3, -0.2, 0.9])
        side /= np.linalg.norm(side)
        turn = np.radians(np.arange(0, 360, 0.5))[:, None]
        closing = np.cos(turn) * side + np.sin(turn) * np.cross(a, side)
        front = np.broadcast_to(a, closing.shape)
        columns = [front, closing, np.cross(front, closing)]  # graspnetAPI: approach first
        if axes == "paper":
            columns = columns[1:] + columns[:1]
        rotations = np.stack(columns, axis=-1)
        tried = literal_score(np.zeros(len(turn)), rotations, directions, weights)
        assert best == pytest.approx(tried.max(), abs=1e-4)
        assert best >= tried.max() - 1e-9


def test_best_turn_at_the_frames_own_axis_reaches_the_whole_weight():
    directions = Directions(np.array([0.6, 0.0, 0.8]), np.array([0.0, 1.0, 0.0]))
    at_z = literal_at_best_turn(np.array([[0.0, 0.0, 1.0]]), directions)
    assert at_z == pytest.approx([0.6])
    at_x = literal_at_best_turn(np.array([[1.0, 0.0, 0.0]]), directions, axes="graspnet")
    assert at_x == pytest.approx([0.6])

"""Grasps on shapes whose good grasps are known: box, leaning cylinder, sphere, too wide things."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hadr.handover.grasping.candidates import NoCandidateError, sample_grasps, surface_normals
from hadr.handover.grasping.gripper import FINGER_HEIGHT

EYE = np.array([-1.0, -0.3, 0.6])


def seen(points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """The points whose surface faces the camera."""
    return points[((EYE - points) * normals).sum(axis=1) > 0]


def box(size: tuple[float, float, float]) -> np.ndarray:
    """The seen sides of a box around (0.5, 0, 0.3), metres."""
    rng = np.random.default_rng(0)
    half = np.array(size) / 2
    points, normals = [], []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            side = rng.uniform(-1, 1, (600, 3)) * half
            side[:, axis] = sign * half[axis]
            points.append(side)
            normals.append(np.tile(sign * np.eye(3)[axis], (600, 1)))
    return seen(np.concatenate(points) + np.array([0.5, 0, 0.3]), np.concatenate(normals))


def cylinder(axis: np.ndarray, radius: float = 0.03, length: float = 0.14) -> np.ndarray:
    """The seen side of a cylinder around (0.5, 0, 0.3), metres."""
    rng = np.random.default_rng(0)
    angle, along = rng.uniform(0, 2 * np.pi, 5000), rng.uniform(-length / 2, length / 2, 5000)
    out = np.stack([np.cos(angle), np.sin(angle), np.zeros(5000)], axis=1)
    turn = Rotation.align_vectors([axis], [[0, 0, 1.0]])[0].as_matrix()
    points = (radius * out + along[:, None] * [0, 0, 1.0]) @ turn.T + [0.5, 0, 0.3]
    return seen(points, out @ turn.T)


def sphere(radius: float) -> np.ndarray:
    """The seen side of a sphere around (0.5, 0, 0.3), metres."""
    out = np.random.default_rng(0).normal(size=(4000, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    return seen(radius * out + [0.5, 0, 0.3], out)


@pytest.mark.parametrize("axis", [[0, 0, 1.0], [0.6, 0, 0.8], [0, 0.8, 0.6]])
def test_cylinder_is_gripped_across_its_axis(axis: list[float]) -> None:
    direction = np.array(axis)
    grasps = sample_grasps(cylinder(direction), np.random.default_rng(1), viewpoint=EYE)
    best = grasps.select(np.arange(40))
    along = np.abs(best.axis("closing") @ direction)
    assert np.rad2deg(np.arcsin(along)).max() < 20
    # the diameter of 6 cm and the fingers' room, 1.6 cm
    np.testing.assert_allclose(best.widths, 0.076, atol=0.006)


def test_a_shorter_reach_stands_the_fingers_farther_back() -> None:
    cloud = cylinder(np.array([0, 0, 1.0]), radius=0.02)
    tips = {}
    for reach in (0.05, 0.025):
        grasps = sample_grasps(cloud, np.random.default_rng(1), viewpoint=EYE, reach=reach)
        facing = grasps.select(grasps.axis("approach")[:, 0] > 0.7)  # first met is what was seen
        past = []
        for turn, point in zip(facing.rotations[:10], facing.translations[:10], strict=True):
            own = (cloud - point) @ turn  # approach, closing, height
            between = (np.abs(own[:, 1]) < 0.04) & (np.abs(own[:, 2]) < FINGER_HEIGHT / 2)
            past.append(0.05 - own[between, 0].min())
        tips[reach] = np.array(past)
    # past the first touch; on a thing of 4 cm seldom less, as the contacts are 2 cm behind it
    np.testing.assert_allclose(tips[0.05], 0.05, atol=0.004)
    np.testing.assert_allclose(tips[0.025], 0.025, atol=0.004)


def test_the_gripper_s_middle_is_the_cylinder_s_although_half_is_unseen() -> None:
    grasps = sample_grasps(cylinder(np.array([0, 0, 1.0])), np.random.default_rng(1), viewpoint=EYE)
    best = grasps.select(np.arange(60))
    off = ((best.translations - [0.5, 0, 0.3]) * best.axis("closing")).sum(axis=1)
    assert np.abs(off).max() < 0.006
    # a grasp from the side meets the cylinder 3 cm before its axis
    side = np.abs(best.axis("approach")[:, 2]) < 0.15
    depth = (([0.5, 0, 0.3] - best.translations) * best.axis("approach")).sum(axis=1)[side]
    assert side.sum() > 5
    np.testing.assert_allclose(depth, 0.03, atol=0.01)
    assert np.median(depth) == pytest.approx(0.03, abs=0.002)


def test_box_is_gripped_by_its_narrow_sides() -> None:
    # 5 cm fit between the fingers, 12 and 15 cm do not
    grasps = sample_grasps(box((0.12, 0.05, 0.15)), np.random.default_rng(0), viewpoint=EYE)
    best = grasps.select(np.arange(30))
    assert np.rad2deg(np.arccos(np.abs(best.axis("closing")[:, 1]))).max() < 25
    assert np.abs(best.widths - 0.066).max() < 0.016


def test_sphere_is_gripped_through_its_middle() -> None:
    best = sample_grasps(sphere(0.03), np.random.default_rng(0), viewpoint=EYE).select(
        np.arange(40)
    )
    # how far the line between the fingers passes the centre, seen along the approach
    off = best.translations - [0.5, 0, 0.3]
    for axis in ("closing", "height"):
        aside = np.abs((off * best.axis(axis)).sum(axis=1))
        assert np.quantile(aside, 0.9) < 0.012, axis


def test_scores_are_shares_in_falling_order() -> None:
    points = cylinder(np.array([0, 0, 1.0]))
    grasps = sample_grasps(points, np.random.default_rng(0), viewpoint=EYE)
    assert len(grasps) >= 200
    assert grasps.scores.min() > 0
    assert grasps.scores.max() <= 1
    assert grasps.scores.max() > 0.8
    assert (np.diff(grasps.scores) <= 0).all()
    assert grasps.widths.max() <= 0.085
    assert grasps.frame == "camera"


def test_less_friction_leaves_fewer(monkeypatch: pytest.MonkeyPatch) -> None:
    rough = sample_grasps(sphere(0.03), np.random.default_rng(0), viewpoint=EYE)
    monkeypatch.setattr("hadr.handover.grasping.candidates.FRICTION", 0.3)
    smooth = sample_grasps(sphere(0.03), np.random.default_rng(0), viewpoint=EYE)
    # with little friction the draws are straighter, and still fewer pass
    assert len(smooth) < len(rough)


def test_toward_leaves_the_other_half_of_the_directions_out() -> None:
    points = cylinder(np.array([0, 0, 1.0]))
    way = np.array([1.0, 0, 0])
    grasps = sample_grasps(points, np.random.default_rng(0), viewpoint=EYE, toward=way)
    assert (grasps.axis("approach") @ way >= 0).all()
    free = sample_grasps(points, np.random.default_rng(0), viewpoint=EYE)
    assert (free.axis("approach") @ way).min() < -0.5


def test_same_seed_same_grasps_other_seed_others() -> None:
    points = sphere(0.03)
    first, again, other = (
        sample_grasps(points, np.random.default_rng(seed), viewpoint=EYE).to_rows()
        for seed in (4, 4, 5)
    )
    np.testing.assert_array_equal(first, again)
    assert first.shape != other.shape or not np.allclose(first, other)


def test_what_is_wider_than_the_gripper_is_refused_by_its_own_error() -> None:
    with pytest.raises(NoCandidateError, match=r"wider than the gripper's 0\.085 m"):
        sample_grasps(sphere(0.08), np.random.default_rng(0), viewpoint=EYE)


def test_grasps_move_with_their_frame() -> None:
    """The frame in which the points are written changes nothing but the numbers' frame."""
    points = cylinder(np.array([0, 0, 1.0]))
    new_from_old = np.eye(4)
    new_from_old[:3, :3] = Rotation.from_euler("xyz", [0.5, -1.0, 2.0]).as_matrix()
    new_from_old[:3, 3] = [0.3, -0.2, 1.0]
    there = points @ new_from_old[:3, :3].T + new_from_old[:3, 3]
    eye = new_from_old[:3, :3] @ EYE + new_from_old[:3, 3]
    grasps = sample_grasps(there, np.random.default_rng(0), viewpoint=eye)
    axis = new_from_old[:3, 2]
    along = np.abs(grasps.select(np.arange(30)).axis("closing") @ axis)
    assert np.rad2deg(np.arcsin(along)).max() < 20


def test_on_a_thin_rod_the_tips_end_35_mm_past_the_contacts() -> None:
    rod = cylinder(np.array([0, 0, 1.0]), radius=0.004)
    best = sample_grasps(rod, np.random.default_rng(0), viewpoint=EYE).select(np.arange(10))
    ends = best.translations + 0.05 * best.axis("approach")
    past = ((ends - [0.5, 0, 0.3]) * best.axis("approach") * [1, 1, 0]).sum(axis=1)
    level = np.abs(best.axis("approach")[:, 2]) < 0.3
    assert level.sum() > 3
    np.testing.assert_allclose(past[level], 0.035, atol=0.006)


def test_normals_of_a_cylinder_point_to_the_viewer() -> None:
    points = cylinder(np.array([0, 0, 1.0]))
    normals = surface_normals(points, EYE)
    expected = (points - [0.5, 0, 0]) * [1, 1, 0] / 0.03
    view = (EYE - points) / np.linalg.norm(EYE - points, axis=1, keepdims=True)
    middle = (np.abs(points[:, 2] - 0.3) < 0.06) & ((view * expected).sum(axis=1) > 0.4)
    assert (normals * expected).sum(axis=1)[middle].min() > 0.98


def test_bad_points_are_refused() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match=r"at least 30 rows.*\(5, 3\)"):
        sample_grasps(np.zeros((5, 3)), rng)
    broken = sphere(0.03)
    broken[3] = np.nan
    with pytest.raises(ValueError, match="must be finite"):
        sample_grasps(broken, rng)

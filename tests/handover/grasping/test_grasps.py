"""Rows of 17 numbers, axes by name, the pose before the grasp and the final move."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hadr.handover.grasping.grasps import Grasps, final_travel, forward_of, pre_grasp

# approach x, closing y, height z, at (0.1, 0.2, 0.7)
ROW = np.array([0.8, 0.06, 0.02, 0.03, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0.1, 0.2, 0.7, 4])


def random_rows(n: int) -> np.ndarray:
    rng = np.random.default_rng(3)
    rotations = Rotation.random(n, rng=rng).as_matrix().reshape(n, 9)
    size, place = rng.uniform(0.01, 0.08, (n, 4)), rng.normal(size=(n, 3))
    return np.concatenate([size, rotations, place, np.arange(n)[:, None]], axis=1)


def test_round_trip() -> None:
    rows = random_rows(6)
    np.testing.assert_array_equal(Grasps.from_rows(rows).to_rows(), rows)


def test_named_access() -> None:
    grasps = Grasps.from_rows(ROW[None])
    assert (grasps.scores[0], grasps.widths[0], grasps.heights[0]) == (0.8, 0.06, 0.02)
    assert (grasps.depths[0], grasps.object_ids[0], grasps.frame) == (0.03, 4, "camera")
    np.testing.assert_array_equal(grasps.translations[0], [0.1, 0.2, 0.7])


def test_axes_by_name_and_the_papers_order() -> None:
    grasps = Grasps.from_rows(random_rows(5))
    for column, name in enumerate(("approach", "closing", "height")):
        np.testing.assert_array_equal(grasps.axis(name), grasps.rotations[:, :, column])
    poses = grasps.poses
    np.testing.assert_array_equal(poses[:, :3, 2], grasps.axis("approach"))
    np.testing.assert_array_equal(poses[:, :3, 0], grasps.axis("closing"))
    np.testing.assert_allclose(np.linalg.det(poses[:, :3, :3]), 1.0)


def test_pre_grasp_is_ten_centimetres_back_along_the_approach() -> None:
    grasps = Grasps.from_rows(ROW[None])
    np.testing.assert_allclose(pre_grasp(grasps)[0, :3, 3], [0.0, 0.2, 0.7], atol=1e-12)
    # graspnetAPI's own third axis would put it 10 cm beside instead
    beside = pre_grasp(grasps, axis="height")[0, :3, 3]
    np.testing.assert_allclose(beside, [0.1, 0.2, 0.6], atol=1e-12)


def test_final_move_in_both_readings() -> None:
    before = pre_grasp(Grasps.from_rows(ROW[None]))[0]
    assert final_travel("past_grasp") == pytest.approx(0.15)
    assert final_travel("from_pre_grasp") == pytest.approx(0.05)
    past = forward_of(before, final_travel("past_grasp"))[:3, 3]
    short = forward_of(before, final_travel("from_pre_grasp"))[:3, 3]
    np.testing.assert_allclose(past, [0.15, 0.2, 0.7], atol=1e-12)
    np.testing.assert_allclose(short, [0.05, 0.2, 0.7], atol=1e-12)
    with pytest.raises(ValueError, match="got 'sideways'"):
        final_travel("sideways")  # type: ignore[arg-type]


def test_in_frame_moves_points_and_axes() -> None:
    base_from_camera = np.eye(4)
    base_from_camera[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    base_from_camera[:3, 3] = [1, 0, 0]
    moved = Grasps.from_rows(ROW[None]).in_frame(base_from_camera, "base")
    np.testing.assert_allclose(moved.axis("approach")[0], [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(moved.translations[0], [0.8, 0.1, 0.7], atol=1e-12)
    assert moved.frame == "base"


def test_select_keeps_the_order() -> None:
    rows = random_rows(4)
    picked = Grasps.from_rows(rows).select(np.array([2, 0]))
    np.testing.assert_array_equal(picked.to_rows(), rows[[2, 0]])
    assert len(Grasps.from_rows(rows).select(np.zeros(4, dtype=bool))) == 0


def test_bad_rows_are_named() -> None:
    with pytest.raises(ValueError, match=r"shape \(n, 17\).*\(2, 16\)"):
        Grasps.from_rows(np.zeros((2, 16)))
    broken = np.stack([ROW, ROW])
    broken[1, 14] = np.nan
    with pytest.raises(ValueError, match="grasp 1: ty must be finite"):
        Grasps.from_rows(broken)
    scaled = ROW.copy()
    scaled[4] = 2.0
    with pytest.raises(ValueError, match="grasp 0: R must be a proper rotation"):
        Grasps.from_rows(scaled[None])
    mirrored = ROW.copy()
    mirrored[4] = -1.0
    with pytest.raises(ValueError, match="det -1"):
        Grasps.from_rows(mirrored[None])
    negative = ROW.copy()
    negative[1] = -0.01
    with pytest.raises(ValueError, match=r"widths must be 0 or more.*-0\.01"):
        Grasps.from_rows(negative[None])

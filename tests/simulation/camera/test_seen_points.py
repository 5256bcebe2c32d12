"""Points of the object without outliers, and of what the gripper must not touch."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from hadr.camera import back_project
from hadr.simulation.camera.robot_camera import RobotCamera
from hadr.simulation.camera.seen_points import object_points, scene_points, without_outliers
from hadr.simulation.world.scenes import HeldScene
from hadr.simulation.world.state import WorldState


def test_scene_points_hold_the_forearm_but_neither_hand_nor_arm_nor_object(
    scene: HeldScene, camera: RobotCamera, at: Callable[..., WorldState]
) -> None:
    frame = camera.capture(at(scene, 0.0), scene, np.random.default_rng(0), color=False)
    exact = replace(frame, raw_depth=frame.depth)
    points = scene_points(exact, frame.object_mask, frame.keypoints)
    distance, _ = cKDTree(frame.keypoints).query(points)
    assert distance.min() > 0.06
    assert np.linalg.norm(points - frame.keypoints.mean(axis=0), axis=1).max() < 0.5
    images = {
        name: back_project(np.where(mask, frame.depth, 0), frame.camera)[mask]
        for name, mask in (("hand", frame.hand_mask), ("arm", frame.arm_mask))
    }
    on_forearm, _ = cKDTree(points).query(images["hand"])
    beyond, _ = cKDTree(frame.keypoints).query(images["hand"])
    assert (on_forearm[beyond > 0.08] < 0.03).mean() > 0.9
    off_arm, _ = cKDTree(images["arm"]).query(points)
    assert off_arm.min() > 0.005
    cubes = np.floor(points / 0.015)
    assert len(np.unique(cubes, axis=0)) == len(points)


def test_outliers_are_dropped_and_a_sheet_stays_whole() -> None:
    grid = np.stack(np.meshgrid(np.arange(20), np.arange(20)), axis=-1).reshape(-1, 2) * 0.003
    sheet = np.column_stack([grid, np.full(400, 0.6)])
    cloud = np.vstack([sheet, [[0.03, 0.03, 0.9], [0.2, 0.0, 0.6]]])
    kept = without_outliers(cloud)
    assert (kept[:, 2] == 0.6).all()
    assert kept[:, 0].max() < 0.1
    assert len(kept) >= 396
    assert len(without_outliers(sheet[:5])) == 5


def test_object_points_are_thinned_and_too_few_are_none(camera: RobotCamera) -> None:
    depth = np.full(camera.intrinsics.shape, 0.6, np.float32)
    mask = np.zeros(depth.shape, bool)
    mask[20:80, 50:110] = True
    points = object_points(depth, mask, camera.intrinsics, np.random.default_rng(0))
    assert points is not None
    assert 1400 < len(points) <= 1500
    depth[:] = 0
    depth[30, 60:69] = np.nan
    assert object_points(depth, mask, camera.intrinsics, np.random.default_rng(0)) is None
    depth[30, 60:69] = 0.6
    assert object_points(depth, mask, camera.intrinsics, np.random.default_rng(0)) is None

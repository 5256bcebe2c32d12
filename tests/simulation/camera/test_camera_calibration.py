"""A real camera's calibration file: what it holds is read, what contradicts itself is refused."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hadr.camera import project, transform_points
from hadr.simulation.camera.camera_calibration import read_calibration


def calibration_values() -> dict[str, object]:
    """Camera 2's colour sensor of a real file, rounded, with P computed from K, R and t."""
    matrix = [[925.355957, 0.0, 649.697632], [0.0, 925.826294, 359.535522], [0.0, 0.0, 1.0]]
    turn = Rotation.from_euler("xyz", [100.0, -5.0, 165.0], degrees=True).as_matrix()
    shift = [[0.0210294], [0.3760795], [1.4884954]]
    projection = np.array(matrix) @ np.hstack([turn, shift])
    pose = {"R": turn.tolist(), "t": shift, "P": projection.tolist()}
    return {
        "camera2": {
            "K": {"rgb": matrix},
            "extrinsics_world_to_camera": {"rgb": pose},
            "extra_points_uv": [[556, 324]],
        }
    }


def written(folder: Path, values: object) -> Path:
    path = folder / "calib.json"
    path.write_text(json.dumps(values), encoding="utf-8")
    return path


def test_a_calibration_file_gives_intrinsics_and_pose(tmp_path: Path) -> None:
    values = calibration_values()
    found = read_calibration(written(tmp_path, values), "camera2")
    assert found.intrinsics.fx == 925.355957
    assert found.intrinsics.cy == 359.535522
    assert found.intrinsics.shape == (720, 1280)
    pose = values["camera2"]["extrinsics_world_to_camera"]["rgb"]  # type: ignore[index]
    # a point of the world is seen where the file's own P projects it
    point = np.array([0.3, 0.2, 0.1])
    u, v, w = np.array(pose["P"]) @ [*point, 1]
    seen = transform_points(np.linalg.inv(found.base_from_camera), point)
    np.testing.assert_allclose(project(seen, found.intrinsics), [u / w, v / w], atol=1e-9)
    assert seen[2] == pytest.approx(w)
    moved = np.eye(4)
    moved[:3, 3] = [0.5, 0.0, 0.1]
    there = read_calibration(tmp_path / "calib.json", "camera2", base_from_world=moved)
    np.testing.assert_allclose(there.base_from_camera, moved @ found.base_from_camera, atol=1e-12)


def test_a_broken_calibration_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"nowhere\.json"):
        read_calibration(tmp_path / "nowhere.json")
    with pytest.raises(ValueError, match="camera1/rgb"):
        read_calibration(written(tmp_path, calibration_values()))
    values = calibration_values()
    pose = values["camera2"]["extrinsics_world_to_camera"]["rgb"]  # type: ignore[index]
    pose["t"][0][0] += 0.01
    with pytest.raises(ValueError, match=r"is not K \[R \| t\]"):
        read_calibration(written(tmp_path, values), "camera2")
    pose["R"][0][0] += 0.1
    with pytest.raises(ValueError, match="proper rotation"):
        read_calibration(written(tmp_path, values), "camera2")
    (tmp_path / "calib.json").write_text("{", encoding="utf-8")
    with pytest.raises(ValueError, match="is no JSON"):
        read_calibration(tmp_path / "calib.json")

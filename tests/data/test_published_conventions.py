"""A second reader: the published loader's conventions, written anew from their description.

Nothing of the package is used but the place of the bundled frames. The log holds the camera's
centre and its Euler angles in degrees, R = Rz Ry Rx; the camera looks along -z with y up, so that
camera coordinates are diag(1, -1, -1) inverse(T) X. Keypoints in pixels are those of a picture of
1280x720 with f = 1137.7778 and the principal point in the middle, ((W - 1) / 2, (H - 1) / 2).
"""

import json
from math import cos, radians, sin

import numpy as np
import pytest

from hadr.data.samples import samples_dir

FOCAL, CENTER = 1137.7778, ((1280 - 1) / 2, (720 - 1) / 2)


def logs(folder):
    root = samples_dir() / folder
    if not root.is_dir():
        pytest.skip(f"{root} is not there: restore it from the repository or `hadr generate` it")
    return sorted(root.glob("*/*/depth/log_json/*.json"))


def rotation(angle):
    x, y, z = (radians(a) for a in angle)
    about_x = [[1, 0, 0], [0, cos(x), -sin(x)], [0, sin(x), cos(x)]]
    about_y = [[cos(y), 0, sin(y)], [0, 1, 0], [-sin(y), 0, cos(y)]]
    about_z = [[cos(z), -sin(z), 0], [sin(z), cos(z), 0], [0, 0, 1]]
    return np.array(about_z) @ np.array(about_y) @ np.array(about_x)


def seen_keypoints(log):
    """The first 21 world keypoints in the OpenCV camera frame."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation(log["camera angle"]), log["camera point"]
    world = np.array(list(log["hand_keypoint"].values())[:21])
    local = np.linalg.solve(pose, np.column_stack([world, np.ones(21)]).T)[:3]
    return (np.diag([1, -1, -1]) @ local).T


@pytest.mark.parametrize("folder", ["frames", "gallery"])
def test_stored_pixels_follow_from_stored_world_points(folder):
    paths = logs(folder)
    assert paths
    worst, wrists = 0.0, set()
    for path in paths:
        log = json.loads(path.read_text())
        x, y, z = seen_keypoints(log).T
        assert (z > 0.15).all(), path
        uv = np.column_stack([FOCAL * x / z + CENTER[0], FOCAL * y / z + CENTER[1]])
        stored = np.loadtxt(path.parents[1] / "hand_kpt" / f"{path.stem}.txt")
        assert stored.shape == (21, 2), path
        worst = max(worst, np.abs(uv - stored).max())
        wrists.add(tuple(stored[0]))
        assert next(iter(log["hand_keypoint"])) == "wrist", path
    assert worst < 0.5
    assert len(wrists) == len(paths)  # no two frames share their keypoints

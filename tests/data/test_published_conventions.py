"""A second reader: the published loader's conventions, written anew from their description.

Nothing of the package is used but the place of the bundled frames. The log holds the camera's
centre and its Euler angles in degrees, R = Rz Ry Rx; the camera looks along -z with y up, so that
camera coordinates are diag(1, -1, -1) inverse(T) X. Keypoints in pixels are those of a picture of
1280x720 with f = 1137.7778 and the principal point in the middle, ((W - 1) / 2, (H - 1) / 2).
"""

import json
from math import cos, radians, sin

import cv2
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


@pytest.mark.parametrize("folder", ["frames", "gallery"])
def test_the_log_s_intrinsics_are_those_of_the_picture(folder):
    """The published camera, scaled; a pixel centre c becomes (c + 0.5) s - 0.5."""
    for path in logs(folder)[::7]:
        k = np.array(json.loads(path.read_text())["camera internal"])
        picture = next((path.parents[1] / "rgb").glob(f"{path.stem}.*"))
        height, width = cv2.imread(str(picture)).shape[:2]
        s = width / 1280
        assert k[0, 0] == pytest.approx(FOCAL * s, rel=1e-6)
        assert k[0, 2] == pytest.approx((CENTER[0] + 0.5) * s - 0.5, abs=1e-6)
        assert k[1, 2] == pytest.approx((CENTER[1] + 0.5) * height / 720 - 0.5, abs=1e-6)


def test_keypoints_lie_on_the_hand_of_the_picture():
    """A wrong axis or sign would put them elsewhere: most of those in the picture hit the hand."""
    shares = []
    for path in logs("frames")[::5]:
        log = json.loads(path.read_text())
        stored = np.loadtxt(path.parents[1] / "hand_kpt" / f"{path.stem}.txt")
        masks = [
            cv2.imread(str(path.parents[1] / name / f"{path.stem}.png"), 0) > 127
            for name in ("hand_mask", "obj_mask")
        ]
        held = cv2.dilate((masks[0] | masks[1]).astype(np.uint8), np.ones((5, 5)))
        k = np.array(log["camera internal"])
        scale = k[0, 0] / FOCAL
        u, v = np.rint((stored + 0.5) * scale - 0.5).astype(int).T
        inside = (u >= 0) & (v >= 0) & (u < held.shape[1]) & (v < held.shape[0])
        shares.append(held[v[inside], u[inside]].mean())
    assert np.mean(shares) > 0.9
    assert np.min(shares) > 0.5

"""Numbers of frames against scenes whose numbers are known."""

import numpy as np
import pytest

from hadr.camera import Intrinsics
from hadr.data.frame import Frame
from hadr.synthesis.generation.statistics import frame_statistics, visible_share
from hadr.synthesis.glass.objects import bodies, glass_object
from hadr.synthesis.rendering.raycast import RayCaster
from hadr.synthesis.scene.contents import Contents

CAMERA = Intrinsics(140.0, 140.0, 79.5, 44.5, 160, 90)
# The camera looks along the world's -x from 0.6 m; the glass stands at the world's origin.
WORLD_FROM_CAMERA = np.array([[0.0, 0, -1, 0.6], [1, 0, 0, 0], [0, -1, 0, 0.05], [0, 0, 0, 1]])


def frame(**changes):
    shape = CAMERA.shape
    made = {
        "stem": "000000",
        "object_id": "0000",
        "split": "test",
        "color": np.zeros((*shape, 3), np.uint8),
        "depth": np.full(shape, 0.5, np.float32),
        "hand_mask": np.zeros(shape, bool),
        "object_mask": np.zeros(shape, bool),
        "keypoints": np.tile([0.3, 0.0, 0.4], (21, 1)),
        "keypoints_uv": np.zeros((21, 2)),
        "camera": CAMERA,
        "world_from_camera": WORLD_FROM_CAMERA,
        "hold_id": "0000-side-0001",
    }
    return Frame(**(made | changes))


def tumbler_frame(pose=np.eye(4)):  # noqa: B008
    glass = tuple(body.moved(pose) for body in bodies(glass_object("0000")))
    labels = RayCaster(Contents(None, glass)).labels(CAMERA, WORLD_FROM_CAMERA)
    return frame(object_mask=labels.object_mask, world_from_object=pose)


def test_counted_by_hand():
    glass, hand = np.zeros(CAMERA.shape, bool), np.zeros(CAMERA.shape, bool)
    glass[10:30, 10:40], hand[40:60, 10:30] = True, True
    raw = np.full(CAMERA.shape, 0.507, np.float32)
    raw[hand] = 0.498
    raw[glass] = 0.53
    raw[10:15, 10:40] = 0.0  # a quarter of the glass
    found = frame_statistics([frame(object_mask=glass, hand_mask=hand, raw_depth=raw)])
    assert len(found) == 1
    assert found.hold_id == ("0000-side-0001",)
    np.testing.assert_allclose(found.distance_m, [0.5])
    np.testing.assert_allclose(found.glass_depth_m, [0.5])
    np.testing.assert_allclose(found.glass_share, [600 / 14400])
    np.testing.assert_allclose(found.hand_share, [400 / 14400])
    np.testing.assert_allclose(found.missing_share, [0.25])
    np.testing.assert_allclose(found.bias_m, [0.03], atol=1e-6)
    np.testing.assert_allclose(found.hand_error_m, [0.002], atol=1e-6)
    np.testing.assert_allclose(found.world_error_m, [0.007], atol=1e-6)


def test_what_a_frame_lacks_is_nan():
    found = frame_statistics([frame(), tumbler_frame()])
    assert np.isnan(found.visible_share[0])
    assert np.isnan(found.bias_m).all()
    assert np.isfinite(found.distance_m).all()


def test_without_glass_the_hand_is_still_measured():
    found = frame_statistics([frame(raw_depth=np.full(CAMERA.shape, 0.507, np.float32))])
    assert np.isnan([found.glass_depth_m, found.missing_share, found.bias_m]).all()
    np.testing.assert_allclose(found.world_error_m, [0.007], atol=1e-6)


def test_a_glass_alone_is_wholly_visible_and_half_of_it_by_half():
    whole = tumbler_frame()
    assert visible_share(whole) == pytest.approx(1.0, abs=0.02)
    rows, _ = np.nonzero(whole.object_mask)
    hidden = whole.object_mask.copy()
    hidden[: int(np.median(rows))] = False
    half = frame(object_mask=hidden, world_from_object=np.eye(4))
    assert visible_share(half) == pytest.approx(hidden.sum() / whole.object_mask.sum(), abs=0.02)


def test_the_object_pose_is_used():
    moved = np.eye(4)
    moved[:3, 3] = (0.0, 0.08, 0.02)
    assert visible_share(tumbler_frame(moved)) == pytest.approx(1.0, abs=0.03)


def test_no_frame_is_refused():
    with pytest.raises(ValueError, match="no frames"):
        frame_statistics([])

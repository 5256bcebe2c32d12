"""A frame with a glass before a wall."""

import numpy as np
import pytest

from hadr.camera import Intrinsics
from hadr.data.frame import Frame


@pytest.fixture
def frame_of():
    """Makes the frame, with some of its parts replaced."""

    def make(**changes):
        mask = np.zeros((40, 60), bool)
        mask[10:30, 20:40] = True
        made = {
            "stem": "000007",
            "object_id": "0000",
            "split": "test",
            "color": np.zeros((40, 60, 3), np.uint8),
            "depth": np.where(mask, 0.5, 0.8).astype(np.float32),
            "hand_mask": np.roll(mask, 20, 1),
            "object_mask": mask,
            "keypoints": np.ones((21, 3)),
            "keypoints_uv": np.full((21, 2), 8.0),
            "camera": Intrinsics(80.0, 80.0, 29.5, 19.5, 60, 40),
            "world_from_camera": np.eye(4),
            "background_depth": np.full((40, 60), 0.8, np.float32),
            "raw_depth": np.full((40, 60), 0.52, np.float32),
        }
        return Frame(**(made | changes))

    return make

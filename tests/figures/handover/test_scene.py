"""The drawn hand has the keypoints that it is drawn for."""

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from hadr.figures.handover.scene import hand_skin
from hadr.hand import FINGERS, HandShape, forward_kinematics, keypoints_from_skeleton


def test_the_skin_lies_around_the_keypoints_wherever_the_hand_is() -> None:
    angles = np.linspace(0.1, 0.7, 20)
    hand = 1.2 * keypoints_from_skeleton(forward_kinematics(angles, HandShape()).joints)
    moved = Rotation.from_rotvec((0.4, -2.0, 0.9)).apply(hand) + np.array([0.3, -0.1, 0.8])
    skin = hand_skin(moved)
    away, _ = cKDTree(skin.vertices).query(moved)
    assert away.max() < 0.03  # inside of a wrist
    tips = [joints[-1] for joints in FINGERS.values()]
    assert away[tips].max() < 0.012
    fist = hand_skin(0.8 * moved)
    assert np.allclose(fist.vertices, 0.8 * skin.vertices, atol=1e-4)

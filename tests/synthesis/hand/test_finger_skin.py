import numpy as np

from hadr.hand import FINGERS, HandShape, forward_kinematics
from hadr.synthesis.hand.finger_skin import finger_skin
from hadr.synthesis.hand.skinning import skin_vertices


def test_posed_finger_skin_is_the_hands_skin():
    """Straight fingers: rigid pieces; the quick skin and the final one are the same."""
    rng = np.random.default_rng(3)
    shape = HandShape("right", 0.93)
    for i, finger in enumerate(FINGERS):
        angles = np.zeros(20)
        angles[4 * i : 4 * i + 4] = np.deg2rad(rng.uniform(-5, 25, 4))
        skin = finger_skin(finger, shape)
        points, joints = skin.pose(angles[None, 4 * i : 4 * i + 4], np.eye(4))
        skeleton = forward_kinematics(angles, shape)
        vertices, _ = skin_vertices(skeleton, shape)
        away = np.linalg.norm(points[:, 0] - vertices[skin.rows], axis=1)
        assert np.median(away) < 0.0006
        assert away.max() < 0.004
        np.testing.assert_allclose(
            joints[0], skeleton.joints[[1 + j for j in FINGERS[finger]]], atol=1e-9
        )

"""The gripper's lines and boxes have its sizes, and move with its pose."""

import numpy as np
import pytest

from hadr.handover.grasping.gripper import fork, gripper_boxes


def test_fork_has_the_gripper_s_size() -> None:
    left, right, bar, stem = fork(0.06)
    np.testing.assert_allclose([left[0, 0], right[0, 0]], [-0.035, 0.035])
    assert np.linalg.norm(left[1] - left[0]) == pytest.approx(0.06)
    np.testing.assert_allclose(bar[:, 2], -0.06)
    assert stem[1, 2] == pytest.approx(-0.12)


def test_boxes_of_the_gripper() -> None:
    left, right, bar, palm = gripper_boxes(np.array([0.06]))[0]
    np.testing.assert_allclose(left, [[-0.04, -0.01, -0.06], [-0.03, 0.01, 0.0]])
    np.testing.assert_allclose(right, [[0.03, -0.01, -0.06], [0.04, 0.01, 0.0]])
    np.testing.assert_allclose(bar, [[-0.0525, -0.0125, -0.08], [0.0525, 0.0125, -0.06]])
    np.testing.assert_allclose(palm, [[-0.04, -0.03, -0.145], [0.04, 0.03, -0.06]])
    swept = gripper_boxes(np.array([0.06]), behind=0.1, ahead=0.05)[0]
    np.testing.assert_allclose(swept[1], [[0.03, -0.01, -0.16], [0.04, 0.01, 0.05]])

import numpy as np
import pytest

from hadr.synthesis.holding.kinds import pose_from_axis


def test_poses_from_an_axis():
    pose = pose_from_axis([0, 1, 0], [0.01, 0.02, 0.03], 0.05, [1, 3, 0])
    np.testing.assert_allclose(pose[:3, 2], [0, 1, 0])
    np.testing.assert_allclose(pose[:3, 0], [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(pose @ [0, 0, 0.05, 1], [0.01, 0.02, 0.03, 1])
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)

import matplotlib.pyplot as plt
import numpy as np
import pytest

from hadr.figures.depth.stereo import draw_stereo_camera


@pytest.mark.parametrize("glass", [False, True])
def test_the_camera_measures_the_wall_but_not_through_glass(glass: bool) -> None:
    """Without glass the imagers' rays are straight; with it their continuations meet before."""
    figure, ax = plt.subplots()
    draw_stereo_camera(ax, glass, "title")
    lines = [line.get_xydata() for line in ax.lines if len(line.get_xdata()) == 3]
    assert len(lines) == 3, "the projector's ray and one for each imager"
    for points in lines:
        np.testing.assert_allclose(points[-1], (0.12, 1.0))
    turns = [np.linalg.det(np.diff(points, axis=0)) for points in lines]
    assert turns[0] == pytest.approx(0, abs=1e-12)
    assert all(abs(turn) > 1e-3 for turn in turns[1:]) == glass
    ghosts = [line.get_xydata()[0] for line in ax.lines if line.get_marker() == "x"]
    assert len(ghosts) == int(glass)
    if glass:
        assert 0.55 < ghosts[0][1] < 1.0, "between glass and wall"
    plt.close(figure)

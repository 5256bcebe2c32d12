"""The drawn hand has the keypoints that it is drawn for."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from hadr.figures.handover.scene import Carried, HandFilm, hand_skin, moment_picture, show_errors
from hadr.hand import FINGERS, HandShape, forward_kinematics, keypoints_from_skeleton
from hadr.simulation.trials.rehearsal import rehearsed_scene

SCENE = rehearsed_scene()


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


def shifted(*, x_mm):
    poses = np.tile(np.eye(4), (len(x_mm), 1, 1))
    poses[:, 0, 3] = np.array(x_mm) / 1000
    return poses


@pytest.fixture
def film():
    """A hand that moves 0, 10 and 20 mm along x; the grasp goes with it."""
    way = shifted(x_mm=[0, 10, 20])
    keypoints = SCENE.keypoints + way[:, None, :3, 3]
    return HandFilm(
        np.array([0.0, 1.0, 2.0]), keypoints, SCENE.item, way @ SCENE.base_from_object, way
    )


@pytest.fixture
def ways():
    return [
        Carried("left behind", "#9a9a9a", shifted(x_mm=[0, 0, 0])),
        Carried("3 mm ahead", "#009E73", shifted(x_mm=[3, 13, 23])),
    ]


def test_chart_is_drawn_in_millimetres_up_to_the_moment(film, ways):
    _, ax = plt.subplots(layout="none")
    show_errors(ax, film, ways, limit_mm=15, at=1)
    full = {line.get_label(): line.get_xydata() for line in ax.lines if line.get_label()[0] != "_"}
    np.testing.assert_allclose(full["left behind"], [[0, 0], [1, 10]], atol=1e-9)
    np.testing.assert_allclose(full["3 mm ahead"], [[0, 3], [1, 3]], atol=1e-9)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("time (s)", "grasp off (mm)")


def test_pictures_of_a_film_have_one_size_and_differ(film, ways):
    pictures = []
    for at in (0, 2):
        figure = moment_picture(film, ways, at, limit_mm=30)
        figure.canvas.draw()
        pictures.append(np.asarray(figure.canvas.buffer_rgba()))
        plt.close(figure)
    assert pictures[0].shape == pictures[1].shape
    half = pictures[0].shape[1] // 2
    assert (pictures[0][:, :half] != pictures[1][:, :half]).any()

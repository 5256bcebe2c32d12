import matplotlib.pyplot as plt
import numpy as np
import pytest

from hadr.figures.handover import rescoring_sphere as sphere
from hadr.handover.grasping.grasps import Grasps
from hadr.handover.grasping.rescoring import Directions, Weights, intended_score
from hadr.simulation.trials.rehearsal import rehearsed_scene

DIRECTIONS = Directions()


def wishes(approach):
    return intended_score(np.zeros(len(approach)), approach, DIRECTIONS)


@pytest.fixture(scope="module")
def two_grasps():
    """One comes from above (x closing), one from the robot's side, both with the same score."""
    down = np.stack([[0, 0, -1], [1, 0, 0], [0, -1, 0]], axis=1)  # approach, closing, height
    level = np.stack([[1, 0, 0], [0, 1, 0], [0, 0, 1]], axis=1)
    one = np.ones(2)
    return Grasps(
        scores=0.5 * one,
        widths=0.06 * one,
        heights=0.02 * one,
        depths=0.0 * one,
        rotations=np.stack([down, level]).astype(float),
        translations=np.array([[0.55, 0, 0.45], [0.5, 0, 0.4]]),
        object_ids=np.array([-1, -1]),
        frame="base",
    )


def test_favourite_of_the_intended_score_is_the_wish():
    wish = np.array([0.4, 0, -0.2]) / np.hypot(0.4, 0.2)
    assert np.degrees(np.arccos(sphere.favourite(wishes) @ wish)) < 1.0


def test_each_pixel_has_the_colour_of_its_direction(ax):
    """Seen from -y, the middle's direction is -y and the right end's is +x."""
    sphere.show_score_sphere(ax, wishes, DIRECTIONS, view=(0, -90), pixels=101)
    image = np.asarray(ax.images[0].get_array())
    assert list(ax.images[0].get_extent()) == [-1, 1, -1, 1]
    cmap, norm = sphere.score_colors(0.6)
    np.testing.assert_allclose(image[50, 50, :3], cmap(norm(0.0))[:3], atol=0.01)
    right = image[50, 93, :3] / np.linalg.norm(image[50, 93, :3])  # x = 0.85, darker at the rim
    wanted = np.array(cmap(norm(0.4 * 0.85))[:3])
    np.testing.assert_allclose(right, wanted / np.linalg.norm(wanted), atol=0.02)
    low, high = image[90, 50], image[10, 50]  # top row first: below is better than above
    np.testing.assert_allclose(
        low[:3] / np.linalg.norm(low[:3]),
        (c := np.array(cmap(norm(0.2 * 0.79))[:3])) / np.linalg.norm(c),
        atol=0.02,
    )
    assert high[:3].sum() < low[:3].sum()
    assert image[0, 0, 3] == 0  # a corner is outside of the sphere


def test_colours_are_told_apart_in_grey():
    cmap, norm = sphere.score_colors(0.6)
    luminance = cmap(norm(np.linspace(-0.59, 0.59, 12)))[:, :3] @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(luminance) > 0.02).all()


def test_a_tilted_frame_keeps_the_grasps_and_changes_the_choice(two_grasps):
    # At 180 degrees about y the frame's z axis points down: the printed formula wants that.
    assert sphere.tilted_frame(180.0)[:, 2] == pytest.approx([0, 0, -1])
    assert sphere.tilted_frame(90.0)[:, 2] == pytest.approx([1, 0, 0])
    written, wishes_there = sphere.in_tilted_frame(two_grasps, DIRECTIONS, 90.0)
    assert written.frame == wishes_there.frame == "tilted"
    np.testing.assert_allclose(
        written.axis("approach") @ wishes_there.robot_to_human, [0, 1], atol=1e-12
    )
    np.testing.assert_allclose(written.axis("approach")[1], [0, 0, 1], atol=1e-12)


@pytest.mark.parametrize(("human", "down", "winner"), [(0.4, 0.2, 1), (0.2, 0.4, 0)])
def test_pictures_of_the_choice_name_the_winner(two_grasps, human, down, winner):
    weights = Weights(robot_to_human=human, up_to_down=down)
    figure = sphere.candidate_choice(rehearsed_scene(), two_grasps, DIRECTIONS, weights)
    words = " ".join(text.get_text() for text in figure.texts)
    assert f"candidate {winner}" in words
    assert f"= {human}" in words


def test_sliders_draw_what_they_say(two_grasps):
    weigh = sphere.weigh_wishes(rehearsed_scene(), two_grasps, DIRECTIONS)
    assert [child.description for child in weigh.children[:2]] == ["w_r2h", "w_u2d"]
    weigh.f(human=0.0, down=1.0)
    assert any("candidate 0" in text.get_text() for text in plt.gcf().texts)

"""The stills: where things stand in the picture, and that glass is seen through."""

import numpy as np
import pytest

from hadr.figures.solids.studio import StudioView, studio_picture, studio_view
from hadr.figures.solids.turntable import HandOnGlass, bare_hand
from hadr.hand import HandShape, forward_kinematics
from hadr.synthesis.glass.surfaces import Surface, revolve

RADIUS = 0.03
NOTHING = Surface(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64), np.zeros((0, 3)))
FRONT = StudioView(np.eye(3), np.zeros(3), 0.05)


def ball(center=(0.0, 0.0, 0.0)):
    angle = np.linspace(-np.pi / 2, np.pi / 2, 90)
    curve = RADIUS * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    curve[[0, -1], 0] = 0.0
    body = revolve(curve)
    return Surface(body.vertices + np.asarray(center), body.faces, body.normals)


def scene(hand=NOTHING, glass=NOTHING, color=(255, 0, 0)):
    colors = np.tile(np.array(color, np.uint8), (len(hand.vertices), 1))
    return HandOnGlass("n", "n", glass, hand, colors, np.zeros((22, 3)), 0.0)


def test_a_ball_has_the_size_that_perspective_gives():
    picture = studio_picture(scene(hand=ball()), FRONT, pixels=200, paper=False).astype(int)
    red = picture[..., 0] - picture[..., 1] > 40
    rows, columns = np.nonzero(red)
    angle = np.arcsin(RADIUS / FRONT.distance)
    expected = 100 * np.tan(angle) / np.tan(0.22)
    assert (np.ptp(columns) + 1) / 2 == pytest.approx(expected, abs=1.0)
    assert (rows.mean(), columns.mean()) == pytest.approx((99.5, 99.5), abs=0.3)


def test_points_are_projected_to_where_they_are_drawn():
    center = np.array([0.01, -0.015, 0.005])
    picture = studio_picture(scene(hand=ball(center)), FRONT, pixels=240, paper=False).astype(int)
    rows, columns = np.nonzero(picture[..., 0] - picture[..., 1] > 40)
    u, v = FRONT.pixels_of(center, 240)
    middle = ((columns.min() + columns.max()) / 2, (rows.min() + rows.max()) / 2)
    assert (u, v) == pytest.approx(middle, abs=1.2)
    np.testing.assert_allclose(FRONT.pixels_of(FRONT.center, 240), [119.5, 119.5])


def test_one_sees_through_glass_but_not_through_the_hand():
    behind, front = ball((0, 0, -0.08)), ball((0, 0, 0.08))
    through = studio_picture(scene(hand=behind, glass=ball()), FRONT, pixels=120, paper=False)
    bare = studio_picture(scene(hand=behind), FRONT, pixels=120, paper=False)
    center = np.s_[50:70, 55:75]
    assert np.abs(through[center].astype(int) - bare[center]).mean() < 25
    assert (through != bare).any()
    hidden = studio_picture(scene(hand=front, glass=ball()), FRONT, pixels=120, paper=False)
    alone = studio_picture(scene(hand=front), FRONT, pixels=120, paper=False)
    np.testing.assert_array_equal(hidden, alone)


def test_the_outline_of_glass_is_darker_than_its_middle():
    picture = studio_picture(scene(glass=ball()), FRONT, pixels=200, paper=False).astype(float)
    row = picture[120].mean(axis=1)
    edge = round(100 - 100 * np.tan(np.arcsin(RADIUS / FRONT.distance)) / np.tan(0.22))
    assert row[edge : edge + 8].min() < row[90:110].mean() - 20
    assert row[edge - 12 : edge - 4].min() > 234


def test_a_bare_hand_points_upward_and_shows_its_palm():
    skeleton = forward_kinematics(np.zeros(20))
    hand = bare_hand(skeleton, HandShape())
    np.testing.assert_allclose(hand.joints[:, 2], skeleton.joints[:, 1])
    view = studio_view(hand)
    tip, wrist, thumb = view.pixels_of(hand.joints[[13, 0, 5]], 300)
    assert tip[1] < wrist[1]
    assert thumb[0] > wrist[0], "the palm of a right hand: its thumb points to the right"
    picture = studio_picture(hand, view, pixels=96, paper=False).astype(int)
    assert 0.1 < (picture[..., 0] - picture[..., 2] > 25).mean() < 0.6

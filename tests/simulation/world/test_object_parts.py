"""Mass from the glass wall's volume, and convex parts that follow the outline."""

import numpy as np
import pytest

from hadr.simulation.trials import TRIAL_OBJECTS
from hadr.simulation.world.object_parts import (
    convex_parts,
    distance_outside,
    handle_capsules,
    mass_properties,
    outside,
    stacked_rings,
)
from hadr.synthesis.glass.objects import glass_object
from hadr.synthesis.glass.shape import GlassObject


@pytest.fixture(scope="module")
def beaker() -> GlassObject:
    # a straight beaker with sharp corners: a cylinder of 40 x 100 mm, wall and foot 2 mm
    return GlassObject(
        "9000",
        "cylinder",
        holds=("side",) * 8,
        outer=((0, 0), (0.04, 0, 1e-4), (0.04, 0.1)),
        inner=((0.038, 0.1), (0.038, 0.002, 1e-4), (0, 0.002)),
        grip=(0.02, 0.08),
    )


def test_mass_of_a_hollow_cylinder_by_hand(beaker: GlassObject) -> None:
    # pi (40^2 - 38^2) 100 + pi 38^2 2 cubic millimetres (the rim's round is a little more)
    volume = np.pi * ((0.04**2 - 0.038**2) * 0.1 + 0.038**2 * 0.002)
    wall = mass_properties(beaker)
    assert wall.mass == pytest.approx(2500 * volume, rel=0.02)
    side = 2500 * np.pi * (0.04**2 - 0.038**2) * 0.1
    about_axis = side * (0.04**2 + 0.038**2) / 2 + (wall.mass - side) * 0.038**2 / 2
    assert wall.inertia[2, 2] == pytest.approx(about_axis, rel=0.03)
    assert wall.center[2] == pytest.approx(side * 0.05 / wall.mass, rel=0.05)


def test_a_cylinder_is_one_part(beaker: GlassObject) -> None:
    (part,) = convex_parts(beaker)
    radius = np.linalg.norm(part[:, :2], axis=1)
    assert radius.max() == pytest.approx(0.04, abs=3e-4)
    # the rim is round: its top stands half a wall above the corners
    np.testing.assert_allclose([part[:, 2].min(), part[:, 2].max()], [0.0, 0.101], atol=2e-4)


def test_distance_from_a_cylinder_and_from_a_handle(beaker: GlassObject) -> None:
    for point, away in (
        ((0.0, 0.0, 0.05), 0.0),  # in its hollow
        ((0.0, 0.06, 0.05), 0.02),
        ((0.0, 0.0, -0.03), 0.03),
        ((0.07, 0.0, 0.141), 0.05),  # over the rim's edge, 3 : 4 : 5
    ):
        assert distance_outside(beaker, np.array(point)) == pytest.approx(away, abs=6e-4)
    mug = glass_object("0008")
    start, end, radius = handle_capsules(mug)[4]
    middle = (start + end) / 2
    assert distance_outside(mug, middle) == pytest.approx(0.0, abs=1e-3)
    beside = middle + np.array([0.0, radius + 0.01, 0.0])  # the handle lies in the plane y = 0
    assert distance_outside(mug, beside) == pytest.approx(0.01, abs=2e-3)


@pytest.mark.parametrize("object_id", TRIAL_OBJECTS)
def test_parts_follow_the_outline_within_a_millimetre(object_id: str) -> None:
    item = glass_object(object_id)
    pieces = stacked_rings(item)
    assert len(pieces) <= 12
    for piece in pieces:  # convex: the radius bends inward only
        slopes = np.diff(piece[:, 0]) / np.diff(piece[:, 1])
        assert (np.diff(slopes) < 1e-9).all()
    for radius, z in outside(item)[1:-1:5]:
        there = [np.interp(z, p[:, 1], p[:, 0]) for p in pieces if p[0, 1] <= z <= p[-1, 1]]
        assert max(there) == pytest.approx(radius, abs=1e-3)
    assert 0.05 < mass_properties(item).mass < 0.6


def test_only_the_mug_has_a_handle() -> None:
    assert handle_capsules(glass_object("0000")) == []
    chain = handle_capsules(glass_object("0008"))
    assert len(chain) == 9
    starts, ends = (np.array(points) for points in list(zip(*chain, strict=True))[:2])
    np.testing.assert_allclose(ends[:-1], starts[1:])
    # a hole between handle and wall: the handle's middle is 69 mm from the axis
    assert ends[:, 0].max() == pytest.approx(0.069, abs=2e-3)

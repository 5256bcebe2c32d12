import numpy as np
import pytest

from hadr.hand import forward_kinematics
from hadr.synthesis.hand_mesh import hand_mesh
from hadr.synthesis.holding import HOLD_KINDS, holds_well, make_hold
from hadr.synthesis.objects import OBJECTS, glass_object, signed_distance

CASES = [(o, n) for o in OBJECTS for n in range(len(HOLD_KINDS[o]))]


@pytest.mark.parametrize(("object_id", "number"), CASES)
def test_fingers_and_thumb_or_palm_touch_without_being_pressed_in(object_id, number):
    hold = make_hold(object_id, number)
    assert holds_well(hold), hold.gaps
    assert hold.hold_id.startswith(f"{object_id}-{hold.kind}-")


@pytest.mark.parametrize(("object_id", "number"), CASES)
def test_the_skin_itself_is_not_pressed_deep_into_the_glass(object_id, number):
    """The mesh, not only the samples that the search looks at, against the exact distance."""
    hold = make_hold(object_id, number)
    surface = hand_mesh(forward_kinematics(hold.angles, hold.shape), hold.shape, step=0.004).surface
    turn, origin = hold.wrist_from_object[:3, :3], hold.wrist_from_object[:3, 3]
    skin = surface.vertices[surface.vertices[:, 1] > -0.03]
    distance = signed_distance(glass_object(object_id), (skin - origin) @ turn)
    assert distance.min() > -0.005
    assert (distance < -0.001).mean() < 0.02
    assert distance.min() < 0.003


def test_poses_are_rigid_on_both_hands():
    sides = set()
    for number in range(8):
        hold = make_hold("0005", number)
        sides.add(hold.shape.side)
        turn = hold.wrist_from_object[:3, :3]
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(turn) == pytest.approx(1.0)
    assert sides == {"left", "right"}


def test_holds_differ_by_number_and_seed_and_repeat_otherwise():
    first, other_seed = make_hold("0000", 0, 0), make_hold("0000", 0, 1)
    make_hold.cache_clear()
    again = make_hold("0000", 0, 0)
    np.testing.assert_array_equal(first.angles, again.angles)
    assert np.abs(first.angles - other_seed.angles).max() > 0.01
    assert np.abs(first.angles - make_hold("0000", 4).angles).max() > 0.01
    assert first.hold_id != make_hold("0000", 4).hold_id


def test_errors():
    with pytest.raises(ValueError, match="no object '9999'"):
        make_hold("9999", 0)
    with pytest.raises(ValueError, match="starts at 0, got -1"):
        make_hold("0000", -1)

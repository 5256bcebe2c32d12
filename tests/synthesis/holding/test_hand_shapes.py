import numpy as np
import pytest
import trimesh

from hadr.hand import HandShape, forward_kinematics
from hadr.synthesis.hand.mesh import hand_mesh
from hadr.synthesis.hand.skinning import skin_vertices
from hadr.synthesis.holding.hold import GIRTH_RANGE, SCALE_RANGE, draw_hand_shape


def test_drawn_hands_differ_within_their_ranges_and_stay_closed():
    shapes = [draw_hand_shape(np.random.default_rng(i), "left") for i in range(200)]
    scales = np.array([s.scale for s in shapes])
    girths = np.array([s.girth for s in shapes])
    assert scales.min() >= SCALE_RANGE[0]
    assert scales.max() <= SCALE_RANGE[1]
    assert girths.min() >= GIRTH_RANGE[0]
    assert girths.max() <= GIRTH_RANGE[1]
    assert np.std(scales) > 0.03
    assert np.std(girths) > 0.03
    assert {s.side for s in shapes} == {"left"}
    for shape in shapes[:4]:
        surface = hand_mesh(forward_kinematics(np.zeros(20), shape), shape, step=0.004).surface
        assert trimesh.Trimesh(surface.vertices, surface.faces, process=False).is_watertight


def test_the_same_generator_state_draws_the_same_hand():
    first, second = (draw_hand_shape(np.random.default_rng(7), "right") for _ in range(2))
    assert first == second


def test_girth_thickens_the_finger_and_length_lengthens_it():
    """In the bone's own axes: a finger 1.1 times as thick and 1.2 times as long."""
    usual = HandShape()
    lengths = {**usual.lengths, "middle": tuple(1.2 * b for b in usual.lengths["middle"])}
    changed = HandShape(lengths=lengths, girth=1.1)
    sizes = []
    for shape in (usual, changed):
        skin, part = skin_vertices(forward_kinematics(np.zeros(20), shape), shape)
        finger = skin[(part == 2) & (skin[:, 1] > 0.090 + 0.6 * sum(shape.lengths["middle"]))]
        sizes.append((np.ptp(finger[:, 0]), finger[:, 1].max() - 0.090))
    assert abs(sizes[1][0] / sizes[0][0] - 1.1) < 0.01
    assert abs(sizes[1][1] / sizes[0][1] - 1.2) < 0.01


def test_girth_is_checked():
    with pytest.raises(ValueError, match=r"girth must lie in \(0.5, 2\), 1 being usual, got 3"):
        HandShape(girth=3)

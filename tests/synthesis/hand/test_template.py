import numpy as np
import pytest
import trimesh

from hadr.hand import FINGERS, HandShape
from hadr.synthesis.hand.mesh import SKIN_TONES, paint
from hadr.synthesis.hand.signed_distance import TIP_PAD, rest_skeleton, signed_distance
from hadr.synthesis.hand.template import (
    BONE_COUNT,
    COARSE_STEP,
    FINE_STEP,
    MIDDLE_STEP,
    bone_weights,
    hand_template,
)


@pytest.mark.parametrize("step", [COARSE_STEP, MIDDLE_STEP, FINE_STEP])
def test_the_template_is_one_closed_body_without_handles(step):
    template = hand_template(step)
    mesh = trimesh.Trimesh(template.vertices, template.faces, process=False)
    assert mesh.is_watertight
    assert mesh.euler_number == 2
    assert mesh.volume == pytest.approx(0.0045, rel=0.1)
    assert hand_template(step) is template


def test_the_skin_lies_on_the_flesh_but_for_creases_and_nails():
    template = hand_template(FINE_STEP)
    hand = template.vertices[:, 1] > -0.03
    distance = signed_distance(
        template.vertices[hand].astype(np.float32), rest_skeleton(), HandShape()
    )
    relief = template.skin.height[hand]
    # The distance is not exact off the surface, and less so where parts meet.
    assert np.median(np.abs(distance - relief)) < 0.0001
    assert np.abs(template.skin.height).max() < 0.003


@pytest.mark.parametrize("finger", FINGERS)
def test_the_flesh_ends_a_little_beyond_the_tip(finger):
    rest = rest_skeleton()
    frame = rest.frames[1 + FINGERS[finger][3]]
    for beyond, inside in ((TIP_PAD - 0.0004, True), (TIP_PAD + 0.0004, False)):
        point = (frame[:3, 3] + beyond * frame[:3, 1])[None].astype(np.float32)
        assert (signed_distance(point, rest, HandShape())[0] < 0) == inside


def test_weights_name_the_bone_that_a_point_lies_in():
    rest = rest_skeleton()
    points, bones = [np.array([0.0, 0.02, 0.0]), np.array([0.0, -0.3, 0.01])], [0, 0]
    for i, indices in enumerate(FINGERS.values()):
        for j in range(1 if i == 0 else 0, 3):
            a, b = (rest.joints[1 + indices[j + k]] for k in (0, 1))
            points.append((a + b) / 2)
            bones.append(1 + 3 * i + j)
    weights = bone_weights(np.array(points), HandShape())
    assert weights.shape == (len(points), BONE_COUNT)
    np.testing.assert_allclose(weights.sum(1), 1)
    assert weights.min() >= 0
    assert weights.argmax(1).tolist() == bones
    assert weights.max(1).min() > 0.8


def test_weights_change_smoothly_over_the_skin():
    template = hand_template(FINE_STEP)
    edges = template.faces[:, [0, 1]]
    hand = template.vertices[edges[:, 0], 1] > 0
    jump = np.abs(template.weights[edges[hand, 0]] - template.weights[edges[hand, 1]]).max(1)
    assert np.quantile(jump, 0.999) < 0.25


def test_nails_lie_on_the_back_of_each_tip_and_shine():
    template = hand_template(FINE_STEP)
    _, gloss = paint(template.skin, SKIN_TONES[1])
    rest = rest_skeleton()
    for i, indices in enumerate(FINGERS.values()):
        rows = np.flatnonzero((template.skin.nail > 0.5) & (template.part == i))
        frame = rest.frames[1 + indices[3]]
        local = (template.vertices[rows] - frame[:3, 3]) @ frame[:3, :3]
        assert len(rows) > 20
        assert local[:, 2].max() < 0  # z points to the palm's side
        assert local[:, 1].min() > -0.020
        assert gloss[rows].min() > 0.5
    assert gloss[template.skin.nail < 0.01].max() < 0.4


@pytest.mark.parametrize("tone", SKIN_TONES)
def test_the_palm_is_lighter_most_of_all_on_dark_skin(tone):
    template = hand_template(COARSE_STEP)
    albedo, _ = paint(template.skin, tone)
    light = albedo.mean(1)
    palm = light[(template.skin.palm > 0.9) & (template.part == 5)].mean()
    back = light[(template.skin.palm < 0.1) & (template.part == 5)].mean()
    ratio = palm / back
    assert ratio > 0.97
    if tone == SKIN_TONES[-1]:
        assert ratio > 1.5

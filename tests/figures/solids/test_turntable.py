"""The page with turning hands: what is inside it, and that it is small and stands alone."""

import base64
import json
import re

import numpy as np
import pytest

from hadr.figures.solids.turntable import (
    FOREARM_SHOWN,
    HandOnGlass,
    held_glass,
    simplified,
    turntable,
)
from hadr.hand import HandShape, forward_kinematics
from hadr.synthesis.glass.surfaces import SEGMENTS, Surface, revolve
from hadr.synthesis.holding.hold import make_hold


def ball(radius=0.03):
    angle = np.linspace(-np.pi / 2, np.pi / 2, 60)
    curve = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    curve[[0, -1], 0] = 0.0
    return revolve(curve)


def volume(surface):
    a, b, c = surface.vertices[surface.faces].transpose(1, 0, 2)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def scene(name="ball", surface=None, azimuth=90.0):
    surface = surface or ball()
    colors = np.full((len(surface.vertices), 3), 200, np.uint8)
    joints = forward_kinematics(np.zeros(20), HandShape()).joints
    return HandOnGlass(name, "note", surface, surface, colors, joints, azimuth)


def data_of(page):
    return json.loads(re.search(r"const DATA = (\{.*?\});\n", page, re.DOTALL).group(1))


def decoded(data, mesh):
    def read(name, kind):
        return np.frombuffer(base64.b64decode(data["arrays"][mesh[name]]), kind).reshape(-1, 3)

    positions = np.array(mesh["low"]) + mesh["step"] * read("positions", "<u2")
    return positions, read("normals", "i1") / 127, read("faces", "<u2")


def test_what_is_stored_is_the_surface_to_a_micrometre():
    surface = ball()
    data = data_of(turntable([scene(surface=surface)]).page)
    positions, normals, faces = decoded(data, data["scenes"][0]["glass"])
    np.testing.assert_allclose(positions, surface.vertices, atol=1e-6)
    np.testing.assert_allclose(normals, surface.normals, atol=0.5 / 127 + 1e-9)
    np.testing.assert_array_equal(faces, surface.faces)


def test_equal_arrays_are_kept_once():
    one = data_of(turntable([scene()]).page)
    two = data_of(turntable([scene(), scene("again")]).page)
    assert len(two["scenes"]) == 2
    assert len(two["arrays"]) == len(one["arrays"])


def test_viewer_stands_where_the_scene_says():
    told = data_of(turntable([scene(azimuth=-30.0)]).page)["scenes"][0]
    assert told["yaw"] == pytest.approx(-np.pi / 6)
    points = np.array(told["joints"])
    assert (np.linalg.norm(points - told["center"], axis=1) <= told["radius"] + 1e-4).all()


def test_frame_holds_the_page_and_asks_no_other_host():
    table = turntable([scene('a "quoted" </script> name')])
    shown = table._repr_html_()
    assert shown.count("<iframe") == 1
    assert shown.count('"') == 8  # style, title, style and srcdoc: no quote of the page gets out
    assert table.page.count("</script>") == 1
    assert not re.search(r"(src|href)=|https?://|import\(|fetch\(", table.page)


def test_too_many_vertices_are_refused():
    many = Surface(
        np.random.default_rng(0).random((70_000, 3)), np.array([[0, 1, 2]]), np.ones((70_000, 3))
    )
    with pytest.raises(ValueError, match="70000 vertices"):
        turntable([scene(surface=many)])


def test_simplifying_keeps_the_body():
    fine = ball()
    coarse = simplified(fine, 0.0002)
    assert len(coarse.vertices) < 0.5 * len(fine.vertices)
    assert volume(coarse) == pytest.approx(volume(fine), rel=0.03)
    radius = np.linalg.norm(coarse.vertices, axis=1)
    np.testing.assert_allclose(radius, 0.03, atol=0.0004)
    np.testing.assert_allclose((coarse.vertices * coarse.normals).sum(1), radius, rtol=0.02)


def test_an_open_surface_stays_as_it_is():
    whole = ball()
    opened = Surface(whole.vertices, whole.faces[SEGMENTS:], whole.normals)
    assert simplified(opened, 0.001) is opened


@pytest.fixture(scope="module")
def held():
    hold = make_hold("0000", 0, 0)
    return hold, held_glass(hold)


def test_a_hold_in_the_glass_frame(held):
    hold, shown = held
    np.testing.assert_allclose(shown.glass.vertices[:, 2].min(), 0.0, atol=1e-3)
    wrist = np.linalg.inv(hold.wrist_from_object)[:3, 3]
    np.testing.assert_allclose(shown.joints[0], wrist, atol=1e-12)
    assert hold.shape.side in shown.note
    assert shown.name == f"tumbler: {hold.kind}"


def test_the_forearm_ends_and_fades(held):
    hold, shown = held
    in_wrist = (
        shown.hand.vertices @ hold.wrist_from_object[:3, :3].T + hold.wrist_from_object[:3, 3]
    )
    low = -FOREARM_SHOWN * hold.shape.scale
    assert in_wrist[:, 1].min() == pytest.approx(low, abs=1e-3)
    opacity = shown.hand.vertices @ shown.fade[:3] + shown.fade[3]
    assert opacity[in_wrist[:, 1] < low + 0.002].max() < 0.1
    assert opacity[in_wrist[:, 1] > 0.6 * low].min() > 1.0
    told = data_of(turntable([shown]).page)["scenes"][0]["fade"]
    np.testing.assert_allclose(told, shown.fade, atol=1e-5)


def test_a_page_is_small(held):
    _, shown = held
    assert len(turntable([shown]).page) < 400_000

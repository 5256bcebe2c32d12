from functools import lru_cache

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from hadr.data.splits import UNKNOWN_OBJECTS
from hadr.synthesis.glass.distance import signed_distance
from hadr.synthesis.glass.objects import NOVEL_OBJECTS, OBJECTS, bodies, glass_object
from hadr.synthesis.glass.shape import handle_sections, profile
from hadr.synthesis.glass.surfaces import merged

IDS = (*OBJECTS, *NOVEL_OBJECTS)


def test_the_eight_ids_are_those_of_the_data_set():
    eight = ("0000", "0001", "0004", "0005", "0006", "0007", "0008", "0009")
    assert tuple(OBJECTS) == eight
    assert tuple(NOVEL_OBJECTS) == ("0010", "0011", "0012")
    assert UNKNOWN_OBJECTS == ("0004", "0007")


@pytest.mark.parametrize("object_id", IDS)
def test_bodies_are_closed_and_their_normals_point_outward(object_id):
    for surface in bodies(glass_object(object_id)):
        mesh = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
        assert mesh.is_watertight
        assert mesh.is_winding_consistent
        assert mesh.volume > 0
        agreement = np.einsum("fij,fj->fi", surface.normals[surface.faces], mesh.face_normals)
        assert agreement.min() > -1e-6
        assert np.quantile(agreement, 0.02) > 0.8


@pytest.mark.parametrize("object_id", IDS)
def test_sizes_are_those_of_tableware(object_id):
    size = np.ptp(merged(bodies(glass_object(object_id))).vertices, axis=0)
    assert 0.05 <= size[:2].max() <= 0.12
    assert 0.06 <= size[2] <= 0.22


@pytest.mark.parametrize("object_id", IDS)
def test_the_wall_has_a_thickness(object_id):
    """From each point inside the hollow the glass is 1-7 mm thick, measured along the normal."""
    curve = profile(glass_object(object_id))
    rim = int(np.argmax(curve[:, 1]))
    inner = curve[rim + 8 : -1]
    inner = inner[inner[:, 1] < curve[rim, 1] - 0.006]
    outer = curve[: rim - 4]
    sides = inner[inner[:, 0] > 0.6 * inner[:, 0].max()]
    gaps = np.linalg.norm(sides[:, None] - outer[None], axis=-1).min(1)
    assert gaps.min() > 0.0010
    assert gaps.max() < 0.011


def test_the_mug_and_its_handle_are_one_surface_with_one_hole():
    (surface,) = bodies(glass_object("0008"))
    mesh = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    assert mesh.euler_number == 0  # a torus's: no inner walls, no second piece, one hole
    assert len(mesh.split()) == 1
    # The handle's ends stay in the wall: the hollow is round.
    r, z = np.hypot(*surface.vertices[:, :2].T), surface.vertices[:, 2]
    wall = (r < 0.0372) & (z > 0.02) & (z < 0.0915)
    assert wall.sum() > 1000
    np.testing.assert_allclose(r[wall], 0.0344 + (z[wall] - 0.0085) * 0.0017 / 0.0835, atol=2e-5)


def test_signed_distance_by_hand():
    tumbler = glass_object("0000")
    points = np.array([[0.0, 0, 0.005], [0, 0, 0.06], [0, 0, -0.01], [0.2, 0, 0.05]])
    distance = signed_distance(tumbler, points)
    assert distance[0] == pytest.approx(-0.0038, abs=1e-4)  # the floor begins at 1.2 mm
    assert distance[1] > 0.02  # the hollow is outside of the glass ...
    assert signed_distance(tumbler, points[1:2], filled=True)[0] < -0.02  # ... unless filled
    assert distance[2] == pytest.approx(0.0112, abs=1e-6)
    assert distance[3] == pytest.approx(0.2 - 0.035, abs=1e-3)


@pytest.mark.parametrize("object_id", IDS)
def test_distance_is_0_on_the_surface_and_has_its_sign_beside_it(object_id):
    """Relief, handle and all: the triangles and the distance know the same shape."""
    item = glass_object(object_id)
    (surface,) = bodies(item)
    mesh = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    points, faces = trimesh.sample.sample_surface(mesh, 3000, seed=3)
    assert np.abs(signed_distance(item, points)).max() < 8e-5
    step = 0.0004 * mesh.face_normals[faces]
    assert (signed_distance(item, points + step) > 0).mean() > 0.998
    assert (signed_distance(item, points - step) < 0).mean() > 0.998


@lru_cache(maxsize=16)
def surface_points(object_id):
    (surface,) = bodies(glass_object(object_id))
    mesh = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    return cKDTree(trimesh.sample.sample_surface(mesh, 60000, seed=1)[0])


@settings(max_examples=80, deadline=None)
@given(st.sampled_from(IDS), st.floats(0, 2 * np.pi), st.floats(0.0, 0.08), st.floats(-0.02, 0.22))
def test_distance_is_that_of_the_nearest_point_of_the_surface(object_id, angle, radius, height):
    point = np.array([[radius * np.cos(angle), radius * np.sin(angle), height]])
    nearest = surface_points(object_id).query(point)[0][0]
    item = glass_object(object_id)
    distance = signed_distance(item, point)[0]
    # Samples lie a millimetre or two apart; relief shifts what the distance is measured from.
    relief = 0.0035 if item.reliefs else 0.0
    inside_two = distance < 0 and item.handle  # where wall and handle overlap
    if not inside_two:
        assert abs(distance) <= nearest + 2e-4 + relief
    assert nearest <= np.hypot(abs(distance) + 1e-4, 0.0025) + relief


def test_the_handle_of_the_mug_is_an_ellipse_by_hand():
    """In its upright part it is 7.8 mm thick and 12.4 mm wide."""
    mug = glass_object("0008")
    line, _, _ = handle_sections(mug)
    outermost = line[np.argmax(line[:, 0])]

    def at(x, y):
        return signed_distance(mug, outermost[None] + np.array([x, y, 0.0]))[0]

    for step, inside in ((0.0038, True), (0.0040, False)):
        assert (at(step, 0) < 0) == inside
    for step, inside in ((0.0061, True), (0.0063, False)):
        assert (at(0, step) < 0) == inside
    assert at(0, 0.0262) == pytest.approx(0.020, abs=5e-5)


def test_the_tumblers_foot_has_ten_facets():
    """Cut at 8 mm: the outside is a decagon, its distance from the axis varies by 5 %."""
    (surface,) = bodies(glass_object("0000"))
    mesh = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    cut = mesh.section([0, 0, 1], [0, 0, 0.008]).vertices
    angle = np.arctan2(cut[:, 1], cut[:, 0])
    wave = np.exp(1j * np.outer(np.arange(1, 21), angle)) @ (np.hypot(*cut[:, :2].T) - 0.0318)
    assert np.argmax(np.abs(wave)) + 1 == 10
    apothem = np.cos(np.mod(angle + np.pi / 10, np.pi / 5) - np.pi / 10) * np.hypot(*cut[:, :2].T)
    flat = np.abs(np.mod(angle + np.pi / 10, np.pi / 5) - np.pi / 10) < np.deg2rad(11)
    np.testing.assert_allclose(apothem[flat], 0.0306 + 0.085 * 0.008, atol=2e-5)


def test_the_beakers_wall_keeps_its_thickness_in_the_spout():
    item = glass_object("0005")
    (surface,) = bodies(item)
    reach = surface.vertices[:, 0].max() - np.abs(surface.vertices[:, 1]).max()
    assert 0.006 < reach < 0.009
    lip = np.array([[item.outer_radius(0.1) + 0.0037 - 0.001, 0.0, 0.1]])
    assert signed_distance(item, lip)[0] == pytest.approx(-0.0008, abs=4e-4)


def test_unknown_object_is_named():
    with pytest.raises(ValueError, match=r"no object '0002'; there are 0000, 0001"):
        glass_object("0002")
    with pytest.raises(ValueError, match=r"shape \(N, 3\) in metres, got \(3,\)"):
        signed_distance(glass_object("0000"), np.zeros(3))

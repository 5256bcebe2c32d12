"""Solids that the arm's and the gripper's looks are made of, and their colours; metres."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from hadr.synthesis.glass.surfaces import Surface, merged, revolve

Array = npt.NDArray[np.float64]
Color = tuple[float, float, float]
Part = tuple[Surface, Color]

SHELL: Color = (0.50, 0.52, 0.54)
"""Light grey of the housings, linear RGB reflectance."""
TUBE: Color = (0.40, 0.415, 0.43)
"""The two long tubes."""
LID: Color = (0.16, 0.33, 0.50)
"""Grey-blue of the joints' lids."""
SEAM: Color = (0.05, 0.055, 0.06)
"""Dark rings between the links, and the gripper's pads."""
METAL: Color = (0.34, 0.35, 0.36)
"""Aluminium of flange and fingers."""
BODY: Color = (0.09, 0.095, 0.105)
"""The gripper's dark housing."""


def round_bar(sections: tuple[tuple[float, float], ...], fillet: float, sides: int = 40) -> Surface:
    """A solid of revolution about z from its corners (r, z), rounded; metres."""
    corners = np.array([(0.0, sections[0][1]), *sections, (0.0, sections[-1][1])])
    curve = [corners[:1]]
    for before, corner, after in zip(corners, corners[1:], corners[2:], strict=False):
        back, on = before - corner, after - corner
        room = float(min(np.linalg.norm(back), np.linalg.norm(on))) / 2
        cut = min(fillet, 0.98 * room)
        start, end = (corner + cut * leg / np.linalg.norm(leg) for leg in (back, on))
        t = np.linspace(0.0, 1.0, 4)[:, None]
        arc = (1 - t) ** 2 * start + 2 * t * (1 - t) * corner + t**2 * end
        # one point close to each end keeps the straight sides' normals straight
        curve += [start + 0.02 * cut * back / np.linalg.norm(back) + np.zeros((1, 2)), arc]
        curve += [end + 0.02 * cut * on / np.linalg.norm(on) + np.zeros((1, 2))]
    return revolve(np.concatenate([*curve, corners[-1:]]), segments=sides)


def _along(axis: str, at: tuple[float, float, float]) -> Array:
    """The pose that turns z into one of the axes x, y, z and then shifts; shape (4, 4)."""
    columns = {"x": (1, 2, 0), "y": (2, 0, 1), "z": (0, 1, 2)}[axis]
    pose = np.eye(4)
    pose[:3, :3] = np.eye(3)[:, list(columns)]
    pose[:3, 3] = at
    return pose


def bar(
    axis: str,
    radius: float,
    low: float,
    high: float,
    at: tuple[float, float, float] = (0.0, 0.0, 0.0),
    fillet: float = 0.006,
) -> Surface:
    """A round bar along an axis through a point, from low to high along it; metres."""
    return round_bar(((radius, low), (radius, high)), fillet).moved(_along(axis, at))


def rounded_block(half_x: float, half_y: float, low: float, high: float) -> Surface:
    """A block along z whose section is a superellipse, with rounded ends; metres."""
    solid = round_bar(((1.0, low), (1.0, high)), 0.008, 64)
    x, y = solid.vertices[:, 0], solid.vertices[:, 1]
    radius = np.hypot(x, y)
    angle = np.arctan2(y, x)
    stretch = (np.abs(np.cos(angle)) ** 5 + np.abs(np.sin(angle)) ** 5) ** (-1 / 5)
    vertices = solid.vertices.copy()
    vertices[:, 0] = half_x * radius * stretch * np.cos(angle)
    vertices[:, 1] = half_y * radius * stretch * np.sin(angle)
    mesh = trimesh.Trimesh(vertices, solid.faces, process=False)
    return Surface(vertices, solid.faces, np.array(mesh.vertex_normals))


def colored(*parts: tuple[Color, list[Surface]]) -> tuple[Part, ...]:
    """Parts, each of several surfaces of one colour."""
    return tuple((merged(tuple(surfaces)), color) for color, surfaces in parts)


def box(low: npt.ArrayLike, high: npt.ArrayLike) -> Surface:
    """A box between two corners (3,) in metres, with flat sides."""
    solid = trimesh.creation.box(bounds=np.array([low, high], dtype=np.float64))
    vertices = np.array(solid.triangles).reshape(-1, 3)
    faces = np.arange(len(vertices)).reshape(-1, 3)
    return Surface(vertices, faces, np.repeat(np.array(solid.face_normals), 3, axis=0))


def search_tree(surface: Surface) -> Any:
    """Embree's search tree over one surface."""
    tree = EmbreeScene(robust=True)
    TriangleMesh(tree, surface.vertices.astype(np.float32), surface.faces.astype(np.int32))
    return tree

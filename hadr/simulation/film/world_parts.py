"""What stands around robot and hand in a picture: the table with its cloth, the floor, a sleeve."""

from __future__ import annotations

import numpy as np
import trimesh

from hadr.camera import Array
from hadr.simulation.robot.arm_shape import FLOOR as FLOOR_HEIGHT
from hadr.simulation.robot.arm_shape import TABLE_FAR, TABLE_NEAR, box
from hadr.synthesis.glass.surfaces import Surface, vertex_normals

Piece = tuple[Surface, Array, int]
"""A surface, its linear RGB reflectance of shape (1, 3) or (V, 3), and its kind."""

NOTHING, ARM, HAND, CLOTH, TABLE, FLOOR, GLASS = range(7)
"""What a pixel can show; the sleeve counts as HAND."""

TABLE_HALF_WIDTH, TABLE_THICKNESS = 0.45, 0.035
"""Along y, and downward, metres: a wider table would hide the view from the side."""
_WOOD = np.array([[0.36, 0.25, 0.16]])
_LINEN = np.array([[0.66, 0.63, 0.56]])
_CONCRETE = np.array([[0.40, 0.41, 0.41]])
_STRIPE = np.array([0.70, 0.80, 0.92])
_SLEEVE = np.array([[0.055, 0.10, 0.20]])
_CUFF_AT, _RINGS, _SIDES = -0.17, 60, 40


def _plane(low: tuple[float, float], high: tuple[float, float], z: float) -> Surface:
    """A level rectangle that faces up; metres."""
    (x0, y0), (x1, y1) = low, high
    vertices = np.array([[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]])
    return Surface(vertices, np.array([[0, 1, 2], [0, 2, 3]]), np.tile([0.0, 0.0, 1.0], (4, 1)))


def table() -> list[Piece]:
    """The robot's table with its cloth, its legs and the floor, in the base frame."""
    x0, x1, y0, y1 = TABLE_NEAR, TABLE_FAR, -TABLE_HALF_WIDTH, TABLE_HALF_WIDTH
    pieces: list[Piece] = [
        (_plane((x0, y0), (x1, y1), 0.0), _LINEN, CLOTH),
        (box((x0, y0, -TABLE_THICKNESS), (x1, y1, -0.0005)), _WOOD, TABLE),
        (_plane((-9.0, -9.0), (9.0, 9.0), FLOOR_HEIGHT), _CONCRETE, FLOOR),
    ]
    for x in (x0 + 0.03, x1 - 0.08):
        for y in (y0 + 0.03, y1 - 0.08):
            leg = box((x, y, FLOOR_HEIGHT), (x + 0.05, y + 0.05, -0.03))
            pieces.append((leg, _WOOD, TABLE))
    return pieces


def cloth(points: Array, blur: Array) -> Array:
    """What the cloth's reflectance is multiplied with at points (N, 3) of the table's top, metres.

    Stripes of two widths both ways, darker where they cross, shape (N, 3); their edges are as soft
    as what one ray stands for is wide, metres, shape (N,).
    """
    factor = np.ones((len(points), 3))
    for axis in (0, 1):
        place = np.mod(points[:, axis] + 0.02, 0.08)
        for middle, half in ((0.012, 0.007), (0.026, 0.002)):
            off = np.abs(place - middle)
            share = np.clip((half - off) / blur + 0.5, 0.0, 1.0)
            share = np.minimum(share, 2 * half / blur)[:, None]
            factor *= 1.0 + share * (_STRIPE - 1.0)
    return factor


def sleeve(arm: Surface) -> Piece:
    """A sleeve over the forearm, which lies along minus y: a tube from the cuff to its end.

    The hand's surface and the sleeve are written in the wrist frame.
    """
    end = float(arm.vertices[:, 1].min()) - 0.02
    along = np.linspace(_CUFF_AT, end, _RINGS)
    forearm = arm.vertices[arm.vertices[:, 1] < _CUFF_AT + 0.03]
    angle = np.arange(_SIDES) * 2 * np.pi / _SIDES
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    rings = []
    for number, y in enumerate(along):
        near = forearm[np.abs(forearm[:, 1] - max(y, end + 0.03)) < 0.02][:, [0, 2]]
        middle = (near.min(0) + near.max(0)) / 2
        half = (near.max(0) - near.min(0)) / 2 + 0.010 + 0.006 * min(number / 12, 1.0)
        # folds of the cloth: shallow waves along and around
        fold = 0.0012 * np.sin(y * 163 + 2.4 * np.sin(angle + 9 * y)) * min(number / 6, 1.0)
        fold += 0.0014 * np.sin(y * 47 + 3 * angle)
        flat = middle + circle * (half + fold[:, None])
        rings.append(np.stack([flat[:, 0], np.full(_SIDES, y), flat[:, 1]], axis=1))
    inner = rings[0] + [0.0, 0.002, 0.0]  # the cuff's edge, turned inward
    inward = inner.mean(0) + 0.80 * (inner - inner.mean(0))
    rings = [inward - [0, 0.012, 0], inward, inner, *rings]
    vertices = np.concatenate(rings)
    i = np.arange(_SIDES)
    j = (i + 1) % _SIDES
    faces = []
    for ring in range(len(rings) - 1):
        low, high = ring * _SIDES, (ring + 1) * _SIDES
        faces += [np.stack([low + i, high + i, high + j], 1)]
        faces += [np.stack([low + i, high + j, low + j], 1)]
    both = np.concatenate(faces)
    tube = trimesh.Trimesh(vertices, both, process=False)
    out = tube.face_normals[len(both) // 2 :].copy()
    middle = tube.triangles_center[len(both) // 2 :] - vertices.mean(0)
    if (out[:, [0, 2]] * middle[:, [0, 2]]).sum() < 0:
        both = both[:, ::-1]
    return Surface(vertices, both, vertex_normals(vertices, both)), _SLEEVE, HAND

"""A closed hand with its forearm, skinned around the skeleton of :mod:`hadr.hand`.

The flesh is an implicit surface: tapered capsules along the bones and a few pads, joined by a
smooth minimum so that palm, thumb's ball and fingers flow into each other, while neighbouring
fingers stay apart. Surface nets turn its zero level into triangles.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import map_coordinates

from hadr.hand import FINGERS, HandShape, Skeleton
from hadr.synthesis.surfaces import Surface

Array = npt.NDArray[np.float64]
Grid = npt.NDArray[np.float32]

#: Skin tones, linear RGB reflectance, light to dark.
SKIN_TONES: tuple[tuple[float, float, float], ...] = (
    (0.76, 0.52, 0.41),
    (0.68, 0.43, 0.32),
    (0.58, 0.35, 0.24),
    (0.46, 0.26, 0.17),
    (0.31, 0.17, 0.105),
    (0.19, 0.10, 0.065),
)
#: Radii at the four joints of each finger, metres, for a hand of scale 1.
FINGER_RADII: dict[str, tuple[float, float, float, float]] = {
    "thumb": (0.0150, 0.0118, 0.0100, 0.0078),
    "index": (0.0104, 0.0088, 0.0077, 0.0064),
    "middle": (0.0106, 0.0090, 0.0079, 0.0066),
    "ring": (0.0102, 0.0085, 0.0074, 0.0062),
    "little": (0.0090, 0.0074, 0.0065, 0.0055),
}
FOREARM_LENGTH = 0.75
_MARGIN = 0.016


@dataclass(frozen=True)
class HandMesh:
    """The skinned hand.

    Args:
        surface: Closed surface in the skeleton's frame (the wrist frame).
        albedo: Linear RGB reflectance per vertex, shape (V, 3).
        gloss: Share of mirror-like reflection per vertex, shape (V,): the nails shine.
    """

    surface: Surface
    albedo: Array
    gloss: Array


@dataclass
class _Field:
    """A distance field on a regular grid; ``values[i, j, k]`` is at origin + step (i, j, k)."""

    origin: Array
    step: float
    values: Grid

    def box(self, low: Array, high: Array) -> tuple[slice, slice, slice]:
        first = np.floor((low - self.origin) / self.step).astype(int).clip(0)
        last = np.ceil((high - self.origin) / self.step).astype(int) + 1
        return slice(first[0], last[0]), slice(first[1], last[1]), slice(first[2], last[2])

    def axes(self, box: tuple[slice, slice, slice]) -> tuple[Grid, Grid, Grid]:
        shape = self.values.shape
        x, y, z = (
            (np.arange(*s.indices(n)) * self.step + o).astype(np.float32)
            for s, n, o in zip(box, shape, self.origin, strict=True)
        )
        return x[:, None, None], y[None, :, None], z[None, None, :]


def _capsule(axes: tuple[Grid, Grid, Grid], a: Array, b: Array, ra: float, rb: float) -> Grid:
    """Distance from a capsule whose radius runs from ra at a to rb at b."""
    edge = b - a
    px, py, pz = (axis - np.float32(start) for axis, start in zip(axes, a, strict=True))
    ex, ey, ez = (np.float32(e) for e in edge)
    share = np.clip((px * ex + py * ey + pz * ez) / np.float32(edge @ edge), 0.0, 1.0)
    away = np.sqrt((px - share * ex) ** 2 + (py - share * ey) ** 2 + (pz - share * ez) ** 2)
    return np.asarray(away - (np.float32(ra) + share * np.float32(rb - ra)), dtype=np.float32)


def _join(first: Grid, second: Grid, blend: float) -> Grid:
    """Smooth minimum of two distances; ``blend`` is the width of the fillet, metres."""
    k = np.float32(blend)
    overlap = np.maximum(k - np.abs(first - second), 0.0) / k
    return np.asarray(np.minimum(first, second) - overlap * overlap * k * 0.25, dtype=np.float32)


def _palm_parts(skeleton: Skeleton, scale: float) -> list[tuple[Array, Array, float, float, float]]:
    """Capsules (a, b, radius a, radius b, blend) of the palm in the wrist frame."""
    joints, frames = skeleton.joints, skeleton.frames
    x = frames[1, :3, 0]  # toward the thumb on both hands, since a left hand's frames are mirrored
    z = np.array([0.0, 0.0, scale])
    roots = {f: joints[1 + FINGERS[f][0]] for f in FINGERS}
    parts = []
    starts = {"index": 0.014, "middle": 0.004, "ring": -0.006, "little": -0.016}
    radii = {"index": 0.0120, "middle": 0.0120, "ring": 0.0115, "little": 0.0105}
    for finger, offset in starts.items():
        start = x * offset * scale + np.array([0.0, 0.008, 0.0]) * scale
        parts.append((start, roots[finger] - 0.0005 * z, 0.0138, radii[finger], 0.016))
    thumb_mcp = joints[1 + FINGERS["thumb"][1]]
    index_root = roots["index"]
    parts += [
        # The ball of the thumb, the edge below the little finger, and the thumb's web.
        (x * 0.016 * scale + np.array([0, 0.016, 0.008]) * scale, thumb_mcp, 0.0160, 0.0105, 0.022),
        (
            -x * 0.021 * scale + np.array([0, 0.014, 0.007]) * scale,
            roots["little"] - np.array([0, 0.014, -0.004]) * scale,
            0.0138,
            0.0100,
            0.022,
        ),
        (
            0.45 * roots["thumb"] + 0.55 * index_root - np.array([0, 0.014, 0]) * scale,
            0.60 * thumb_mcp + 0.40 * index_root - np.array([0, 0.010, 0]) * scale,
            0.0090,
            0.0060,
            0.014,
        ),
    ]
    return [(a, b, ra * scale, rb * scale, k * scale) for a, b, ra, rb, k in parts]


def _forearm(axes: tuple[Grid, Grid, Grid], scale: float) -> Grid:
    """Distance from a forearm of elliptic section along -y, widest near the elbow."""
    x, y, z = axes
    along = np.clip(-y / scale, -0.005, FOREARM_LENGTH)
    knots, wide, thick = (
        [-0.01, 0.03, 0.08, 0.16, 0.24, FOREARM_LENGTH],
        [0.0275, 0.0278, 0.0305, 0.0385, 0.0430, 0.0450],
        [0.0200, 0.0200, 0.0230, 0.0320, 0.0385, 0.0420],
    )
    half_x = np.interp(along, knots, wide).astype(np.float32) * scale
    half_z = np.interp(along, knots, thick).astype(np.float32) * scale
    ratio = np.sqrt((x / half_x) ** 2 + (z / half_z) ** 2)
    radial = (ratio - 1.0) * half_z
    beyond = np.maximum(-y - FOREARM_LENGTH * scale, y - 0.004 * scale)
    outside = np.sqrt(np.maximum(radial, 0) ** 2 + np.maximum(beyond, 0) ** 2)
    return np.asarray(np.minimum(np.maximum(radial, beyond), 0) + outside, dtype=np.float32)


def hand_field(skeleton: Skeleton, shape: HandShape, step: float) -> _Field:
    """Sample the flesh's distance field around a posed skeleton.

    Args:
        skeleton: A pose in the wrist frame.
        shape: Its sizes.
        step: Distance of the samples, metres.

    Returns:
        The field; negative inside.
    """
    scale, joints = shape.scale, skeleton.joints
    margin = _MARGIN * scale
    low = np.minimum(joints.min(0), [-0.05 * scale, -FOREARM_LENGTH * scale, -0.05 * scale])
    high = np.maximum(joints.max(0), [0.05 * scale, 0, 0.05 * scale])
    low, high = low - 2 * margin, high + 2 * margin
    size = np.ceil((high - low) / step).astype(int) + 1
    field = _Field(low, step, np.full(tuple(size), 1.0, dtype=np.float32))

    def capsule_box(points: list[Array], radius: float) -> tuple[slice, slice, slice]:
        stacked = np.stack(points)
        return field.box(stacked.min(0) - radius - margin, stacked.max(0) + radius + margin)

    box = field.box(
        np.array([-0.06, -(FOREARM_LENGTH + 0.01), -0.06]) * scale,
        np.array([0.06, 0.03, 0.06]) * scale,
    )
    field.values[box] = _forearm(field.axes(box), scale)
    for a, b, ra, rb, blend in _palm_parts(skeleton, scale):
        box = capsule_box([a, b], max(ra, rb))
        part = _capsule(field.axes(box), a, b, ra, rb)
        field.values[box] = _join(field.values[box], part, blend)
    palm = field.values.copy()
    for finger, indices in FINGERS.items():
        points = [joints[1 + i] for i in indices]
        turns = [skeleton.frames[1 + i, :3, :3] for i in indices]
        radii = [r * scale for r in FINGER_RADII[finger]]
        tip = points[3] - turns[3][:, 1] * 0.45 * radii[3]
        box = capsule_box(points, radii[0])
        axes = field.axes(box)
        thumb = finger == "thumb"
        chain = _join(
            palm[box],
            _capsule(axes, points[0], points[1], radii[0], radii[1]),
            (0.012 if thumb else 0.008) * scale,
        )
        for joint, end in ((1, points[2]), (2, tip)):
            part = _capsule(axes, points[joint], end, radii[joint], radii[joint + 1])
            chain = _join(chain, part, 0.003 * scale)
        for joint, (start, end) in enumerate(zip(points[:3], [*points[1:3], tip], strict=True)):
            # The pad of flesh on the palm's side of each bone.
            pad = turns[joint][:, 2] * 0.18 * radii[joint + 1]
            a, b = 0.65 * start + 0.35 * end + pad, 0.3 * start + 0.7 * end + pad
            r = 0.93 * (0.4 * radii[joint] + 0.6 * radii[joint + 1])
            if not (thumb and joint == 0):
                chain = _join(chain, _capsule(axes, a, b, r, r), 0.005 * scale)
        field.values[box] = np.minimum(field.values[box], chain)
    return field


def surface_nets(values: Grid, origin: Array, step: float) -> Surface:
    """Triangulate the zero level of a sampled field (negative inside) by naive surface nets.

    One vertex per cell that the surface crosses, the mean of the crossings on its edges; one quad
    per grid edge whose ends differ in sign. The surface is closed where it stays off the border.

    Args:
        values: The field, shape (X, Y, Z).
        origin: Position of ``values[0, 0, 0]``, shape (3,).
        step: Distance of the samples.

    Returns:
        The surface, its normals along the field's gradient.
    """
    inside = values < 0
    corners = [(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    shape = np.array(values.shape) - 1

    def shifted(array: npt.NDArray[Any], c: tuple[int, int, int]) -> npt.NDArray[Any]:
        return array[c[0] : c[0] + shape[0], c[1] : c[1] + shape[1], c[2] : c[2] + shape[2]]

    count = np.zeros(tuple(shape), dtype=np.int8)
    for corner in corners:
        count += shifted(inside, corner)
    cells = np.argwhere((count > 0) & (count < 8))
    number = np.full(tuple(shape), -1, dtype=np.int64)
    number[tuple(cells.T)] = np.arange(len(cells))
    total, crossings = np.zeros((len(cells), 3)), np.zeros(len(cells))
    for first in corners:
        for axis in range(3):
            if first[axis]:
                continue
            second = tuple(int(c + (a == axis)) for a, c in enumerate(first))
            va = values[tuple((cells + first).T)]
            vb = values[tuple((cells + second).T)]
            cross = (va < 0) != (vb < 0)
            share = np.where(cross, va / np.where(cross, va - vb, 1.0), 0.0)
            point = np.asarray(first, dtype=float) + share[:, None] * np.eye(3)[axis]
            total += np.where(cross[:, None], point, 0.0)
            crossings += cross
    grid_points = cells + total / crossings[:, None]

    quads = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        low = [slice(None)] * 3
        high = [slice(None)] * 3
        low[axis], high[axis] = slice(None, -1), slice(1, None)
        a, b = inside[tuple(low)], inside[tuple(high)]
        for flip, edges in ((False, np.argwhere(a & ~b)), (True, np.argwhere(~a & b))):
            around = []
            for du, dv in ((0, 0), (-1, 0), (-1, -1), (0, -1)):
                cell = edges.copy()
                cell[:, u] += du
                cell[:, v] += dv
                around.append(number[tuple(cell.T)])
            quad = np.stack(around, axis=1)
            quads.append(quad[:, ::-1] if flip else quad)
    quad = np.concatenate(quads)
    faces = np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]])

    def at(points: Array) -> Array:
        return np.asarray(map_coordinates(values, points.T, order=1, mode="nearest"), dtype=float)

    normals = np.stack(
        [at(grid_points + np.eye(3)[a]) - at(grid_points - np.eye(3)[a]) for a in range(3)], axis=1
    )
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    return Surface(origin + grid_points * step, faces, normals)


def _paint(
    surface: Surface, skeleton: Skeleton, shape: HandShape, tone: Array
) -> tuple[Array, Array]:
    """Skin reflectance and gloss per vertex: nails, reddish tips and knuckles, mottled tone."""
    p, scale = surface.vertices, shape.scale
    mottle = (
        np.sin(p @ np.array([310.0, 170.0, 230.0]))
        + np.sin(p @ np.array([-190.0, 260.0, 330.0]) + 1.7)
    ) * 0.007 + np.sin(p @ np.array([60.0, 45.0, -70.0])) * 0.02
    color = tone * (1.0 + mottle)[:, None]
    gloss = np.full(len(p), 0.25)
    red = np.array([1.10, 0.90, 0.88])
    for indices in FINGERS.values():
        chain = skeleton.joints[[1 + i for i in indices]]
        reach = 0.03 * scale
        rows = np.flatnonzero(((p > chain.min(0) - reach) & (p < chain.max(0) + reach)).all(axis=1))
        q, skin = p[rows], color[rows]
        for joint, center in enumerate(chain):
            squared = np.square((q - center) / scale).sum(1)
            wide = 0.011 if joint == 3 else 0.0125
            skin = skin * (1 + (red - 1) * np.exp(-squared / wide**2)[:, None] * 0.7)
        frame = skeleton.frames[1 + indices[3]]
        local = (q - frame[:3, 3]) @ frame[:3, :3] / scale
        nail = np.exp(-((local[:, 0] / 0.0050) ** 4 + ((local[:, 1] + 0.0065) / 0.0062) ** 4))
        nail *= (surface.normals[rows] @ frame[:3, 2] < -0.35) & (local[:, 2] < 0)
        pale = 0.55 * tone + 0.45 * np.array([0.80, 0.58, 0.52])
        color[rows] = skin * (1 - nail[:, None]) + pale * nail[:, None]
        gloss[rows] += nail
    return np.clip(color, 0.01, 0.95), gloss


def hand_mesh(
    skeleton: Skeleton,
    shape: HandShape | None = None,
    *,
    tone: npt.ArrayLike = SKIN_TONES[1],
    step: float = 0.0025,
) -> HandMesh:
    """Skin a posed skeleton.

    Args:
        skeleton: The pose, wrist frame, metres.
        shape: The sizes that posed it; an adult's right hand where it is left out.
        tone: Linear RGB reflectance of the skin, shape (3,).
        step: Grid of the implicit surface, metres; 2.5 mm shows nails, 4 mm is faster.

    Returns:
        A closed hand with its forearm in the wrist frame.

    Raises:
        ValueError: The grid is not between 1 and 10 mm.
    """
    if not 0.001 <= step <= 0.010:
        raise ValueError(f"step must lie between 0.001 and 0.010 metres, got {step}")
    shape = shape or HandShape()
    field = hand_field(skeleton, shape, step)
    surface = surface_nets(field.values, field.origin, field.step)
    albedo, gloss = _paint(surface, skeleton, shape, np.asarray(tone, dtype=float))
    return HandMesh(surface, albedo, gloss)

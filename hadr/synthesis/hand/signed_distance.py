"""The surface of a hand at rest, as an implicit surface around straight, slightly spread fingers.

Each finger, and the forearm with the palm, is a generalised cylinder: a line with tables of its
half-width and of its depth to the back and to the palm. A smooth minimum lets them flow into each
other, together with the balls of thumb and little finger and the web between the fingers.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.interpolate import PchipInterpolator

from hadr.camera import Array
from hadr.hand import FINGERS, HandShape, Skeleton, forward_kinematics

Grid = npt.NDArray[np.float32]

FOREARM_LENGTH = 0.75
#: How far the finger reaches beyond the tip keypoint, metres.
TIP_PAD = 0.0035
#: Spread of each finger at rest, radians: neighbours stay apart beyond their web.
REST_SPREAD = {"thumb": 0.0, "index": 0.22, "middle": 0.08, "ring": -0.07, "little": -0.22}
#: Girth of each finger against the tables below.
GIRTH = {"thumb": 1.0, "index": 0.97, "middle": 1.0, "ring": 0.95, "little": 0.84}
#: Along a finger, 0 at the MCP, 1 at the PIP, 2 at the DIP, 3 at the tip keypoint; half-width and
#: depths to the back and to the palm, millimetres.
FINGER_TABLE = (
    (-0.30, 10.0, 10.4, 10.4),
    (-0.04, 10.0, 11.8, 11.0),
    (0.12, 9.9, 10.6, 11.4),
    (0.30, 9.8, 9.4, 11.3),
    (0.55, 9.5, 8.7, 10.6),
    (0.80, 9.5, 8.8, 9.5),
    (1.00, 10.0, 9.5, 8.9),
    (1.22, 9.3, 8.3, 9.3),
    (1.55, 8.8, 7.6, 9.3),
    (1.82, 8.7, 7.5, 8.3),
    (2.00, 8.9, 7.7, 7.8),
    (2.22, 8.4, 6.9, 8.0),
    (2.55, 7.9, 5.9, 8.0),
    (2.85, 7.4, 5.1, 7.2),
    (3.20, 6.9, 4.4, 6.2),
)
#: The same for the thumb: 0 at the CMC, 1 at the MCP, 2 at the IP, 3 at the tip keypoint.
THUMB_TABLE = (
    (-0.30, 12.0, 11.0, 13.0),
    (0.00, 14.0, 12.0, 16.0),
    (0.40, 14.5, 11.6, 17.0),
    (0.75, 13.2, 11.0, 15.0),
    (1.00, 12.0, 11.2, 12.4),
    (1.30, 10.9, 9.6, 11.4),
    (1.65, 10.5, 8.9, 10.8),
    (1.90, 10.9, 9.1, 9.6),
    (2.00, 11.1, 9.0, 9.2),
    (2.25, 11.0, 7.6, 9.8),
    (2.60, 10.7, 6.2, 9.9),
    (2.85, 10.0, 5.3, 8.8),
    (3.20, 9.0, 4.6, 7.4),
)
#: Forearm and palm along y: y, centre x, half-width, depth to the back and to the palm, mm.
PALM_TABLE = (
    (-760.0, 0.0, 46.0, 41.0, 42.0),
    (-240.0, 0.0, 44.5, 39.0, 40.0),
    (-160.0, 0.0, 40.5, 33.0, 33.0),
    (-80.0, 0.0, 33.5, 24.5, 24.5),
    (-30.0, 0.0, 29.6, 20.5, 20.0),
    (-5.0, -0.2, 29.2, 19.0, 18.6),
    (12.0, -1.5, 31.0, 18.0, 18.0),
    (35.0, -4.5, 35.2, 16.2, 15.6),
    (60.0, -6.0, 38.2, 14.2, 13.0),
    (80.0, -6.2, 39.4, 11.6, 12.4),
    (105.0, -6.2, 39.4, 8.6, 11.4),
)


def rest_angles() -> Array:
    """The twenty angles of the template's pose, radians: straight and slightly spread."""
    angles = np.zeros(20)
    angles[4::4] = [REST_SPREAD[f] for f in ("index", "middle", "ring", "little")]
    return angles


def rest_skeleton(shape: HandShape | None = None) -> Skeleton:
    """The skeleton that the template is built around."""
    return forward_kinematics(rest_angles(), shape)


def along_finger(finger: str, distance: npt.NDArray[np.float32] | Array, shape: HandShape) -> Array:
    """Metres beyond a finger's first joint as joint numbers: 0, 1, 2 at joints, 3 at the tip."""
    lengths = np.asarray(shape.lengths[finger])
    knots = np.concatenate([[-lengths[0], 0.0], np.cumsum(lengths)])
    knots = np.append(knots, knots[-1] + lengths[2])
    return np.asarray(np.interp(distance, knots, np.arange(-1.0, 5.0)), dtype=float)


def _tabulated(table: tuple[tuple[float, ...], ...], at: Array | Grid) -> list[Grid]:
    rows = np.asarray(table)
    curve = PchipInterpolator(rows[:, 0], rows[:, 1:] * 1e-3, axis=0)
    values = curve(np.clip(at, rows[0, 0], rows[-1, 0]))
    return [np.asarray(values[..., i], dtype=np.float32) for i in range(values.shape[-1])]


def _smooth_min(first: Grid, second: Grid, blend: float) -> Grid:
    """Smooth minimum of two distances; ``blend`` is the width of the fillet, metres."""
    k = np.float32(blend)
    overlap = np.maximum(k - np.abs(first - second), 0.0) / k
    return np.asarray(np.minimum(first, second) - overlap * overlap * k * 0.25, dtype=np.float32)


def _round_cone(points: Grid, a: Array, b: Array, ra: float, rb: float) -> Grid:
    """Distance from a capsule whose radius runs from ra at a to rb at b."""
    edge = (b - a).astype(np.float32)
    offset = points - a.astype(np.float32)
    fraction = np.clip(offset @ edge / np.float32(edge @ edge), 0.0, 1.0)
    away = np.linalg.norm(offset - fraction[..., None] * edge, axis=-1)
    return np.asarray(away - (np.float32(ra) + fraction * np.float32(rb - ra)), dtype=np.float32)


def _section(
    u: Grid, v: Grid, wide: Grid, back: Grid, palm: Grid, beyond: Grid, cap: float
) -> Grid:
    """Radial distance from a section of half-width ``wide``, closed by a cap of length ``cap``."""
    deep = np.where(v < 0, back, palm)
    ratio = np.sqrt((u / wide) ** 2 + (v / deep) ** 2 + (beyond / np.float32(cap)) ** 2)
    away = np.sqrt(u * u + v * v + beyond * beyond)
    near = np.minimum(wide, deep)
    return np.asarray(
        np.where(ratio < 0.3, (ratio - 1) * near, away * (1 - 1 / np.maximum(ratio, 1e-3))),
        dtype=np.float32,
    )


def finger_distance(points: Grid, finger: str, rest: Skeleton, shape: HandShape) -> Grid:
    """Distance of points from one straight finger, metres."""
    frame = rest.frames[1 + FINGERS[finger][0]].astype(np.float32)
    local = (points - frame[:3, 3]) @ frame[:3, :3]
    u, s, v = local[..., 0], local[..., 1], local[..., 2]
    table = THUMB_TABLE if finger == "thumb" else FINGER_TABLE
    wide, back, palm = (
        np.float32(GIRTH[finger]) * t for t in _tabulated(table, along_finger(finger, s, shape))
    )
    end = np.float32(sum(shape.lengths[finger]) + TIP_PAD)
    cap = np.float32((0.0145 if finger == "thumb" else 0.0125) * GIRTH[finger])
    start = np.float32(0.004)
    beyond = np.maximum(s - (end - cap), 0) + np.maximum(-s - start, 0)
    return _section(u, v, wide, back, palm, beyond, float(cap))


def palm_distance(points: Grid, rest: Skeleton) -> Grid:
    """Distance of points from forearm and palm with the balls of thumb and little finger."""
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    centre, wide, back, palm = _tabulated(PALM_TABLE, np.asarray(y * 1e3))
    roots = {f: rest.joints[1 + FINGERS[f][0]] for f in FINGERS}
    line = np.array([roots[f][:2] for f in ("little", "ring", "middle", "index")])
    end = np.interp(x, line[:, 0], line[:, 1]).astype(np.float32) + np.float32(0.005)
    beyond = np.maximum(y - end, 0) + np.maximum(-FOREARM_LENGTH - y, 0)
    distance = _section(x - centre, z, wide, back, palm, beyond.astype(np.float32), 0.013)

    def cone(a: Array, b: Array, ra: float, rb: float, blend: float) -> None:
        nonlocal distance
        distance = _smooth_min(distance, _round_cone(points, a, b, ra, rb), blend)

    thumb = rest.joints[2:5]
    on_thumb = thumb[0] + np.outer([0.45, 0.80], thumb[1] - thumb[0])
    cone(np.array([0.013, 0.022, 0.010]), on_thumb[1], 0.0170, 0.0125, 0.018)
    cone(np.array([-0.021, 0.024, 0.006]), np.array([-0.032, 0.058, 0.004]), 0.0148, 0.0110, 0.018)
    cone(np.array([0.017, 0.046, 0.004]), on_thumb[0], 0.0120, 0.0115, 0.020)
    cone(np.array([0.021, 0.068, 0.002]), on_thumb[1], 0.0095, 0.0085, 0.020)
    return distance


def signed_distance(points: Grid, rest: Skeleton, shape: HandShape) -> Grid:
    """Distance of points (..., 3) from the whole hand at rest with its forearm; negative inside.

    ``rest`` is the rest skeleton of a right hand of scale 1, ``shape`` has its sizes; wrist frame,
    metres.
    """
    palm = palm_distance(points, rest)
    distance = palm
    for finger in FINGERS:
        one = finger_distance(points, finger, rest, shape)
        joined = _smooth_min(palm, one, 0.014 if finger == "thumb" else 0.007)
        distance = _smooth_min(distance, joined, 0.0025)
    return distance

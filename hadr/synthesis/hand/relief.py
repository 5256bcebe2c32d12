"""What is seen on a hand's skin: creases, knuckles, nails, tendons, veins, and where it is red.

Everything is drawn once on the template at rest, in coordinates of the fingers and of the palm,
so that it moves with the skin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree

from hadr.camera import Array
from hadr.hand import FINGERS, HandShape
from hadr.synthesis.hand.signed_distance import GIRTH, along_finger, rest_skeleton

#: Where a nail starts and how far it reaches beside its middle, in a finger's table coordinates
#: and in fractions of its half-width.
NAIL_FROM, NAIL_TO, NAIL_HALF_WIDTH = 2.44, 3.04, 0.74
# Lines of the palm (x, y), mm, on a right hand: heart, head and life line, thumb's base, wrist.
_PALM_LINES = (
    ((-45, 59, 0.1), (-37, 63, 0.7), (-24, 67, 0.9), (-10, 70, 0.7), (2, 77, 0.5), (9, 86, 0.0)),
    ((32, 64, 0.6), (20, 62, 0.7), (6, 58, 0.6), (-10, 51, 0.6), (-26, 41, 0.0)),
    ((32, 65, 0.6), (22, 60, 0.8), (12, 49, 0.8), (6, 37, 0.7), (3, 24, 0.6), (6, 10, 0.0)),
    ((-30, -2, 0.0), (-20, 0, 0.5), (-6, 2, 0.6), (10, 2, 0.5), (28, -1, 0.0)),
    ((-24, -9, 0.0), (-8, -7, 0.3), (10, -7, 0.3), (24, -9, 0.0)),
    ((-20, 76, 0.0), (-17, 62, 0.3), (-15, 48, 0.2), (-14, 34, 0.0)),
    ((20, 46, 0.0), (22, 38, 0.25), (20, 28, 0.25), (14, 18, 0.0)),
    ((-40, 44, 0.0), (-32, 47, 0.25), (-22, 46, 0.0)),
)
# Veins on the back of hand and forearm (x, y), mm.
_VEINS = (
    ((-28, 72), (-27, 55), (-18, 38), (-16, 10), (-22, -40), (-15, -120)),
    ((-10, 74), (-11, 60), (-18, 40)),
    ((13, 76), (10, 58), (2, 40), (9, 15), (22, -20), (26, -90)),
    ((-11, 62), (-2, 50), (3, 38)),
)


@dataclass(frozen=True, eq=False)
class SkinMap:
    """The skin's features per vertex of the template, each shape (V,), 0 to 1 but for the height.

    Args:
        height: Displacement along the normal, metres.
        palm: On the palm's side, which is lighter and without freckles.
        red: Knuckles, tips and balls, where blood shows.
        crease: Folds, which are darker.
        nail: The nails' plates.
        moon: The nails' pale ends.
        vein: Bluish veins.
        mottle: Uneven tone, -1 to 1.
    """

    height: Array
    palm: Array
    red: Array
    crease: Array
    nail: Array
    moon: Array
    vein: Array
    mottle: Array


def _bump(distance: Array, width: float) -> Array:
    return np.asarray(np.exp(-np.square(distance / width)), dtype=float)


def _step(value: Array, low: float, high: float) -> Array:
    t = np.clip((value - low) / (high - low), 0.0, 1.0)
    return np.asarray(t * t * (3 - 2 * t), dtype=float)


def _to_curve(points: Array, knots: tuple[tuple[float, ...], ...]) -> tuple[Array, Array]:
    """Distance (V,) to a curve through (x, y) knots in mm, metres, and their further number."""
    rows = np.asarray(knots, dtype=float)
    at = np.linspace(0, len(rows) - 1, 400)
    curve = CubicSpline(np.arange(len(rows)), rows, axis=0)(at)
    distance, nearest = cKDTree(curve[:, :2] * 1e-3).query(points)
    strength = curve[nearest, 2] if rows.shape[1] > 2 else np.ones(len(points))
    return np.asarray(distance, dtype=float), np.asarray(strength, dtype=float)


def noise(points: Array, wavelength: float, seed: int) -> Array:
    """Smooth random values of about -1 to 1 at points, without direction, shape (V,)."""
    lattice = np.random.default_rng(seed).uniform(-1.6, 1.6, (32, 32, 32))
    return np.asarray(
        map_coordinates(lattice, (points / wavelength).T, order=1, mode="grid-wrap"), dtype=float
    )


def skin_map(points: Array, normals: Array, shape: HandShape) -> SkinMap:
    """Draw the skin's features on the smooth surface (V, 3) of the rest hand of a shape."""
    count = len(points)
    maps = {name: np.zeros(count) for name in SkinMap.__dataclass_fields__}
    rest = rest_skeleton(shape)
    _draw_palm(points, normals, maps)
    frames = [rest.frames[1 + joints[0]] for joints in FINGERS.values()]
    local = [(points - frame[:3, 3]) @ frame[:3, :3] for frame in frames]
    away = []
    for finger, place in zip(FINGERS, local, strict=True):
        before = 0.030 if finger == "thumb" else 0.0
        off = place - [0, 1, 0] * np.clip(place[:, 1:2], before, sum(shape.lengths[finger]))
        away.append(np.linalg.norm(off, axis=1))
    nearest, least = np.argmin(away, axis=0), np.min(away, axis=0)
    for i, finger in enumerate(FINGERS):
        rows = np.flatnonzero((nearest == i) & (least < 0.020))
        _draw_finger(finger, local[i][rows], normals[rows] @ frames[i][:3, :3], rows, maps, shape)
    coarse, fine = noise(points, 0.016, 3), noise(points, 0.0045, 4)
    maps["mottle"] = 0.6 * coarse + 0.4 * fine
    maps["height"] += 0.00005 * noise(points, 0.0031, 5) * (points[:, 1] > -0.03)
    return SkinMap(**maps)


def pose_correctives(points: Array, normals: Array, shape: HandShape) -> Array:
    """How much the back of each joint rises when it bends by a right angle: `HandTemplate`'s.

    Bone ends push the skin out; between the four knuckles it sinks. The thumb's CMC is flat.
    """
    rest = rest_skeleton(shape)
    rises = np.zeros((len(points), 15))
    for i, finger in enumerate(FINGERS):
        girth = GIRTH[finger]
        lengths = shape.lengths[finger]
        frame = rest.frames[1 + FINGERS[finger][0]]
        local, facing = (points - frame[:3, 3]) @ frame[:3, :3], normals @ frame[:3, 2]
        across, s = local[:, 0] / girth, local[:, 1]
        back = _step(-facing, 0.0, 0.7) * (local[:, 2] < 0.004)
        for j, at in enumerate(np.cumsum([0.0, *lengths[:2]])):
            if j == 0 and finger == "thumb":
                continue
            wide, high = ((0.0075, 0.0020), (0.0070, 0.0011), (0.0055, 0.0007))[j]
            over = back * _bump(s - at - 0.001, 0.0085 if j == 0 else 0.0062)
            rise = high * _bump(across, wide)
            if j == 0:
                rise = rise - 0.0016 * _bump(np.abs(across) - 0.0115, 0.0042)
            rises[:, 3 * i + j] = girth * over * rise
    return rises


def _draw_palm(points: Array, normals: Array, maps: dict[str, Array]) -> None:
    x, y = points[:, 0], points[:, 1]
    facing = normals[:, 2]
    inner, back = _step(facing, 0.1, 0.6), _step(-facing, 0.1, 0.6)
    maps["palm"] += _step(facing, -0.25, 0.45) * _step(y, -0.03, 0.02)
    maps["palm"] += 0.5 * _step(facing, -0.4, 0.6) * (1 - _step(y, -0.03, 0.02))
    # The head of the ulna, on the back of the wrist below the little finger.
    ulna = np.hypot(x + 0.020, (y + 0.020) * 0.8)
    maps["height"] += 0.0021 * _step(-facing, -0.1, 0.7) * _bump(ulna, 0.0095)
    hand = (y > -0.02) & (points[:, 2] > -0.02)
    rows = np.flatnonzero(hand & (facing > 0.05))
    wander = noise(points, 0.006, 6)
    for line in _PALM_LINES:
        distance, strength = _to_curve(points[rows, :2], line)
        depth = np.clip(strength, 0, 1) * inner[rows] * (0.8 + 0.35 * wander[rows])
        distance = np.abs(distance + 0.0004 * wander[rows])
        maps["height"][rows] -= 0.00075 * depth * _bump(distance, 0.0014)
        maps["height"][rows] += 0.00025 * depth * _bump(distance - 0.0032, 0.0020)
        maps["crease"][rows] += 0.6 * depth * _bump(distance, 0.0012)
    rows = np.flatnonzero((y > -0.25) & (facing < -0.05))
    for i, vein in enumerate(_VEINS):
        distance, _ = _to_curve(points[rows, :2], vein)
        fade = back[rows] * _step(y[rows], -0.12, -0.05) * (0.8 if i % 2 else 1.0)
        maps["height"][rows] += 0.00042 * fade * _bump(distance, 0.0022)
        maps["vein"][rows] += 0.45 * fade * _bump(distance, 0.0023)
    for root, start in ((24, 6), (0, 1), (-19, -5), (-36, -11)):
        ends = np.array([[start, 6.0], [root, 80.0 - 0.18 * abs(root)]]) * 1e-3
        edge = ends[1] - ends[0]
        along = ((points[rows, :2] - ends[0]) @ edge) / (edge @ edge)
        distance = np.abs((points[rows, :2] - ends[0]) @ [edge[1], -edge[0]]) / np.hypot(*edge)
        fade = back[rows] * _step(along, 0.25, 0.6) * (1 - _step(along, 0.95, 1.08))
        maps["height"][rows] += 0.0007 * fade * _bump(distance, 0.0030)
    for root, up in ((24, 88), (0, 90), (-19, 84), (-36, 74)):
        distance = np.hypot(x - root * 1e-3, y - up * 1e-3)
        maps["red"] += 0.6 * back * _bump(distance, 0.0090)
    balls = _bump(np.hypot(x - 0.024, y - 0.030), 0.018)
    balls = balls + _bump(np.hypot(x + 0.033, y - 0.035), 0.020)
    heads = _bump(y - 0.084, 0.010) * (x > -0.045)
    maps["red"] += (0.35 * balls + 0.35 * heads) * inner


def _draw_finger(
    finger: str,
    local: Array,
    facing: Array,
    rows: npt.NDArray[np.int64],
    maps: dict[str, Array],
    shape: HandShape,
) -> None:
    """Draw on one finger; ``local`` is across, along and toward the palm in the finger's frame."""
    thumb, girth = finger == "thumb", GIRTH[finger]
    across, s = local[:, 0] / girth, local[:, 1]
    t = along_finger(finger, s, shape)
    lengths = shape.lengths[finger]
    joints = np.cumsum([0.0, *lengths])
    inner, back = _step(facing[:, 2], -0.1, 0.45), _step(-facing[:, 2], 0.15, 0.6)
    height, crease, red = (np.zeros(len(rows)) for _ in range(3))

    # Folds on the palm's side: (place along the finger, depth, curve).
    folds = [(joints[1] - 0.001, 0.7), (joints[2] - 0.001, 0.9)]
    if not thumb:
        folds = [(0.44 * lengths[0], 0.9), (joints[1] - 0.0024, 0.8)]
        folds += [(joints[1] + 0.0016, 0.7), (joints[2] - 0.0008, 0.9)]
    for at, depth in folds:
        bent = s - at + 0.0012 * np.cos(across / 0.005)
        deep = depth * inner * (0.75 + 0.25 * np.cos(across / 0.0045))
        height -= 0.0007 * deep * _bump(bent, 0.0013)
        crease += 0.6 * deep * _bump(bent, 0.0013)
    # Wrinkles and red on the back of the joints.
    for joint, wide, strong in ((1, 0.0066, 0.35 if thumb else 1.0), (2, 0.0042, 0.7)):
        d = s - joints[joint] + 0.00016 * np.square(across / 0.005) * np.sign(s - joints[joint]) * 5
        over = back * _bump(d, wide * 1.15) * _bump(across, 0.0085)
        wave = np.cos(2 * np.pi * d / 0.0030 + 1.2 * np.sin(across / 0.0022))
        height -= 0.00027 * strong * over * wave
        crease += 0.34 * strong * over * np.clip(wave, 0, 1)
        red += 0.65 * strong * back * _bump(s - joints[joint], 0.0085)
        red += 0.25 * inner * _bump(s - joints[joint], 0.006)
    red += 0.85 * _step(t, 2.30, 2.85) * (0.55 + 0.45 * inner)

    # The nail: a plate with a groove around, a free edge that stands off, a pale moon and end.
    wide = (0.0104 if thumb else 0.0080) * NAIL_HALF_WIDTH
    length = (NAIL_TO - NAIL_FROM) * lengths[2]
    start = joints[2] + (NAIL_FROM - 2) * lengths[2]
    v = (s - start) / length
    side = np.abs(across) / wide
    half = np.where(v < 0.52, (0.52 - v) / 0.46, (v - 0.52) / 0.48)
    # An oval at the root, straighter toward the free edge; 0 on the border, 1 in the middle.
    power = np.where(v < 0.52, 2.6, 4.0)
    inside = 1 - (np.minimum(side, 3) ** power + np.minimum(half, 3) ** power) ** (1 / power)
    on_back = _step(-facing[:, 2], -0.25, -0.05)
    plate = _step(inside, -0.09, 0.15) * on_back
    rim = _bump(inside + 0.05, 0.10) * on_back * (1 - _step(v, 0.80, 0.92))
    fold = _bump(inside + 0.28, 0.17) * on_back * (1 - _step(v, 0.65, 0.85))
    height += plate * (0.00010 + 0.00030 * _step(v, 0.5, 1.0)) - 0.00030 * rim + 0.00028 * fold
    edge = plate * _step(v, 0.84, 0.96)
    crescent = plate * (1 - _step(np.hypot(across / wide / 1.5, (v - 0.02) / 0.62), 0.30, 0.46))
    red *= 1 - 0.6 * plate
    maps["height"][rows] = height + maps["height"][rows] * (1 - _step(t, 0.1, 0.4))
    maps["palm"][rows] = np.where(t > 0.5, _step(facing[:, 2], -0.30, 0.40), maps["palm"][rows])
    maps["crease"][rows] = np.clip(crease + maps["crease"][rows] + 0.40 * rim, 0, 1)
    maps["red"][rows] = np.clip(red + maps["red"][rows], 0, 1)
    maps["nail"][rows] = plate
    maps["moon"][rows] = np.clip(edge + 0.4 * crescent, 0, 1)
    maps["vein"][rows] *= 1 - _step(t, 0.0, 0.4)

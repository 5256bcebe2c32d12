"""Eight transparent things, as watertight surfaces of revolution with a real wall.

An object stands in its own frame: metres, the axis of revolution is z, the table z = 0, the
mouth up. Its shape is one closed curve in the half plane (r, z): from the axis up along the
outside, over the rounded rim, down along the inside and back to the axis. The mug adds a handle,
a second closed body whose two ends lie inside the wall.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from hadr.synthesis.surfaces import Surface, revolve, smooth_curve, tube_around

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class GlassObject:
    """One transparent object.

    Args:
        object_id: Its four digits, as the data set's folders are named.
        name: What it is.
        outer: Control points (r, z) of the outside from the table to the rim, metres.
        inner: Control points (r, z) of the inside from the rim to its floor, metres.
        grip: Heights (z) between which fingers may close on it, metres.
        stem: Heights of the stem, metres, for a thing that has one.
        handle: Control points (r, z) of the handle's centre line; empty without a handle.
        handle_radius: Half of the handle's thickness, metres.
        tint: Share of red, green and blue light that a centimetre of the material lets through.
    """

    object_id: str
    name: str
    outer: tuple[tuple[float, float], ...]
    inner: tuple[tuple[float, float], ...]
    grip: tuple[float, float]
    stem: tuple[float, float] | None = None
    handle: tuple[tuple[float, float], ...] = ()
    handle_radius: float = 0.0
    tint: tuple[float, float, float] = (0.95, 0.975, 0.965)

    @property
    def height(self) -> float:
        """Metres from the table to the rim."""
        return float(profile(self)[:, 1].max())

    @property
    def radius(self) -> float:
        """Largest radius of the body without its handle, metres."""
        return float(profile(self)[:, 0].max())

    def outer_radius(self, z: float) -> float:
        """Largest radius of the body at the height z, metres; 0 above and below it."""
        curve = profile(self)
        a, b = curve[:-1], curve[1:]
        crosses = (np.minimum(a[:, 1], b[:, 1]) <= z) & (np.maximum(a[:, 1], b[:, 1]) >= z)
        if not crosses.any():
            return 0.0
        a, b = a[crosses], b[crosses]
        rise = np.where(np.abs(b[:, 1] - a[:, 1]) < 1e-12, 1.0, b[:, 1] - a[:, 1])
        share = np.clip((z - a[:, 1]) / rise, 0.0, 1.0)
        return float((a[:, 0] + share * (b[:, 0] - a[:, 0])).max())


@lru_cache(maxsize=32)
def profile(item: GlassObject, spacing: float = 0.003) -> Array:
    """The closed outline in the half plane, from the axis below to the axis inside.

    Args:
        item: The object.
        spacing: Distance of the samples, metres.

    Returns:
        Points (r, z) in metres, shape (N, 2); the first and the last lie on the axis.
    """
    outer, inner = smooth_curve(item.outer, spacing), smooth_curve(item.inner, spacing)
    middle = (outer[-1] + inner[0]) / 2
    half = float(np.linalg.norm(outer[-1] - inner[0])) / 2
    across = (outer[-1] - middle) / half
    up = np.array([-across[1], across[0]])
    turn = np.linspace(0, np.pi, 9)[1:-1, None]
    rim = middle + half * (np.cos(turn) * across + np.sin(turn) * up)
    return np.concatenate([outer, rim, inner])


def handle_line(item: GlassObject) -> Array:
    """The centre line of the handle in the object's frame, metres, shape (N, 3); N = 0 without."""
    if not item.handle:
        return np.zeros((0, 3))
    rz = smooth_curve(item.handle, 0.002)
    return np.stack([rz[:, 0], np.zeros(len(rz)), rz[:, 1]], axis=1)


@lru_cache(maxsize=32)
def bodies(item: GlassObject) -> tuple[Surface, ...]:
    """The closed surfaces that make up the object, in its own frame: the body, then the handle."""
    parts = [revolve(profile(item))]
    if item.handle:
        tube = tube_around(handle_line(item), item.handle_radius)
        volume = np.einsum(
            "ij,ij->i",
            tube.vertices[tube.faces[:, 0]],
            np.cross(tube.vertices[tube.faces[:, 1]], tube.vertices[tube.faces[:, 2]]),
        ).sum()
        parts.append(
            Surface(tube.vertices, tube.faces[:, ::-1], tube.normals) if volume < 0 else tube
        )
    return tuple(parts)


def _polyline_distance(points: Array, curve: Array) -> Array:
    a, b = curve[:-1], curve[1:]
    edge = b - a
    offset = points[:, None] - a
    share = (offset * edge).sum(-1) / np.maximum((edge * edge).sum(-1), 1e-18)
    nearest = offset - np.clip(share, 0, 1)[..., None] * edge
    return np.asarray(np.sqrt((nearest * nearest).sum(-1).min(1)))


def signed_distance(item: GlassObject, points: npt.ArrayLike, *, filled: bool = False) -> Array:
    """Distance from the glass, negative inside of it.

    Args:
        item: The object.
        points: Object frame, metres, shape (N, 3).
        filled: True closes the mouth: the hollow counts as inside.

    Returns:
        Metres, shape (N,).

    Raises:
        ValueError: The points have another shape.
    """
    p = np.asarray(points, dtype=float)
    if p.ndim != 2 or p.shape[1] != 3:
        raise ValueError(f"points must have shape (N, 3) in metres, got {p.shape}")
    curve = profile(item)
    if filled:
        rim = int(np.argmax(curve[:, 1]))
        curve = np.concatenate([curve[: rim + 1], [[0.0, curve[rim, 1]]]])
    rz = np.stack([np.hypot(p[:, 0], p[:, 1]), p[:, 2]], axis=1)
    distance = _polyline_distance(rz, curve)
    # Even-odd rule along the direction of growing r; the axis closes the outline.
    closed = np.concatenate([curve, curve[:1]])
    a, b = closed[:-1], closed[1:]
    z = rz[:, 1:2]
    between = (a[:, 1] > z) != (b[:, 1] > z)
    rise = np.where(np.abs(b[:, 1] - a[:, 1]) < 1e-15, 1.0, b[:, 1] - a[:, 1])
    crossing = a[:, 0] + (z - a[:, 1]) / rise * (b[:, 0] - a[:, 0])
    inside = ((between & (crossing > rz[:, :1])).sum(1) % 2) == 1
    distance = np.where(inside, -distance, distance)
    line = handle_line(item)
    if len(line):
        tube = _polyline_distance(p, line) - item.handle_radius
        # The handle ends flat, inside the wall.
        distance = np.minimum(distance, np.maximum(tube, line[:, 0].min() - rz[:, 0]))
    return np.asarray(distance)


_ITEMS = (
    GlassObject(
        "0000",
        "tumbler",
        outer=((0, 0), (0.027, 0), (0.0295, 0.001), (0.031, 0.004), (0.034, 0.05), (0.038, 0.109)),
        inner=((0.0357, 0.109), (0.0318, 0.05), (0.0285, 0.014), (0.026, 0.0105), (0, 0.010)),
        grip=(0.02, 0.10),
    ),
    GlassObject(
        "0001",
        "wine glass",
        outer=(
            (0, 0),
            (0.033, 0),
            (0.0355, 0.001),
            (0.0345, 0.0028),
            (0.018, 0.006),
            (0.006, 0.014),
            (0.0045, 0.03),
            (0.0043, 0.068),
            (0.007, 0.081),
            (0.022, 0.092),
            (0.036, 0.111),
            (0.0405, 0.135),
            (0.038, 0.163),
            (0.0335, 0.188),
        ),
        inner=(
            (0.0318, 0.188),
            (0.0363, 0.163),
            (0.0388, 0.135),
            (0.0342, 0.112),
            (0.020, 0.0945),
            (0.006, 0.0875),
            (0, 0.087),
        ),
        grip=(0.105, 0.17),
        stem=(0.025, 0.075),
    ),
    GlassObject(
        "0004",
        "champagne flute",
        outer=(
            (0, 0),
            (0.030, 0),
            (0.0325, 0.001),
            (0.0315, 0.0026),
            (0.016, 0.0055),
            (0.0055, 0.013),
            (0.0042, 0.03),
            (0.0042, 0.066),
            (0.008, 0.082),
            (0.018, 0.102),
            (0.0245, 0.13),
            (0.0262, 0.16),
            (0.0245, 0.213),
        ),
        inner=(
            (0.0229, 0.213),
            (0.0246, 0.16),
            (0.0228, 0.131),
            (0.0160, 0.1035),
            (0.0058, 0.090),
            (0, 0.088),
        ),
        grip=(0.105, 0.195),
        stem=(0.025, 0.075),
    ),
    GlassObject(
        "0005",
        "beaker",
        outer=(
            (0, 0),
            (0.031, 0),
            (0.0345, 0.0012),
            (0.036, 0.005),
            (0.036, 0.05),
            (0.036, 0.096),
            (0.0375, 0.1015),
            (0.040, 0.104),
        ),
        inner=(
            (0.0389, 0.1056),
            (0.0363, 0.1030),
            (0.0342, 0.097),
            (0.0342, 0.05),
            (0.0342, 0.006),
            (0.0325, 0.0032),
            (0.030, 0.0026),
            (0, 0.0025),
        ),
        grip=(0.02, 0.09),
        tint=(0.965, 0.98, 0.98),
    ),
    GlassObject(
        "0006",
        "bottle",
        outer=(
            (0, 0),
            (0.028, 0),
            (0.0315, 0.0012),
            (0.033, 0.005),
            (0.033, 0.06),
            (0.033, 0.115),
            (0.0305, 0.131),
            (0.020, 0.150),
            (0.0138, 0.163),
            (0.0130, 0.175),
            (0.0130, 0.187),
            (0.0148, 0.189),
            (0.0148, 0.2),
        ),
        inner=(
            (0.0118, 0.2),
            (0.0105, 0.187),
            (0.0105, 0.175),
            (0.0113, 0.163),
            (0.0175, 0.1485),
            (0.0280, 0.130),
            (0.0305, 0.115),
            (0.0305, 0.06),
            (0.0305, 0.008),
            (0.028, 0.0055),
            (0.024, 0.005),
            (0, 0.005),
        ),
        grip=(0.02, 0.125),
        tint=(0.93, 0.97, 0.945),
    ),
    GlassObject(
        "0007",
        "jar",
        outer=(
            (0, 0),
            (0.038, 0),
            (0.0415, 0.0012),
            (0.0435, 0.006),
            (0.0435, 0.04),
            (0.0435, 0.073),
            (0.041, 0.082),
            (0.0365, 0.087),
            (0.036, 0.0895),
            (0.0385, 0.091),
            (0.0385, 0.094),
            (0.0365, 0.095),
            (0.0365, 0.103),
        ),
        inner=(
            (0.0338, 0.103),
            (0.0335, 0.090),
            (0.0345, 0.0855),
            (0.0385, 0.0805),
            (0.0408, 0.072),
            (0.0408, 0.04),
            (0.0405, 0.009),
            (0.037, 0.006),
            (0.032, 0.0055),
            (0, 0.005),
        ),
        grip=(0.02, 0.08),
    ),
    GlassObject(
        "0008",
        "mug",
        outer=(
            (0, 0),
            (0.033, 0),
            (0.0365, 0.0014),
            (0.038, 0.006),
            (0.0385, 0.045),
            (0.0395, 0.092),
        ),
        inner=(
            (0.0358, 0.092),
            (0.0347, 0.045),
            (0.034, 0.012),
            (0.0315, 0.0085),
            (0.027, 0.0075),
            (0, 0.007),
        ),
        grip=(0.02, 0.085),
        handle=(
            (0.0372, 0.074),
            (0.046, 0.0765),
            (0.0585, 0.075),
            (0.0670, 0.066),
            (0.0690, 0.050),
            (0.0665, 0.034),
            (0.0575, 0.0245),
            (0.046, 0.022),
            (0.0362, 0.023),
        ),
        handle_radius=0.0046,
    ),
    GlassObject(
        "0009",
        "bowl",
        outer=(
            (0, 0),
            (0.024, 0),
            (0.0262, 0.0008),
            (0.0268, 0.0035),
            (0.034, 0.0085),
            (0.047, 0.023),
            (0.0545, 0.042),
            (0.058, 0.064),
        ),
        inner=(
            (0.0555, 0.064),
            (0.0518, 0.043),
            (0.0442, 0.0255),
            (0.031, 0.0125),
            (0.019, 0.0082),
            (0, 0.007),
        ),
        grip=(0.02, 0.062),
    ),
)
#: The eight objects by their id; which thing stands behind an id is our choice, not the paper's.
OBJECTS: dict[str, GlassObject] = {item.object_id: item for item in _ITEMS}
#: The objects of the paper's unknown-category experiment.
UNKNOWN_OBJECTS: tuple[str, ...] = ("0004", "0007")


def glass_object(object_id: str) -> GlassObject:
    """Look up an object by its four digits.

    Raises:
        ValueError: There is no such object; the message lists them.
    """
    if object_id not in OBJECTS:
        raise ValueError(f"no object {object_id!r}; there are {', '.join(OBJECTS)}")
    return OBJECTS[object_id]

"""Grasp candidates from points alone: a geometric stand-in for a trained grasp detector.

A parallel gripper holds without slipping where its two pads meet surfaces that face them: the
line from one contact to the other must lie within the friction cone of both (an antipodal pair).
The sampler draws one contact with a closing axis inside its cone, and looks what the fingers would
find on the other side. The camera sees one side only; the other is guessed (`unseen_side`).
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from hadr.camera import Array
from hadr.handover.grasping.grasps import Grasps
from hadr.handover.grasping.gripper import FINGER_HEIGHT, LARGEST_OPENING
from hadr.handover.grasping.unseen_side import unseen_side

Mask = NDArray[np.bool_]

FINGER_REACH = 0.05
"""How far past the first touched point the fingertips end (the paper's 5 cm), metres."""
PAST_CONTACT = 0.035
"""How far past the contacts the fingertips end on thin things such as a stem, metres."""
SPARE = 0.016
"""How much wider than the object the fingers open, both sides together, metres."""
LEAST_SPARE = 0.003
"""Least opening beyond the object's width, both sides together, metres."""
LEVER = 0.10
"""Distance from the object's middle at which the balance of a grasp falls to 1/e, metres."""
ATTEMPTS, TURNS, MOST_SCORED = 800, 3, 500
"""Contacts tried, approach directions at each, evenly about the closing axis, and how many of the
candidates that a quick look leaves are scored."""
FRICTION = 0.6
"""Coefficient of friction between pad and object; rubber on dry glass has this or more."""
_MOST_POINTS = 500
_MOST_NEIGHBOURS = 2000
_STRIPS = 4  # over the pad's height


class NoCandidateError(ValueError):
    """No grasp fits the gripper; the message says why."""


def surface_normals(
    points: Array, viewpoint: Array, neighbours: int = 16, *, among: Array | None = None
) -> Array:
    """Unit normals (n, 3) of points (n, 3), turned to the side of a viewpoint (3,), metres.

    Of the plane of their nearest neighbours, in a denser cloud `among` (m, 3) where one is given.
    """
    cloud = points if among is None else among
    _, near = cKDTree(cloud).query(points, k=min(neighbours, len(cloud)))
    around = cloud[near] - cloud[near].mean(axis=1, keepdims=True)  # (n, k, 3)
    _, vectors = np.linalg.eigh(around.transpose(0, 2, 1) @ around)
    normals: Array = vectors[:, :, 0]
    away = ((viewpoint - points) * normals).sum(axis=1) < 0
    normals[away] *= -1
    return normals


def sample_grasps(
    points: Array,
    rng: np.random.Generator,
    *,
    viewpoint: Array | None = None,
    toward: Array | None = None,
    reach: float = FINGER_REACH,
    frame: str = "camera",
) -> Grasps:
    """Draw grasp candidates around an object's points.

    Each attempt takes a surface point and a closing axis inside its friction cone, and tries
    several approach directions about that axis. The score is the geometric mean of four
    shares, each 0 to 1: how much of the friction is to spare, how much of the pads' height
    touches, how much room the open fingers have, and how near to its middle the object is held.

    Args:
        points: Points of the object alone, shape (n, 3), metres; seen from one side is enough.
        rng: Source of the draws.
        viewpoint: Where the camera stood, shape (3,), metres; the frame's origin if left out.
        toward: A direction (3,): only approaches at less than 90 degrees to it, as an arm cannot
            reach round the object.
        reach: How far past the first touched point the fingertips end, metres.
        frame: Name of the points' frame.

    Returns:
        Candidates, highest score first. The fingertips are to end 5 cm past a grasp's point. It
        lies where the object is met first, or before that: by what `reach` is less, and on things
        less than 3 cm thick so that the tips end 3.5 cm past the contacts.

    Raises:
        NoCandidateError: Nothing was found that fits between the fingers.
        ValueError: Fewer than 30 points, another shape, or NaN.
    """
    cloud = np.asarray(points, dtype=np.float64)
    if cloud.ndim != 2 or cloud.shape[1] != 3 or len(cloud) < 30:
        raise ValueError(f"points must be at least 30 rows of 3 metres, got shape {cloud.shape}")
    if not np.isfinite(cloud).all():
        raise ValueError("points must be finite, got NaN or infinity; drop the missing ones first")
    cloud = cloud[rng.permutation(len(cloud))[:_MOST_NEIGHBOURS]]
    eye = np.zeros(3) if viewpoint is None else np.asarray(viewpoint, dtype=np.float64)
    cloud, normals = completed(cloud, eye)
    places = _narrow_places(cloud, normals)
    seeds = rng.choice(places, ATTEMPTS) if len(places) else np.zeros(0, dtype=np.int64)
    axes = _axes(normals[seeds], rng)
    if toward is not None:  # half a turn about the closing axis
        axes[axes[:, :, 0] @ np.asarray(toward) < 0] *= [-1.0, 1.0, -1.0]
    seeds = np.repeat(seeds, TURNS)
    # a look at every fourth point rules most out: fewer points never reach further apart
    coarse = _Slabs(cloud[::4], cloud[seeds], axes, reach)
    likely = np.flatnonzero(coarse.fits(3, 0.0))[:MOST_SCORED]
    slabs = _Slabs(cloud, cloud[seeds[likely]], axes[likely], reach)
    table = _rows(cloud, normals, slabs, np.flatnonzero(slabs.fits(8, 0.003)))
    if not len(table):
        raise NoCandidateError(
            f"no candidate among {ATTEMPTS} attempts: the object is wider than the gripper's "
            f"{LARGEST_OPENING} m in every direction tried, or its points are too sparse"
        )
    return Grasps.from_rows(table[np.argsort(-table[:, 0], kind="stable")], frame)


def completed(points: Array, viewpoint: Array) -> tuple[Array, Array]:
    """Some of the seen points with the guessed ones behind them, and all their unit normals.

    Of the seen points (n, 3), in any but a regular order, the first 500 are kept and come first;
    all help to find their normals.
    """
    kept = points[:_MOST_POINTS]
    dense = len(points) > 2 * _MOST_POINTS
    normals = surface_normals(kept, viewpoint, 32 if dense else 16, among=points)
    more, more_normals = unseen_side(kept, normals, viewpoint)
    return np.concatenate([kept, more]), np.concatenate([normals, more_normals])


def _narrow_places(cloud: Array, normals: Array) -> NDArray[np.int64]:
    """Points behind which, straight along their normal, the object ends within the gripper."""
    near = (cloud - cloud.mean(axis=0)).astype(np.float32)
    n = normals.astype(np.float32)
    others = near[::2]
    along = n @ others.T - (n * near).sum(axis=1)[:, None]
    squares = (near**2).sum(axis=1)[:, None] + (others**2).sum(axis=1) - 2 * near @ others.T
    beside = squares - along**2 > (FINGER_HEIGHT / 2) ** 2
    reach = np.where(beside, 0, np.abs(along)).max(axis=1)
    return np.flatnonzero(reach < LARGEST_OPENING)


def _axes(normals: Array, rng: np.random.Generator) -> Array:
    """Axes (n * TURNS, 3, 3) near the normals (n, 3): approach, closing and height as columns."""
    n = len(normals)
    closing = normals + 0.5 * FRICTION * rng.uniform(-1, 1, size=(n, 3))
    closing /= np.linalg.norm(closing, axis=1, keepdims=True)
    side = np.cross(closing, np.eye(3)[np.abs(closing).argmin(axis=1)])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(closing, side)
    angle = rng.uniform(0, 2 * np.pi, size=(n, 1)) + np.arange(TURNS) * 2 * np.pi / TURNS
    approach = np.cos(angle)[..., None] * side[:, None] + np.sin(angle)[..., None] * other[:, None]
    approach = approach.reshape(-1, 3)
    closing = np.repeat(closing, TURNS, axis=0)
    return np.stack([approach, closing, np.cross(approach, closing)], axis=2)


class _Slabs:
    """What lies in the slabs that the pads would sweep; float32, one row a candidate.

    Attributes:
        axes: Approach, closing and height as columns, (k, 3, 3).
        along: Coordinates of all points along the closing axis, from the contact, (k, n).
        height: The same along the height axis.
        inside: Which points would lie between the fingers, (k, n).
        count: How many those are, (k,).
        first: Approach coordinate of the first point met, from the contact, (k,).
        low, high, extent: Ends along the closing axis and their distance, (k,).
    """

    def __init__(self, cloud: Array, contacts: Array, axes: Array, reach: float) -> None:
        self.axes, self.contacts, self.reach = axes, contacts, reach
        middle = cloud.mean(axis=0)
        flat = axes.transpose(2, 0, 1).astype(np.float32)  # (3, k, 3)
        near = (cloud - middle).T.astype(np.float32)
        own = np.einsum("aki,ki->ak", flat, (contacts - middle).astype(np.float32))
        approach, self.along, self.height = (flat[i] @ near - own[i][:, None] for i in range(3))
        slab = np.abs(self.height) < FINGER_HEIGHT / 2
        slab &= np.abs(self.along) < LARGEST_OPENING
        big = np.float32(1e3)
        self.first = np.where(slab, approach, big).min(axis=1)
        slab &= approach < (self.first + reach)[:, None]
        self.inside = slab
        self.count = slab.sum(axis=1)
        self.low = np.where(slab, self.along, big).min(axis=1)
        self.high = np.where(slab, self.along, -big).max(axis=1)
        self.extent = self.high - self.low

    def fits(self, points: int, narrowest: float) -> Mask:
        """Which have that many points between the fingers and an extent that fits, (k,)."""
        fits: Mask = (self.count >= points) & (self.extent >= narrowest)
        fits &= self.extent < LARGEST_OPENING - LEAST_SPARE
        return fits


def _rows(cloud: Array, normals: Array, slabs: _Slabs, kept: NDArray[np.int64]) -> Array:
    """Rows of 17 numbers for those of the kept slabs that friction holds."""
    axes, closing = slabs.axes[kept], slabs.axes[kept, :, 1]
    along, inside = slabs.along[kept], slabs.inside[kept]
    low, high, extent = slabs.low[kept], slabs.high[kept], slabs.extent[kept]
    zone = np.maximum(0.12 * extent, 0.003)[:, None]
    strip = ((slabs.height[kept] / FINGER_HEIGHT + 0.5) * _STRIPS).astype(np.int8)
    points, n = cloud.astype(np.float32), normals.astype(np.float32)
    turned = np.sign(closing.astype(np.float32) @ n.T)  # so that all normals face along closing
    used, touched, contact = [], [], []
    for depth in (along - low[:, None], high[:, None] - along):
        weight = np.maximum(1 - depth / zone, 0) * inside
        used.append(_tangent((weight * turned) @ n, closing))
        contact.append(weight @ points / weight.sum(axis=1, keepdims=True))
        touched.append(_touched(weight > 0, strip))
    line = contact[1] - contact[0]
    worst = np.maximum.reduce([*used, _tangent(line, closing)])
    middle = (contact[0] + contact[1]) / 2
    room = (LARGEST_OPENING - extent) / SPARE
    scores = _scores(worst / FRICTION, np.minimum(*touched), room, middle, closing, cloud)
    good = scores > 0
    # across: the middle of the slab; along the approach: the first touch, or before it where the
    # contacts are so near that the tips would end far behind them
    touch = ((middle - slabs.contacts[kept]) * axes[:, :, 0]).sum(axis=1)
    tips = np.minimum(slabs.first[kept] + slabs.reach, touch + PAST_CONTACT)
    shift = np.stack([tips - FINGER_REACH, (low + high) / 2, np.zeros(len(kept))], axis=1)
    point = slabs.contacts[kept] + np.einsum("kij,kj->ki", axes, shift)
    table = np.zeros((len(kept), 17))
    table[:, 0] = scores
    table[:, 1] = np.minimum(extent.astype(np.float64) + SPARE, LARGEST_OPENING)
    table[:, 2:4] = FINGER_HEIGHT, 0.02
    table[:, 4:13] = axes.reshape(-1, 9)
    table[:, 13:16] = point
    table[:, 16] = -1
    return table[good]


def _scores(
    used: Array, touched: Array, room: Array, middle: Array, closing: Array, cloud: Array
) -> Array:
    """Geometric mean of friction not used at the worse contact, pad that touches, room, balance."""
    # balance: how far the object's middle lies from the line between the contacts
    away = middle - cloud.mean(axis=0)
    away -= (away * closing).sum(axis=1, keepdims=True) * closing
    balance = np.exp(-(away**2).sum(axis=1) / LEVER**2)
    product = np.clip(1 - used, 0, 1) * touched * np.clip(room, 0, 1) * balance
    scores: Array = product**0.25
    return scores


def _tangent(vectors: Array, axis: Array) -> Array:
    """Tangent of the angle between vectors (n, 3) and unit axes (n, 3); 1e3 where it is 90."""
    forward = (vectors * axis).sum(axis=1)
    across = np.linalg.norm(vectors - forward[:, None] * axis, axis=1)
    tangent: Array = np.where(forward > 1e-3 * across, across / np.maximum(forward, 1e-12), 1e3)
    return tangent


def _touched(end: Mask, strip: NDArray[np.int8]) -> Array:
    """Share of the pad's height strips in which an end (k, n) has a point, shape (k,)."""
    strips = [(end & (strip == number)).any(axis=1) for number in range(_STRIPS)]
    share: Array = np.mean(strips, axis=0)
    return share

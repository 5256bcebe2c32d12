"""The checks of a hold: contact, penetration, limits, and fingers through each other.

They look at the skin itself, against the object's exact distance, and hold for both hands.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from hadr.camera import Array
from hadr.hand import ANGLE_LIMITS, ANGLE_NAMES, FINGERS, HandShape, forward_kinematics
from hadr.records.caches import kept
from hadr.synthesis.glass.distance import signed_distance
from hadr.synthesis.glass.objects import glass_object
from hadr.synthesis.glass.shape import GlassObject
from hadr.synthesis.glass.surfaces import vertex_normals
from hadr.synthesis.hand.finger_skin import finger_skin
from hadr.synthesis.hand.skinning import skin_vertices
from hadr.synthesis.hand.template import COARSE_STEP, hand_template
from hadr.synthesis.holding.clearance import clearance_table, hollow_distance
from hadr.synthesis.holding.grasp_optimisation import bone_spheres, object_from_wrist

Part = npt.NDArray[np.int8]

#: Skin nearer than this touches, metres.
TOUCH = 0.002
#: Deepest allowed penetration of the glass, metres.
DEEPEST = 0.002
#: Deepest allowed overlap of two fingers, or of a finger and the palm, metres.
OVERLAP = 0.003
#: A piece of skin that runs through the wall is in it deeper than this somewhere, metres.
_IN_WALL = 0.0005
PARTS = (*FINGERS, "palm", "forearm")


@dataclass(frozen=True)
class ContactReport:
    """What the checks found.

    Args:
        gaps: Smallest distance of the skin of each part to the glass, metres; negative inside.
        overlap: Deepest overlap of two fingers, or of a finger and the palm, metres.
        through_wall: Whether skin passes through the wall.
        beyond_limits: Names of the angles outside of the limits.
    """

    gaps: dict[str, float]
    overlap: float
    through_wall: bool
    beyond_limits: tuple[str, ...]

    @property
    def touching(self) -> tuple[str, ...]:
        """The parts that touch the glass."""
        return tuple(name for name, gap in self.gaps.items() if gap <= TOUCH)

    @property
    def depth(self) -> float:
        """Deepest penetration of the glass, metres; 0 without any."""
        return max(0.0, -min(self.gaps.values()))

    @property
    def problems(self) -> tuple[str, ...]:
        """What speaks against the hold, in words with numbers; empty for a good one."""
        found = []
        touching = set(self.touching)
        fingers = touching & {"index", "middle", "ring", "little"}
        if len(fingers) < 2 or not touching & {"thumb", "palm"}:
            gaps = ", ".join(f"{p} {g * 1e3:.1f}" for p, g in self.gaps.items() if p != "forearm")
            found.append(f"no two fingers with thumb or palm touch (gaps in mm: {gaps})")
        if self.depth > DEEPEST:
            part = min(self.gaps, key=lambda name: self.gaps[name])
            found.append(f"{part} is {self.depth * 1e3:.1f} mm deep in the glass")
        if self.through_wall:
            found.append("skin passes through the wall")
        if self.overlap > OVERLAP:
            found.append(f"fingers overlap by {self.overlap * 1e3:.1f} mm")
        if self.beyond_limits:
            found.append(f"beyond the limits: {', '.join(self.beyond_limits)}")
        return tuple(found)


@kept(1)
def _edges() -> npt.NDArray[np.int64]:
    """Edges of the coarse skin without the forearm's, each once, shape (E, 2)."""
    template = hand_template(COARSE_STEP)
    faces = template.faces
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    pairs = np.unique(np.sort(pairs, axis=1), axis=0)
    return np.asarray(pairs[(template.part[pairs] != 6).all(axis=1)])


def passes_through_wall(item: GlassObject, points: Array, edges: npt.NDArray[np.int64]) -> bool:
    """Whether skin, joined by edges, runs from outside to the hollow not over the rim alone."""
    around = signed_distance(item, points, filled=True)
    if (around > 0).all():
        return False
    within = hollow_distance(item, points)
    below = points[:, 2] < item.height
    hollow = below & (around < 0) & (within > around)
    crossing = edges[hollow[edges[:, 0]] != hollow[edges[:, 1]]]
    if len(crossing) == 0:
        return False
    fraction = np.linspace(0, 1, 13)[:, None, None]
    a, b = points[crossing[:, 0]], points[crossing[:, 1]]
    along = a + fraction * (b - a)
    glass = signed_distance(item, along.reshape(-1, 3)).reshape(along.shape[:2])
    return bool((glass.min(0) < -_IN_WALL).any())


def _finger_overlap(angles: Array, shape: HandShape, vertices: Array, part: Part) -> float:
    """Deepest overlap of a right hand's skin with another finger or with the palm, metres."""
    skins = {finger: finger_skin(finger, shape) for finger in FINGERS}
    beyond = {f: vertices[skin.rows[skin.bone > 0]] for f, skin in skins.items()}
    deepest = 0.0
    for i, (finger, skin) in enumerate(skins.items()):
        _, joints = skin.bones(angles[None, 4 * i : 4 * i + 4])
        centers, radii = bone_spheres(joints * shape.scale, skin.girth)
        others = np.concatenate([points for other, points in beyond.items() if other != finger])
        away = np.linalg.norm(others[:, None] - centers, axis=-1)
        deepest = max(deepest, float((radii - away).max()))
    palm = vertices[part == 5]
    normals = vertex_normals(vertices, hand_template(COARSE_STEP).faces)[part == 5]
    tips = np.concatenate([points for f, points in beyond.items() if f != "thumb"])
    distance, nearest = cKDTree(palm).query(tips, distance_upper_bound=0.012)
    near = np.isfinite(distance)
    offset, facing = tips[near] - palm[nearest[near]], normals[nearest[near]]
    return max(deepest, float(-(offset * facing).sum(1).min(initial=0.0)))


def check_contact(
    object_id: str,
    shape: HandShape,
    angles: npt.ArrayLike,
    wrist_from_object: Array,
    inside: tuple[str, ...] = (),
) -> ContactReport:
    """Check how a hand with twenty joint angles, radians, meets an object.

    ``wrist_from_object`` is the object's pose in the wrist frame, (4, 4); the fingers ``inside``
    may be in the mouth.
    """
    item = glass_object(object_id)
    q = np.asarray(angles, dtype=float)
    vertices, part = skin_vertices(forward_kinematics(q, shape), shape)
    inverse = object_from_wrist(wrist_from_object)
    points = vertices @ inverse[:3, :3].T + inverse[:3, 3]
    gaps = clearance_table(object_id).around(points.astype(np.float32)).astype(float)
    may_enter = np.isin(part, [list(FINGERS).index(f) for f in inside])
    near = np.flatnonzero((gaps < 0.006) | (may_enter & (gaps < 0.03)))
    exact = signed_distance(item, points[near], filled=True)
    if inside:
        rows = np.flatnonzero(may_enter[near])
        exact[rows] = np.maximum(exact[rows], hollow_distance(item, points[near[rows]]))
    # The closed mouth is nothing to touch: what is free of it is as near as the glass is.
    free = np.flatnonzero(exact >= 0)
    exact[free] = np.maximum(exact[free], signed_distance(item, points[near[free]]))
    gaps[near] = exact
    by_part = {name: float(gaps[part == number].min()) for number, name in enumerate(PARTS)}
    limits = (q < ANGLE_LIMITS[:, 0] - 1e-6) | (q > ANGLE_LIMITS[:, 1] + 1e-6)
    if shape.side == "left":
        vertices = vertices * [-1.0, 1.0, 1.0]
    overlap = _finger_overlap(q, replace(shape, side="right"), vertices, part)
    through = bool(inside) and passes_through_wall(item, points, _edges())
    return ContactReport(
        by_part, overlap, through, tuple(ANGLE_NAMES[i] for i in np.flatnonzero(limits))
    )

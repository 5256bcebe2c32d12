"""What rays meet in the world and the colour that they bring, for `world_view`.

Opaque things are lit by one wide lamp, a weak second one and the sky. Glass bends and dims rays
and mirrors two bright panels that nothing else shows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from hadr.simulation.film.world_parts import ARM, CLOTH, FLOOR, HAND, NOTHING, TABLE, Piece, cloth
from hadr.synthesis.glass.surfaces import Surface, merged
from hadr.synthesis.rendering.raycast import RayCaster, Rows, search_tree
from hadr.synthesis.rendering.refraction import Beams, cross
from hadr.synthesis.scene.contents import Contents

Array = npt.NDArray[Any]


def _unit(*direction: float) -> Array:
    return np.asarray(np.array(direction) / np.linalg.norm(direction), dtype=np.float32)


def _lamp_places() -> Array:
    """Unit directions toward 16 places of the key light, (16, 3)."""
    side = np.cross(_KEY, [0.0, 0.0, 1.0])
    other = np.cross(_KEY, side)
    places = [0.13 * (np.array([k % 4, k // 4]) / 3 - 0.5) for k in range(16)]
    return np.stack([_unit(*(_KEY + a * side + b * other)) for a, b in places])


_KEY, _FILL = _unit(-0.42, -0.62, 1.0), _unit(0.7, -0.7, 0.25)
_LAMP = _lamp_places()
_SKY: Array = np.array([0.96, 1.0, 1.06], dtype=np.float32)
_SUN: Array = np.array([0.99, 0.95, 0.89], dtype=np.float32)
_WRAP: Array = np.zeros((7, 3), dtype=np.float32)
_WRAP[HAND] = (0.42, 0.22, 0.16)
_WALL: Array = np.array([[0.74, 0.78, 0.80], [0.40, 0.48, 0.56]], dtype=np.float32)
_BOUNCES = 8


@dataclass(frozen=True)
class Seen(Rows):
    """What N rays met first among opaque things; all float32, infinite distance on a miss."""

    kind: npt.NDArray[np.int64]
    distance: Array
    normal: Array
    albedo: Array
    point: Array


class Solid:
    """Opaque things as one surface with normal, colour and kind per vertex."""

    def __init__(self, pieces: list[Piece]) -> None:
        surface = merged(tuple(piece[0] for piece in pieces))
        albedo = [np.broadcast_to(color, (len(s.vertices), 3)) for s, color, _ in pieces]
        self.looks = np.concatenate([surface.normals, np.concatenate(albedo)], 1).astype(np.float32)
        self.kind = np.concatenate([np.full(len(s.vertices), k) for s, _, k in pieces])
        self.faces = surface.faces
        self.tree = search_tree(surface)

    def meet(self, origins: Array, directions: Array, seen: Seen) -> Seen:
        """Add what N rays meet here nearer than what they have met, float32."""
        found = self.tree.run(origins, directions, query="INTERSECT", output=True)
        rows = np.flatnonzero((found["primID"] >= 0) & (found["tfar"] < seen.distance))
        corners = self.faces[found["primID"][rows]]
        u, v = found["u"][rows, None], found["v"][rows, None]
        mixed = (1 - u - v) * self.looks[corners[:, 0]]
        mixed += u * self.looks[corners[:, 1]] + v * self.looks[corners[:, 2]]
        normal = mixed[:, :3]
        normal /= np.maximum(np.sqrt((normal**2).sum(1, keepdims=True)), 1e-12)
        away = found["tfar"][rows]
        new = Seen(*(getattr(seen, name).copy() for name in Seen.__dataclass_fields__))
        new.kind[rows] = self.kind[corners[:, 0]]
        new.distance[rows], new.normal[rows], new.albedo[rows] = away, normal, mixed[:, 3:]
        new.point[rows] = origins[rows] + away[:, None] * directions[rows]
        return new

    def hides(self, points: Array, toward: Array) -> npt.NDArray[np.bool_]:
        """Whether something lies on the way from points into unit directions, float32."""
        return np.asarray(self.tree.run(points, toward, query="OCCLUDED") >= 0)


def _nothing(count: int) -> Seen:
    three = (np.zeros((count, 3), dtype=np.float32) for _ in range(3))
    far = np.full(count, np.inf, dtype=np.float32)
    return Seen(np.zeros(count, dtype=np.int64), far, *three)


def room_seen(room: Solid, origins: Array, directions: Array) -> Seen:
    """What N rays meet of table, cloth and floor."""
    seen = room.meet(origins, directions, _nothing(len(origins)))
    rows = np.flatnonzero(seen.kind == CLOTH)
    seen.albedo[rows] *= cloth(seen.point[rows], 0.0012 * seen.distance[rows])
    return seen


def shade(seen: Seen, directions: Array, lit: Array) -> Array:
    """Linear RGB of what N rays met, (N, 3)."""
    color = _backdrop(directions)
    rows = np.flatnonzero(seen.kind > NOTHING)
    n, kind = seen.normal[rows], seen.kind[rows]
    wrap = _WRAP[kind]
    key = np.maximum(((n @ _KEY)[:, None] + wrap) / (1 + wrap), 0.0) * lit[rows, None]
    fill = np.maximum(n @ _FILL, 0.0)[:, None]
    light = (0.40 + 0.20 * n[:, 2:3]) * _SKY + key * _SUN + 0.14 * fill
    shaded = seen.albedo[rows] * light
    shiny = np.flatnonzero((kind == ARM) | (kind == HAND))
    n, d, arm = n[shiny], directions[rows[shiny]], kind[shiny] == ARM
    half = _KEY - d
    half /= np.sqrt((half**2).sum(1, keepdims=True))
    shine = np.maximum((n * half).sum(1), 0.0) ** np.where(arm, 45.0, 16.0)
    rim = (1 - np.clip(-(n * d).sum(1), 0, 1)) ** 4
    gloss = np.where(arm, 0.22, 0.05) * shine * lit[rows[shiny]] + np.where(arm, 0.1, 0) * rim
    shaded[shiny] += gloss[:, None]
    floor = np.flatnonzero(kind == FLOOR)
    far = np.clip((seen.distance[rows[floor]] - 1.6) / 3.0, 0, 1)[:, None]
    shaded[floor] += far * (color[rows[floor]] - shaded[floor])
    color[rows] = shaded
    return color


class Moment(RayCaster):
    """The world at one moment, ready to be met by rays."""

    def __init__(
        self, room: Solid, things: Solid, glass: tuple[Surface, ...], tint: tuple[float, ...]
    ) -> None:
        super().__init__(Contents(None, glass, (tint[0], tint[1], tint[2])))
        self.room, self.things = room, things

    def meet(self, origins: Array, directions: Array) -> Seen:
        """First opaque things along N rays."""
        start = np.ascontiguousarray(origins, dtype=np.float32)
        heading = np.ascontiguousarray(directions, dtype=np.float32)
        return self.things.meet(start, heading, room_seen(self.room, start, heading))

    def lit(self, seen: Seen, which: npt.NDArray[np.int64]) -> Array:
        """Share of the key light that arrives, from one of 16 places on the lamp, (N,)."""
        lit = np.ones(len(which), dtype=np.float32)
        rows = np.flatnonzero((seen.kind > NOTHING) & (seen.kind != FLOOR))
        rows = rows[(seen.normal[rows] @ _KEY) > np.where(seen.kind[rows] == HAND, -0.45, 0.02)]
        toward = _LAMP[which[rows]]
        start = seen.point[rows] + np.float32(0.003) * seen.normal[rows]
        hidden = self.things.hides(start, toward)
        low = np.flatnonzero(seen.kind[rows] == TABLE)
        hidden[low] |= self.room.hides(start[low], toward[low])
        lit[rows[hidden]] = 0.0
        flat = np.flatnonzero(seen.kind[rows] == CLOTH)
        _, glass = self._clear[0]
        lit[rows[flat[glass.run(start[flat], toward[flat], query="OCCLUDED") >= 0]]] *= 0.6
        return lit

    def through_glass(
        self, origins: Array, directions: Array, nearest: Array
    ) -> tuple[npt.NDArray[np.int64], Array]:
        """Which of N rays meet glass first, and the linear RGB that they bring, (K, 3)."""
        hits = self._trace(self._clear, origins, directions)
        rows = np.flatnonzero(hits.distance < nearest)
        color = np.zeros((len(rows), 3))
        beams = Beams.start(origins[rows], directions[rows])
        hits = hits.take(rows)
        seen: Seen | None = None
        for bounce in range(_BOUNCES):
            clear = hits.mesh >= 0
            if seen is not None:
                clear &= hits.distance < seen.distance
                done = np.flatnonzero(~clear)
                last = beams.take(done)
                part = seen.take(done)
                light = shade(part, last.direction, np.ones(len(done), dtype=np.float32))
                light[part.kind == NOTHING] = self._around(last.direction[part.kind == NOTHING])
                np.add.at(color, last.row, last.weight * light)
            k = np.flatnonzero(clear)
            if not len(k):
                break
            beams, mirrored = cross(self, beams.take(k), hits.take(k))
            if bounce < 4:
                np.add.at(color, beams.row, mirrored.weight * self._around(mirrored.direction))
            if bounce == _BOUNCES - 1:
                np.add.at(color, beams.row, beams.weight * self._around(beams.direction))
                break
            hits = self._trace(self._clear, beams.origin, beams.direction)
            seen = self.meet(beams.origin, beams.direction)
        return rows, color

    @staticmethod
    def _around(directions: Array) -> Array:
        """What glass shows of the studio: wall, dark sides and two bright panels; (N, 3)."""
        x, y, z = directions.T
        side = np.clip((0.80 - y) / 0.35, 0.0, 1.0)[:, None]  # the view looks along y
        light = _backdrop(directions) * (1.0 - 0.62 * side)
        bearing = np.arctan2(x, -y)
        window = (np.abs(bearing + 0.75) < 0.30) & (np.abs(z - 0.45) < 0.22)
        strip = (np.abs(bearing - 1.3) < 0.16) & (np.abs(z - 0.3) < 0.35)
        return np.asarray(light + (3.2 * window + 2.2 * strip)[:, None])


def rolled_off(light: Array) -> Array:
    """Roll bright light off instead of clipping it."""
    over = np.maximum(light - 0.7, 0.0)
    return np.asarray(np.minimum(light, 0.7) + 0.3 * (1 - np.exp(-over / 0.3)))


def _backdrop(directions: Array) -> Array:
    """The wall behind everything, lighter toward the floor's line; linear RGB, (N, 3)."""
    height = np.clip(directions[:, 2:3] * 1.6 + 0.45, 0.0, 1.0).astype(np.float32)
    return np.asarray(_WALL[0] + height * (_WALL[1] - _WALL[0]))

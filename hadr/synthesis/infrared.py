"""Infrared pictures of a scene under a dot projector: what a stereo camera's imagers receive.

Light follows the laws of `hadr.synthesis.optics` in both directions. An imager's rays are split
and bent at every glass surface until they end on something opaque. The projector's beams are
followed the same way, so that dots fall through the glass onto what stands behind it, displaced
and blurred. Glass itself scatters nothing: there are no dots on it, only mirror images.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from scipy.spatial import cKDTree

from hadr.synthesis.optics import GLASS_INDEX, reflect, refract
from hadr.synthesis.raycast import GLASS, HAND, SURROUNDINGS, RayCaster
from hadr.synthesis.textures import SIZE, sample

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]

_NUDGE = 2e-6
_FAINTEST = 0.015
_TEXTURE = 2048


@dataclass(frozen=True)
class Projector:
    """A projector of static random dots.

    Args:
        dots: Number of dots over the whole field.
        field: Horizontal and vertical field of projection, degrees.
        dot_width: Standard deviation of a dot's beam, radians.
        strength: Irradiance in the middle of a dot on a wall at one metre, against that of the
            room's light.
        aperture: Radius of the opening that glass mirrors as a glint, metres.
    """

    dots: int = 5000
    field: tuple[float, float] = (86.0, 57.0)
    dot_width: float = 1.5e-3
    strength: float = 3.0
    aperture: float = 1.5e-3

    @property
    def reach(self) -> tuple[float, float]:
        """Half of the field as tangents, horizontal and vertical."""
        return (
            float(np.tan(np.deg2rad(self.field[0]) / 2)),
            float(np.tan(np.deg2rad(self.field[1]) / 2)),
        )

    def directions(self) -> Array:
        """Where the dots go, as tangents (x, y), shape (N, 2): a jittered grid, always the same."""
        return _dot_grid(self.dots, self.reach)


@lru_cache(maxsize=4)
def _dot_grid(dots: int, reach: tuple[float, float]) -> Array:
    rng = np.random.default_rng(435)
    columns = max(round(np.sqrt(dots * reach[0] / reach[1])), 1)
    rows = max(round(dots / columns), 1)
    y, x = np.mgrid[0:rows, 0:columns].astype(float)
    x = (x + 0.5 + rng.uniform(-0.5, 0.5, x.shape)) / columns
    y = (y + 0.5 + rng.uniform(-0.5, 0.5, y.shape)) / rows
    return np.stack([(2 * x.ravel() - 1) * reach[0], (2 * y.ravel() - 1) * reach[1]], axis=1)


@lru_cache(maxsize=4)
def _pattern(projector: Projector) -> npt.NDArray[np.float32]:
    """The pattern as a picture over the field, 1 in the middle of a dot, (H, W) float32."""
    half_x, half_y = projector.reach
    height = round(_TEXTURE * half_y / half_x)
    scale = _TEXTURE / (2 * half_x)
    sigma = projector.dot_width * scale
    # The grid carries each dot's energy on its four nearest texels; blurring makes it round.
    image = np.zeros((height, _TEXTURE))
    at = (projector.directions() + np.array([half_x, half_y])) * scale - 0.5
    low = np.floor(at).astype(int)
    part = at - low
    for dx in (0, 1):
        for dy in (0, 1):
            share = np.abs(1 - dx - part[:, 0]) * np.abs(1 - dy - part[:, 1])
            x = np.clip(low[:, 0] + dx, 0, _TEXTURE - 1)
            y = np.clip(low[:, 1] + dy, 0, height - 1)
            np.add.at(image, (y, x), share)
    blurred = cv2.GaussianBlur(image, (0, 0), sigma) * (2 * np.pi * sigma**2)
    return np.asarray(blurred, dtype=np.float32)


@dataclass(frozen=True)
class Ends:
    """Where rays end on opaque surfaces; a ray that glass splits has several ends.

    Args:
        row: Number of the ray, shape (M,).
        weight: Share of its light, shape (M,).
        point: World frame, metres, shape (M, 3).
        mesh: Which mesh, shape (M,); -1 where nothing was met.
        face: Which triangle, shape (M,).
        u: First barycentric coordinate, shape (M,).
        v: Second one, shape (M,).
        toward: Direction of travel, shape (M, 3).
        length: Length of the path, metres, shape (M,).
        glass: Number of glass surfaces met on the way, shape (M,).
    """

    row: Index
    weight: Array
    point: Array
    mesh: Index
    face: Index
    u: Array
    v: Array
    toward: Array
    length: Array
    glass: Index

    def take(self, rows: Any) -> Ends:
        """Some of the ends."""
        return Ends(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


class InfraredScene:
    """A scene as infrared light sees it.

    Args:
        rays: Its surfaces.
        projector: The dot projector.
        position: The projector's place, world frame, metres, shape (3,).
        turn: Its orientation: columns are its x, y and viewing axes in the world, shape (3, 3).
    """

    def __init__(self, rays: RayCaster, projector: Projector, position: Array, turn: Array) -> None:
        self.rays, self.projector, self.position, self.turn = rays, projector, position, turn
        self.meshes = list(rays.meshes)
        self.kinds = np.array([kind for kind, _ in self.meshes] + [-1])
        self.tree = EmbreeScene()
        for _, surface in self.meshes:
            TriangleMesh(
                self.tree, surface.vertices.astype(np.float32), surface.faces.astype(np.int32)
            )
        self._photons = self._beams_through_glass()

    def _hit(self, origins: Array, directions: Array) -> dict[str, Any]:
        if len(self.meshes) == 0 or len(origins) == 0:
            nothing = np.full(len(origins), -1)
            zero = np.zeros(len(origins))
            return {"geomID": nothing, "primID": nothing, "tfar": zero, "u": zero, "v": zero}
        found = self.tree.run(
            np.ascontiguousarray(origins, dtype=np.float32),
            np.ascontiguousarray(directions, dtype=np.float32),
            query="INTERSECT",
            output=True,
        )
        found["geomID"] = np.where(found["primID"] < 0, -1, found["geomID"].astype(np.int64))
        return dict(found)

    def normal(self, mesh: Index, face: Index, u: Array, v: Array) -> tuple[Array, Array]:
        """Smooth and flat unit normals, outward, each (N, 3)."""
        smooth, flat = np.zeros((len(mesh), 3)), np.zeros((len(mesh), 3))
        for number, (kind, surface) in enumerate(self.meshes):
            rows = np.flatnonzero(mesh == number)
            if not len(rows):
                continue
            corners = surface.faces[face[rows]]
            a, b, c = (surface.vertices[corners[:, i]] for i in range(3))
            cross = np.cross(b - a, c - a)
            flat[rows] = cross / np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), 1e-20)
            if kind == SURROUNDINGS:
                smooth[rows] = flat[rows]
                continue
            n, s, t = surface.normals, u[rows, None], v[rows, None]
            mixed = (1 - s - t) * n[corners[:, 0]] + s * n[corners[:, 1]] + t * n[corners[:, 2]]
            length = np.linalg.norm(mixed, axis=1, keepdims=True)
            smooth[rows] = mixed / np.maximum(length, 1e-12)
        return smooth, flat

    def follow(
        self, origins: Array, directions: Array, *, bounces: int = 9
    ) -> tuple[Ends, Index, Array]:
        """Follow rays through glass to where they end.

        Args:
            origins: World frame, metres, shape (N, 3).
            directions: Unit directions of travel, shape (N, 3).
            bounces: Most glass surfaces on a path.

        Returns:
            The ends, and the glints of the projector: the ray's number (K,) and the light (K,).
        """
        n = len(origins)
        o, d = np.asarray(origins, dtype=float), np.asarray(directions, dtype=float)
        weight, row, length = np.ones(n), np.arange(n), np.zeros(n)
        parts: list[Ends] = []
        glint_row: list[Index] = []
        glint: list[Array] = []
        for step in range(bounces + 1):
            if not len(row):
                break
            hit = self._hit(o, d)
            mesh = hit["geomID"]
            clear = self.kinds[mesh] == GLASS
            k = np.flatnonzero(~clear)
            distance = np.where(mesh < 0, 1e3, hit["tfar"]).astype(float)
            point = o + distance[:, None] * d
            parts.append(
                Ends(
                    row[k],
                    weight[k],
                    point[k],
                    mesh[k],
                    hit["primID"][k].astype(np.int64),
                    hit["u"][k].astype(float),
                    hit["v"][k].astype(float),
                    d[k],
                    (length + distance)[k],
                    np.full(len(k), step),
                )
            )
            k = np.flatnonzero(clear)
            if step == bounces or not len(k):
                break
            smooth, flat = self.normal(
                mesh[k], hit["primID"][k], hit["u"][k].astype(float), hit["v"][k].astype(float)
            )
            o, d, weight, row = point[k], d[k], weight[k], row[k]
            length = (length + distance)[k]
            entering = (flat * d).sum(1) < 0
            sign = np.where(entering, 1.0, -1.0)[:, None]
            against, flat = smooth * sign, flat * sign
            wrong = (against * d).sum(1) > -1e-3
            against = np.where(wrong[:, None], flat, against)
            ratio = np.where(entering, 1.0 / GLASS_INDEX, GLASS_INDEX)
            bent, share = refract(d, against, ratio)
            mirrored = reflect(d, against)
            if step == 0:
                light = self._mirrored_projector(o, mirrored) * share * weight
                bright = np.flatnonzero(light > 0.01)
                glint_row.append(row[bright])
                glint.append(light[bright])
            passed, bounced = weight * (1.0 - share), weight * share
            go, back = np.flatnonzero(passed > _FAINTEST), np.flatnonzero(bounced > _FAINTEST)
            o = np.concatenate([o[go] - _NUDGE * flat[go], o[back] + _NUDGE * flat[back]])
            d = np.concatenate([bent[go], mirrored[back]])
            weight = np.concatenate([passed[go], bounced[back]])
            row = np.concatenate([row[go], row[back]])
            length = np.concatenate([length[go], length[back]])
        ends = Ends(
            *(
                np.concatenate([getattr(part, name) for part in parts])
                for name in Ends.__dataclass_fields__
            )
        )
        none = np.zeros(0, dtype=np.int64)
        return (
            ends,
            np.concatenate([none, *glint_row]),
            np.concatenate([np.zeros(0), *glint]),
        )

    def _mirrored_projector(self, points: Array, directions: Array) -> Array:
        """Light of the projector itself, seen in a mirror at ``points`` along ``directions``."""
        there = self.position - points
        distance = np.linalg.norm(there, axis=1)
        aside = np.linalg.norm(np.cross(there, directions), axis=1)
        ahead = (there * directions).sum(1) > 0
        blur = 3 * self.projector.aperture + 0.004 * distance
        return np.asarray(60.0 * np.exp(-0.5 * (aside / blur) ** 2) * ahead)

    def _beams_through_glass(self, spread: int = 48) -> tuple[cKDTree, Array] | None:
        """Where the dots behind glass land: a search tree of light packets and their light."""
        if not any(kind == GLASS for kind, _ in self.meshes):
            return None
        tangents = self.projector.directions()
        centre = np.concatenate([tangents, np.ones((len(tangents), 1))], axis=1)
        width = 2.5 * self.projector.dot_width
        near = np.zeros(len(centre), dtype=bool)
        for dx, dy in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)):
            beam = centre + np.array([dx * width, dy * width, 0.0])
            mesh = self._hit(*self._from_projector(beam))["geomID"]
            near |= self.kinds[mesh] == GLASS
        rng = np.random.default_rng(4350)
        beams = np.repeat(centre[near], spread, axis=0)
        beams[:, :2] += self.projector.dot_width * rng.normal(size=(len(beams), 2))
        ends, _, _ = self.follow(*self._from_projector(beams))
        ends = ends.take(np.flatnonzero((ends.mesh >= 0) & (ends.glass > 0)))
        if not len(ends.row):
            return None
        # Irradiance of one packet if it fell on a round spot of a metre's standard deviation.
        light = self.projector.strength * self.projector.dot_width**2 / spread * ends.weight
        return cKDTree(ends.point), light

    def _from_projector(self, tangents: Array) -> tuple[Array, Array]:
        d = tangents / np.linalg.norm(tangents, axis=1, keepdims=True) @ self.turn.T
        return np.broadcast_to(self.position, d.shape), d

    def dots(self, points: Array, normals: Array) -> Array:
        """Irradiance by the projector.

        Args:
            points: World frame, metres, shape (N, 3).
            normals: Unit normals on the side that is seen, shape (N, 3).

        Returns:
            Against the room's light, shape (N,).
        """
        away = points - self.position
        distance = np.linalg.norm(away, axis=1)
        away /= np.maximum(distance, 1e-9)[:, None]
        hit = self._hit(np.broadcast_to(self.position, away.shape), away)
        facing = np.maximum(-(away * normals).sum(1), 0.0)
        slack = 1e-3 + 2e-3 * distance
        lit = (hit["geomID"] >= 0) & (hit["tfar"] > distance - slack) & (facing > 0)
        light = np.zeros(len(points))
        local = away[lit] @ self.turn
        half_x, half_y = self.projector.reach
        pattern = _pattern(self.projector)
        scale = pattern.shape[1] / (2 * half_x)
        ahead = np.maximum(local[:, 2], 1e-6)
        x = ((local[:, 0] / ahead + half_x) * scale - 0.5).astype(np.float32)
        y = ((local[:, 1] / ahead + half_y) * scale - 0.5).astype(np.float32)
        found = np.empty(len(x), dtype=np.float32)
        for first in range(0, len(x), 30000):
            part = slice(first, first + 30000)
            at = (x[part].reshape(1, -1), y[part].reshape(1, -1))
            found[part] = cv2.remap(pattern, *at, cv2.INTER_LINEAR, borderValue=0.0).ravel()
        light[lit] = self.projector.strength * found * facing[lit] / distance[lit] ** 2
        shaded = np.flatnonzero((self.kinds[hit["geomID"]] == GLASS) & ~lit)
        if self._photons is not None and len(shaded):
            tree, packets = self._photons
            blur = 0.5 * self.projector.dot_width * np.maximum(distance[shaded], 0.2)
            gap, which = tree.query(points[shaded], k=24, distance_upper_bound=0.008)
            kernel = np.exp(-0.5 * (gap / blur[:, None]) ** 2) / blur[:, None] ** 2
            light[shaded] = (np.append(packets, 0.0)[which] * kernel).sum(1)
        return light

    def radiance(self, origins: Array, directions: Array, pixel: float) -> Array:
        """Infrared light that arrives along rays.

        Args:
            origins: World frame, metres, shape (N, 3).
            directions: Unit directions of looking, shape (N, 3).
            pixel: Width of a pixel as a tangent.

        Returns:
            Light, shape (N,); 1 is a white wall in the room's light.
        """
        ends, glint_row, glint = self.follow(origins, directions)
        met = np.flatnonzero(ends.mesh >= 0)
        light = np.full(len(ends.row), 0.35)
        solid = ends.take(met)
        smooth, flat = self.normal(solid.mesh, solid.face, solid.u, solid.v)
        toward = -np.sign((flat * solid.toward).sum(1, keepdims=True))
        normal = smooth * toward
        room = 0.75 + 0.25 * normal[:, 2]
        light[met] = self._albedo(solid, pixel) * (room + self.dots(solid.point, normal))
        n = len(origins)
        total = np.bincount(ends.row, ends.weight * light, minlength=n)
        total += np.bincount(glint_row, glint, minlength=n)
        return np.asarray(total)

    def _albedo(self, ends: Ends, pixel: float) -> Array:
        """Reflectance near 850 nm: paler and flatter than in colour; all skins are alike."""
        albedo = np.full(len(ends.row), 0.5)
        kind = self.kinds[ends.mesh]
        around, hand = self.rays.surroundings, self.rays.hand
        rows = np.flatnonzero(kind == SURROUNDINGS)
        if around is not None and len(rows):
            face = ends.face[rows]
            corners = around.surface.faces[face]
            u, v = ends.u[rows, None], ends.v[rows, None]
            uv = (1 - u - v) * around.uv[corners[:, 0]] + u * around.uv[corners[:, 1]]
            uv = uv + v * around.uv[corners[:, 2]]
            texels = 1.3 * ends.length[rows] * pixel / around.repeat[face] * SIZE
            color = sample(around.picture[face].astype(float), uv, texels) * around.tint[face]
            albedo[rows] = 0.25 + 0.55 * np.clip(color @ [0.6, 0.3, 0.1], 0.0, 1.0)
        rows = np.flatnonzero(kind == HAND)
        if hand is not None and len(rows):
            corners = hand.surface.faces[ends.face[rows]]
            albedo[rows] = 0.45 + 0.25 * hand.albedo[corners[:, 0]].mean(axis=1)
        return albedo

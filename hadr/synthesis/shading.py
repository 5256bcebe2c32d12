"""Pictures by ray casting: lit skin, textured surroundings and glass that refracts.

Colour follows a pixel's ray beyond the first surface: at glass it is split by Fresnel's equations
and bent by Snell's law at each interface, until it reaches something opaque.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from hadr.camera import Intrinsics, pixel_grid
from hadr.synthesis.hand_mesh import HandMesh
from hadr.synthesis.lights import AreaLight, Environment
from hadr.synthesis.optics import GLASS_INDEX, reflect, refract
from hadr.synthesis.raycast import GLASS, HAND, SURROUNDINGS, Hits, RayCaster, Surroundings
from hadr.synthesis.surfaces import Surface
from hadr.synthesis.textures import SIZE, sample

Array = npt.NDArray[np.float64]

_NUDGE = 2e-6


class RayScene(RayCaster):
    """Surfaces, materials and lights, ready to be drawn.

    Args:
        hand: The skinned hand, world frame, or None.
        glass: The closed glass bodies, world frame; overlapping ones count as one.
        tint: Share of red, green, blue that a centimetre of glass lets through.
        surroundings: Everything else, or None.
        key: Unit direction toward the key light, world frame, where there are no lamps.
        key_color: Its linear RGB irradiance.
        ambient: Linear RGB of the light from all sides, where there is no environment.
        lamps: Rectangles that shine; the first one is the key light.
        environment: Light from far away.
    """

    def __init__(
        self,
        hand: HandMesh | None,
        glass: tuple[Surface, ...],
        tint: tuple[float, float, float] = (0.95, 0.975, 0.965),
        surroundings: Surroundings | None = None,
        key: Array | None = None,
        key_color: Array | None = None,
        ambient: Array | None = None,
        lamps: tuple[AreaLight, ...] = (),
        environment: Environment | None = None,
    ) -> None:
        super().__init__(hand, glass, surroundings)
        self.tint = np.log(np.asarray(tint)) * 100.0  # per metre
        self.key = np.array([0.0, 0.0, 1.0]) if key is None else key
        self.key_color = np.ones(3) if key_color is None else key_color
        self.ambient = np.full(3, 0.5) if ambient is None else ambient
        self.lamps = lamps
        self.environment = environment

    def _lamp_light(self, origins: Array, directions: Array, before: Array) -> Array:
        """Light of lamps that rays meet before they have travelled so far."""
        light = np.zeros((len(directions), 3))
        for lamp in self.lamps:
            light += lamp.radiance(origins, directions, before)
        return light

    def _beyond(self, directions: Array) -> Array:
        """Linear RGB from where there is no surface."""
        if self.environment is None:
            return np.broadcast_to(self.ambient, directions.shape)
        return self.environment.radiance(directions)

    def _sky(self, normals: Array) -> Array:
        """Light from all sides on a white surface, linear RGB, before anything hides it."""
        if self.environment is None:
            return np.asarray(self.ambient * (0.81 + 0.19 * normals[:, 2:3]))
        return self.environment.irradiance(normals) / np.pi

    def _key(self, points: Array) -> tuple[Array, Array]:
        """Unit directions toward the key light and its irradiance over pi when it falls straight.

        Args:
            points: World frame, metres, shape (N, 3).
        """
        if not self.lamps:
            shape = points.shape
            return np.broadcast_to(self.key, shape), np.broadcast_to(self.key_color, shape)
        toward = self.lamps[0].center - points
        toward = toward / np.linalg.norm(toward, axis=1, keepdims=True)
        return toward, self.lamps[0].irradiance(points, toward) / np.pi

    def _shade(
        self,
        origins: Array,
        directions: Array,
        hits: Hits,
        travelled: Array,
        pixel: float,
        rng: np.random.Generator | None,
    ) -> Array:
        """Linear RGB of opaque hits; ``rng`` None leaves out shadows and occlusion."""
        color = np.zeros((len(origins), 3))
        miss = hits.mesh < 0
        color[miss] = self._beyond(directions[miss])
        for number, (kind, surface) in enumerate(self._opaque):
            rows = np.flatnonzero(hits.mesh == number)
            if not len(rows):
                continue
            smooth, flat = self._normal(surface, hits, rows)
            d = directions[rows]
            toward = -np.sign((flat * d).sum(1, keepdims=True))
            normal, flat = smooth * toward, flat * toward
            point = origins[rows] + hits.distance[rows, None] * d
            key, key_light = self._key(point)
            facing = (normal * key).sum(1)
            lit = np.ones(len(rows))
            open_sky = np.ones(len(rows))
            if rng is not None:
                lit = self._sunlit(point + 3e-4 * flat, key, rng, facing > -0.4)
                if kind == HAND:
                    open_sky = self._openness(point + 4e-4 * flat, normal, rng)
            sky = self._sky(normal)
            if kind == SURROUNDINGS and self.surroundings is not None:
                near = travelled[rows] + hits.distance[rows]
                color[rows] = self._picture(self.surroundings, hits, rows, near * pixel)
                color[rows] *= sky + key_light * (np.maximum(facing, 0) * lit)[:, None]
            elif self.hand is not None:
                color[rows] = self._skin(
                    hits, rows, d, normal, key, key_light * lit[:, None], sky * open_sky[:, None]
                )
        return color + self._lamp_light(origins, directions, hits.distance)

    def _picture(self, around: Surroundings, hits: Hits, rows: Any, footprint: Array) -> Array:
        face = hits.face[rows]
        corners = around.surface.faces[face]
        u, v = hits.u[rows, None], hits.v[rows, None]
        uv = (1 - u - v) * around.uv[corners[:, 0]] + u * around.uv[corners[:, 1]]
        uv = uv + v * around.uv[corners[:, 2]]
        texels = 1.3 * footprint / around.repeat[face] * SIZE
        colors = sample(around.picture[face], uv, texels, around.photographs)
        return np.asarray(colors * around.tint[face])

    def _skin(
        self, hits: Hits, rows: Any, d: Array, normal: Array, key: Array, light: Array, sky: Array
    ) -> Array:
        hand = self.hand
        assert hand is not None
        corners = hand.surface.faces[hits.face[rows]]
        u, v = hits.u[rows, None], hits.v[rows, None]

        def mix(values: Array) -> Array:
            a, b, c = (values[corners[:, i]] for i in range(3))
            return np.asarray((1 - u - v) * a + u * b + v * c)

        albedo, gloss = mix(hand.albedo), mix(hand.gloss[:, None])
        # Light that seeps around the terminator is red: each channel wraps by its own share.
        wrap = np.array([0.42, 0.22, 0.16])
        facing = (normal * key).sum(1)
        color = albedo * (sky + light * np.maximum((facing[:, None] + wrap) / (1 + wrap), 0.0))
        half = key - d
        half /= np.linalg.norm(half, axis=1, keepdims=True)
        shine = np.maximum((normal * half).sum(1), 0.0)
        sharp = np.where(gloss[:, 0] > 0.6, 70.0, 18.0)
        rim = (1 - np.clip(-(normal * d).sum(1), 0, 1)) ** 4
        spark = gloss[:, 0] * 0.5 * shine**sharp * np.maximum(facing, 0)
        return np.asarray(color + spark[:, None] * light + 0.10 * rim[:, None] * sky)

    def _sunlit(
        self, points: Array, key: Array, rng: np.random.Generator, wanted: npt.NDArray[np.bool_]
    ) -> Array:
        """One jittered shadow ray per point toward the key light: 1 lit, 0 in shadow."""
        lit = np.ones(len(points))
        rows = np.flatnonzero(wanted)
        d = key[rows] + 0.05 * rng.normal(size=(len(rows), 3))
        d /= np.linalg.norm(d, axis=1, keepdims=True)
        hits = self._trace(self._solid, points[rows], d)
        blocked = self._kinds[hits.mesh] == HAND
        lit[rows] = np.where(blocked & (hits.distance < 0.9), 0.0, 1.0)
        return lit

    def _openness(self, points: Array, normal: Array, rng: np.random.Generator) -> Array:
        """Share of the half space over a point that is free of the hand, from three rays."""
        free = np.zeros(len(points))
        for _ in range(3):
            d = rng.normal(size=points.shape)
            d /= np.linalg.norm(d, axis=1, keepdims=True)
            d = d + 1.02 * normal
            d /= np.linalg.norm(d, axis=1, keepdims=True)
            hits = self._trace(self._solid, points, d)
            blocked = (self._kinds[hits.mesh] == HAND) & (hits.distance < 0.12)
            free += ~blocked
        return np.asarray(0.30 + 0.70 * free / 3.0)

    def radiance(
        self,
        origins: Array,
        directions: Array,
        pixel: float,
        rng: np.random.Generator | None = None,
        *,
        bounces: int = 10,
    ) -> Array:
        """Linear RGB that arrives along rays.

        Args:
            origins: World frame, metres, shape (N, 3).
            directions: Unit directions of looking, shape (N, 3).
            pixel: Width of a pixel as a tangent, for the choice of the texture's level.
            rng: Jitters shadow rays; None leaves out shadows and the weaker reflections.
            bounces: Most interfaces that a ray may cross.

        Returns:
            Shape (N, 3).
        """
        n = len(origins)
        color = np.zeros((n, 3))
        o, d = np.array(origins, dtype=float), np.array(directions, dtype=float)
        weight, travelled = np.ones((n, 3)), np.zeros(n)
        inside, row = np.zeros(n, dtype=np.int64), np.arange(n)
        for depth in range(bounces + 1):
            hits = self._trace(self._all, o, d)
            clear = self._kinds[hits.mesh] == GLASS
            done = ~clear if depth < bounces else np.ones(len(row), dtype=bool)
            if done.any():
                k = np.flatnonzero(done)
                ends = Hits(*(getattr(hits, f)[k] for f in ("distance", "mesh", "face", "u", "v")))
                if depth == bounces:
                    ends = self._trace(self._solid, o[k], d[k])
                light = self._shade(o[k], d[k], ends, travelled[k], pixel, rng)
                color[row[k]] += weight[k] * light
            k = np.flatnonzero(~done)
            if not len(k):
                break
            part = Hits(*(getattr(hits, f)[k] for f in ("distance", "mesh", "face", "u", "v")))
            o, d, weight, travelled, inside, row = self._cross(
                o[k],
                d[k],
                weight[k],
                travelled[k],
                inside[k],
                row[k],
                part,
                color,
                pixel,
                rng,
                depth,
            )
        return color

    def reflectance(
        self, origins: Array, directions: Array, pixel: float, *, bounces: int = 10
    ) -> Array:
        """Reflectance of what rays end on, through the glass and tinted by it, (N, 3).

        Args:
            origins: World frame, metres, shape (N, 3).
            directions: Unit directions of looking, shape (N, 3).
            pixel: Width of a pixel as a tangent, for the choice of the texture's level.
            bounces: Most interfaces that a ray may cross.
        """
        n = len(origins)
        result, unused = np.ones((n, 3)), np.zeros((n, 3))
        o, d = np.array(origins, dtype=float), np.array(directions, dtype=float)
        weight, travelled = np.ones((n, 3)), np.zeros(n)
        inside, row = np.zeros(n, dtype=np.int64), np.arange(n)
        for _ in range(bounces):
            hits = self._trace(self._all, o, d)
            clear = self._kinds[hits.mesh] == GLASS
            for number, (kind, _) in enumerate(self._opaque):
                k = np.flatnonzero(hits.mesh == number)
                if not len(k):
                    continue
                if kind == SURROUNDINGS and self.surroundings is not None:
                    footprint = (travelled[k] + hits.distance[k]) * pixel
                    found = self._picture(self.surroundings, hits, k, footprint)
                elif self.hand is not None:
                    found = self.hand.albedo[self.hand.surface.faces[hits.face[k], 0]]
                result[row[k]] = weight[k] * found
            k = np.flatnonzero(clear)
            if not len(k):
                break
            part = Hits(*(getattr(hits, f)[k] for f in ("distance", "mesh", "face", "u", "v")))
            o, d, weight, travelled, inside, row = self._cross(
                o[k],
                d[k],
                weight[k],
                travelled[k],
                inside[k],
                row[k],
                part,
                unused,
                pixel,
                None,
                bounces,
            )
        return result

    def _cross(
        self,
        o: Array,
        d: Array,
        weight: Array,
        travelled: Array,
        inside: npt.NDArray[np.int64],
        row: npt.NDArray[np.int64],
        hits: Hits,
        color: Array,
        pixel: float,
        rng: np.random.Generator | None,
        depth: int,
    ) -> tuple[Array, Array, Array, Array, npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Carry rays over one glass interface and add what it mirrors to ``color``."""
        smooth, flat = np.zeros_like(d), np.zeros_like(d)
        for number in range(len(self._opaque), len(self.meshes)):
            rows = np.flatnonzero(hits.mesh == number)
            if len(rows):
                smooth[rows], flat[rows] = self._normal(self.meshes[number][1], hits, rows)
        entering = (flat * d).sum(1) < 0
        sign = np.where(entering, 1.0, -1.0)[:, None]
        against, flat_against = smooth * sign, flat * sign
        wrong = (against * d).sum(1) > -1e-3
        against = np.where(wrong[:, None], flat_against, against)
        length = hits.distance
        weight = np.where(
            (inside > 0)[:, None], weight * np.exp(self.tint * length[:, None]), weight
        )
        point = o + length[:, None] * d
        after = inside + np.where(entering, 1, -1)
        # Between two overlapping bodies there is glass on both sides: nothing happens.
        border = np.minimum(np.maximum(inside, 0), np.maximum(after, 0)) == 0
        ratio = np.where(entering, 1.0 / GLASS_INDEX, GLASS_INDEX)
        bent, mirrored = refract(d, against, ratio)
        total = border & (mirrored >= 1.0)
        out = np.where(border[:, None], bent, d)
        bounced = reflect(d, against)
        out = np.where(total[:, None], bounced, out)
        share = np.where(border & ~total, mirrored, 0.0)
        if rng is not None:
            strong = np.flatnonzero((share * weight.max(1) > 0.012) & (depth < 5))
            if len(strong):
                start = point[strong] + _NUDGE * flat_against[strong]
                seen = self._trace(self._solid, start, bounced[strong])
                light = self._shade(
                    start, bounced[strong], seen, travelled[strong] + length[strong], pixel, None
                )
                np.add.at(color, row[strong], weight[strong] * share[strong, None] * light)
        else:
            far = np.full(len(bounced), np.inf)
            light = self._lamp_light(point, bounced, far) + 0.45 * self._beyond(bounced)
            np.add.at(color, row, weight * share[:, None] * light)
        weight = weight * (1.0 - share)[:, None]
        onward = np.where(total[:, None], flat_against, -flat_against)
        inside = np.where(total, inside, np.maximum(after, 0))
        return point + _NUDGE * onward, out, weight, travelled + length, inside, row

    def path(self, origin: Array, direction: Array, *, bounces: int = 10) -> Array:
        """Follow one ray through the glass, always along its stronger part.

        Args:
            origin: World frame, metres, shape (3,).
            direction: Unit direction, shape (3,).
            bounces: Most interfaces to follow.

        Returns:
            The points at which it starts, crosses interfaces and ends, shape (K, 3). A ray that
            leaves the scene ends 0.1 m behind its last interface.
        """
        o, d = np.asarray(origin, dtype=float)[None], np.asarray(direction, dtype=float)[None]
        weight, travelled = np.ones((1, 3)), np.zeros(1)
        inside, row = np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int64)
        points = [o[0]]
        for depth in range(bounces):
            hits = self._trace(self._all, o, d)
            end = hits.distance[0] if np.isfinite(hits.distance[0]) else 0.1
            points.append(o[0] + end * d[0])
            if self._kinds[hits.mesh[0]] != GLASS:
                break
            unused = np.zeros((1, 3))
            o, d, weight, travelled, inside, row = self._cross(
                o, d, weight, travelled, inside, row, hits, unused, 0.0, None, depth
            )
        return np.stack(points)

    def picture(
        self,
        camera: Intrinsics,
        world_from_camera: Array,
        rng: np.random.Generator | None = None,
        *,
        supersample: int = 1,
        exposure: float = 1.0,
    ) -> npt.NDArray[np.uint8]:
        """Draw the scene.

        Args:
            camera: Intrinsics.
            world_from_camera: Pose of the OpenCV camera, shape (4, 4).
            rng: Jitters shadow rays; None draws faster, without shadows.
            supersample: Rays per pixel and axis.
            exposure: Factor on all light.

        Returns:
            sRGB, shape (H, W, 3) uint8.

        Raises:
            ValueError: ``supersample`` is not from 1 to 4.
        """
        if not 1 <= supersample <= 4:
            raise ValueError(f"supersample must be 1, 2, 3 or 4 rays per axis, got {supersample}")
        uv = pixel_grid(camera).reshape(-1, 2)
        offsets = (np.arange(supersample) + 0.5) / supersample - 0.5
        turn, eye = world_from_camera[:3, :3], world_from_camera[:3, 3]
        total = np.zeros((len(uv), 3))
        for dv in offsets:
            for du in offsets:
                local = np.stack(
                    [
                        (uv[:, 0] + du - camera.cx) / camera.fx,
                        (uv[:, 1] + dv - camera.cy) / camera.fy,
                        np.ones(len(uv)),
                    ],
                    axis=1,
                )
                local /= np.linalg.norm(local, axis=1, keepdims=True)
                directions = local @ turn.T
                origins = np.broadcast_to(eye, directions.shape)
                light = self.radiance(origins, directions, 1.0 / camera.fx, rng)
                total += _film(light * exposure)
        srgb = (total / supersample**2) ** (1 / 2.2)
        return np.asarray((srgb * 255).round().clip(0, 255), dtype=np.uint8).reshape(
            *camera.shape, 3
        )


def _film(light: Array) -> Array:
    """Roll bright light off smoothly instead of clipping it: linear to 0.6, then toward 1."""
    knee = 0.6
    over = np.maximum(light - knee, 0.0)
    return np.asarray(np.minimum(light, knee) + (1 - knee) * (1 - np.exp(-over / (1 - knee))))

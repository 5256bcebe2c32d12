"""Pictures by ray casting: lit skin, textured surroundings and glass that refracts.

Colour follows a pixel's ray beyond the first surface: at glass it is split by Fresnel's equations
and bent by Snell's law at each interface, until it reaches something opaque.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import numpy.typing as npt

from hadr.camera import Array, Intrinsics, pixel_grid
from hadr.synthesis.glass.surfaces import dots
from hadr.synthesis.hand.mesh import HandMesh
from hadr.synthesis.rendering.color_camera import film
from hadr.synthesis.rendering.raycast import (
    GLASS,
    HAND,
    SURROUNDINGS,
    Hits,
    RayCaster,
    rays_through,
    unit,
)
from hadr.synthesis.rendering.refraction import BOUNCES, Beams, cross
from hadr.synthesis.scene.contents import Surroundings
from hadr.synthesis.textures.families import sample
from hadr.synthesis.textures.noise import SIZE

#: Light from all sides, linear RGB, where there is no environment.
_AMBIENT = np.full(3, 0.5)


def texture_color(around: Surroundings, hits: Hits, footprint: Array) -> Array:
    """Linear RGB reflectance of surroundings where pixels ``footprint`` metres wide meet them."""
    face = hits.face
    texels = 1.3 * footprint / around.repeat[face] * SIZE
    uv = hits.mixed(around.uv, around.surface.faces)
    return sample(around.texture[face], uv, texels, around.photographs) * around.tint[face]


def _skin(
    hand: HandMesh, hits: Hits, d: Array, normal: Array, key: Array, light: Array, sky: Array
) -> Array:
    """Linear RGB of lit skin where rays of directions ``d`` meet it."""
    albedo = hits.mixed(hand.albedo, hand.surface.faces)
    gloss = hits.mixed(hand.gloss[:, None], hand.surface.faces)
    # Light that seeps around the terminator is red: each channel wraps by its own amount.
    wrap = np.array([0.42, 0.22, 0.16])
    facing = dots(normal, key)
    color = albedo * (sky + light * np.maximum((facing[:, None] + wrap) / (1 + wrap), 0.0))
    shine = np.maximum(dots(normal, unit(key - d)), 0.0)
    sharp = np.where(gloss[:, 0] > 0.6, 70.0, 18.0)
    rim = (1 - np.clip(-dots(normal, d), 0, 1)) ** 4
    spark = gloss[:, 0] * 0.5 * shine**sharp * np.maximum(facing, 0)
    return np.asarray(color + spark[:, None] * light + 0.10 * rim[:, None] * sky)


class RayTracer(RayCaster):
    """Surfaces, materials and lights, ready to be drawn."""

    def _lamp_light(self, origins: Array, directions: Array, before: Array) -> Array:
        """Light of lamps that rays meet before they have travelled so far."""
        lamps = self.contents.lamps
        none = np.zeros((len(directions), 3))
        return sum((lamp.radiance(origins, directions, before) for lamp in lamps), none)

    def _beyond(self, directions: Array) -> Array:
        """Linear RGB from where there is no surface."""
        environment = self.contents.environment
        if environment is None:
            return np.broadcast_to(_AMBIENT, directions.shape)
        return environment.radiance(directions)

    def _sky(self, normals: Array) -> Array:
        """Light from all sides on a white surface, linear RGB, before anything hides it."""
        environment = self.contents.environment
        if environment is None:
            return np.asarray(_AMBIENT * (0.81 + 0.19 * normals[:, 2:3]))
        return environment.irradiance(normals) / np.pi

    def _key(self, points: Array) -> tuple[Array, Array]:
        """Unit directions toward the key light from points, and its irradiance over pi."""
        if not self.contents.lamps:
            return np.broadcast_to([0.0, 0.0, 1.0], points.shape), np.ones_like(points)
        lamp = self.contents.lamps[0]
        toward = unit(lamp.center - points)
        return toward, lamp.irradiance(points, toward) / np.pi

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
        for number, (kind, _) in enumerate(self._opaque):
            rows = np.flatnonzero(hits.mesh == number)
            some, d = hits.take(rows), directions[rows]
            smooth, flat = self.normals(some)
            toward = -np.sign(dots(flat, d))[:, None]
            normal, flat = smooth * toward, flat * toward
            point = origins[rows] + some.distance[:, None] * d
            key, key_light = self._key(point)
            facing, sky = dots(normal, key), self._sky(normal)
            lit, open_sky = np.ones((2, len(rows)))
            if rng is not None:
                lit = self._sunlit(point + 3e-4 * flat, key, rng, facing > -0.4)
                if kind == HAND:
                    open_sky = self._openness(point + 4e-4 * flat, normal, rng)
            if kind == SURROUNDINGS and self.contents.surroundings is not None:
                footprint = (travelled[rows] + some.distance) * pixel
                color[rows] = texture_color(self.contents.surroundings, some, footprint)
                color[rows] *= sky + key_light * (np.maximum(facing, 0) * lit)[:, None]
            elif self.contents.hand is not None:
                light, around = key_light * lit[:, None], sky * open_sky[:, None]
                color[rows] = _skin(self.contents.hand, some, d, normal, key, light, around)
        return color + self._lamp_light(origins, directions, hits.distance)

    def _sunlit(
        self, points: Array, key: Array, rng: np.random.Generator, wanted: npt.NDArray[np.bool_]
    ) -> Array:
        """One jittered shadow ray per point toward the key light: 1 lit, 0 in shadow."""
        lit = np.ones(len(points))
        rows = np.flatnonzero(wanted)
        d = unit(key[rows] + 0.05 * rng.normal(size=(len(rows), 3)))
        lit[rows] = np.where(self._hand_hides(points[rows], d, 0.9), 0.0, 1.0)
        return lit

    def _hand_hides(self, points: Array, directions: Array, within: float) -> npt.NDArray[np.bool_]:
        """Which rays meet the hand first of what is opaque, within so many metres, (N,)."""
        trees = list(zip(self._opaque, self._solid, strict=True))
        hand = [tree for (kind, _), tree in trees if kind == HAND]
        others = [tree for (kind, _), tree in trees if kind != HAND]
        distance = self._trace(hand, points, directions).distance
        rows = np.flatnonzero(distance < within)
        hidden = np.zeros(len(points), dtype=bool)
        hidden[rows] = distance[rows] < self._trace(others, points[rows], directions[rows]).distance
        return hidden

    def _openness(self, points: Array, normal: Array, rng: np.random.Generator) -> Array:
        """Share of the half space over a point that is free of the hand, from three rays."""
        free = np.zeros(len(points))
        for _ in range(3):
            d = unit(unit(rng.normal(size=points.shape)) + 1.02 * normal)
            free += ~self._hand_hides(points, d, 0.12)
        return np.asarray(0.30 + 0.70 * free / 3.0)

    def radiance(
        self,
        origins: Array,
        directions: Array,
        pixel: float,
        rng: np.random.Generator | None = None,
    ) -> Array:
        """Linear RGB that arrives along rays, shape (N, 3).

        Origins (world frame, metres) and unit directions of looking are (N, 3); a pixel's width as
        a tangent chooses textures' levels. ``rng`` jitters shadow rays; None leaves out shadows and
        the weaker reflections.
        """
        color = np.zeros((len(origins), 3))
        beams = Beams.start(origins, directions)
        for depth in range(BOUNCES + 1):
            trees = self._all if depth < BOUNCES else self._solid
            hits = self._trace(trees, beams.origin, beams.direction)
            clear = self._kinds[hits.mesh] == GLASS
            k = np.flatnonzero(~clear)
            last, ends = beams.take(k), hits.take(k)
            light = self._shade(last.origin, last.direction, ends, last.travelled, pixel, rng)
            color[last.row] += last.weight * light
            k = np.flatnonzero(clear)
            if not len(k):
                break
            beams, mirrored = cross(self, beams.take(k), hits.take(k))
            if rng is None:
                far = np.full(len(k), np.inf)
                light = self._lamp_light(mirrored.origin, mirrored.direction, far)
                light = light + 0.45 * self._beyond(mirrored.direction)
                np.add.at(color, mirrored.row, mirrored.weight * light)
            elif depth < 5:  # what glass mirrors, where it is worth while
                some = mirrored.take(np.flatnonzero(mirrored.weight.max(1) > 0.012))
                seen = self._trace(self._solid, some.origin, some.direction)
                light = self._shade(some.origin, some.direction, seen, some.travelled, pixel, None)
                np.add.at(color, some.row, some.weight * light)
        return color

    def reflectance(self, origins: Array, directions: Array, pixel: float) -> Array:
        """Reflectance of what rays end on, through the glass and tinted by it, (N, 3)."""
        result = np.ones((len(origins), 3))
        beams = Beams.start(origins, directions)
        for _ in range(BOUNCES):
            hits = self.first(beams.origin, beams.direction)
            around, hand = self.contents.surroundings, self.contents.hand
            if around is not None:
                k = np.flatnonzero(self._kinds[hits.mesh] == SURROUNDINGS)
                footprint = (beams.travelled[k] + hits.distance[k]) * pixel
                found = texture_color(around, hits.take(k), footprint)
                result[beams.row[k]] = beams.weight[k] * found
            if hand is not None:
                k = np.flatnonzero(self._kinds[hits.mesh] == HAND)
                found = hand.albedo[hand.surface.faces[hits.face[k], 0]]
                result[beams.row[k]] = beams.weight[k] * found
            k = np.flatnonzero(self._kinds[hits.mesh] == GLASS)
            if not len(k):
                break
            beams, _mirrored = cross(self, beams.take(k), hits.take(k))
        return result

    def picture(
        self,
        camera: Intrinsics,
        world_from_camera: Array,
        rng: np.random.Generator | None = None,
    ) -> npt.NDArray[np.uint8]:
        """Draw the scene: sRGB, shape (H, W, 3) uint8.

        With a generator, which jitters shadow rays, four rays a pixel; faster without it: one ray a
        pixel and no shadows.
        """
        uv = pixel_grid(camera)
        offsets = (0.0,) if rng is None else (-0.25, 0.25)
        total = np.zeros((camera.height * camera.width, 3))
        for dv, du in product(offsets, offsets):
            rays = rays_through(uv + np.array([du, dv]), camera, world_from_camera)
            total += film(self.radiance(*rays, 1.0 / camera.fx, rng))
        srgb = (total / len(offsets) ** 2) ** (1 / 2.2)
        return (srgb * 255).round().clip(0, 255).astype(np.uint8).reshape(*camera.shape, 3)

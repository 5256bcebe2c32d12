"""Ray casting: exact labels at the pixel centres, and pictures with refracting glass.

The first surface that a pixel's ray meets gives depth, masks and normals. Colour follows the ray
further: at glass it is split by Fresnel's equations and bent by Snell's law at each interface,
until it reaches something opaque.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from hadr.camera import Intrinsics, pixel_grid, ray_directions
from hadr.synthesis.hand_mesh import HandMesh
from hadr.synthesis.objects import Surface
from hadr.synthesis.textures import SIZE, sample

Array = npt.NDArray[np.float64]

#: Refractive index of the glass.
GLASS_INDEX = 1.50
#: What a ray can meet first.
NOTHING, HAND, GLASS, SURROUNDINGS = 0, 1, 2, 3
_NUDGE = 2e-6


@dataclass(frozen=True)
class Surroundings:
    """Opaque textured surfaces.

    Args:
        surface: The triangles, world frame.
        uv: Texture coordinates per vertex, in repeats, shape (V, 2).
        picture: Number of the picture per face, shape (F,).
        tint: Factor on the picture's colour per face, shape (F, 3).
        repeat: Width of one repeat per face, metres, shape (F,).
    """

    surface: Surface
    uv: Array
    picture: npt.NDArray[np.int64]
    tint: Array
    repeat: Array


@dataclass(frozen=True)
class Lamp:
    """A bright, soft-edged panel far away; glass and nails mirror it.

    Args:
        direction: Unit vector toward it, world frame.
        half_width: Half of its width as a tangent.
        half_height: Half of its height as a tangent.
        color: Linear RGB radiance.
    """

    direction: Array
    half_width: float
    half_height: float
    color: Array


@dataclass(frozen=True)
class Labels:
    """Exact labels of one frame, all (H, W).

    Args:
        depth: z-depth of the first surface, metres, float32; 0 where there is none.
        background_depth: The same with the glass taken away.
        hand_mask: Where the first surface is the hand.
        object_mask: Where it is the glass.
        normals: Unit normals toward the camera, camera frame, (H, W, 3); 0 where nothing is met.
    """

    depth: npt.NDArray[np.float32]
    background_depth: npt.NDArray[np.float32]
    hand_mask: npt.NDArray[np.bool_]
    object_mask: npt.NDArray[np.bool_]
    normals: npt.NDArray[np.float32]


@lru_cache(maxsize=8)
def _tree(surfaces: tuple[Surface, ...]) -> Any:
    """The search tree over surfaces; kept, since a probe and a picture ask the same ones."""
    tree = EmbreeScene()
    for surface in surfaces:
        TriangleMesh(tree, surface.vertices.astype(np.float32), surface.faces.astype(np.int32))
    return tree


@dataclass(frozen=True)
class Hits:
    """First surfaces along N rays: distance (inf on a miss), mesh number, face, barycentrics."""

    distance: Array
    mesh: npt.NDArray[np.int64]
    face: npt.NDArray[np.int64]
    u: Array
    v: Array


def refract(direction: Array, normal: Array, ratio: Array) -> tuple[Array, Array]:
    """Bend unit directions at an interface by Snell's law.

    Args:
        direction: Unit directions of travel, shape (N, 3).
        normal: Unit normals against the direction of travel, shape (N, 3).
        ratio: Refractive index before the interface over that behind it, shape (N,).

    Returns:
        Bent unit directions (N, 3), not meaningful where all light is reflected, and the share of
        light that is reflected (N,): unpolarised Fresnel, 1 at total internal reflection.
    """
    cos_in = np.clip(-(direction * normal).sum(-1), 0.0, 1.0)
    sin2_out = ratio**2 * (1.0 - cos_in**2)
    total = sin2_out >= 1.0
    cos_out = np.sqrt(np.maximum(1.0 - sin2_out, 0.0))
    bent = ratio[:, None] * direction + (ratio * cos_in - cos_out)[:, None] * normal
    bent /= np.maximum(np.linalg.norm(bent, axis=-1, keepdims=True), 1e-12)
    across = (ratio * cos_in - cos_out) / np.maximum(ratio * cos_in + cos_out, 1e-12)
    along = (cos_in - ratio * cos_out) / np.maximum(cos_in + ratio * cos_out, 1e-12)
    return bent, np.where(total, 1.0, 0.5 * (across**2 + along**2))


def reflect(direction: Array, normal: Array) -> Array:
    """Mirror unit directions (N, 3) at unit normals (N, 3)."""
    return np.asarray(direction - 2.0 * (direction * normal).sum(-1, keepdims=True) * normal)


class RayScene:
    """Surfaces, materials and lights, ready to be traced.

    Args:
        hand: The skinned hand, world frame, or None.
        glass: The closed glass bodies, world frame; overlapping ones count as one.
        tint: Share of red, green, blue that a centimetre of glass lets through.
        surroundings: Everything else, or None.
        key: Unit direction toward the key light, world frame.
        key_color: Its linear RGB irradiance.
        ambient: Linear RGB of the light from all sides.
        lamps: Panels that are mirrored.
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
        lamps: tuple[Lamp, ...] = (),
    ) -> None:
        self.hand, self.glass, self.surroundings = hand, glass, surroundings
        self.tint = np.log(np.asarray(tint)) * 100.0  # per metre
        self.key = np.array([0.0, 0.0, 1.0]) if key is None else key
        self.key_color = np.ones(3) if key_color is None else key_color
        self.ambient = np.full(3, 0.5) if ambient is None else ambient
        self.lamps = lamps
        self._opaque: list[tuple[int, Surface]] = []
        if surroundings is not None:
            self._opaque.append((SURROUNDINGS, surroundings.surface))
        if hand is not None:
            self._opaque.append((HAND, hand.surface))
        self._meshes = [*self._opaque, *((GLASS, body) for body in glass)]
        self._kinds = np.array([kind for kind, _ in self._meshes] + [NOTHING])
        # One tree per kind of thing: (number of its first mesh, tree). A ray asks several.
        self._solid = [(i, _tree((surface,))) for i, (_, surface) in enumerate(self._opaque)]
        self._clear = [(len(self._opaque), _tree(glass))] if glass else []
        self._all = [*self._solid, *self._clear]

    @staticmethod
    def _trace(trees: list[tuple[int, Any]], origins: Array, directions: Array) -> Hits:
        n = len(origins)
        none = np.full(n, -1, dtype=np.int64)
        hits = Hits(np.full(n, np.inf), none, none.copy(), np.zeros(n), np.zeros(n))
        if n == 0:
            return hits
        start = np.ascontiguousarray(origins, dtype=np.float32)
        heading = np.ascontiguousarray(directions, dtype=np.float32)
        for first, tree in trees:
            found = tree.run(start, heading, query="INTERSECT", output=True)
            nearer = np.flatnonzero((found["primID"] >= 0) & (found["tfar"] < hits.distance))
            hits.distance[nearer] = found["tfar"][nearer]
            hits.mesh[nearer] = found["geomID"][nearer] + first
            hits.face[nearer] = found["primID"][nearer]
            hits.u[nearer], hits.v[nearer] = found["u"][nearer], found["v"][nearer]
        return hits

    def first_kind(self, origins: Array, directions: Array) -> npt.NDArray[np.int64]:
        """What each ray meets first: NOTHING, HAND, GLASS or SURROUNDINGS, shape (N,)."""
        return np.asarray(self._kinds[self._trace(self._all, origins, directions).mesh])

    def glass_alone(self, origins: Array, directions: Array) -> npt.NDArray[np.bool_]:
        """Which rays would meet the glass if nothing hid it, shape (N,)."""
        return np.asarray(self._trace(self._clear, origins, directions).face >= 0)

    def _normal(self, surface: Surface, hits: Hits, rows: Any) -> tuple[Array, Array]:
        """Smooth and flat unit normals of the hits in ``rows``, outward."""
        faces = surface.faces[hits.face[rows]]
        u, v = hits.u[rows, None], hits.v[rows, None]
        n = surface.normals
        smooth = (1 - u - v) * n[faces[:, 0]] + u * n[faces[:, 1]] + v * n[faces[:, 2]]
        smooth /= np.maximum(np.linalg.norm(smooth, axis=1, keepdims=True), 1e-12)
        a, b, c = (surface.vertices[faces[:, i]] for i in range(3))
        flat = np.cross(b - a, c - a)
        flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-20)
        return smooth, flat

    def labels(self, camera: Intrinsics, world_from_camera: Array) -> Labels:
        """Cast one ray through every pixel's centre.

        Args:
            camera: Intrinsics.
            world_from_camera: Pose of the OpenCV camera, shape (4, 4).

        Returns:
            Depth, masks and normals.
        """
        local = ray_directions(camera).reshape(-1, 3)
        turn = world_from_camera[:3, :3]
        directions = local @ turn.T
        origins = np.broadcast_to(world_from_camera[:3, 3], directions.shape)
        hits = self._trace(self._all, origins, directions)
        behind = self._trace(self._solid, origins, directions)
        kind = self._kinds[hits.mesh]
        normals = np.zeros_like(directions)
        for number, (_, surface) in enumerate(self._meshes):
            rows = np.flatnonzero(hits.mesh == number)
            if len(rows):
                smooth, _ = self._normal(surface, hits, rows)
                toward = -np.sign((smooth * directions[rows]).sum(1, keepdims=True))
                normals[rows] = (smooth * toward) @ turn
        shape = camera.shape

        def depth(found: Hits) -> npt.NDArray[np.float32]:
            z = np.where(np.isfinite(found.distance), found.distance * local[:, 2], 0.0)
            return z.astype(np.float32).reshape(shape)

        return Labels(
            depth(hits),
            depth(behind),
            (kind == HAND).reshape(shape),
            (kind == GLASS).reshape(shape),
            normals.astype(np.float32).reshape(*shape, 3),
        )

    # Colour ------------------------------------------------------------------------------------

    def _lamp_light(self, directions: Array) -> Array:
        light = np.zeros((len(directions), 3))
        for lamp in self.lamps:
            z = lamp.direction
            x = np.cross([0.0, 0.0, 1.0] if abs(z[2]) < 0.9 else [0.0, 1.0, 0.0], z)
            x /= np.linalg.norm(x)
            ahead = directions @ z
            safe = np.maximum(ahead, 1e-3)
            a = np.abs(directions @ x) / safe / lamp.half_width
            b = np.abs(directions @ np.cross(z, x)) / safe / lamp.half_height
            panel = np.clip((1.08 - np.maximum(a, b)) / 0.16, 0.0, 1.0) * (ahead > 0)
            light += panel[:, None] * lamp.color
        return light

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
        color[miss] = self.ambient
        for number, (kind, surface) in enumerate(self._opaque):
            rows = np.flatnonzero(hits.mesh == number)
            if not len(rows):
                continue
            smooth, flat = self._normal(surface, hits, rows)
            d = directions[rows]
            if kind == SURROUNDINGS:
                smooth = flat
            toward = -np.sign((flat * d).sum(1, keepdims=True))
            normal, flat = smooth * toward, flat * toward
            point = origins[rows] + hits.distance[rows, None] * d
            facing = normal @ self.key
            lit = np.ones(len(rows))
            open_sky = np.ones(len(rows))
            if rng is not None:
                lit = self._sunlit(point + 3e-4 * flat, rng, facing > -0.4)
                if kind == HAND:
                    open_sky = self._openness(point + 4e-4 * flat, normal, rng)
            up = 0.5 + 0.5 * normal[:, 2:3]
            sky = self.ambient * (0.62 + 0.38 * up)
            if kind == SURROUNDINGS and self.surroundings is not None:
                near = travelled[rows] + hits.distance[rows]
                color[rows] = self._picture(self.surroundings, hits, rows, near * pixel)
                light = 0.95 * sky + 0.55 * self.key_color * (np.maximum(facing, 0) * lit)[:, None]
                color[rows] *= light
            elif self.hand is not None:
                color[rows] = self._skin(
                    hits, rows, d, normal, facing, lit, sky * open_sky[:, None]
                )
        return color

    def _picture(self, around: Surroundings, hits: Hits, rows: Any, footprint: Array) -> Array:
        face = hits.face[rows]
        corners = around.surface.faces[face]
        u, v = hits.u[rows, None], hits.v[rows, None]
        uv = (1 - u - v) * around.uv[corners[:, 0]] + u * around.uv[corners[:, 1]]
        uv = uv + v * around.uv[corners[:, 2]]
        texels = 1.3 * footprint / around.repeat[face] * SIZE
        return np.asarray(sample(around.picture[face], uv, texels) * around.tint[face])

    def _skin(
        self, hits: Hits, rows: Any, d: Array, normal: Array, facing: Array, lit: Array, sky: Array
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
        diffuse = np.maximum((facing[:, None] + wrap) / (1 + wrap), 0.0) * lit[:, None]
        color = albedo * (sky + 0.85 * self.key_color * diffuse)
        half = self.key - d
        half /= np.linalg.norm(half, axis=1, keepdims=True)
        shine = np.maximum((normal * half).sum(1), 0.0)
        sharp = np.where(gloss[:, 0] > 0.6, 70.0, 18.0)
        rim = (1 - np.clip(-(normal * d).sum(1), 0, 1)) ** 4
        spark = gloss[:, 0] * 0.35 * shine**sharp * np.maximum(facing, 0) * lit
        return np.asarray(color + spark[:, None] * self.key_color + 0.10 * rim[:, None] * sky)

    def _sunlit(
        self, points: Array, rng: np.random.Generator, wanted: npt.NDArray[np.bool_]
    ) -> Array:
        """One jittered shadow ray per point toward the key light: 1 lit, 0 in shadow."""
        lit = np.ones(len(points))
        rows = np.flatnonzero(wanted)
        d = self.key + 0.035 * rng.normal(size=(len(rows), 3))
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
                if depth:
                    light = (
                        light
                        + 0.6 * self._lamp_light(d[k]) * (self._kinds[ends.mesh] != HAND)[:, None]
                    )
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
        for number in range(len(self._opaque), len(self._meshes)):
            rows = np.flatnonzero(hits.mesh == number)
            if len(rows):
                smooth[rows], flat[rows] = self._normal(self._meshes[number][1], hits, rows)
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
                light += self._lamp_light(bounced[strong])
                np.add.at(color, row[strong], weight[strong] * share[strong, None] * light)
        else:
            light = self._lamp_light(bounced) + 0.45 * self.ambient
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

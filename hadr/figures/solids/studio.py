"""Stills of hands on glass: the turntable's light, paper and glass, drawn by casting rays."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from scipy.ndimage import map_coordinates

from hadr.camera import Array
from hadr.figures.method.hands import upright_view
from hadr.figures.solids.turntable import HandOnGlass
from hadr.synthesis.glass.surfaces import Surface

Index = npt.NDArray[np.int64]

#: Grey of the plain background, sRGB in 0..1.
PLAIN = 0.93
_HALF_ANGLE = 0.22
_MOST_WALLS = 8


@dataclass(frozen=True)
class StudioView:
    """From where the studio looks at a scene, and how it projects.

    Args:
        screen_from_object: Rotation, rows right, up and toward the viewer, shape (3, 3).
        center: Middle of the picture, the scene's frame, metres, shape (3,).
        radius: What the picture shows around the middle, metres.
    """

    screen_from_object: Array
    center: Array
    radius: float

    @property
    def distance(self) -> float:
        """Metres from the viewer to the middle."""
        return 1.06 * self.radius / float(np.sin(_HALF_ANGLE))

    def pixels_of(self, points: npt.ArrayLike, pixels: int) -> Array:
        """Where points of the scene's frame, (..., 3) metres, lie in a picture: (..., 2) u, v."""
        x = (np.asarray(points, dtype=float) - self.center) @ self.screen_from_object.T
        flat = x[..., :2] / (self.distance - x[..., 2:]) / np.tan(_HALF_ANGLE) * [1.0, -1.0]
        return np.asarray((flat + 1) / 2 * pixels - 0.5)


def studio_view(
    scene: HandOnGlass,
    *,
    azimuth_deg: float | None = None,
    center: npt.ArrayLike | None = None,
    radius: float | None = None,
) -> StudioView:
    """Look at a scene as the turntable does first, or from elsewhere.

    From degrees about z from x, at a middle and as far around it as told, metres.
    """
    turn = upright_view(scene.azimuth_deg if azimuth_deg is None else azimuth_deg,
                        scene.elevation_deg)  # fmt: skip
    middle, reach = scene.sphere
    middle = middle if center is None else np.asarray(center, dtype=float)
    reach = reach if radius is None else radius
    return StudioView(turn, middle, reach)


def studio_picture(
    scene: HandOnGlass, view: StudioView | None = None, *, pixels: int, paper: bool = True
) -> npt.NDArray[np.uint8]:
    """Draw hand and glass, either perhaps without faces, as the turntable shows them.

    Behind them is squared paper, or else a plain grey; sRGB, shape (pixels, pixels, 3).
    """
    view = view or studio_view(scene)
    side = 2 * pixels
    image = _paper(side) if paper else np.full((side, side, 3), PLAIN)
    rays = _Rays(view, side)
    wall = np.full(side * side, np.inf)  # how far away the hand ends each ray
    if len(scene.hand.faces):
        _draw_skin(image.reshape(-1, 3), rays, scene, wall)
    if len(scene.glass.faces):
        _draw_glass(image, rays, scene.glass, wall)
    small = image.reshape(pixels, 2, pixels, 2, 3).mean(axis=(1, 3))
    return np.asarray(np.round(255 * np.clip(small, 0.0, 1.0)), dtype=np.uint8)


@dataclass(frozen=True)
class _Hits:
    """What some rays meet: their numbers, metres, unit normals (screen), faces, barycentrics."""

    rows: Index
    distance: Array
    normals: Array
    faces: Index
    weights: Array


class _Rays:
    """A ray through each pixel; directions are unit and in the screen's frame, (side ** 2, 3)."""

    def __init__(self, view: StudioView, side: int) -> None:
        at = (np.arange(side) + 0.5) / side * 2 - 1
        x, y = np.meshgrid(at, -at)
        heading = np.stack([x, y, np.full_like(x, -1 / np.tan(_HALF_ANGLE))], -1).reshape(-1, 3)
        self.view, self.side = view, side
        self.directions = heading / np.linalg.norm(heading, axis=1, keepdims=True)

    def points(self, rows: Index, distance: Array) -> Array:
        """Where rays are after so many metres, the scene's frame."""
        eye, turn = np.array([0.0, 0.0, self.view.distance]), self.view.screen_from_object
        along: Array = (eye + distance[:, None] * self.directions[rows]) @ turn + self.view.center
        return along

    def layers(self, surface: Surface, most: int) -> Iterator[_Hits]:
        """What each ray meets of a surface first, then behind that, at most so often."""
        tree, turn = EmbreeScene(), self.view.screen_from_object
        TriangleMesh(tree, surface.vertices.astype(np.float32), surface.faces.astype(np.int32))
        rows, start = np.arange(len(self.directions)), np.zeros(len(self.directions))
        for _ in range(most):
            origins = self.points(rows, start).astype(np.float32)
            heading = (self.directions[rows] @ turn).astype(np.float32)
            found = tree.run(origins, heading, query="INTERSECT", output=True)
            hit = np.flatnonzero(found["primID"] >= 0)
            if not len(hit):
                return
            u, v, faces = (found[name][hit] for name in ("u", "v", "primID"))
            weights = np.stack([1.0 - u - v, u, v], axis=1)
            n = np.einsum("ij,ijk->ik", weights, surface.normals[surface.faces[faces]]) @ turn.T
            n /= np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-12)
            rows, start = rows[hit], start[hit] + found["tfar"][hit]
            yield _Hits(rows, start, n, faces, weights)
            start = start + 2e-5


def _step(low: float, high: float, value: Array) -> Array:
    t = np.clip((value - low) / (high - low), 0.0, 1.0)
    return np.asarray(t * t * (3 - 2 * t))


def _paper(side: int) -> Array:
    """Squared paper, light above: straight lines show what glass does to them."""
    y, x = np.mgrid[0:side, 0:side] - side / 2 + 0.5
    ink = np.zeros((side, side, 1))
    for step, width, share in ((side / 28, 1.4, 0.16), (side / 7, 1.8, 0.26)):
        away = step / 2 - np.maximum(np.abs(x % step - step / 2), np.abs(y % step - step / 2))
        ink += share * np.clip(1.0 - away / width, 0.0, 1.0)[..., None]
    light = 0.15 * (0.5 - y / side) - 0.07 * np.hypot(x, y) / side
    color = np.array([0.80, 0.84, 0.87]) + light[..., None]
    return np.asarray(color * (1 - ink) + ink * np.array([0.42, 0.58, 0.70]))


def _draw_skin(flat: Array, rays: _Rays, scene: HandOnGlass, wall: Array) -> None:
    """Shade the hand into the picture (N, 3), and note where it ends rays."""
    for hits in rays.layers(scene.hand, 1):
        n, v = hits.normals, -rays.directions[hits.rows]
        n = n * np.where((n * v).sum(1, keepdims=True) < -0.2, -1.0, 1.0)
        corners = scene.hand_colors[scene.hand.faces[hits.faces]] / 255.0
        light, soft = np.array([-0.42, 0.70, 0.58]), np.array([0.45, 0.28, 0.22])
        wrap = np.clip(((n @ light)[:, None] + soft) / (1 + soft), 0.0, 1.0)
        sky = (0.5 + 0.5 * n[:, 1:2]) * np.array([0.22, 0.25, 0.27]) + np.array([0.20, 0.19, 0.20])
        shine = np.clip((n * (light + v)).sum(1) / np.linalg.norm(light + v, axis=1), 0, 1) ** 26
        paint = np.einsum("ij,ijk->ik", hits.weights, corners) ** 2.2
        shade = np.clip(paint * (0.95 * wrap + 0.75 * sky) + 0.10 * shine[:, None], 0.0, 1.0)
        fade = rays.points(hits.rows, hits.distance) @ np.array(scene.fade[:3]) + scene.fade[3]
        cover = np.clip(fade, 0.0, 1.0)[:, None] ** 1.5
        flat[hits.rows] = shade ** (1 / 2.2) * cover + flat[hits.rows] * (1 - cover)
        wall[hits.rows] = np.where(cover[:, 0] > 0.5, hits.distance, np.inf)


def _draw_glass(image: Array, rays: _Rays, glass: Surface, wall: Array) -> None:
    """Lay the glass over the picture: its nearest wall bends it, every wall mirrors."""
    layers = []
    for hits in rays.layers(glass, _MOST_WALLS):
        seen = hits.distance < wall[hits.rows]
        layers.append((hits.rows[seen], hits.normals[seen]))
    if not layers:
        return
    rows, n = layers[0]
    facing = (n * -rays.directions[rows]).sum(1)
    edge = 1 - np.abs(facing)
    shift = (np.sign(facing) * (0.012 * edge + 0.16 * edge**5) * rays.side)[:, None] * n[:, :2]
    at = np.stack([rows // rays.side + shift[:, 1], rows % rays.side - shift[:, 0]])
    bent = [map_coordinates(image[..., c], at, order=1, mode="nearest") for c in range(3)]
    flat = image.reshape(-1, 3)
    flat[rows] = np.stack(bent, axis=1) * (0.985 - 0.06 * edge**3)[:, None]
    for rows, n in reversed(layers):
        heading = rays.directions[rows]
        cosine = -(n * heading).sum(1)
        outside = np.where(cosine > 0, 1.0, 0.55)[:, None]
        c = np.abs(cosine)[:, None]
        fresnel, dark = 0.04 + 0.96 * (1 - c) ** 5, 0.46 * (1 - c) ** 2.5
        room = _mirrored(heading + 2 * c * n * np.sign(cosine)[:, None])[:, None]
        add = 0.85 * room * (fresnel + 0.05 * (room > 1.1)) + dark * np.array([0.16, 0.24, 0.28])
        cover = np.clip(0.6 * fresnel + dark, 0.0, 0.9)
        flat[rows] = add * outside + flat[rows] * (1 - cover * outside)


def _mirrored(d: Array) -> Array:
    """How bright the room is along directions (N, 3): a window and a strip of light in front."""
    x, y = d[:, 0], d[:, 1]
    across, up = np.abs(x + 0.52), np.abs(y - 0.42)
    window = _step(0.10, 0.02, across - 0.22) * _step(0.10, 0.02, up - 0.26)
    bars = np.minimum(_step(0.042, 0.012, across) + _step(0.042, 0.012, up), 1.0)
    strip = _step(0.06, 0.0, np.abs(x - 0.78) - 0.05) * _step(0.1, 0.0, np.abs(y - 0.1) - 0.5)
    lights = 1.25 * window * (1 - 0.5 * bars) + 0.9 * strip
    return np.asarray(0.44 + 0.44 * _step(-0.5, 0.8, y) + (d[:, 2] > 0) * lights)

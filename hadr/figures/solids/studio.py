"""Stills of hands on glass: the turntable's light, paper and glass, drawn by casting rays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from scipy.ndimage import map_coordinates

from hadr.figures.solids.turntable import HandOnGlass
from hadr.synthesis.glass.surfaces import Surface

Array = npt.NDArray[np.float64]

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
    elevation_deg: float | None = None,
    center: npt.ArrayLike | None = None,
    radius: float | None = None,
) -> StudioView:
    """Look at a scene as the turntable does first, or from elsewhere.

    Args:
        scene: Hand and glass.
        azimuth_deg: Where the viewer stands, degrees about z from x.
        elevation_deg: How far he is raised, degrees.
        center: Middle of the picture, metres; that of glass and joints where it is left out.
        radius: Metres around the middle; as far as glass and joints reach where left out.

    Returns:
        The view.
    """
    a, e = np.deg2rad(
        [
            scene.azimuth_deg if azimuth_deg is None else azimuth_deg,
            scene.elevation_deg if elevation_deg is None else elevation_deg,
        ]
    )
    toward = np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    points = np.concatenate([scene.glass.vertices, scene.joints])
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    if center is not None:
        middle = np.asarray(center, dtype=float)
    reach = float(np.linalg.norm(points - middle, axis=1).max()) if radius is None else radius
    return StudioView(np.stack([right, np.cross(toward, right), toward]), middle, reach)


def studio_picture(
    scene: HandOnGlass,
    view: StudioView | None = None,
    *,
    pixels: int = 320,
    paper: bool = True,
) -> npt.NDArray[np.uint8]:
    """Draw hand and glass as the turntable shows them.

    Args:
        scene: Hand and glass; either may have no faces.
        view: From where; the scene's own view where it is left out.
        pixels: Side of the square picture.
        paper: Squared paper behind; else plain.

    Returns:
        sRGB, shape (pixels, pixels, 3).

    Raises:
        ValueError: The picture has fewer than 16 pixels a side.
    """
    if pixels < 16:
        raise ValueError(f"a picture needs at least 16 pixels a side, got {pixels}")
    view = view or studio_view(scene)
    fine = 2 * pixels
    rays = _camera_rays(fine, view.distance)
    image = _paper(fine) if paper else np.full((fine, fine, 3), PLAIN)
    wall = np.full(fine * fine, np.inf)
    if len(scene.hand.faces):
        wall = _draw_skin(image, rays, scene, view)
    if len(scene.glass.faces):
        _draw_glass(image, rays, _on_screen(scene.glass, view), wall)
    small = image.reshape(pixels, 2, pixels, 2, 3).mean(axis=(1, 3))
    return np.asarray(np.round(255 * np.clip(small, 0.0, 1.0)), dtype=np.uint8)


@dataclass(frozen=True)
class _Rays:
    """Rays of all pixels, screen frame: origin (3,), unit directions (N, 3)."""

    origin: Array
    directions: Array
    side: int


def _camera_rays(side: int, distance: float) -> _Rays:
    at = (np.arange(side) + 0.5) / side * 2 - 1
    x, y = np.meshgrid(at, -at)
    heading = np.stack([x, y, np.full_like(x, -1 / np.tan(_HALF_ANGLE))], axis=-1).reshape(-1, 3)
    heading /= np.linalg.norm(heading, axis=1, keepdims=True)
    return _Rays(np.array([0.0, 0.0, distance]), heading, side)


def _on_screen(surface: Surface, view: StudioView) -> Surface:
    turn = view.screen_from_object.T
    return Surface((surface.vertices - view.center) @ turn, surface.faces, surface.normals @ turn)


class _Tree:
    """A surface that rays can meet: smooth normals and colours at the hits."""

    def __init__(self, surface: Surface) -> None:
        self.surface, self.tree = surface, EmbreeScene()
        TriangleMesh(self.tree, surface.vertices.astype(np.float32), surface.faces.astype(np.int32))

    def meet(
        self, rays: _Rays, rows: npt.NDArray[np.int64], start: Array
    ) -> tuple[npt.NDArray[np.int64], Array, npt.NDArray[np.int64], Array]:
        """Of the rays in ``rows``, from distances ``start``: which hit, where, face, weights."""
        heading = rays.directions[rows]
        origins = (rays.origin + start[:, None] * heading).astype(np.float32)
        found = self.tree.run(origins, heading.astype(np.float32), query="INTERSECT", output=True)
        hit = np.flatnonzero(found["primID"] >= 0)
        u, v = found["u"][hit].astype(float), found["v"][hit].astype(float)
        weights = np.stack([1 - u - v, u, v], axis=1)
        return rows[hit], start[hit] + found["tfar"][hit], found["primID"][hit], weights

    def normals(self, faces: npt.NDArray[np.int64], weights: Array) -> Array:
        n = np.einsum("ij,ijk->ik", weights, self.surface.normals[self.surface.faces[faces]])
        return np.asarray(n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-12))


def _paper(side: int) -> Array:
    """Squared paper, light above: straight lines show what glass does to them."""
    cell = side / 28
    y, x = np.mgrid[0:side, 0:side] - side / 2 + 0.5

    def lines(step: float, width: float) -> Array:
        away = step / 2 - np.maximum(np.abs((x % step) - step / 2), np.abs((y % step) - step / 2))
        return np.asarray(np.clip(1.0 - away / width, 0.0, 1.0))

    up = 0.5 - y / side
    color = np.array([0.80, 0.84, 0.87]) + (0.15 * up - 0.07 * np.hypot(x, y) / side)[..., None]
    ink = (0.16 * lines(cell, 1.4) + 0.26 * lines(4 * cell, 1.8))[..., None]
    return np.asarray(color * (1 - ink) + ink * np.array([0.42, 0.58, 0.70]))


def _draw_skin(image: Array, rays: _Rays, scene: HandOnGlass, view: StudioView) -> Array:
    """Shade the hand into the picture; returns the distance at which it stops each ray."""
    hand = _on_screen(scene.hand, view)
    tree = _Tree(hand)
    everything = np.arange(len(rays.directions))
    rows, distance, faces, weights = tree.meet(rays, everything, np.zeros(len(everything)))
    n = tree.normals(faces, weights)
    v = -rays.directions[rows]
    n *= np.where((n * v).sum(1, keepdims=True) < -0.2, -1.0, 1.0)
    paint = np.einsum("ij,ijk->ik", weights, scene.hand_colors[hand.faces[faces]] / 255.0)
    light = np.array([-0.45, 0.75, 0.62]) / np.linalg.norm([-0.45, 0.75, 0.62])
    soft = np.array([0.45, 0.28, 0.22])
    wrap = np.clip(((n @ light)[:, None] + soft) / (1 + soft), 0.0, 1.0)
    sky = (0.5 + 0.5 * n[:, 1:2]) * np.array([0.22, 0.25, 0.27]) + np.array([0.20, 0.19, 0.20])
    half = light + v
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    shine = np.clip((n * half).sum(1), 0.0, 1.0)[:, None] ** 26
    rim = (1 - np.clip((n * v).sum(1), 0.0, 1.0))[:, None] ** 4
    shade = paint**2.2 * (0.95 * wrap + 0.75 * sky) + 0.10 * shine + 0.05 * rim
    flat = image.reshape(-1, 3)
    points = rays.origin + distance[:, None] * rays.directions[rows]
    places = points @ view.screen_from_object + view.center
    cover = np.clip(places @ np.array(scene.fade[:3]) + scene.fade[3], 0.0, 1.0)[:, None] ** 1.5
    flat[rows] = np.clip(shade, 0, 1) ** (1 / 2.2) * cover + flat[rows] * (1 - cover)
    wall = np.full(len(rays.directions), np.inf)
    wall[rows] = np.where(cover[:, 0] > 0.5, distance, np.inf)
    return wall


def _draw_glass(image: Array, rays: _Rays, glass: Surface, wall: Array) -> None:
    """Lay the glass over the picture: its nearest wall bends it, every wall mirrors."""
    tree = _Tree(glass)
    rows, start = np.arange(len(rays.directions)), np.zeros(len(rays.directions))
    layers = []
    for _ in range(_MOST_WALLS):
        rows, distance, faces, weights = tree.meet(rays, rows, start)
        seen = distance < wall[rows]
        rows, distance = rows[seen], distance[seen]
        if len(rows) == 0:
            break
        layers.append((rows, tree.normals(faces[seen], weights[seen])))
        start = distance + 2e-5
    if not layers:
        return
    side = rays.side
    flat = image.reshape(-1, 3)
    first, n = layers[0]
    facing = (n * -rays.directions[first]).sum(1)
    n = n * np.sign(facing)[:, None]
    edge = 1 - np.abs(facing)
    shift = (0.012 * edge + 0.16 * edge**5)[:, None] * n[:, :2] * side
    at = np.stack([first // side + shift[:, 1], first % side - shift[:, 0]])
    bent = np.stack(
        [map_coordinates(image[..., c], at, order=1, mode="nearest") for c in range(3)], axis=1
    )
    flat[first] = bent * (0.985 - 0.06 * edge**3)[:, None]
    for rows, normals in reversed(layers):
        _mirror(flat, rows, normals, rays.directions[rows])


def _mirror(flat: Array, rows: npt.NDArray[np.int64], n: Array, heading: Array) -> None:
    cosine = -(n * heading).sum(1)
    outside = np.where(cosine > 0, 1.0, 0.55)[:, None]
    n = n * np.sign(cosine)[:, None]
    c = np.abs(cosine)[:, None]
    fresnel = 0.04 + 0.96 * (1 - c) ** 5
    mirrored = _studio(heading + 2 * c * n)[:, None]
    dark = 0.46 * (1 - c) ** 2.5
    add = mirrored * (fresnel + 0.05 * (mirrored > 1.1)) * 0.85
    add = add + dark * np.array([0.16, 0.24, 0.28])
    cover = np.clip(0.6 * fresnel + dark, 0.0, 0.9)
    flat[rows] = add * outside + flat[rows] * (1 - cover * outside)


def _studio(d: Array) -> Array:
    """What is mirrored: a grey room with a window and a strip of light in front."""

    def step(low: float, high: float, value: Array) -> Array:
        t = np.clip((value - low) / (high - low), 0.0, 1.0)
        return np.asarray(t * t * (3 - 2 * t))

    x, y = d[:, 0], d[:, 1]
    across, up = np.abs(x + 0.52), np.abs(y - 0.42)
    window = step(0.10, 0.02, across - 0.22) * step(0.10, 0.02, up - 0.26)
    bars = np.minimum(step(0.042, 0.012, across) + step(0.042, 0.012, up), 1.0)
    strip = step(0.06, 0.0, np.abs(x - 0.78) - 0.05) * step(0.1, 0.0, np.abs(y - 0.1) - 0.5)
    room = 0.44 + 0.44 * step(-0.5, 0.8, y)
    return np.asarray(room + (d[:, 2] > 0) * (1.25 * window * (1 - 0.5 * bars) + 0.9 * strip))

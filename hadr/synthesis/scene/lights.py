"""The light of a scene: a picture of radiance from all directions, and lamps, drawn by rule."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
import numpy.typing as npt

from hadr.camera import Array
from hadr.synthesis.glass.surfaces import dots
from hadr.synthesis.textures.noise import look_up, noise, ramp, room_colors

Radiance = npt.NDArray[np.float32]

#: Rows and columns of an environment that is drawn.
_SHAPE = (128, 256)
#: Weight of each band in a cosine lobe, spherical harmonics (Ramamoorthi and Hanrahan, 2001).
_BANDS = np.array([np.pi] + [2 * np.pi / 3] * 3 + [np.pi / 4] * 5)


def _harmonics(d: Array) -> Array:
    """The nine real spherical harmonics up to the second degree, shape (..., 9)."""
    x, y, z = d[..., 0], d[..., 1], d[..., 2]
    low = [np.full_like(x, 0.282095), 0.488603 * y, 0.488603 * z, 0.488603 * x]
    high = [1.092548 * x * y, 1.092548 * y * z, 0.315392 * (3 * z**2 - 1), 1.092548 * x * z]
    return np.stack([*low, *high, 0.546274 * (x**2 - y**2)], axis=-1)


@dataclass(frozen=True, eq=False)
class Environment:
    """Light from far away, as a picture of all directions.

    Rows run from the zenith (+z) to the nadir; columns run with the azimuth atan2(y, x), from 0
    at the left edge over pi in the middle to 2 pi.

    Args:
        image: Linear RGB radiance, shape (H, W, 3).
    """

    image: Radiance

    def directions(self) -> Array:
        """Unit direction of each pixel's centre, world frame, shape (H, W, 3)."""
        height, width = self.image.shape[:2]
        polar = (np.arange(height) + 0.5) / height * np.pi
        azimuth = (np.arange(width) + 0.5) / width * 2 * np.pi
        sine = np.sin(polar)[:, None]
        x, y = sine * np.cos(azimuth), sine * np.sin(azimuth)
        return np.stack([x, y, np.broadcast_to(np.cos(polar)[:, None], x.shape)], axis=-1)

    def radiance(self, directions: Array) -> Array:
        """Linear RGB radiance that arrives from unit directions, shape (N, 3)."""
        height, width = self.image.shape[:2]
        azimuth = np.arctan2(directions[:, 1], directions[:, 0]) % (2 * np.pi)
        polar = np.arccos(np.clip(directions[:, 2], -1, 1))
        x = azimuth / (2 * np.pi) * width - 0.5
        return look_up(self.image, x, np.clip(polar / np.pi * height - 0.5, 0, height - 1))

    @cached_property
    def _coefficients(self) -> Array:
        height, width = self.image.shape[:2]
        polar = (np.arange(height) + 0.5) / height * np.pi
        solid = np.sin(polar)[:, None] * (np.pi / height) * (2 * np.pi / width)
        basis = _harmonics(self.directions()) * solid[..., None]
        flat = basis.reshape(-1, 9).T @ self.image.reshape(-1, 3).astype(float)
        return np.asarray(flat * _BANDS[:, None])

    def irradiance(self, normals: Array) -> Array:
        """Linear RGB irradiance on surfaces of unit normals, smooth, (N, 3), by nine harmonics."""
        return np.asarray(np.maximum(_harmonics(normals) @ self._coefficients, 0.0))


@dataclass(frozen=True, eq=False)
class AreaLight:
    """A rectangle that shines on one side.

    Args:
        center: World frame, metres, shape (3,).
        half_width: From the centre to the middle of one side, world frame, metres, shape (3,).
        half_height: The same across it, shape (3,); it shines toward half_width x half_height.
        color: Linear RGB radiance, shape (3,).
    """

    center: Array
    half_width: Array
    half_height: Array
    color: Array

    @cached_property
    def normal(self) -> Array:
        """Unit direction in which it shines, shape (3,)."""
        across = np.cross(self.half_width, self.half_height)
        return np.asarray(across / np.linalg.norm(across))

    @cached_property
    def area(self) -> float:
        """Square metres."""
        return 4.0 * float(np.linalg.norm(np.cross(self.half_width, self.half_height)))

    def radiance(self, origins: Array, directions: Array, before: Array) -> Array:
        """Linear RGB radiance along rays that meet its shining side, else 0, shape (N, 3).

        Origins (world frame, metres) and unit directions of looking are (N, 3); each ray reaches to
        ``before``, metres, shape (N,).
        """
        normal = self.normal
        facing = directions @ normal
        safe = np.where(facing < -1e-6, facing, -1.0)
        distance = ((self.center - origins) @ normal) / safe
        local = origins + distance[:, None] * directions - self.center
        a = np.abs(local @ self.half_width) / (self.half_width @ self.half_width)
        b = np.abs(local @ self.half_height) / (self.half_height @ self.half_height)
        hit = (facing < -1e-6) & (distance > 0) & (distance < before) & (a <= 1) & (b <= 1)
        return np.asarray(hit[:, None] * self.color)

    def irradiance(self, points: Array, normals: Array) -> Array:
        """Linear RGB irradiance at points of given unit normals, as if it were small, (N, 3)."""
        away = self.center - points
        squared = np.maximum(dots(away, away), 1e-6)
        away = away / np.sqrt(squared)[:, None]
        cosines = np.maximum(-(away @ self.normal), 0) * np.maximum(dots(away, normals), 0)
        return np.asarray((cosines * self.area / squared)[:, None] * self.color)


def _outdoors(rng: np.random.Generator, image: npt.NDArray[np.float32], sun: Array) -> None:
    """Sky with clouds and a veiled sun, a skyline of trees and houses, bright ground."""
    height, width = _SHAPE
    v = ((np.arange(height) + 0.5) / height)[:, None] * np.ones((1, width))
    tops = (
        ((0.75, 0.9, 1.25), (0.95, 1.05, 1.2), (1.25, 1.25, 1.2)),
        ((1.15, 1.18, 1.22), (1.2, 1.2, 1.2), (1.25, 1.22, 1.18)),
        ((0.65, 0.72, 0.95), (1.1, 0.95, 0.9), (1.6, 1.2, 0.85)),
    )
    image[:] = ramp(np.clip(v * 2, 0, 1).astype(np.float32), tops[int(rng.integers(3))])
    cloud = np.clip(noise(rng, (4, 6), 4, 0.55, _SHAPE) * 2 - 0.9, 0, 1)[..., None]
    image += 0.55 * cloud * (v < 0.5)[..., None]
    ground = room_colors(rng, 1, pale=0.6)[0] * 0.62
    image[v[:, 0] > 0.5] = ground
    skyline = 0.5 - 0.10 * noise(rng, (1, 14), 3, 0.7, (1, width))[0] - 0.02
    below = (v > skyline[None]) & (v < 0.53)
    dark = room_colors(rng, 1, pale=0.1)[0] * rng.uniform(0.2, 0.5)
    image[below] = dark * (0.6 + 0.8 * noise(rng, (24, 48), 2, 0.6, _SHAPE)[below][:, None])


def _indoors(rng: np.random.Generator, image: npt.NDArray[np.float32], sun: Array) -> None:
    """Walls, a bright ceiling, a darker floor with furniture, windows, lamps."""
    height, width = _SHAPE
    wall = room_colors(rng, 1, pale=0.75)[0]
    v = (np.arange(height) + 0.5) / height
    image[:] = wall * 0.85
    image[v < 0.27] = np.array([1.15, 1.13, 1.08])
    image[v > 0.66] = room_colors(rng, 1, pale=0.35)[0] * 0.55
    for _ in range(int(rng.integers(4, 9))):
        x, w = int(rng.integers(width)), int(rng.integers(8, 34))
        top = int(height * rng.uniform(0.42, 0.6))
        columns = np.arange(x, x + w) % width
        tone = room_colors(rng, 1, pale=0.2)[0] * rng.uniform(0.25, 0.8)
        image[top : int(height * rng.uniform(0.66, 0.74)), columns] = tone
    azimuth = np.arctan2(sun[1], sun[0]) % (2 * np.pi) / (2 * np.pi)
    for k in range(int(rng.integers(2, 5))):
        x = int((azimuth if k == 0 else rng.random()) * width) - 14
        w, upper, lower = int(rng.integers(16, 34)), rng.uniform(0.28, 0.36), rng.uniform(0.5, 0.62)
        light = np.array([1.0, 1.02, 1.06]) * rng.uniform(4.5, 7.5)
        rows = slice(int(height * upper), int(height * lower))
        image[rows, np.arange(x, x + w) % width] = light
        panes = int(rng.integers(2, 4))
        for p in range(panes + 1):
            image[rows, (x + (w - 1) * p // panes) % width] = 0.35
        middle = (rows.start + rows.stop) // 2
        image[middle, np.arange(x, x + w) % width] = 0.35
    for _ in range(int(rng.integers(1, 5))):
        x, y = int(rng.integers(width)), int(height * rng.uniform(0.06, 0.24))
        image[y : y + 5, np.arange(x, x + int(rng.integers(8, 20))) % width] = (8.0, 7.4, 6.4)


def make_lights(
    eye: Array, middle: Array, rng: np.random.Generator
) -> tuple[Environment, tuple[AreaLight, ...]]:
    """The light of a scene, so bright that white paper that faces the camera is about white.

    The camera at ``eye`` looks at ``middle``, world frame, metres. Light from far away, and one or
    two panels above or beside the camera.
    """
    back = (eye - middle) / np.linalg.norm(eye - middle)
    sun = back + np.array([0, 0, rng.uniform(0.3, 1.0)]) + 0.8 * rng.normal(size=3)
    sun[2] = abs(sun[2])
    sun /= np.linalg.norm(sun)
    image = np.zeros((*_SHAPE, 3), dtype=np.float32)
    indoors = rng.random() < 0.55
    (_indoors if indoors else _outdoors)(rng, image, sun)
    around = cv2.GaussianBlur(np.concatenate([image] * 3, axis=1), (0, 0), 0.8)
    image = np.asarray(np.split(around, 3, axis=1)[1])
    if not indoors:
        toward = Environment(image).directions() @ sun
        glow = 14.0 * np.exp(-(((1 - toward) / 0.006) ** 2)) + 1.2 * np.exp(-(1 - toward) / 0.12)
        sunny = np.array([1.0, 0.95, 0.85], dtype=np.float32)
        image = image + glow[..., None].astype(np.float32) * sunny
    lamps = []
    for number in range(2 if rng.random() < 0.35 else 1):
        # From above and mostly from one side: what is held throws a shadow, soft at its edges.
        toward = 0.4 * back + np.array([0, 0, 0.8]) + 0.65 * rng.normal(size=3)
        toward[2] = abs(toward[2])
        toward += max(0.1 - toward @ back, 0) * back
        toward /= np.linalg.norm(toward)
        center = middle + toward * rng.uniform(1.5, 2.2)
        off_axis = [0.0, 0.0, 1.0] if abs(toward[2]) < 0.9 else [0.0, 1.0, 0.0]
        side = np.cross(off_axis, toward)
        side /= np.linalg.norm(side)
        wide, tall = rng.uniform(0.25, 0.55, 2)
        warm = rng.uniform(-1, 1)
        tone = np.array([1 + 0.08 * warm, 1.0, 1 - 0.10 * warm])
        color = tone * (rng.uniform(14, 34) if number == 0 else rng.uniform(2, 5))
        # It shines toward what is held.
        lamps.append(AreaLight(center, side * wide, np.cross(side, toward) * tall, color))
    environment = Environment((image * rng.uniform(0.25, 0.7)).astype(np.float32))
    normals = np.stack([back, back + np.array([0, 0, 0.8])])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    total = environment.irradiance(normals)
    for lamp in lamps:
        total = total + lamp.irradiance(np.tile(middle, (2, 1)), normals)
    gain = np.pi * rng.uniform(0.95, 1.25) / float(total.mean())
    brighter = tuple(replace(lamp, color=lamp.color * gain) for lamp in lamps)
    return Environment(environment.image * np.float32(gain)), brighter

"""The light of a scene: a surrounding picture of radiance, and rectangles that shine."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from hadr.synthesis.textures.noise import look_up

Array = npt.NDArray[np.float64]
Radiance = npt.NDArray[np.float32]

#: Weight of each band in a cosine lobe, spherical harmonics (Ramamoorthi and Hanrahan, 2001).
_BANDS = np.array([np.pi] + [2 * np.pi / 3] * 3 + [np.pi / 4] * 5)


def _harmonics(d: Array) -> Array:
    """The nine real spherical harmonics up to the second degree, shape (..., 9)."""
    x, y, z = d[..., 0], d[..., 1], d[..., 2]
    return np.stack(
        [
            np.full_like(x, 0.282095),
            0.488603 * y,
            0.488603 * z,
            0.488603 * x,
            1.092548 * x * y,
            1.092548 * y * z,
            0.315392 * (3 * z**2 - 1),
            1.092548 * x * z,
            0.546274 * (x**2 - y**2),
        ],
        axis=-1,
    )


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
        """Linear RGB irradiance on surfaces of given unit normals, smooth, shape (N, 3).

        From nine spherical harmonics: right to a few per cent unless the light is one small spot.
        """
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

    @property
    def normal(self) -> Array:
        """Unit direction in which it shines, shape (3,)."""
        across = np.cross(self.half_width, self.half_height)
        return np.asarray(across / np.linalg.norm(across))

    @property
    def area(self) -> float:
        """Square metres."""
        return 4.0 * float(np.linalg.norm(np.cross(self.half_width, self.half_height)))

    def radiance(self, origins: Array, directions: Array, before: Array) -> Array:
        """Linear RGB radiance along rays that meet its shining side, else 0, shape (N, 3).

        Args:
            origins: World frame, metres, shape (N, 3).
            directions: Unit directions of looking, shape (N, 3).
            before: How far each ray reaches, metres, shape (N,).
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
        squared = np.maximum((away**2).sum(1), 1e-6)
        away = away / np.sqrt(squared)[:, None]
        cosines = np.maximum(-(away @ self.normal), 0) * np.maximum((away * normals).sum(1), 0)
        return np.asarray((cosines * self.area / squared)[:, None] * self.color)

"""Flat and revolved surfaces with textures, put up one by one to become a scene's surroundings."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from hadr.camera import Array
from hadr.synthesis.glass.surfaces import Surface, merged, revolve
from hadr.synthesis.scene.contents import Surroundings
from hadr.synthesis.textures.families import pyramid


@dataclass
class Stage:
    """Surfaces with their textures, as they are put up one by one.

    ``photographs`` are the files that negative texture numbers stand for.
    """

    photographs: tuple[Path, ...] = ()
    parts: list[tuple[Surface, Array, int, float]] = field(default_factory=list)

    def add(self, surface: Surface, uv: Array, number: int, repeat: float) -> None:
        """Put up a surface; ``repeat`` is the height of its texture, metres."""
        self.parts.append((surface, uv, number, repeat))

    def aspect(self, number: int) -> float:
        """Width of a texture over its height."""
        height, width = pyramid(number, self.photographs)[0].shape[:2]
        return float(width / height)

    def quad(
        self, corner: Array, right: Array, down: Array, number: int, repeat: float, start: Array
    ) -> None:
        """Put up a parallelogram whose texture repeats, each ``repeat`` metres high.

        Its edges start at the upper left ``corner`` of what is looked at, metres; the texture is at
        ``start`` there, shape (2,), in repeats.
        """
        wide = np.linalg.norm(right) / (repeat * self.aspect(number))
        tall = np.linalg.norm(down) / repeat
        vertices = corner + np.array([[0, 0], [0, 1], [1, 1], [1, 0]]) @ np.stack([right, down])
        uv = start + np.array([[0, 0], [0, tall], [wide, tall], [wide, 0]])
        self._add_flat(vertices, right, down, uv, number, repeat)

    def _add_flat(
        self, vertices: Array, right: Array, down: Array, uv: Array, number: int, repeat: float
    ) -> None:
        """Put up four corners, counter-clockwise from the upper left one."""
        normal = np.cross(down, right)
        normals = np.tile(normal / np.linalg.norm(normal), (4, 1))
        faces = np.array([[0, 1, 2], [0, 2, 3]])
        self.add(Surface(vertices, faces, normals), uv, number, repeat)

    def mirrored(
        self,
        corner: Array,
        right: Array,
        down: Array,
        number: int,
        repeat: float,
        start: float,
        rows: tuple[float, float] = (0.002, 0.998),
    ) -> None:
        """As :meth:`quad`, but each second repeat across is mirrored, so that no seam is seen.

        ``down`` shows the rows between two fractions of the texture's height, which is ``repeat``.
        """
        wide, step = float(np.linalg.norm(right)), repeat * self.aspect(number)
        edges = (np.arange(np.ceil(wide / step) + 2) - start % 1) * step
        edges = edges[(edges > 1e-6) & (edges < wide - 1e-6)]
        cuts = np.concatenate([[0.0], edges, [wide]])
        for x0, x1 in pairwise(cuts):
            ends = np.array([x0 + 1e-7, x1 - 1e-7]) / step + start
            # Folding is only linear between the cuts, so it is measured just inside of them.
            u0, u1 = np.clip(1 - np.abs(1 - ends % 2), 0.001, 0.999)
            a, b = corner + right * (x0 / wide), corner + right * (x1 / wide)
            vertices = np.stack([a, a + down, b + down, b])
            uv = np.array([[u0, rows[0]], [u0, rows[1]], [u1, rows[1]], [u1, rows[0]]])
            self._add_flat(vertices, right, down, uv, number, repeat)

    def box(self, pose: Array, size: Array, number: int, repeat: float, start: Array) -> None:
        """Put up a box of half sizes ``size`` at a pose (4, 4)."""
        rotation, place = pose[:3, :3], pose[:3, 3]
        for axis in range(3):
            u, v = (axis + 1) % 3, (axis + 2) % 3
            for sign in (-1.0, 1.0):
                normal = np.where(np.arange(3) == axis, sign, 0.0)
                # The texture stands upright on the sides.
                right = np.eye(3)[u if v == 2 or axis == 2 else v]
                down = np.cross(right, normal)
                if abs(down[2]) > 0.5 and down[2] > 0:
                    right, down = -right, -down
                wide, tall = size @ np.abs(right), size @ np.abs(down)
                corner = normal * size[axis] - right * wide - down * tall
                sides = rotation @ (right * 2 * wide), rotation @ (down * 2 * tall)
                self.quad(rotation @ corner + place, *sides, number, repeat, start)

    def revolved(self, curve: Array, place: Array, number: int, repeat: float) -> None:
        """Put up a vase, pot, ball or can: an outline (radius, height) around z."""
        surface = revolve(curve)
        angle = np.arctan2(surface.vertices[:, 1], surface.vertices[:, 0]) / (2 * np.pi)
        laps = max(round(2 * np.pi * curve[:, 0].max() / (repeat * self.aspect(number))), 1)
        # Half of the laps is mirrored, so that no face runs back over a seam.
        uv = np.stack([2 * laps * np.abs(angle), -surface.vertices[:, 2] / repeat], axis=1)
        placed = replace(surface, vertices=surface.vertices + place)
        self.add(placed, uv, number, repeat)

    def surroundings(self) -> Surroundings:
        """All of it as one."""
        surfaces, uvs, numbers, repeats = zip(*self.parts, strict=True)
        counts = [len(surface.faces) for surface in surfaces]
        texture = np.repeat(np.asarray(numbers, dtype=np.int64), counts)
        repeat, tint = np.repeat(np.asarray(repeats), counts), np.ones((sum(counts), 3))
        uv = np.concatenate(uvs)
        return Surroundings(merged(surfaces), uv, texture, tint, repeat, self.photographs)

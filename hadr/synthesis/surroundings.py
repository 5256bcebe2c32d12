"""What stands around a held thing: ground, table, backdrop, walls, and things on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from hadr.synthesis.raycast import Surroundings
from hadr.synthesis.surfaces import Surface, revolve
from hadr.synthesis.textures import FAMILIES, FEW, VARIANTS, picture_number, pyramid

Array = npt.NDArray[np.float64]

_UP = np.array([0.0, 0.0, 1.0])
#: Distance of the last backdrop from the camera, metres.
FARTHEST = 5.0


@dataclass
class Stage:
    """Surfaces with their pictures, as they are put up one by one.

    Args:
        photographs: Files that negative picture numbers stand for.
    """

    photographs: tuple[Path, ...] = ()
    parts: list[tuple[Array, npt.NDArray[np.int64], Array, Array]] = field(default_factory=list)
    numbers: list[int] = field(default_factory=list)
    repeats: list[float] = field(default_factory=list)

    def add(
        self,
        vertices: Array,
        faces: npt.NDArray[np.int64],
        normals: Array,
        uv: Array,
        number: int,
        repeat: float,
    ) -> None:
        """Put up a surface; ``repeat`` is the height of its picture, metres."""
        self.parts.append((vertices, faces, normals, uv))
        self.numbers.append(number)
        self.repeats.append(repeat)

    def aspect(self, number: int) -> float:
        """Width of a picture over its height."""
        height, width = pyramid(number, self.photographs)[0].shape[:2]
        return float(width / height)

    def quad(
        self, corner: Array, right: Array, down: Array, number: int, repeat: float, start: Array
    ) -> None:
        """Put up a parallelogram whose picture repeats.

        Args:
            corner: Upper left corner, seen from the side that is looked at, metres.
            right: Edge from there to the right, metres.
            down: Edge from there down, metres.
            number: Its picture.
            repeat: Height of one repeat, metres.
            start: Picture's coordinates at the corner, in repeats, shape (2,).
        """
        wide = np.linalg.norm(right) / (repeat * self.aspect(number))
        tall = np.linalg.norm(down) / repeat
        vertices = corner + np.array([[0, 0], [0, 1], [1, 1], [1, 0]]) @ np.stack([right, down])
        normal = np.cross(down, right)
        normals = np.tile(normal / np.linalg.norm(normal), (4, 1))
        uv = start + np.array([[0, 0], [0, tall], [wide, tall], [wide, 0]])
        self.add(vertices, np.array([[0, 1, 2], [0, 2, 3]]), normals, uv, number, repeat)

    def mirrored(
        self, corner: Array, right: Array, down: Array, number: int, repeat: float, start: Array
    ) -> None:
        """As :meth:`quad`, but each second repeat across is mirrored, so that no seam is seen.

        The picture's height is ``repeat``; ``down`` has that length and ``start[1]`` is 0.
        """
        self._panels(corner, right, down, number, repeat, float(start[0]), (0.002, 0.998))

    def stretched(
        self, corner: Array, right: Array, down: Array, number: int, repeat: float, start: Array
    ) -> None:
        """As :meth:`mirrored`, but only the picture's upmost row is seen, drawn out."""
        self._panels(corner, right, down, number, repeat, float(start[0]), (0.002, 0.004))

    def _panels(
        self,
        corner: Array,
        right: Array,
        down: Array,
        number: int,
        repeat: float,
        start: float,
        rows: tuple[float, float],
    ) -> None:
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
            normal = np.cross(down, right)
            normals = np.tile(normal / np.linalg.norm(normal), (4, 1))
            self.add(vertices, np.array([[0, 1, 2], [0, 2, 3]]), normals, uv, number, repeat)

    def box(self, pose: Array, size: Array, number: int, repeat: float, start: Array) -> None:
        """Put up a box of half sizes ``size`` at a pose (4, 4)."""
        turn, place = pose[:3, :3], pose[:3, 3]
        for axis in range(3):
            u, v = (axis + 1) % 3, (axis + 2) % 3
            for sign in (-1.0, 1.0):
                normal = np.zeros(3)
                normal[axis] = sign
                right, down = np.zeros(3), np.zeros(3)
                # The picture stands upright on the sides.
                right[u if v == 2 or axis == 2 else v] = 1.0
                down = np.cross(right, normal)
                if abs(down[2]) > 0.5 and down[2] > 0:
                    right, down = -right, -down
                wide, tall = size @ np.abs(right), size @ np.abs(down)
                corner = normal * size[axis] - right * wide - down * tall
                self.quad(
                    turn @ corner + place,
                    turn @ (right * 2 * wide),
                    turn @ (down * 2 * tall),
                    number,
                    repeat,
                    start,
                )

    def turned(self, curve: Array, place: Array, number: int, repeat: float) -> None:
        """Put up a vase, pot, ball or can: an outline (radius, height) turned around z."""
        surface = revolve(curve)
        angle = np.arctan2(surface.vertices[:, 1], surface.vertices[:, 0]) / (2 * np.pi)
        turns = max(round(2 * np.pi * curve[:, 0].max() / (repeat * self.aspect(number))), 1)
        # Half of the turns is mirrored, so that no face runs back over a seam.
        uv = np.stack([2 * turns * np.abs(angle), -surface.vertices[:, 2] / repeat], axis=1)
        self.add(surface.vertices + place, surface.faces, surface.normals, uv, number, repeat)

    def surroundings(self) -> Surroundings:
        """All of it as one."""
        offsets = np.cumsum([0] + [len(part[0]) for part in self.parts])
        counts = [len(part[1]) for part in self.parts]
        surface = Surface(
            np.concatenate([part[0] for part in self.parts]),
            np.concatenate([part[1] + k for part, k in zip(self.parts, offsets, strict=False)]),
            np.concatenate([part[2] for part in self.parts]),
        )
        faces = sum(counts)
        return Surroundings(
            surface,
            np.concatenate([part[3] for part in self.parts]),
            np.repeat(np.asarray(self.numbers, dtype=np.int64), counts),
            np.ones((faces, 3)),
            np.repeat(np.asarray(self.repeats), counts),
            self.photographs,
        )


class _Choice:
    """Draws pictures for one scene, each used for several things."""

    def __init__(self, rng: np.random.Generator, photographs: int) -> None:
        self.rng, self.photographs = rng, photographs
        self.kept: list[int] = []

    def draw(self, names: Sequence[str], odds: Sequence[float], variants: int = VARIANTS) -> int:
        """One of some families' variants, with unlike odds."""
        share = np.asarray(odds, dtype=float) / np.sum(odds)
        name = names[int(self.rng.choice(len(names), p=share))]
        return picture_number(name, int(self.rng.integers(variants)))

    def view(self) -> int:
        """A backdrop."""
        if self.photographs:
            return -1 - int(self.rng.integers(self.photographs))
        names = [f.name for f in FAMILIES if f.place == "view"] + ["leaf_wall", "flowers"]
        weight = {"garden": 3.2, "room": 3.2, "foliage": 1.6, "bookshelf": 1.8, "leaf_wall": 1.4}
        return self.draw(names, [weight.get(name, 1.0) for name in names])

    def ground(self) -> int:
        """What a table or a floor is made of; a picture in one case of four."""
        if self.rng.random() < 0.32:
            return self.view()
        names = ["wood", "tiles", "marble", "terrazzo", "plaid", "print_cloth", "carpet"]
        names += ["pebbles", "grass"]
        return self.draw(names, [3.2, 1.5, 1.2, 0.7, 1.3, 1.4, 1.2, 0.6, 0.5])

    def wall(self) -> int:
        """A wall beside the backdrop."""
        names = ["wood", "boards", "shingles", "plaster", "tiles", "bookshelf", "leaf_wall"]
        return self.draw(names, [1.2, 1.6, 1.0, 2.0, 0.6, 1.4, 0.8])

    def thing(self) -> int:
        """What a small thing is covered with; few different ones a scene."""
        if len(self.kept) < 3:
            names = ["wood", "plaid", "print_cloth", "magazine", "marble", "terrazzo"]
            names += ["painting", "plaster", "big_leaves"]
            odds = [1.0, 1.0, 1.0, 0.6, 0.7, 0.6, 0.8, 1.6, 0.5]
            self.kept.append(self.draw(names, odds, FEW))
            return self.kept[-1]
        return int(self.rng.choice(self.kept))


def _is_view(number: int) -> bool:
    return number < 0 or FAMILIES[number % len(FAMILIES)].place == "view"


def _natural(number: int) -> float:
    return 1.5 if number < 0 else FAMILIES[number % len(FAMILIES)].width


def _ball(radius: float, squash: float) -> Array:
    angle = np.linspace(0, np.pi, 14)
    return np.stack([radius * np.sin(angle), squash * radius * (1 - np.cos(angle))], axis=1)


def _vase(rng: np.random.Generator, radius: float, height: float) -> Array:
    z = np.linspace(0, 1, 16)
    wave = 0.72 + 0.28 * np.sin(rng.uniform(1.5, 6.5) * z + rng.uniform(0, 6))
    side = np.stack([radius * wave, height * z], axis=1)
    return np.concatenate([[[0.0, 0.0]], side, [[0.0, height]]])


def _plant(stage: Stage, rng: np.random.Generator, place: Array, size: float, number: int) -> None:
    """A plant of bent leaves that grow from one point."""
    season = picture_number("leaf_wall", int(rng.integers(FEW)))
    for _ in range(int(rng.integers(12, 30))):
        azimuth, rise = rng.uniform(0, 2 * np.pi), rng.uniform(0.2, 1.35)
        length, width = size * rng.uniform(0.5, 1.0), size * rng.uniform(0.06, 0.13)
        t = np.linspace(0, 1, 6)
        out = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        side = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        bend = rng.uniform(0.2, 0.9)
        line = place + length * (
            t[:, None] * np.cos(rise) * out + (t * np.sin(rise) - bend * t**2 * 0.5)[:, None] * _UP
        )
        half = (width * np.sin(np.pi * np.clip(t, 0.03, 0.97)) ** 0.7)[:, None]
        vertices = np.stack([line - half * side, line + half * side], axis=1).reshape(-1, 3)
        tangent = np.gradient(line, axis=0)
        normal = np.cross(tangent, side)
        normal *= np.sign(normal[:, 2:] + 1e-9) / np.linalg.norm(normal, axis=1, keepdims=True)
        i = 2 * np.arange(5)
        faces = np.concatenate([np.stack([i, i + 2, i + 1], 1), np.stack([i + 1, i + 2, i + 3], 1)])
        spot = rng.random(2)
        uv = spot + np.stack([np.tile([0.0, 0.05], 6), np.repeat(0.15 * t, 2)], axis=1)
        stage.add(vertices, faces, np.repeat(normal, 2, axis=0), uv, season, 0.9)
    if number >= 0:
        height = 0.28 * size
        stage.turned(_vase(rng, 0.16 * size, height), place - height * _UP, number, 0.5)


def _thing(stage: Stage, choice: _Choice, place: Array, size: float) -> None:
    """Put one thing of about a size onto a place."""
    rng = choice.rng
    kind, number = rng.random(), choice.thing()
    repeat = _natural(number) * rng.uniform(0.25, 0.6)
    if kind < 0.40:
        # A pile of books or boxes.
        level = place.copy()
        half = size * rng.uniform(0.35, 1.0, 3) * np.array([1.0, 1.0, rng.choice([0.25, 0.9])])
        for _ in range(int(rng.integers(1, 5)) if half[2] < 0.3 * size else 1):
            pose = np.eye(4)
            pose[:3, :3] = Rotation.from_euler("z", rng.uniform(0, np.pi)).as_matrix()
            pose[:3, 3] = level + half[2] * _UP
            stage.box(pose, half, number, repeat, rng.random(2))
            level = level + 2 * half[2] * _UP
            number = choice.thing()
    elif kind < 0.62:
        stage.turned(_vase(rng, size * rng.uniform(0.35, 0.7), size * 2), place, number, repeat)
    elif kind < 0.76:
        radius = size * rng.uniform(0.5, 0.9)
        stage.turned(_ball(radius, rng.uniform(0.6, 1.0)), place, number, repeat)
    else:
        _plant(stage, rng, place + 0.5 * size * _UP, size * rng.uniform(1.6, 2.6), number)


def _sheet(stage: Stage, choice: _Choice, place: Array) -> None:
    """A magazine, a cloth or a print that lies on the table."""
    rng = choice.rng
    names = ["magazine", "painting", "print_cloth", "plaid", "carpet"]
    number = choice.draw([*names, "garden", "room"], [2, 1, 1, 1, 0.5, 0.7, 0.7], FEW)
    if choice.photographs and rng.random() < 0.6:
        number = choice.view()
    tall = rng.uniform(0.16, 0.5)
    wide = tall * stage.aspect(number)
    turn = Rotation.from_euler("z", rng.uniform(0, 2 * np.pi)).as_matrix()
    right, down = turn @ [wide, 0, 0], turn @ [0, -tall, 0]
    corner = place - right / 2 - down / 2 + rng.uniform(0.001, 0.003) * _UP
    stage.quad(corner, right, down, number, tall, np.zeros(2))


def make_surroundings(
    eye: Array,
    middle: Array,
    lowest: float,
    rng: np.random.Generator,
    photographs: Sequence[Path] = (),
) -> Surroundings:
    """Put up a place around what is held: every ray of the camera ends on something.

    Args:
        eye: The camera, world frame, metres.
        middle: What it looks at.
        lowest: Height under which nothing of hand and glass reaches, metres.
        rng: Draws it.
        photographs: A user's photographs for backdrop, table and floor; procedural ones without.

    Returns:
        The surfaces; none of them between the camera and what is held.
    """
    stage = Stage(tuple(photographs))
    choice = _Choice(rng, len(photographs))
    ahead = middle - eye
    flat = np.array([ahead[0], ahead[1], 0.0])
    flat = flat / max(float(np.linalg.norm(flat)), 1e-6)
    side = np.array([flat[1], -flat[0], 0.0])  # to the right
    floor = min(lowest - 0.05, -rng.uniform(0.35, 1.1), eye[2] - 0.3)
    # The last backdrop: half a cylinder around the camera.
    far = choice.view()
    steps = 20
    angles = np.linspace(-1.9, 1.9, steps + 1)
    ring = [eye + FARTHEST * (np.cos(a) * flat + np.sin(a) * side) for a in angles]
    top = eye[2] + 5.0
    # The picture stands on the floor once; what is above it is drawn out to the top.
    height = min(float(rng.uniform(3.4, 5.5)), top - floor - 0.1)
    # A whole number of pictures around; neighbours are mirrored.
    across = FARTHEST * 2 * 1.9 / steps
    # Ahead stands about the middle of a picture, not a mirror's line.
    start = 20 + 0.5 + rng.uniform(-0.2, 0.2) - steps / 2 * across / (height * stage.aspect(far))
    for k in range(steps):
        wide = across / (height * stage.aspect(far))
        corner = np.array([*ring[k][:2], top])
        right = np.array([*(ring[k + 1] - ring[k])[:2], 0.0])
        offset = np.array([start + k * wide, 0.0])
        if not _is_view(far):
            grain = _natural(far)
            offset = np.array([k * across / (grain * stage.aspect(far)), 0.0])
            stage.quad(corner, right, _UP * (floor - top), far, grain, offset)
            continue
        middle_height = np.array([0, 0, floor + height - top])
        stage.mirrored(corner + middle_height, right, _UP * -height, far, height, offset)
        stage.stretched(corner, right, middle_height, far, height, offset)
    # The floor.
    ground = choice.ground()
    reach = FARTHEST + 0.3
    repeat = _natural(ground) * float(rng.uniform(0.8, 1.6))
    turn = Rotation.from_euler("z", rng.choice([0.0, np.pi / 2]) + rng.normal() * 0.4).as_matrix()
    corner = np.array([eye[0], eye[1], floor]) + turn @ (1.5 * np.array([-reach, reach, 0]))
    stage.quad(
        corner,
        turn @ np.array([3 * reach, 0, 0]),
        turn @ np.array([0, -3 * reach, 0]),
        ground,
        repeat,
        rng.random(2),
    )
    # A wall nearer by, in three cases of four, and one beside it as in a room's corner.
    beyond = float(rng.uniform(0.9, 3.2))
    if rng.random() < 0.75:
        yaw = float(np.clip(rng.normal() * 0.35, -0.6, 0.6))
        along = np.cos(yaw) * side + np.sin(yaw) * flat
        center = np.array([middle[0], middle[1], 0.0]) + beyond * flat
        distance = beyond + float(np.linalg.norm(ahead))
        view = choice.view() if rng.random() < 0.7 else choice.wall()
        left, right_end = -rng.uniform(0.8, 3.0), rng.uniform(0.8, 3.0)
        across_wall = (right_end - left) * along
        tall = 3.4
        if _is_view(view):
            # The picture fills the wall's height once.
            tall = float(np.clip(0.65 * distance * rng.uniform(1.0, 1.9), 1.1, 3.6))
            sight = eye[2] + (middle[2] - eye[2]) * distance / np.linalg.norm(ahead)
            bottom = max(float(sight - tall * rng.uniform(0.35, 0.6)), floor)
            corner = np.array([*(center + left * along)[:2], bottom + tall])
            ahead_at = -left / (tall * stage.aspect(view))
            offset = np.array([20.5 + rng.uniform(-0.25, 0.25) - ahead_at, 0.0])
            stage.mirrored(corner, across_wall, -tall * _UP, view, tall, offset)
        else:
            corner = np.array([*(center + left * along)[:2], floor + tall])
            stage.quad(corner, across_wall, -tall * _UP, view, _natural(view), rng.random(2))
        if rng.random() < 0.6:
            number = choice.wall()
            sign = rng.choice([-1.0, 1.0])
            edge = center + (right_end if sign > 0 else left) * along
            toward = -np.cos(yaw) * flat + np.sin(yaw) * side
            toward = toward / np.linalg.norm(toward)
            ends = (edge, edge + 1.8 * toward) if sign > 0 else (edge + 1.8 * toward, edge)
            corner = np.array([*ends[0][:2], floor + tall])
            natural = _natural(number)
            stage.quad(corner, ends[1] - ends[0], -tall * _UP, number, natural, rng.random(2))
    # A table under what is held.
    level = floor
    if lowest > -0.35 and rng.random() < 0.72:
        level = lowest - float(rng.choice([rng.uniform(0.004, 0.03), rng.uniform(0.03, 0.3)]))
        level = min(level, eye[2] - 0.08)
        half = np.array([rng.uniform(0.5, 1.1), rng.uniform(0.45, 0.8), 0.02])
        pose = np.eye(4)
        heading = np.arctan2(flat[1], flat[0]) + np.pi / 2 + rng.normal() * 0.5
        pose[:3, :3] = Rotation.from_euler("z", heading).as_matrix()
        away = middle + flat * rng.uniform(0.0, 0.35) + side * rng.normal() * 0.2
        pose[:3, 3] = [away[0], away[1], level - 0.02]
        number = choice.ground()
        scale = _natural(number) * float(rng.uniform(0.6, 1.2))
        stage.box(pose, half, number, scale, rng.random(2))
        for _ in range(int(rng.integers(1, 5))):
            spot = middle + flat * rng.uniform(-0.15, 0.6) + side * rng.uniform(-0.45, 0.45)
            _sheet(stage, choice, np.array([spot[0], spot[1], level]))
    for _ in range(int(rng.integers(5, 12))):
        reach_out = float(rng.uniform(0.3, 0.95 * beyond if level < floor + 0.01 else 0.9))
        spread = 0.55 * (reach_out + float(np.linalg.norm(ahead)))
        spot = middle + flat * reach_out + side * rng.uniform(-spread, spread)
        extent = float(rng.uniform(0.04, 0.11)) * (1.0 if level > floor else 2.2)
        place = np.array([spot[0], spot[1], level])
        # Nothing may stand in hand or glass, or right before the camera.
        if np.linalg.norm(place[:2] - middle[:2]) < 0.17 + 1.5 * extent:
            continue
        _thing(stage, choice, place, extent)
    return stage.surroundings()

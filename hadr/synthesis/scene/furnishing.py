"""Things that lie and stand about, and the textures that cover them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from hadr.camera import Array
from hadr.synthesis.glass.surfaces import Surface
from hadr.synthesis.scene.stage import Stage
from hadr.synthesis.textures.families import FAMILIES, FEW, VARIANTS, texture_number

#: Against gravity, world frame.
UP = np.array([0.0, 0.0, 1.0])


class TextureChoice:
    """Draws textures for one scene, each used for several things."""

    def __init__(self, rng: np.random.Generator, photographs: int) -> None:
        self.rng, self.photographs = rng, photographs
        self.kept: list[int] = []

    def draw(self, names: Sequence[str], odds: Sequence[float], variants: int = VARIANTS) -> int:
        """One of some families' variants, with unlike odds."""
        odds_of_each = np.asarray(odds, dtype=float) / np.sum(odds)
        name = names[int(self.rng.choice(len(names), p=odds_of_each))]
        return texture_number(name, int(self.rng.integers(variants)))

    def view(self) -> int:
        """A backdrop."""
        if self.photographs:
            return -1 - int(self.rng.integers(self.photographs))
        names = [f.name for f in FAMILIES if f.place == "view"] + ["leaf_wall", "flowers"]
        weight = {"garden": 3.2, "room": 3.2, "foliage": 1.6, "bookshelf": 1.8, "leaf_wall": 1.4}
        weight |= {"painting": 0.4, "magazine": 0.4}
        return self.draw(names, [weight.get(name, 1.0) for name in names])

    def ground(self) -> int:
        """What a table or a floor is made of; a view in one case of three."""
        if self.rng.random() < 0.32:
            return self.view()
        names = ["wood", "tiles", "marble", "terrazzo", "plaid", "print_cloth", "carpet"]
        names += ["pebbles", "grass", "plaster"]
        return self.draw(names, [3.2, 1.0, 1.2, 0.3, 0.5, 0.4, 0.6, 0.6, 0.5, 2.4])

    def wall(self) -> int:
        """A wall beside the backdrop."""
        names = ["wood", "boards", "shingles", "plaster", "tiles", "bookshelf", "leaf_wall"]
        return self.draw(names, [1.2, 1.6, 1.0, 2.0, 0.6, 1.4, 0.8])

    def thing(self) -> int:
        """What a small thing is covered with; few different ones a scene."""
        if len(self.kept) == 3:
            return int(self.rng.choice(self.kept))
        names = ["wood", "plaid", "print_cloth", "magazine", "marble", "terrazzo"]
        names += ["painting", "plaster", "big_leaves"]
        self.kept.append(self.draw(names, [1.4, 0.4, 0.3, 0.6, 0.7, 0.2, 0.4, 3.2, 0.2], FEW))
        return self.kept[-1]


def is_view(number: int) -> bool:
    """Whether a texture shows a place as it is seen from afar; photographs do."""
    return number < 0 or FAMILIES[number % len(FAMILIES)].place == "view"


def natural_size(number: int) -> float:
    """Height of what a texture shows, metres."""
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
    season = texture_number("leaf_wall", int(rng.integers(FEW)))
    for _ in range(int(rng.integers(12, 30))):
        azimuth, rise = rng.uniform(0, 2 * np.pi), rng.uniform(0.2, 1.35)
        length, width = size * rng.uniform(0.5, 1.0), size * rng.uniform(0.06, 0.13)
        t = np.linspace(0, 1, 6)
        out = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        side = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        high = t * np.sin(rise) - rng.uniform(0.2, 0.9) * t**2 * 0.5
        line = place + length * (t[:, None] * np.cos(rise) * out + high[:, None] * UP)
        half = (width * np.sin(np.pi * np.clip(t, 0.03, 0.97)) ** 0.7)[:, None]
        vertices = np.stack([line - half * side, line + half * side], axis=1).reshape(-1, 3)
        tangent = np.gradient(line, axis=0)
        normal = np.cross(tangent, side)
        normal *= np.sign(normal[:, 2:] + 1e-9) / np.linalg.norm(normal, axis=1, keepdims=True)
        i = 2 * np.arange(5)
        faces = np.concatenate([np.stack([i, i + 2, i + 1], 1), np.stack([i + 1, i + 2, i + 3], 1)])
        spot = rng.random(2)
        uv = spot + np.stack([np.tile([0.0, 0.05], 6), np.repeat(0.15 * t, 2)], axis=1)
        leaf = Surface(vertices, faces, np.repeat(normal, 2, axis=0))
        stage.add(leaf, uv, season, 0.9)
    if number >= 0:
        height = 0.28 * size
        stage.revolved(_vase(rng, 0.16 * size, height), place - height * UP, number, 0.5)


def put_thing(stage: Stage, choice: TextureChoice, place: Array, size: float) -> None:
    """Put one thing of about a size onto a place."""
    rng = choice.rng
    kind, number = rng.random(), choice.thing()
    repeat = natural_size(number) * rng.uniform(0.25, 0.6)
    if kind < 0.40:
        # A pile of books or boxes.
        level = place.copy()
        half = size * rng.uniform(0.35, 1.0, 3) * np.array([1.0, 1.0, rng.choice([0.25, 0.9])])
        for _ in range(int(rng.integers(1, 5)) if half[2] < 0.3 * size else 1):
            pose = np.eye(4)
            pose[:3, :3] = Rotation.from_euler("z", rng.uniform(0, np.pi)).as_matrix()
            pose[:3, 3] = level + half[2] * UP
            stage.box(pose, half, number, repeat, rng.random(2))
            level = level + 2 * half[2] * UP
            number = choice.thing()
    elif kind < 0.62:
        stage.revolved(_vase(rng, size * rng.uniform(0.35, 0.7), size * 2), place, number, repeat)
    elif kind < 0.76:
        radius = size * rng.uniform(0.5, 0.9)
        stage.revolved(_ball(radius, rng.uniform(0.6, 1.0)), place, number, repeat)
    else:
        _plant(stage, rng, place + 0.5 * size * UP, size * rng.uniform(1.6, 2.6), number)


def put_sheet(stage: Stage, choice: TextureChoice, place: Array) -> None:
    """A magazine, a cloth or a print that lies on the table."""
    rng = choice.rng
    names = ["magazine", "painting", "print_cloth", "plaid", "carpet"]
    number = choice.draw([*names, "garden", "room"], [2, 0.4, 0.4, 0.6, 0.3, 1, 1], FEW)
    if choice.photographs and rng.random() < 0.6:
        number = choice.view()
    tall = rng.uniform(0.16, 0.5)
    wide = tall * stage.aspect(number)
    rotation = Rotation.from_euler("z", rng.uniform(0, 2 * np.pi)).as_matrix()
    right, down = rotation @ [wide, 0, 0], rotation @ [0, -tall, 0]
    corner = place - right / 2 - down / 2 + rng.uniform(0.001, 0.003) * UP
    stage.quad(corner, right, down, number, tall, np.zeros(2))

"""The room in which the robot stands: its table with a patterned cloth, floor, walls and light.

Robot's base frame: the table's top is z = 0, the human stands beyond its edge at x = 0.42 m. Every
ray of a camera beside the robot ends on something.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hadr.camera import Array
from hadr.records.caches import kept
from hadr.simulation.robot.arm_shape import FLOOR, TABLE_FAR, TABLE_NEAR, Part
from hadr.simulation.world.scenes import MIDDLE
from hadr.synthesis.glass.surfaces import merged
from hadr.synthesis.scene.contents import Surroundings
from hadr.synthesis.scene.furnishing import UP, TextureChoice, natural_size, put_thing
from hadr.synthesis.scene.lights import AreaLight, Environment, make_lights
from hadr.synthesis.scene.stage import Stage
from hadr.synthesis.textures.families import pyramid, texture_number

_TABLE_LOWER: Array = np.array([TABLE_NEAR, -0.65, -0.04])
_TABLE_UPPER: Array = np.array([TABLE_FAR, 0.65, 0.0])
BESIDE, BEYOND = 1.7, 2.1
"""The walls' distances from the robot to either side, and beyond the human, metres."""
_TALL = 2.6
_PLAIN = texture_number("plaster", 2)


@dataclass(frozen=True)
class Room:
    """What stands around robot and human, in the base frame, and the light, near and far."""

    surroundings: Surroundings
    environment: Environment
    lamps: tuple[AreaLight, ...]


@kept(8)
def make_room(number: int) -> Room:
    """Furnish a room; its number chooses cloth, walls, things and light."""
    rng = np.random.default_rng([number, 71])
    stage, choice = Stage(), TextureChoice(rng, 0)
    _add_table(stage, rng)
    _add_floor_and_walls(stage, choice, rng)
    _add_sideboard(stage, choice, rng)
    # the light comes as in the training pictures: from behind and above a camera
    environment, lamps = make_lights(np.array([0.2, 0.1, 0.7]), MIDDLE, rng)
    return Room(stage.surroundings(), environment, lamps)


def _add_table(stage: Stage, rng: np.random.Generator) -> None:
    cloth = texture_number("plaid" if rng.random() < 0.5 else "print_cloth", int(rng.integers(6)))
    pose = np.eye(4)
    pose[:3, 3] = (_TABLE_LOWER + _TABLE_UPPER) / 2
    half = (_TABLE_UPPER - _TABLE_LOWER) / 2
    stage.box(pose, half, cloth, natural_size(cloth), rng.random(2))


def _add_floor_and_walls(stage: Stage, choice: TextureChoice, rng: np.random.Generator) -> None:
    floor = texture_number(str(rng.choice(["wood", "tiles", "carpet"])), int(rng.integers(6)))
    wide = BESIDE + 0.1
    stage.quad(
        np.array([-2.0, wide, FLOOR]),
        np.array([BEYOND + 2.1, 0.0, 0.0]),
        np.array([0.0, -2 * wide, 0.0]),
        floor,
        natural_size(floor),
        rng.random(2),
    )
    kinds = ["boards", "plaster", "tiles", "shingles", "bookshelf", "leaf_wall"]
    top = FLOOR + _TALL
    corners = {
        (BEYOND, BESIDE, top): (0.0, -2 * BESIDE, 0.0),
        (-2.0, BESIDE, top): (BEYOND + 2.0, 0.0, 0.0),
        (BEYOND, -BESIDE, top): (-BEYOND - 2.0, 0.0, 0.0),
        (-2.0, -BESIDE, top): (0.0, 2 * BESIDE, 0.0),
    }
    for corner, right in corners.items():
        wall = texture_number(str(rng.choice(kinds)), int(rng.integers(6)))
        size = natural_size(wall)
        stage.quad(np.array(corner), np.array(right), -_TALL * UP, wall, size, rng.random(2))


def _add_sideboard(stage: Stage, choice: TextureChoice, rng: np.random.Generator) -> None:
    """Low boards along two walls, with things on them."""
    wood = texture_number("wood", int(rng.integers(6)))
    for middle, half in (
        (np.array([0.8, -BESIDE + 0.25, -0.35]), np.array([0.9, 0.22, 0.40])),
        (np.array([BEYOND - 0.25, -0.2, -0.35]), np.array([0.22, 1.1, 0.40])),
    ):
        pose = np.eye(4)
        pose[:3, 3] = middle
        stage.box(pose, half, wood, natural_size(wood), rng.random(2))
        for _ in range(6):
            spot = middle + rng.uniform(-0.9, 0.9, 3) * half
            spot[2] = middle[2] + half[2]
            put_thing(stage, choice, spot, float(rng.uniform(0.07, 0.15)))


def with_parts(room: Surroundings, parts: Sequence[Part]) -> Surroundings:
    """Put parts into a room."""
    stage = Stage()
    for surface, _ in parts:
        stage.add(surface, np.zeros((len(surface.vertices), 2)), _PLAIN, 1.0)
    added = stage.surroundings()
    tints = [np.tile(color / _plain_color(), (len(surface.faces), 1)) for surface, color in parts]
    return Surroundings(
        merged([room.surface, added.surface]),
        np.concatenate([room.uv, added.uv]),
        np.concatenate([room.texture, added.texture]),
        np.concatenate([room.tint, *tints]),
        np.concatenate([room.repeat, added.repeat]),
    )


@kept(1)
def _plain_color() -> Array:
    """Linear RGB of the nearly even picture that plain parts are tinted from, shape (3,)."""
    mean = pyramid(_PLAIN)[-1].reshape(-1, 3).astype(float).mean(axis=0) / 255
    return np.asarray(mean**2.2)

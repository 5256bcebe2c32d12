"""What stands around a held thing: a far backdrop, a floor, walls, a table, things on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from hadr.camera import Array
from hadr.synthesis.scene.contents import Surroundings
from hadr.synthesis.scene.furnishing import (
    UP,
    TextureChoice,
    is_view,
    natural_size,
    put_sheet,
    put_thing,
)
from hadr.synthesis.scene.stage import Stage

#: Distance of the last backdrop from the camera, metres.
FARTHEST = 5.0
#: Angle to either side to which it reaches, radians, and the number of its panels.
_REACH, _PANELS = 1.9, 20


@dataclass(frozen=True)
class _View:
    """Where the camera is and what is ahead of it, world frame, metres."""

    eye: Array
    middle: Array  # what it looks at
    flat: Array  # level unit direction ahead
    side: Array  # level unit direction to the right
    distance: float  # from the camera to the middle
    floor: float  # the floor's height


def _add_backdrop(stage: Stage, choice: TextureChoice, view: _View) -> None:
    """Half a cylinder around the camera, where whatever passes all else ends."""
    rng = choice.rng
    number = choice.view()
    angles = np.linspace(-_REACH, _REACH, _PANELS + 1)
    ring = [view.eye + FARTHEST * (np.cos(a) * view.flat + np.sin(a) * view.side) for a in angles]
    top = view.eye[2] + 5.0
    # The texture stands on the floor once; what is above it is drawn out to the top.
    height = min(float(rng.uniform(3.4, 5.5)), top - view.floor - 0.1)
    across = FARTHEST * 2 * _REACH / _PANELS
    wide = across / (height * stage.aspect(number))
    # Ahead stands about the middle of a texture, not a mirror's line.
    start = 20 + 0.5 + rng.uniform(-0.2, 0.2) - _PANELS / 2 * wide
    drawn_out = np.array([0, 0, view.floor + height - top])
    for k in range(_PANELS):
        corner = np.array([*ring[k][:2], top])
        right = np.array([*(ring[k + 1] - ring[k])[:2], 0.0])
        if is_view(number):
            left = start + k * wide
            stage.mirrored(corner + drawn_out, right, UP * -height, number, height, left)
            stage.mirrored(corner, right, drawn_out, number, height, left, (0.002, 0.004))
        else:
            grain = natural_size(number)
            offset = np.array([k * across / (grain * stage.aspect(number)), 0.0])
            stage.quad(corner, right, UP * (view.floor - top), number, grain, offset)


def _add_floor(stage: Stage, choice: TextureChoice, view: _View) -> None:
    rng = choice.rng
    number = choice.ground()
    reach = FARTHEST + 0.3
    repeat = natural_size(number) * float(rng.uniform(0.8, 1.6))
    heading = rng.choice([0.0, np.pi / 2]) + rng.normal() * 0.4
    rotation = Rotation.from_euler("z", heading).as_matrix()
    corner = np.array([*view.eye[:2], view.floor]) + rotation @ [-1.5 * reach, 1.5 * reach, 0]
    right, down = rotation @ [3 * reach, 0, 0], rotation @ [0, -3 * reach, 0]
    stage.quad(corner, right, down, number, repeat, rng.random(2))


def _add_walls(stage: Stage, choice: TextureChoice, view: _View, beyond: float) -> None:
    """A wall so far beyond what is held, and often one beside it as in a room's corner."""
    rng, floor = choice.rng, view.floor
    yaw = float(np.clip(rng.normal() * 0.35, -0.6, 0.6))
    along = np.cos(yaw) * view.side + np.sin(yaw) * view.flat
    center = np.array([view.middle[0], view.middle[1], 0.0]) + beyond * view.flat
    distance = beyond + view.distance
    number = choice.view() if rng.random() < 0.7 else choice.wall()
    left, right = -rng.uniform(0.8, 3.0), rng.uniform(0.8, 3.0)
    across = (right - left) * along
    tall = 3.4
    if is_view(number):
        # The texture fills the wall's height once.
        tall = float(np.clip(0.65 * distance * rng.uniform(1.0, 1.9), 1.1, 3.6))
        sight = view.eye[2] + (view.middle[2] - view.eye[2]) * distance / view.distance
        bottom = max(float(sight - tall * rng.uniform(0.35, 0.6)), floor)
        corner = np.array([*(center + left * along)[:2], bottom + tall])
        ahead_at = -left / (tall * stage.aspect(number))
        start = 20.5 + rng.uniform(-0.25, 0.25) - ahead_at
        stage.mirrored(corner, across, -tall * UP, number, tall, start)
    else:
        corner = np.array([*(center + left * along)[:2], floor + tall])
        stage.quad(corner, across, -tall * UP, number, natural_size(number), rng.random(2))
    sign = rng.choice([-1.0, 1.0])
    end = right if sign > 0 else left
    # Not where it would stand before the camera or cut through what is held.
    if rng.random() < 0.6 and sign * (end + beyond * np.sin(yaw)) > 0.6:
        number = choice.wall()
        edge = center + end * along
        toward = -np.cos(yaw) * view.flat + np.sin(yaw) * view.side
        toward = toward / np.linalg.norm(toward)
        ends = (edge, edge + 1.8 * toward) if sign > 0 else (edge + 1.8 * toward, edge)
        corner = np.array([*ends[0][:2], floor + tall])
        size = natural_size(number)
        stage.quad(corner, ends[1] - ends[0], -tall * UP, number, size, rng.random(2))


def _add_table(stage: Stage, choice: TextureChoice, view: _View, lowest: float) -> float:
    """A table under what is held, with sheets on it; gives its height."""
    rng = choice.rng
    level = lowest - float(rng.choice([rng.uniform(0.004, 0.03), rng.uniform(0.03, 0.3)]))
    level = min(level, float(view.eye[2]) - 0.08)
    half = np.array([rng.uniform(0.5, 1.1), rng.uniform(0.45, 0.8), 0.02])
    pose = np.eye(4)
    heading = np.arctan2(view.flat[1], view.flat[0]) + np.pi / 2 + rng.normal() * 0.5
    pose[:3, :3] = Rotation.from_euler("z", heading).as_matrix()
    away = view.middle + view.flat * rng.uniform(0.0, 0.35) + view.side * rng.normal() * 0.2
    pose[:3, 3] = [away[0], away[1], level - 0.02]
    number = choice.ground()
    size = natural_size(number) * float(rng.uniform(0.6, 1.2))
    stage.box(pose, half, number, size, rng.random(2))
    for _ in range(int(rng.integers(1, 5))):
        spot = view.middle + view.flat * rng.uniform(-0.15, 0.6)
        spot = spot + view.side * rng.uniform(-0.45, 0.45)
        put_sheet(stage, choice, np.array([spot[0], spot[1], level]))
    return level


def _add_things(
    stage: Stage, choice: TextureChoice, view: _View, level: float, beyond: float
) -> None:
    """Things on table or floor, none of them in hand or glass or right before the camera."""
    rng = choice.rng
    on_table = level > view.floor
    for _ in range(int(rng.integers(5, 12))):
        ahead = float(rng.uniform(0.3, 0.9 if level >= view.floor + 0.01 else 0.95 * beyond))
        spread = 0.55 * (ahead + view.distance)
        spot = view.middle + view.flat * ahead + view.side * rng.uniform(-spread, spread)
        size = float(rng.uniform(0.04, 0.11)) * (1.0 if on_table else 2.2)
        place = np.array([spot[0], spot[1], level])
        if np.linalg.norm(place[:2] - view.middle[:2]) >= 0.17 + 1.5 * size:
            put_thing(stage, choice, place, size)


def make_surroundings(
    eye: Array,
    middle: Array,
    lowest: float,
    rng: np.random.Generator,
    photographs: Sequence[Path] = (),
) -> Surroundings:
    """Put up a place around what is held: every ray of the camera ends on something.

    The camera at ``eye`` looks at ``middle``; hand and glass stay above the height ``lowest``, and
    nothing comes between them and the camera. World frame, metres.
    """
    stage = Stage(tuple(photographs))
    choice = TextureChoice(rng, len(photographs))
    ahead = middle - eye
    flat = np.array([ahead[0], ahead[1], 0.0])
    flat = flat / max(float(np.linalg.norm(flat)), 1e-6)
    side = np.array([flat[1], -flat[0], 0.0])
    floor = min(lowest - 0.05, -rng.uniform(0.35, 1.1), eye[2] - 0.3)
    view = _View(eye, middle, flat, side, float(np.linalg.norm(ahead)), float(floor))
    _add_backdrop(stage, choice, view)
    _add_floor(stage, choice, view)
    beyond = float(rng.uniform(0.9, 3.2))
    if rng.random() < 0.75:
        _add_walls(stage, choice, view, beyond)
    level = view.floor
    if lowest > -0.35 and rng.random() < 0.72:
        level = _add_table(stage, choice, view, lowest)
    _add_things(stage, choice, view, level, beyond)
    return stage.surroundings()

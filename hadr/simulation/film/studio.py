"""What stands around robot and hand in a film: the table, the light, a sleeve."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from hadr.camera import Array
from hadr.records.caches import kept
from hadr.simulation.camera.room import Room
from hadr.simulation.robot.arm_shape import FLOOR, TABLE_FAR, TABLE_NEAR, Part
from hadr.synthesis.glass.surfaces import Surface, revolve
from hadr.synthesis.scene.furnishing import natural_size
from hadr.synthesis.scene.lights import AreaLight, Environment
from hadr.synthesis.scene.stage import Stage
from hadr.synthesis.textures.families import texture_number

TABLE_HALF_WIDTH = 0.45
"""Along y, metres: a wider table would hide the view from the side."""
_KEY: Array = np.array([-0.36, -0.53, 0.77])
_KEY_FAR, _KEY_HALF = 6.0, 0.15
_CUFF_AT = 0.17
_NAVY = (0.055, 0.10, 0.20)


@kept(1)
def studio() -> Room:
    """The robot's table, in the base frame, before an even wall."""
    stage = Stage()

    wood = texture_number("wood", 4)

    def box(low: tuple[float, ...], high: tuple[float, ...]) -> None:
        pose, half = np.eye(4), np.subtract(high, low) / 2
        pose[:3, 3] = np.add(low, high) / 2
        stage.box(pose, half, wood, natural_size(wood), np.zeros(2))

    x0, x1, y = TABLE_NEAR, TABLE_FAR, TABLE_HALF_WIDTH
    box((x0, -y, -0.035), (x1, y, 0.0))
    for x in (x0 + 0.03, x1 - 0.08):
        for side in (-y + 0.03, y - 0.08):
            box((x, side, FLOOR), (x + 0.05, side + 0.05, -0.035))
    across = np.cross([0.0, 0.0, 1.0], -_KEY)
    half_width = _KEY_HALF * across / np.linalg.norm(across)
    half_height = np.cross(-_KEY, half_width)
    white = np.array([1300.0, 1250.0, 1170.0])
    lamp = AreaLight(_KEY_FAR * _KEY, half_width, half_height, white)
    return Room(stage.surroundings(), Environment(_wall_and_panels()), (lamp,))


def _wall_and_panels() -> npt.NDArray[np.float32]:
    """Radiance from all sides: the views look along y, at a pale wall.

    Glass has dark outlines, since it is dark to the sides, and mirrors two bright panels.
    """
    far = Environment(np.zeros((128, 256, 3), dtype=np.float32)).directions()
    x, y, z = np.moveaxis(far, -1, 0)
    low, high = np.array([[0.74, 0.78, 0.80], [0.40, 0.48, 0.56]])
    light = low + np.clip(1.6 * z + 0.45, 0.0, 1.0)[..., None] * (high - low)
    light *= 1.0 - 0.80 * np.clip((0.76 - y) / 0.35, 0.0, 1.0)[..., None]
    bearing = np.arctan2(x, -y)
    light[(np.abs(bearing + 0.75) < 0.30) & (np.abs(z - 0.45) < 0.22)] += 4.5
    light[(np.abs(bearing - 1.3) < 0.16) & (np.abs(z - 0.3) < 0.35)] += 3.0
    return np.asarray(light, dtype=np.float32)


def sleeve(arm: Surface) -> Part:
    """A sleeve over the forearm, which lies along minus y; both in the wrist frame, metres."""
    end = 0.02 - float(arm.vertices[:, 1].min())
    forearm = arm.vertices[arm.vertices[:, 1] < 0.03 - _CUFF_AT] * [1, -1, 1]
    x, z = (forearm.min(axis=0) + forearm.max(axis=0))[[0, 2]] / 2
    along = np.linspace(_CUFF_AT, end, 60)
    near = [np.abs(forearm[:, 1] - min(at, end - 0.03)) < 0.02 for at in along]
    half = np.array([np.abs(forearm[n][:, [0, 2]] - [x, z]).max(axis=0) for n in near]) + 0.014

    def radius(angle: Array, curve: Array) -> Array:
        share, at = np.moveaxis(curve, -1, 0)
        a, b = (np.interp(at, along, column) for column in half.T)
        # folds of the cloth: shallow waves along and around
        folds = 0.0012 * np.sin(163 * at + 2.4 * np.sin(angle + 9 * at))
        folds += 0.0014 * np.sin(47 * at + 3 * angle)
        return np.asarray(share * (a * b / np.hypot(b * np.cos(angle), a * np.sin(angle)) + folds))

    outline = [(0.0, _CUFF_AT), (0.8, _CUFF_AT), *((1.0, at) for at in along), (0.0, end)]
    along_minus_y = np.array([[1, 0, 0, x], [0, 0, -1, 0], [0, 1, 0, z], [0, 0, 0, 1]])
    return revolve(np.array(outline), radius, 40).moved(along_minus_y), _NAVY

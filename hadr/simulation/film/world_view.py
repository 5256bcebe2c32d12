"""A picture of the whole world from beside the table: robot, hand, sleeve, glass and cloth.

For people, not for the robot: what the robot's camera sees is made elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from hadr.camera import Intrinsics, pixel_grid
from hadr.handover.poses import camera_at
from hadr.simulation.film.world_light import Moment, Seen, Solid, rolled_off, room_seen, shade
from hadr.simulation.film.world_parts import (
    ARM,
    CLOTH,
    FLOOR,
    GLASS,
    HAND,
    NOTHING,
    Piece,
    sleeve,
    table,
)
from hadr.simulation.robot.arm_shape import arm_surfaces
from hadr.simulation.world.scenes import HeldScene
from hadr.simulation.world.state import WorldState

Array = npt.NDArray[Any]
Picture = npt.NDArray[np.uint8]

_HAND_STEP = 0.0035


@dataclass(frozen=True)
class View:
    """From where the world is looked at: pose (4, 4) of an OpenCV camera, metres."""

    base_from_camera: Array
    camera: Intrinsics


def view_from(
    eye: tuple[float, float, float],
    look_at: tuple[float, float, float],
    *,
    width: int = 640,
    height: int = 360,
    across: float = 1.4,
) -> View:
    """A view from an eye at a point (base frame, metres), so many metres wide at that point."""
    distance = float(np.linalg.norm(np.subtract(look_at, eye)))
    focal = width * distance / across
    camera = Intrinsics(focal, focal, (width - 1) / 2, (height - 1) / 2, width, height)
    return View(camera_at(np.array(eye), np.array(look_at)), camera)


def side_view(width: int = 640, height: int = 360) -> View:
    """Robot at the left, human at the right: the film's standard view."""
    return view_from((0.72, -1.6, 0.80), (0.36, 0.0, 0.32), width=width, height=height, across=1.55)


def close_view(point: tuple[float, float, float], width: int = 640, height: int = 360) -> View:
    """The same side, near to a point (base frame, metres), for what the fingers do."""
    x, y, z = point
    eye = (x - 0.05, y - 0.75, z + 0.28)
    return view_from(eye, point, width=width, height=height, across=0.46)


class FilmSet:
    """One held scene, looked at from one view, the side view if left out: draws any moment."""

    def __init__(self, scene: HeldScene, view: View | None = None) -> None:
        self.view = view or side_view()
        self._scene = self._shown = scene
        self._hand = scene.hand(step=_HAND_STEP)
        self._sleeve = sleeve(self._hand.surface)
        self._glass = scene.glass()
        self._tint = tuple(share**2.5 for share in scene.item.transmittance)
        self._room = Solid(table())
        self._uv = pixel_grid(self.view.camera).reshape(-1, 2).astype(np.float32)
        self._lamp = (self._uv[:, 0] % 4 + 4 * (self._uv[:, 1] % 4)).astype(np.int64)
        self._rays = self._cast(self._uv)
        self._still = room_seen(self._room, *self._rays)
        unshadowed = np.ones(len(self._uv), dtype=np.float32)
        self._far = shade(self._still, self._rays[1], unshadowed)  # of use for wall and floor

    def _cast(self, uv: Array) -> tuple[Array, Array]:
        """Origins and unit directions of rays through pixel coordinates (N, 2), float32."""
        camera, pose = self.view.camera, self.view.base_from_camera
        local = np.ones((len(uv), 3), dtype=np.float32)
        local[:, :2] = (uv - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
        local /= np.sqrt((local**2).sum(1, keepdims=True))
        directions = local @ pose[:3, :3].T.astype(np.float32)
        origins = np.tile(pose[:3, 3].astype(np.float32), (len(uv), 1))
        return origins, directions

    def draw(self, state: WorldState) -> Picture:
        """Draw one moment: sRGB, shape (H, W, 3) uint8."""
        return self.render(state)[0]

    def render(self, state: WorldState) -> tuple[Picture, npt.NDArray[np.int64]]:
        """Draw one moment, see `draw`, and say what each pixel's centre shows: ARM, HAND, ..."""
        glass = tuple(body.moved(state.base_from_object) for body in self._glass)
        moment = Moment(self._room, Solid(self._pieces(state)), glass, self._tint)
        shape = self.view.camera.shape
        origins, directions = self._rays
        seen = moment.things.meet(origins, directions, self._still)
        lit = _smooth(moment.lit(seen, self._lamp), seen.kind, shape)
        near = np.flatnonzero((seen.kind != NOTHING) & (seen.kind != FLOOR))
        color = self._far.copy()
        color[near] = shade(seen.take(near), directions[near], lit[near])
        kind = seen.kind.copy()
        rows, through = moment.through_glass(origins, directions, seen.distance)
        color[rows], kind[rows] = through, GLASS
        color = rolled_off(color)
        edge = np.flatnonzero(_edges(kind, seen, shape))
        spread = np.array([(-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)])
        uv = (self._uv[edge, None] + spread.astype(np.float32)).reshape(-1, 2)
        origins, directions = self._cast(uv)
        fine = moment.meet(origins, directions)
        lamp = (self._lamp[edge, None] + np.array([0, 5, 10, 15])).ravel() % 16
        light = shade(fine, directions, moment.lit(fine, lamp))
        rows, through = moment.through_glass(origins, directions, fine.distance)
        light[rows] = through
        color[edge] = rolled_off(light).reshape(-1, 4, 3).mean(axis=1)
        srgb = np.clip(color, 0, 1) ** np.float32(1 / 2.2) * 255
        return srgb.round().astype(np.uint8).reshape(*shape, 3), kind.reshape(shape)

    def _pieces(self, state: WorldState) -> list[Piece]:
        """Arm, hand and sleeve where they are."""
        parts = arm_surfaces(state.joints, state.gripper_width)
        shown = self._scene.opened(state.opened)
        if shown is not self._shown:
            self._shown, self._hand = shown, shown.hand(step=_HAND_STEP)
        cuff, blue, _ = self._sleeve
        pieces: list[Piece] = [(surface, np.array([color]), ARM) for surface, color in parts]
        hand = self._hand.surface.moved(state.base_from_wrist)
        pieces.append((hand, self._hand.albedo, HAND))
        pieces.append((cuff.moved(state.base_from_wrist), blue, HAND))
        return pieces


def _smooth(lit: Array, kinds: npt.NDArray[np.int64], shape: tuple[int, int]) -> Array:
    """Average the 16 places of the lamp over 4 x 4 pixels that show the same kind of thing."""
    kind, light = kinds.reshape(shape), lit.reshape(shape)
    result = light.copy()
    for number in (ARM, HAND, CLOTH):
        here = (kind == number).astype(np.float32)
        share = cv2.blur(light * here, (4, 4)) / np.maximum(cv2.blur(here, (4, 4)), 1e-6)
        result = np.where(kind == number, share, result)
    return np.asarray(result.ravel())


def _edges(
    kind: npt.NDArray[np.int64], seen: Seen, shape: tuple[int, int]
) -> npt.NDArray[np.bool_]:
    """Pixels whose neighbours show something else: another kind, distance, normal or colour."""
    k, tint = kind.reshape(shape), seen.albedo.sum(1).reshape(shape)
    z = np.where(np.isfinite(seen.distance), seen.distance, 9.0).reshape(shape)
    n = seen.normal.reshape(*shape, 3)
    edge = np.zeros(shape, dtype=bool)
    for axis in (0, 1):
        a, b = (slice(None, -1), slice(1, None))
        first, second = ((a,), (b,)) if axis == 0 else ((slice(None), a), (slice(None), b))
        differs = k[first] != k[second]
        differs |= np.abs(z[first] - z[second]) > 0.02
        solid = (k[first] == ARM) | (k[first] == HAND)
        differs |= solid & ((n[first] * n[second]).sum(-1) < 0.8)
        differs |= (k[first] == ARM) & (np.abs(tint[first] - tint[second]) > 0.1)
        differs |= (k[first] == GLASS) & ((n[first] * n[second]).sum(-1) < 0.9)
        edge[first] |= differs
        edge[second] |= differs
    return edge.ravel()

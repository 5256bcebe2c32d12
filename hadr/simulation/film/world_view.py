"""A picture of the whole world from beside the table: robot, hand, sleeve, glass and table.

For people, not for the robot, but drawn as its camera draws, by `MovingView`.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from hadr.camera import Array, Intrinsics, pixel_grid
from hadr.handover.poses import camera_at
from hadr.simulation.camera.moving_view import MovingView
from hadr.simulation.film.studio import sleeve, studio
from hadr.simulation.robot.arm_shape import arm_surfaces
from hadr.simulation.world.scenes import HeldScene
from hadr.simulation.world.state import WorldState
from hadr.synthesis.rendering.color_camera import film
from hadr.synthesis.rendering.raycast import rays_through

Picture = npt.NDArray[np.uint8]

_EDGE = 0.08
"""Pixels that differ by more from a neighbour, of 1, are drawn again with four rays."""
_CORNERS: Array = np.array([(-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)])


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


class _FilmView(MovingView):
    """Whatever is opaque throws a shadow, soft and the same in each picture, without noise."""

    def _sunlit(
        self, points: Array, key: Array, rng: np.random.Generator, wanted: npt.NDArray[np.bool_]
    ) -> Array:
        lit, rows = np.ones(len(points)), np.flatnonzero(wanted)
        lamp, start = self.contents.lamps[0], points[rows]
        for a, b in 2 * _CORNERS:
            place = lamp.center + a * lamp.half_width + b * lamp.half_height
            lit[rows] -= (self._trace(self._solid, start, place - start).mesh >= 0) / len(_CORNERS)
        return lit

    def _openness(self, points: Array, normal: Array, rng: np.random.Generator) -> Array:
        return np.full(len(points), 0.85)


class FilmSet:
    """One held scene, looked at from one view, the side view if left out: draws any moment."""

    def __init__(self, scene: HeldScene, view: View | None = None) -> None:
        self.view = view or side_view()
        self._scene = self._shown = scene
        self._drawn = _FilmView(scene, studio())
        self._cuff, self._navy = sleeve(scene.hand().surface)

    def at(self, state: WorldState) -> MovingView:
        """The scene at one moment; the sleeve counts as part of the arm."""
        shown = self._scene.opened(state.opened)
        if shown is not self._shown:
            self._shown, self._drawn = shown, _FilmView(shown, studio())
        wrist = state.base_from_wrist
        arm = arm_surfaces(state.joints, state.gripper_width)
        clothed = [*arm, (self._cuff.moved(wrist), self._navy)]
        return self._drawn.at(wrist, state.base_from_object, clothed)

    def draw(self, state: WorldState) -> Picture:
        """Draw one moment: sRGB, shape (H, W, 3) uint8."""
        moment, camera = self.at(state), self.view.camera
        rng = np.random.default_rng(0)  # asks for shadows, in which `_FilmView` draws nothing

        def light(uv: Array) -> Array:
            rays = rays_through(uv, camera, self.view.base_from_camera)
            return np.asarray(film(moment.radiance(*rays, 1.0 / camera.fx, rng)))

        uv = pixel_grid(camera)
        color = light(uv).reshape(*camera.shape, 3)
        around = cv2.morphologyEx(color ** (1 / 2.2), cv2.MORPH_GRADIENT, np.ones((3, 3)))
        edge = around.max(axis=2) > _EDGE
        color[edge] = light(uv[edge][:, None] + _CORNERS).reshape(-1, 4, 3).mean(axis=1)
        return np.rint(255 * color ** (1 / 2.2)).astype(np.uint8)

"""The camera beside the robot: where it stands, where it is believed to stand, and what it sees.

A third-person RGB-D camera that looks at the place where things are held out. Labels are exact by
ray casting, and the colour refracts in the glass.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from hadr.camera import TRANSHAND_CAMERA, Array, Intrinsics, project, transform_points
from hadr.handover.poses import camera_at
from hadr.simulation.camera.depth_sensor import Depth, DepthSensor, Mask
from hadr.simulation.camera.moving_view import MovingView
from hadr.simulation.camera.room import make_room
from hadr.simulation.robot.arm_shape import Part, arm_surfaces
from hadr.simulation.world.scenes import MIDDLE, HeldScene
from hadr.simulation.world.state import WorldState
from hadr.synthesis.glass.surfaces import merged
from hadr.synthesis.rendering.color_camera import ColorCamera, develop
from hadr.synthesis.rendering.raycast import search_tree

EYE: Array = np.array([0.32, 0.52, 0.54])
"""Where the camera stands in the base frame, metres: 0.64 m from `scenes.MIDDLE`, so far to the
side that a gripper at the object seldom hides the hand."""


UNDER_SKIN = 0.025
"""No keypoint lies deeper under its own skin, metres: a palm's half thickness and more."""


@dataclass(frozen=True)
class CapturedFrame:
    """One picture with its exact labels, see `SeenLabels`; all images (H, W).

    Attributes:
        color: sRGB, shape (H, W, 3) uint8, or None where no colour was asked for.
        raw_depth: Measured z-depth, metres, float32; 0 is missing.
        depth: True z-depth.
        background_depth: That of what is behind the object.
        hand_mask: The hand's and forearm's pixels.
        object_mask: The object's.
        arm_mask: The robot's, as it draws itself from its joints and where it believes the camera.
        keypoints: True keypoints, camera frame, metres, shape (21, 3).
        camera: The picture's intrinsics.
    """

    color: npt.NDArray[np.uint8] | None
    raw_depth: Depth
    depth: Depth
    background_depth: Depth
    hand_mask: Mask
    object_mask: Mask
    arm_mask: Mask
    keypoints: Array
    camera: Intrinsics


@dataclass(frozen=True)
class RobotCamera:
    """A third-person RGB-D camera.

    Attributes:
        base_from_camera: Where it really stands, shape (4, 4), metres.
        calibrated: Where the robot believes it stands; the truth where it is left out.
        room: Number of the room in which all of this happens.
    """

    base_from_camera: Array = field(default_factory=lambda: camera_at(EYE, MIDDLE))
    calibrated: Array | None = None
    room: int = 7
    intrinsics: ClassVar[Intrinsics] = TRANSHAND_CAMERA.resized(256, 144)
    _views: dict[int, tuple[HeldScene, MovingView]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    @property
    def calibration(self) -> Array:
        """base_from_camera as the robot knows it, shape (4, 4), metres."""
        return self.base_from_camera if self.calibrated is None else self.calibrated

    def miscalibrated(self, degrees: float, seed: int = 0) -> RobotCamera:
        """The same camera whose calibration is turned by an angle about an axis of that seed."""
        axis = np.random.default_rng([seed, 29]).normal(size=3)
        believed = self.base_from_camera.copy()
        turn = Rotation.from_rotvec(np.deg2rad(degrees) * axis / np.linalg.norm(axis))
        believed[:3, :3] = believed[:3, :3] @ turn.as_matrix()
        return replace(self, calibrated=believed)

    def capture(
        self,
        state: WorldState,
        scene: HeldScene,
        rng: np.random.Generator,
        *,
        color: bool = True,
    ) -> CapturedFrame:
        """Take a picture; `rng` draws the sensors' noise, colour takes most of the time."""
        color_rng, depth_rng = rng.spawn(2)  # the depth is the same with colour and without
        moved = self._view(scene.opened(state.opened))
        poses = state.base_from_wrist, state.base_from_object
        view = moved.at(*poses, self._arm_in_view(state, self.base_from_camera))
        labels = view.seen(self.intrinsics, self.base_from_camera)
        picture = None
        if color:
            light = view.light(self.intrinsics, self.base_from_camera, color_rng)
            picture = develop(light, color_rng, ColorCamera())
        raw = DepthSensor().measure(
            labels.depth, labels.background_depth, labels.object_mask, self.intrinsics, depth_rng
        )
        if self.calibrated is not None:
            believed = moved.at(*poses, self._arm_in_view(state, self.calibrated))
            drawn = believed.seen(self.intrinsics, self.calibrated).arm_mask
            labels = labels._replace(arm_mask=drawn)
        keypoints = self.true_keypoints(state, scene)
        return CapturedFrame(picture, raw, *labels, keypoints, self.intrinsics)

    def true_keypoints(self, state: WorldState, scene: HeldScene) -> Array:
        """The hand's keypoints in the camera frame, metres, shape (21, 3)."""
        moved = state.base_from_wrist @ np.linalg.inv(scene.base_from_wrist)
        camera_from_start = np.linalg.inv(self.base_from_camera) @ moved
        hand = scene.opened(state.opened).keypoints
        points: Array = transform_points(camera_from_start, hand)
        return points

    def visible(self, points: Array, state: WorldState) -> Mask:
        """Which points (n, 3), camera frame, metres, are in the picture and behind no arm, (n,)."""
        uv = project(points, self.intrinsics)
        size = [self.intrinsics.width - 0.5, self.intrinsics.height - 0.5]
        inside: Mask = (uv >= -0.5) & (uv <= size)  # NaN is outside
        found: Mask = np.asarray(inside.all(axis=1))
        here = self.base_from_camera
        parts = self._arm_in_view(state, here, uv[found]) if found.any() else []
        if parts:
            camera_from_base = np.linalg.inv(self.base_from_camera).astype(np.float64)
            arm = merged(tuple(surface for surface, _ in parts)).moved(camera_from_base)
            rays = points.astype(np.float32)  # the parameter along them is 1 at the point
            hits = search_tree(arm).run(np.zeros_like(rays), rays, query="INTERSECT", output=True)
            found = found & ((hits["primID"] < 0) | (hits["tfar"] > 1))
        return found

    def behind_hand_or_glass(self, points: Array, state: WorldState, scene: HeldScene) -> Mask:
        """Which points (n, 3) of the hand, camera frame, metres, skin or glass hides, (n,)."""
        view = self._view(scene.opened(state.opened))
        rays = points @ self.base_from_camera[:3, :3].T
        eyes = np.broadcast_to(self.base_from_camera[:3, 3], rays.shape)
        poses = state.base_from_wrist, state.base_from_object
        behind = 1.0 - view.first_at(*poses, eyes, rays).distance
        hidden: Mask = behind * np.linalg.norm(rays, axis=1) > UNDER_SKIN
        return hidden

    def _arm_in_view(
        self, state: WorldState, base_from_camera: Array, pixels: Array | None = None
    ) -> list[Part]:
        """The arm's parts that a ray of a camera there may meet: most of it is beside the picture.

        Of rays that lie among some pixels (n, 2), where they are given.
        """
        camera_from_base = np.linalg.inv(base_from_camera)
        # the picture is the part of space on the inner side of four planes through the camera
        c = self.intrinsics
        if pixels is None:
            pixels = np.array([[0, 0], [c.width - 1, c.height - 1]])
        left, top = (pixels.min(axis=0) - 0.5 - [c.cx, c.cy]) / [c.fx, c.fy]
        right, bottom = (pixels.max(axis=0) + 0.5 - [c.cx, c.cy]) / [c.fx, c.fy]
        inward = np.array([[1, 0, -left], [-1, 0, right], [0, 1, -top], [0, -1, bottom]])
        seen = []
        for part in arm_surfaces(state.joints, state.gripper_width):
            corners = transform_points(camera_from_base, part[0].vertices)
            if (corners @ inward.T > 0).any(axis=0).all():
                seen.append(part)
        return seen

    def _view(self, scene: HeldScene) -> MovingView:
        """The drawn scene, kept while the same scene is asked for."""
        kept = self._views.get(id(scene))
        if kept is None or kept[0] is not scene:
            self._views.clear()
            kept = (scene, MovingView(scene, make_room(self.room)))
            self._views[id(scene)] = kept
        return kept[1]

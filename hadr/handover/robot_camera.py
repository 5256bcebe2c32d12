"""The camera beside the robot: where it stands, what it sees, what its depth sensor measures.

A third-person RGB-D camera that looks at the place where things are held out. Labels are exact by
ray casting; the colour refracts in the glass; the depth fails on glass as that of the path-traced
stereo camera does (chapter 1).
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from hadr.camera import TRANSHAND_CAMERA, Intrinsics, project, transform_points
from hadr.corruption import edge_noise, see_through, smooth_noise, stereo_noise
from hadr.handover import ur5
from hadr.handover.arm_shape import Part, arm_surfaces
from hadr.handover.moving_view import MovingView, search_tree
from hadr.handover.rehearsal import camera_at
from hadr.handover.room import make_room
from hadr.handover.scenes import MIDDLE, HeldScene
from hadr.handover.world_state import WorldState
from hadr.synthesis.sensor_noise import ColorCamera, develop
from hadr.synthesis.surfaces import merged

Array = npt.NDArray[np.float64]
Depth = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]

EYE: Array = np.array([0.18, 0.44, 0.54])
"""Where the camera stands in the base frame, metres: 0.66 m from `scenes.MIDDLE`."""


@dataclass(frozen=True)
class DepthSensor:
    """How the depth sensor errs.

    The shares on glass are the means of the path-traced stereo camera's frames of held glasses in
    `data_samples` (validation): 75 % of the glass is missing, 19 % lies more than 1 cm behind the
    surface, most of it on what stands behind; 6 % is about right. Disparities are those of a D435
    (`hadr.synthesis.depth_camera`), given in its own pixels.

    Attributes:
        missing: Share of the glass without depth.
        behind: Share of it that shows what is behind the glass, or something in between.
        focal: The imagers' focal length, pixels.
        baseline: Their distance, metres.
        disparity_std: Standard deviation of the matching error, pixels.
        disparity_step: The matcher's step, pixels.
        lost: Share of other pixels that find no match.
        farthest: Larger depths are not reported, metres.
    """

    missing: float = 0.75
    behind: float = 0.19
    focal: float = 425.0
    baseline: float = 0.050
    disparity_std: float = 0.08
    disparity_step: float = 1 / 16
    lost: float = 0.03
    farthest: float = 4.0

    def measure(
        self,
        depth: Depth,
        background_depth: Depth,
        object_mask: Mask,
        camera: Intrinsics,
        rng: np.random.Generator,
    ) -> Depth:
        """Measure a depth image.

        Args:
            depth: True z-depth, metres, shape (H, W); 0 where there is none.
            background_depth: The same with the object taken away.
            object_mask: The glass, shape (H, W) bool.
            camera: Intrinsics of the images.
            rng: Draws the errors.

        Returns:
            Measured z-depth, metres, shape (H, W) float32; 0 where nothing is measured.
        """
        # what passes the glass is bent: the match lies between its surface and the background
        share = np.clip(1.15 + 0.45 * smooth_noise(depth.shape, 3.0, rng), 0.1, 1.0)
        apparent = (depth + share * (background_depth - depth)).astype(np.float32)
        seen = see_through(
            depth,
            apparent,
            object_mask,
            rng,
            missing_share=self.missing,
            background_share=self.behind,
            blob_px=2.0,
        )
        scale = camera.fx / self.focal  # the sensor's pixels are not the picture's
        raw = stereo_noise(
            seen,
            camera,
            rng,
            baseline_m=self.baseline,
            disparity_step=self.disparity_step * scale,
            disparity_std=self.disparity_std * scale,
        )
        raw = edge_noise(raw, rng, flying_share=0.15, shift_px=0.5)
        patches = smooth_noise(depth.shape, 2.0, rng)
        lost = patches > np.quantile(patches, 1 - self.lost)
        lost |= in_shadow(background_depth, camera.fx * self.baseline)
        lost |= raw > self.farthest
        return np.where(lost, 0, raw).astype(np.float32)


def in_shadow(depth: Depth, focal_baseline: float) -> Mask:
    """Pixels of the left imager that something nearer hides from the right one.

    Args:
        depth: z-depth, metres, shape (H, W); 0 counts as infinitely far.
        focal_baseline: Focal length in pixels times baseline in metres.

    Returns:
        Shape (H, W) bool: the band on the left of each foreground object.
    """
    disparity = focal_baseline / np.where(depth > 0, depth, np.inf)
    column = np.arange(depth.shape[1]) - disparity  # where the right imager sees it
    nearest = np.minimum.accumulate(column[:, ::-1], axis=1)[:, ::-1]
    hidden = np.zeros(depth.shape, dtype=bool)
    hidden[:, :-1] = nearest[:, 1:] <= column[:, :-1]
    return hidden


@dataclass(frozen=True)
class CapturedFrame:
    """One picture with its exact labels; all images (H, W).

    Attributes:
        time: When it was taken, seconds.
        color: sRGB, shape (H, W, 3) uint8, or None where no colour was asked for.
        raw_depth: Measured z-depth, metres, float32; 0 is missing.
        depth: True z-depth, metres, float32.
        background_depth: True z-depth with the object taken away.
        object_mask: The object's pixels.
        hand_mask: The hand's and forearm's pixels.
        arm_mask: The robot's pixels, also where the object is before it.
        keypoints: True keypoints, camera frame, metres, shape (21, 3).
        camera: Intrinsics.
    """

    time: float
    color: npt.NDArray[np.uint8] | None
    raw_depth: Depth
    depth: Depth
    background_depth: Depth
    object_mask: Mask
    hand_mask: Mask
    arm_mask: Mask
    keypoints: Array
    camera: Intrinsics


@dataclass(frozen=True)
class RobotCamera:
    """A third-person RGB-D camera.

    Attributes:
        base_from_camera: Where it really stands, shape (4, 4), metres.
        intrinsics: Of colour and depth.
        calibrated: Where the robot believes it stands; the truth where it is left out.
        room: Number of the room in which all of this happens.
        sensor: How its depth errs.
        see_arm: Draw the robot's arm.
    """

    base_from_camera: Array = field(default_factory=lambda: camera_at(EYE, MIDDLE))
    intrinsics: Intrinsics = field(default_factory=lambda: TRANSHAND_CAMERA.resized(256, 144))
    calibrated: Array | None = None
    room: int = 7
    sensor: DepthSensor = field(default_factory=DepthSensor)
    see_arm: bool = True
    _views: dict[int, tuple[HeldScene, MovingView]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        ur5.check_pose(self.base_from_camera, "base_from_camera")
        if self.calibrated is not None:
            ur5.check_pose(self.calibrated, "calibrated")

    @property
    def calibration(self) -> Array:
        """base_from_camera as the robot knows it, shape (4, 4), metres."""
        return self.base_from_camera if self.calibrated is None else self.calibrated

    def miscalibrated(self, degrees: float, seed: int = 0) -> RobotCamera:
        """Give the same camera whose calibration is turned about the camera by an angle.

        Args:
            degrees: The angle; 0 is a perfect calibration.
            seed: Chooses the axis.
        """
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
        """Take a picture.

        Args:
            state: The world now.
            scene: What is held, by which hand.
            rng: Draws the sensors' noise.
            color: Draw the colour too, which takes most of the time.
        """
        arm = self._arm_in_view(state)
        view = self._view(scene).at(state.base_from_wrist, state.base_from_object, arm)
        labels = view.seen(self.intrinsics, self.base_from_camera)
        picture = None
        if color:
            light = view.light(self.intrinsics, self.base_from_camera, rng)
            picture = develop(light, rng, ColorCamera())
        raw = self.sensor.measure(
            labels.depth, labels.background_depth, labels.object_mask, self.intrinsics, rng
        )
        return CapturedFrame(
            time=state.time,
            color=picture,
            raw_depth=raw,
            depth=labels.depth,
            background_depth=labels.background_depth,
            object_mask=labels.object_mask,
            hand_mask=labels.hand_mask,
            arm_mask=labels.arm_mask,
            keypoints=self.true_keypoints(state, scene),
            camera=self.intrinsics,
        )

    def true_keypoints(self, state: WorldState, scene: HeldScene) -> Array:
        """The hand's keypoints in the camera frame, metres, shape (21, 3)."""
        moved = state.base_from_wrist @ np.linalg.inv(scene.base_from_wrist)
        camera_from_start = np.linalg.inv(self.base_from_camera) @ moved
        points: Array = transform_points(camera_from_start, scene.keypoints)
        return points

    def visible(self, points: Array, state: WorldState) -> Mask:
        """Which points lie within the picture and are not hidden by the robot's arm, shape (n,).

        Args:
            points: Camera frame, metres, shape (n, 3).
            state: The world now.
        """
        uv = project(points, self.intrinsics)
        size = [self.intrinsics.width - 0.5, self.intrinsics.height - 0.5]
        inside: Mask = (uv >= -0.5) & (uv <= size)  # NaN is outside
        found: Mask = np.asarray(inside.all(axis=1))
        parts = self._arm_in_view(state)
        if parts:
            camera_from_base = np.linalg.inv(self.base_from_camera).astype(np.float64)
            arm = merged(tuple(surface for surface, _ in parts)).moved(camera_from_base)
            rays = points.astype(np.float32)  # the parameter along them is 1 at the point
            hits = search_tree(arm).run(np.zeros_like(rays), rays, query="INTERSECT", output=True)
            found = found & ((hits["primID"] < 0) | (hits["tfar"] > 1))
        return found

    def _arm_in_view(self, state: WorldState) -> list[Part]:
        """The arm's parts that a ray of this camera may meet: most of it is beside the picture."""
        if not self.see_arm:
            return []
        camera_from_base = np.linalg.inv(self.base_from_camera)
        # the picture is the part of space on the inner side of four planes through the camera
        c = self.intrinsics
        left, right = (-0.5 - c.cx) / c.fx, (c.width - 0.5 - c.cx) / c.fx
        top, bottom = (-0.5 - c.cy) / c.fy, (c.height - 0.5 - c.cy) / c.fy
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


class Calibration(NamedTuple):
    """A camera's calibration: intrinsics, and its pose in the frame that it was calibrated in."""

    intrinsics: Intrinsics
    base_from_camera: Array


def read_calibration(
    path: str | Path,
    camera: str = "camera1",
    sensor: str = "rgb",
    *,
    width: int = 1280,
    height: int = 720,
    base_from_world: Array | None = None,
) -> Calibration:
    """Read a calibration file of the CORSMAL handover set-up (RealSense cameras).

    The file holds, for each camera, ``K`` and ``extrinsics_world_to_camera`` (``R``, ``t``, and
    ``P = K [R | t]``) of the sensors ``rgb``, ``ir1``, ``ir2``; metres.

    Args:
        path: The JSON file.
        camera: Which camera.
        sensor: Which of its sensors.
        width: Width of its images, which the file does not tell, pixels.
        height: Their height, pixels.
        base_from_world: Where the calibration's world lies in the robot's base frame, shape
            (4, 4); they are the same where it is left out.

    Returns:
        Intrinsics and base_from_camera.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is none of this form, or its numbers contradict each other.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"no calibration file at {path}")
    try:
        values: Any = json.loads(path.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is no JSON: {error}") from error
    try:
        matrix = np.asarray(values[camera]["K"][sensor], dtype=float)
        pose = values[camera]["extrinsics_world_to_camera"][sensor]
        turn, shift = np.asarray(pose["R"], dtype=float), np.asarray(pose["t"], dtype=float)
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path} lacks {camera}/{sensor} with K, R and t: {error}") from error
    if turn.shape != (3, 3) or shift.size != 3:
        raise ValueError(f"{path}: R must be (3, 3) and t (3,), got {turn.shape}, {shift.shape}")
    camera_from_world = np.eye(4)
    camera_from_world[:3, :3], camera_from_world[:3, 3] = turn, shift.ravel()
    ur5.check_pose(camera_from_world, f"{camera}/{sensor} of {path}")
    if "P" in pose:
        off = np.abs(matrix @ camera_from_world[:3] - np.asarray(pose["P"], dtype=float)).max()
        if not off < 0.1:
            raise ValueError(f"{path}: P of {camera}/{sensor} is not K [R | t], off by {off:.3g}")
    world = np.eye(4) if base_from_world is None else base_from_world
    return Calibration(
        Intrinsics.from_matrix(matrix, width, height),
        ur5.check_pose(world, "base_from_world") @ np.linalg.inv(camera_from_world),
    )

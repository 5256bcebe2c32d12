"""What the robot sees at one moment: the hand, the object's points, what stands around.

Masks and keypoints come from the simulator, with noise that lasts from frame to frame: the same in
every condition of the experiment, which then differ by the object's depth alone. Or they come from
networks, as on a real robot. The network of `hadr` sees the picture, the measured depth outside of
the glass, the mask and the keypoints.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from scipy.spatial import cKDTree

from hadr.camera import Array, Intrinsics, back_project, project, window_around
from hadr.corruption import smooth_noise
from hadr.data.samples import samples_dir
from hadr.frame_checks import depth_to_use
from hadr.handover.observation import Observation
from hadr.handover.tracking import HandFilter
from hadr.models.hand.plausible import NoHandError
from hadr.rivals import classical
from hadr.simulation.camera.depth_sensor import Depth, Mask
from hadr.simulation.camera.robot_camera import CapturedFrame, RobotCamera
from hadr.simulation.world.scenes import HeldScene
from hadr.simulation.world.state import WorldState
from hadr.trained_finders import HandKeypoints, Segmentation
from hadr.trained_networks import DepthNetwork
from hadr.training.checkpoints import read_record

DepthSource = Literal["raw", "inpainted", "unet-hand", "hadr", "hadr-plus", "perfect"]
SOURCES: tuple[DepthSource, ...] = get_args(DepthSource)
CHECKPOINTS = {
    "unet-hand": "unet-hand-handover.safetensors",
    "hadr": "hadr-handover.safetensors",
    "hadr-plus": "hadr-plus-handover.safetensors",
    "segmentation": "segmentation-imagenet.safetensors",
    "keypoints": "hand-keypoints-handover.safetensors",
}
"""The bundled networks, trained on other holds of the known objects before this camera; that which
finds masks also on other frames."""
KEYPOINT_NOISE = 0.004
"""Standard deviation of each keypoint coordinate, metres. Half of the variance is common to all
keypoints, as where a hand is taken for nearer than it is."""
NOISE_LASTS = 0.3
"""Time after which a keypoint's error is mostly a new one, seconds."""
MASK_JITTER = 0.6
"""Standard deviation of the mask's outline, pixels."""
HIDDEN_NOISE = 2.0
"""Factor on the error of keypoints that the robot, the glass or another part of the hand hides, or
that lie outside of the picture: they are guessed from the others."""
RIGHT_M = 0.02
"""So far off may a point of the object be that counts as right, metres."""
SMALLEST_VISIBLE = 5
"""With fewer keypoints in the picture and not behind the robot no hand is found."""
_LARGEST_CLOUD = 1500
_SMALLEST_CLOUD = 10
_SCENE_SPACING = 0.015
_SCENE_REACH = 0.50
_FOREARM_FROM = 0.06


class Sight:
    """Perception through one camera, with one way to the object's depth.

    Args:
        scene: Hand and object, as they were at time 0.
        camera: Through which it looks.
        source: Where the object's depth comes from: "raw" takes what the sensor measured,
            "inpainted" fills the mask from around it, "unet-hand", "hadr" and "hadr-plus" restore
            it, "perfect" knows it.
        seed: Seed of all noise, which differs from hold to hold.
        finder: Networks that find mask and keypoints in each picture, which are then steadied from
            picture to picture; the simulator's, with noise, where it is left out.
    """

    def __init__(
        self,
        scene: HeldScene,
        camera: RobotCamera,
        source: DepthSource,
        *,
        seed: int = 0,
        finder: HandAndGlass | None = None,
    ) -> None:
        self.scene, self.camera, self.source, self._finder = scene, camera, source, finder
        name = list(scene.hold.hold_id.encode())  # every hold has noise of its own
        self._sensor_rng, self._noise_rng, self._mask_rng = (
            np.random.default_rng([seed, part, 83, *name]) for part in range(3)
        )
        self._noise: tuple[float, Array] | None = None
        self._steady = HandFilter()
        self.right: npt.NDArray[np.bool_] | None = None
        """Which of the last object points are within `RIGHT_M` of the true depth on their rays."""

    def look(self, state: WorldState, with_points: bool) -> Observation:
        """What is seen of the world, camera frame; points of object and surroundings cost most."""
        if self._finder is not None:
            frame = self.camera.capture(state, self.scene, self._sensor_rng)
            mask, hand, keypoints = self._finder.find(frame)
            if keypoints is not None:
                keypoints = self._steady.steadied(state.time, keypoints)
            # the depth camera's masks of the arm are the robot's own knowledge, the hand's are not
            frame = replace(frame, hand_mask=hand)
        else:
            keypoints = self._seen_keypoints(state)
        found = Observation(state.time, keypoints, frame_time=state.time)
        if not with_points:
            return found
        if self._finder is None:
            color = self.source in CHECKPOINTS
            frame = self.camera.capture(state, self.scene, self._sensor_rng, color=color)
            mask = self._seen_mask(frame.object_mask)
        scene = scene_points(frame, mask, keypoints)
        if not mask.any():
            return replace(found, scene_points=scene)
        depth, confidence = object_depth(self.source, frame, mask, keypoints)
        points = object_points(depth, mask, frame.camera, self._mask_rng)
        self.right = None if points is None else _right(points, frame)
        return replace(found, object_points=points, scene_points=scene, confidence=confidence)

    def _seen_keypoints(self, state: WorldState) -> Array | None:
        """The simulator's keypoints with noise, or None where too few are in view."""
        true = self.camera.true_keypoints(state, self.scene)
        seen = self.camera.visible(true, state)
        hidden = ~seen | self.camera.behind_hand_or_glass(true, state, self.scene)
        factor = np.where(hidden, HIDDEN_NOISE, 1.0)[:, None]
        keypoints: Array = true + factor * self._keypoint_noise(state.time)
        return None if seen.sum() < SMALLEST_VISIBLE else keypoints

    def _keypoint_noise(self, time: float) -> Array:
        """Errors that die away and are renewed, shape (21, 3), metres."""
        half = np.sqrt(0.5) * KEYPOINT_NOISE
        rng = self._noise_rng
        fresh = half * (rng.standard_normal((21, 3)) + rng.standard_normal((1, 3)))
        if self._noise is not None:
            before, old = self._noise
            kept = np.exp(-max(time - before, 0.0) / NOISE_LASTS)
            fresh = kept * old + np.sqrt(1 - kept**2) * fresh
        self._noise = (time, fresh)
        return np.asarray(fresh)

    def _seen_mask(self, mask: Mask) -> Mask:
        """The mask with an outline that wavers."""
        if not mask.any():
            return mask
        window = window_around(mask, 6)
        true = mask[window]
        inside = ndimage.distance_transform_edt(true) - ndimage.distance_transform_edt(~true)
        wave = MASK_JITTER * smooth_noise(true.shape, 2.0, self._mask_rng)
        seen = np.zeros_like(mask)
        # the outline lies half a pixel outside of the last pixel on either side
        seen[window] = inside - 0.5 * np.sign(inside) + wave > 0
        return seen


def object_depth(
    source: DepthSource, frame: CapturedFrame, mask: Mask, keypoints: Array | None
) -> tuple[Depth, float | None]:
    """The depth that a source believes in, metres, 0 where unknown, from a picture and its mask.

    And the mean probability over the mask that it is right to 2 cm; None where the source has no
    opinion. The keypoints (21, 3) are in the camera frame, metres; None: no hand was found.
    """
    if source == "perfect":
        # where the mask is too wide, the object's depth goes on
        known = np.where(frame.object_mask, frame.depth, 0)
        return classical.nearest_valid(known, ~frame.object_mask).astype(np.float32), 1.0
    if source == "raw":
        return frame.raw_depth, None
    if source == "inpainted":
        return classical.inpaint(frame.raw_depth, mask).astype(np.float32), None
    assert frame.color is not None
    if keypoints is None:
        return np.where(mask, np.float32(0), frame.raw_depth), 0.0
    network = bundled_network(source)
    given = depth_to_use(frame.raw_depth, mask, network.corruption)
    answer = network.restore(frame.color, given, frame.camera, mask, keypoints)
    sure = float(answer.confidence[mask].mean()) if network.can_say else None
    return answer.depth, sure


def object_points(
    depth: Depth, mask: Mask, camera: Intrinsics, rng: np.random.Generator
) -> Array | None:
    """Points (n, 3) of the mask's pixels, camera frame, without those that lie apart.

    At most 1500 of them, drawn at random; None where fewer than ten are left.
    """
    points = back_project(np.where(mask, depth, 0), camera)[mask]
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) > _LARGEST_CLOUD:
        points = points[np.sort(rng.choice(len(points), _LARGEST_CLOUD, replace=False))]
    points = without_outliers(points)
    return points if len(points) >= _SMALLEST_CLOUD else None


def without_outliers(points: Array) -> Array:
    """Drop points (n, 3) whose mean distance to eight neighbours is two deviations too far."""
    if len(points) <= 8:
        return points
    distances, _ = cKDTree(points).query(points, 9)
    apart = distances[:, 1:].mean(axis=1)
    kept: Array = points[apart <= apart.mean() + 2.0 * apart.std()]
    return kept


def scene_points(frame: CapturedFrame, mask: Mask, keypoints: Array | None) -> Array:
    """Measured points that the gripper must not touch: what stands around, and the forearm.

    The robot knows its own arm and leaves it out, as it does the object's mask (H, W); the hand
    itself is known by its keypoints (21, 3). Camera frame, metres, shape (n, 3): one a cube of
    1.5 cm, within 0.5 m of the hand, or of the picture's middle where none was found.
    """
    near_own = ndimage.binary_dilation(mask | frame.arm_mask, iterations=3)
    points = back_project(np.where(near_own, 0, frame.raw_depth), frame.camera).reshape(-1, 3)
    known = np.isfinite(points[:, 2])
    points, skin = points[known], frame.hand_mask.ravel()[known]
    if keypoints is None:
        middle = np.median(points, axis=0) if len(points) else np.zeros(3)
    else:
        middle = keypoints.mean(axis=0)
    near = np.linalg.norm(points - middle, axis=1) < _SCENE_REACH
    points, skin = points[near], skin[near]
    if keypoints is not None and len(points):
        margin = ndimage.binary_dilation(frame.hand_mask, iterations=2).ravel()[known][near] & ~skin
        distance, _ = cKDTree(keypoints).query(points)
        # pixels beside the hand's outline hold flying points, no obstacles
        points = points[(distance > _FOREARM_FROM) & ~margin]
    _, first = np.unique(np.floor(points / _SCENE_SPACING), axis=0, return_index=True)
    thinned: Array = points[np.sort(first)]
    return thinned


def _right(points: Array, frame: CapturedFrame) -> npt.NDArray[np.bool_]:
    """Which points (n, 3), camera frame, are within `RIGHT_M` of what the picture truly shows."""
    u, v = np.rint(project(points, frame.camera)).astype(int).T
    near: npt.NDArray[np.bool_] = np.abs(points[:, 2] - frame.depth[v, u]) < RIGHT_M
    return near


def bundled_file(name: str) -> Path:
    """Where the bundled network of a name in `CHECKPOINTS` is."""
    return samples_dir() / "checkpoints" / CHECKPOINTS[name]


@lru_cache(maxsize=2)
def bundled_network(name: str) -> DepthNetwork:
    """The bundled network of that name, loaded once; FileNotFoundError without `data_samples`."""
    return DepthNetwork.load(bundled_file(name))


@dataclass(frozen=True)
class HandAndGlass:
    """Networks that find masks in a picture's colour, keypoints in its depth around the hand."""

    segmentation: Segmentation
    keypoints: HandKeypoints

    def find(self, frame: CapturedFrame) -> tuple[Mask, Mask, Array | None]:
        """The object's and the hand's pixels (H, W) in a picture with colour, and the keypoints.

        Those are in the camera frame, metres, (21, 3), or None where there is no hand with depth.
        """
        if frame.color is None:
            raise ValueError("networks find mask and keypoints in a picture with colour, got none")
        mask, hand, _ = self.segmentation.masks(frame.color)
        hand = np.zeros_like(mask) if hand is None else hand & ~mask & ~frame.arm_mask
        depth = np.where(mask, np.float32(0), frame.raw_depth)
        try:
            return mask, hand, self.keypoints.find(frame.color, depth, frame.camera, mask, hand)
        except NoHandError:
            return mask, hand, None


@lru_cache(maxsize=1)
def bundled_finder() -> HandAndGlass:
    """The bundled networks of this camera, loaded once; as `bundled_network`."""
    keypoints = HandKeypoints.load(bundled_file("keypoints"))
    return HandAndGlass(Segmentation.load(bundled_file("segmentation")), keypoints)


def keypoint_uncertainty(*, by_networks: bool) -> float:
    """Twice the standard deviation of a keypoint's coordinate, metres: what a guard reckons with.

    That of the simulator's noise; or of the bundled network, from its mean distance on validation
    frames as if errors were normal and alike in all directions: sqrt(8 / pi) deviations then.
    """
    if not by_networks:
        return 2 * KEYPOINT_NOISE
    record = read_record(bundled_file("keypoints"))
    return 2 * float(record["validation"]["keypoints_m"]) / float(np.sqrt(8 / np.pi))


Fault = Literal["no hand", "nan keypoints", "frozen keypoints", "no frames", "low confidence"]
FAULTS: tuple[Fault, ...] = get_args(Fault)
Look = Callable[[WorldState, bool], Observation]
"""Looks at the world, with the points of object and surroundings or without, as `Sight.look`."""


def broken_sight(fault: Fault, since: float = 0.0, until: float = np.inf) -> Callable[[Look], Look]:
    """Perception that breaks for a span of time, seconds, to see what the robot does then.

    "no hand": none is found. "nan keypoints": one is NaN. "frozen keypoints": new pictures, but
    always the same hand. "no frames": the camera stops, so the last picture is all there is. "low
    confidence": 0.02. ValueError for another fault, or one that would end before it begins.
    """
    if fault not in FAULTS:
        raise ValueError(f"fault must be one of {', '.join(FAULTS)}, got {fault!r}")
    if not since <= until:
        raise ValueError(f"since must not be later than until, got {since} and {until}")

    def spoil(look: Look) -> Look:
        last = Observation(0.0, frame_time=-np.inf)

        def broken(state: WorldState, with_points: bool) -> Observation:
            nonlocal last
            breaks = since <= state.time < until
            if breaks and fault == "no frames":
                return replace(last, time=state.time)
            found = look(state, with_points)
            if not breaks:
                last = found
                return found
            if fault == "low confidence":
                return replace(found, confidence=0.02)
            if fault == "frozen keypoints":
                last = last if np.isfinite(last.taken) else found
                return replace(found, keypoints=last.keypoints)
            keypoints = None
            if fault == "nan keypoints" and found.keypoints is not None:
                keypoints = found.keypoints.copy()
                keypoints[8] = np.nan
            return replace(found, keypoints=keypoints)

        return broken

    return spoil

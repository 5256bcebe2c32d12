"""What the robot sees at one moment: the hand, the object's points, what stands around.

Masks and keypoints come from the simulator, with noise that lasts from frame to frame: the same
for every condition of the experiment, which then differ by the object's depth alone. Or they come
from networks, as on a real robot. The network of `hadr` sees the picture, the measured depth
outside of the glass, the mask and the keypoints.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal, Protocol, get_args

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from hadr.camera import window_around
from hadr.corruption import smooth_noise
from hadr.data.samples import samples_dir
from hadr.frame_checks import depth_to_use
from hadr.handover.observation import Observation
from hadr.models.hand.plausible import NoHandError
from hadr.rivals import classical
from hadr.simulation.camera.robot_camera import CapturedFrame, RobotCamera
from hadr.simulation.camera.seen_points import object_points, scene_points
from hadr.simulation.world.scenes import HeldScene
from hadr.simulation.world.state import WorldState
from hadr.trained_networks import DepthNetwork, HandKeypoints, Segmentation

Array = npt.NDArray[np.float64]
Depth = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]
DepthSource = Literal["raw", "inpainted", "hadr", "hadr-plus", "perfect"]
SOURCES: tuple[DepthSource, ...] = get_args(DepthSource)
CHECKPOINTS = {
    "hadr": "hadr-handover.safetensors",
    "hadr-plus": "hadr-plus-handover.safetensors",
    "segmentation": "segmentation-handover.safetensors",
    "keypoints": "hand-keypoints-handover.safetensors",
}
"""The bundled networks, trained on other holds of the known objects before this camera."""


@dataclass(frozen=True)
class SightConfig:
    """The noise of masks and keypoints, and the camera's rate; metres, seconds, pixels.

    Attributes:
        keypoint_noise: Standard deviation of each keypoint coordinate. Half of the variance is
            common to all keypoints, as where a hand is taken for nearer than it is.
        noise_lasts: Time after which a keypoint's error is mostly a new one.
        mask_jitter: Standard deviation of the mask's outline.
        period: Time from one picture to the next; between them the last one is given again.
        hidden_noise: Factor on the error of keypoints that the robot hides or that lie outside of
            the picture: they are guessed from the others.
        smallest_visible: With fewer keypoints in view no hand is found.
    """

    keypoint_noise: float = 0.004
    noise_lasts: float = 0.3
    mask_jitter: float = 0.6
    period: float = 0.1
    hidden_noise: float = 2.0
    smallest_visible: int = 5


class Looks(Protocol):
    """Whatever looks at the world for the workflow: `Sight`, or one that breaks."""

    def look(self, state: WorldState, *, with_points: bool) -> Observation:
        """Look at the world, see `Sight.look`."""
        ...


class Sight:
    """Perception through one camera, with one way to the object's depth.

    Args:
        scene: What is held.
        camera: The camera.
        source: Where the object's depth comes from: "raw" takes what the sensor measured,
            "inpainted" fills the mask from around it, "hadr" and "hadr-plus" restore it,
            "perfect" knows it.
        seed: Seed of all noise, which differs from hold to hold.
        config: Noise and rate.
        network: The depth network of "hadr" or "hadr-plus", if not the bundled one.
        finder: Networks that find mask and keypoints in each picture; the simulator's, with noise,
            where it is left out.

    Raises:
        ValueError: The source is unknown.
    """

    def __init__(
        self,
        scene: HeldScene,
        camera: RobotCamera,
        source: DepthSource,
        *,
        seed: int = 0,
        config: SightConfig | None = None,
        network: DepthNetwork | None = None,
        finder: HandAndGlass | None = None,
    ) -> None:
        if source not in SOURCES:
            raise ValueError(f"source must be one of {', '.join(SOURCES)}, got {source!r}")
        self.scene, self.camera, self.source = scene, camera, source
        self.config = config or SightConfig()
        self.frame: CapturedFrame | None = None
        """The last picture that points were taken from."""
        self._network, self._finder = network, finder
        if source in ("hadr", "hadr-plus") and network is None:
            self._network = bundled_network(source)
        name = list(scene.hold.hold_id.encode())  # every hold has noise of its own
        self._sensor_rng, self._noise_rng, self._mask_rng = (
            np.random.default_rng([seed, part, 83, *name]) for part in range(3)
        )
        self._noise: tuple[float, Array] | None = None
        self._last: Observation | None = None

    def look(self, state: WorldState, *, with_points: bool) -> Observation:
        """Look at the world.

        Args:
            state: The world now.
            with_points: Also take the points of object and surroundings, which costs a picture.

        Returns:
            What is seen, in the camera frame. Before the next picture is due, the last one again.
        """
        last = self._last
        if (
            last is not None
            and state.time - last.taken < self.config.period - 1e-9
            and state.time >= last.time
        ):
            return replace(last, time=state.time)
        if self._finder is not None:
            self._last = self._found_by(self._finder, state, with_points=with_points)
            return self._last
        keypoints: Array | None = self.camera.true_keypoints(state, self.scene)
        assert keypoints is not None  # for the type checker: it may become None below
        seen = self.camera.visible(keypoints, state)
        factor = np.where(seen, 1.0, self.config.hidden_noise)[:, None]
        keypoints = keypoints + factor * self._keypoint_noise(state.time)
        if seen.sum() < self.config.smallest_visible:
            keypoints = None
        found = Observation(state.time, keypoints, frame_time=state.time)
        if with_points:
            found = self._with_points(found, state)
        self._last = found
        return found

    def _found_by(
        self, finder: HandAndGlass, state: WorldState, *, with_points: bool
    ) -> Observation:
        """What networks find in a new picture."""
        frame = self.camera.capture(state, self.scene, self._sensor_rng, color=True)
        mask, hand, keypoints = finder.find(frame)
        found = Observation(state.time, keypoints, frame_time=state.time)
        # the depth camera's masks of the arm are the robot's own knowledge, the hand's are not
        return self._points(found, replace(frame, hand_mask=hand), mask) if with_points else found

    def _with_points(self, found: Observation, state: WorldState) -> Observation:
        color = self._network is not None
        frame = self.camera.capture(state, self.scene, self._sensor_rng, color=color)
        return self._points(found, frame, self._seen_mask(frame.object_mask))

    def _points(self, found: Observation, frame: CapturedFrame, mask: Mask) -> Observation:
        self.frame = frame
        if not mask.any():
            return replace(found, scene_points=scene_points(frame, mask, found.keypoints))
        depth, confidence = self.object_depth(frame, mask, found.keypoints)
        return replace(
            found,
            object_points=object_points(depth, mask, frame.camera, self._mask_rng),
            scene_points=scene_points(frame, mask, found.keypoints),
            confidence=confidence,
        )

    def object_depth(
        self, frame: CapturedFrame, mask: Mask, keypoints: Array | None
    ) -> tuple[Depth, float | None]:
        """The depth that this source believes in.

        Args:
            frame: The picture.
            mask: The object's pixels, shape (H, W) bool.
            keypoints: The hand, camera frame, metres, shape (21, 3); None: no hand was found.

        Returns:
            z-depth in metres, shape (H, W), 0 where unknown; and the mean probability over the
            mask that it is right to 2 cm, None where the source has no opinion.
        """
        if self.source == "perfect":
            # where the mask is too wide, the object's depth goes on
            known = np.where(frame.object_mask, frame.depth, 0)
            return classical.nearest_valid(known, ~frame.object_mask).astype(np.float32), 1.0
        if self.source == "raw":
            return frame.raw_depth, None
        if self.source == "inpainted":
            return classical.inpaint(frame.raw_depth, mask).astype(np.float32), None
        network = self._network
        assert network is not None  # the constructor loads it for the other sources
        assert frame.color is not None
        if keypoints is None:
            return np.where(mask, np.float32(0), frame.raw_depth), 0.0
        given = depth_to_use(frame.raw_depth, mask, network.corruption, [])
        answer = network.restore(frame.color, given, frame.camera, mask, keypoints)
        sure = float(answer.confidence[mask].mean()) if network.can_say else None
        return answer.depth, sure

    def _keypoint_noise(self, time: float) -> Array:
        """Errors that die away and are renewed, shape (21, 3), metres."""
        half = np.sqrt(0.5) * self.config.keypoint_noise
        rng = self._noise_rng
        fresh = half * (rng.standard_normal((21, 3)) + rng.standard_normal((1, 3)))
        if self._noise is not None:
            before, old = self._noise
            kept = np.exp(-max(time - before, 0.0) / self.config.noise_lasts)
            fresh = kept * old + np.sqrt(1 - kept**2) * fresh
        self._noise = (time, fresh)
        return np.asarray(fresh)

    def _seen_mask(self, mask: Mask) -> Mask:
        """The mask with an outline that wavers."""
        if self.config.mask_jitter <= 0 or not mask.any():
            return mask
        window = window_around(mask, 6)
        true = mask[window]
        inside = ndimage.distance_transform_edt(true) - ndimage.distance_transform_edt(~true)
        wave = self.config.mask_jitter * smooth_noise(true.shape, 2.0, self._mask_rng)
        seen = np.zeros_like(mask)
        # the outline lies half a pixel outside of the last pixel on either side
        seen[window] = inside - 0.5 * np.sign(inside) + wave > 0
        return seen


@lru_cache(maxsize=2)
def bundled_network(source: str) -> DepthNetwork:
    """The bundled network of a source, loaded once.

    Raises:
        FileNotFoundError: The folder `data_samples` is not there.
        KeyError: The source has no network.
    """
    return DepthNetwork.load(samples_dir() / "checkpoints" / CHECKPOINTS[source])


@dataclass(frozen=True)
class HandAndGlass:
    """Networks that find glass, hand and keypoints in one picture.

    Attributes:
        segmentation: Finds the masks in the colour.
        keypoints: Finds the keypoints in the depth around the hand.
    """

    segmentation: Segmentation
    keypoints: HandKeypoints

    def find(self, frame: CapturedFrame) -> tuple[Mask, Mask, Array | None]:
        """Find them.

        Args:
            frame: The picture, with colour.

        Returns:
            The object's and the hand's pixels, shape (H, W) bool, and the keypoints, camera frame,
            metres, shape (21, 3), or None where there is no hand with depth.
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
    """The bundled networks of this camera, loaded once.

    Raises:
        FileNotFoundError: The folder `data_samples` is not there.
    """
    folder = samples_dir() / "checkpoints"
    return HandAndGlass(
        Segmentation.load(folder / CHECKPOINTS["segmentation"]),
        HandKeypoints.load(folder / CHECKPOINTS["keypoints"]),
    )


Fault = Literal["no hand", "nan keypoints", "frozen keypoints", "no frames", "low confidence"]
FAULTS: tuple[Fault, ...] = get_args(Fault)


class BrokenSight:
    """Perception that breaks at a given time: for tests of what the robot does then.

    Args:
        sight: The perception that works until then.
        fault: How it breaks. "no hand": none is found. "nan keypoints": one keypoint is NaN.
            "frozen keypoints": new pictures, but always the same hand. "no frames": the camera
            stops, so the last picture is all there is. "low confidence": 0.02.
        since: From this time on, seconds.
        until: Until this time, seconds.

    Raises:
        ValueError: The fault is unknown, or it would end before it begins.
    """

    def __init__(
        self, sight: Looks, fault: Fault, since: float = 0.0, until: float = np.inf
    ) -> None:
        if fault not in FAULTS:
            raise ValueError(f"fault must be one of {', '.join(FAULTS)}, got {fault!r}")
        if not since <= until:
            raise ValueError(f"since must not be later than until, got {since} and {until}")
        self.sight, self.fault, self.since, self.until = sight, fault, since, until
        self._held: Observation | None = None

    def look(self, state: WorldState, *, with_points: bool) -> Observation:
        """As `Sight.look`, with the fault while it lasts."""
        broken = self.since <= state.time < self.until
        if broken and self.fault == "no frames":
            held = self._held or Observation(state.time, frame_time=-np.inf)
            return replace(held, time=state.time)
        found = self.sight.look(state, with_points=with_points)
        if not broken:
            self._held = found
            return found
        if self.fault == "no hand":
            return replace(found, keypoints=None)
        if self.fault == "low confidence":
            return replace(found, confidence=0.02)
        if self.fault == "frozen keypoints":
            self._held = self._held or found
            return replace(found, keypoints=self._held.keypoints)
        if found.keypoints is None:
            return found
        keypoints = found.keypoints.copy()
        keypoints[8] = np.nan
        return replace(found, keypoints=keypoints)

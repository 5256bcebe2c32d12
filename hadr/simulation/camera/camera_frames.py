"""Frames of the camera beside the robot, for training: other holds, places, rooms than in trials.

Each frame is what `hadr.simulation.camera.robot_camera` sees of one scene: colour, what its depth
sensor measured, exact labels. The camera stands within some centimetres of its place in the trials,
so that a network learns this view and not this one calibration.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hadr.camera import project
from hadr.data.frame import Frame
from hadr.handover.dimensions import LARGEST_OPENING
from hadr.handover.poses import camera_at
from hadr.handover.robot import HOME_JOINTS
from hadr.simulation.camera.robot_camera import EYE, RobotCamera
from hadr.simulation.world.scenes import MIDDLE, held_scene
from hadr.simulation.world.state import WorldState
from hadr.simulation.world.trial_set import TRIAL_HOLDS
from hadr.synthesis.glass.objects import OBJECTS, glass_object

Array = npt.NDArray[np.float64]

TRAINING_HOLDS = range(400, 600)
"""Holding poses that may be drawn for training."""
VALIDATION_HOLDS = range(600, 640)
"""Holding poses that may be drawn for validation."""
TEST_HOLDS = range(640, 680)
"""Holding poses that may be drawn to score the networks; none of them is one of a trial's."""
_ROOMS = {  # the trials are made in number 7
    "train": range(100, 124),
    "val": range(200, 206),
    "test": range(300, 306),
}
_HOLDS = {"train": TRAINING_HOLDS, "val": VALIDATION_HOLDS, "test": TEST_HOLDS}


@dataclass(frozen=True)
class CameraFrameConfig:
    """How frames for training differ from each other; metres, radians.

    Attributes:
        eye: Largest displacement of the camera along each axis.
        aim: The same of the point that it looks at.
        arm_at_home: Share of the frames in which the arm is at home; else it is turned by ...
        joints: ... this standard deviation in each joint.
        objects: Those that may be held: the eight that the bundled networks know.
    """

    eye: float = 0.06
    aim: float = 0.05
    arm_at_home: float = 0.7
    joints: float = 0.15
    objects: tuple[str, ...] = tuple(OBJECTS)

    def __post_init__(self) -> None:
        for name in ("eye", "aim", "joints"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise ValueError(f"{name} must be finite and 0 or more, got {value}")
        if not 0 <= self.arm_at_home <= 1:
            raise ValueError(f"arm_at_home must be a share in 0..1, got {self.arm_at_home}")
        if not self.objects:
            raise ValueError(f"objects must name at least one object, got {self.objects}")
        for name in self.objects:
            glass_object(name)  # says which there are


def camera_frame(
    split: str, number: int, seed: int = 0, config: CameraFrameConfig | None = None
) -> Frame:
    """Draw one frame.

    Args:
        split: "train", "val" or "test"; they share no hold and no room.
        number: Which frame; it chooses object, hold, place, room, camera and the arm's pose.
        seed: Seed of all of them.
        config: How frames differ.

    Returns:
        The frame at the camera's 256x144; the same for the same arguments.

    Raises:
        ValueError: The split has no frames of this camera, or the number is negative.
    """
    if split not in _HOLDS:
        raise ValueError(f"split must be one of {', '.join(_HOLDS)}, got {split!r}")
    if number < 0:
        raise ValueError(f"number must be 0 or more, got {number}")
    c = config or CameraFrameConfig()
    rng = np.random.default_rng([seed, number, len(split), 97])
    object_id = c.objects[number % len(c.objects)]
    # consecutive frames share a room, which takes as long to furnish as three frames to draw
    room = _ROOMS[split][number // (4 * len(c.objects)) % len(_ROOMS[split])]
    hold = int(rng.choice(_HOLDS[split]))
    assert hold not in TRIAL_HOLDS
    scene = held_scene(object_id, hold, seed=int(rng.integers(1 << 30)))
    camera = RobotCamera(
        base_from_camera=camera_at(
            EYE + rng.uniform(-c.eye, c.eye, 3), MIDDLE + rng.uniform(-c.aim, c.aim, 3)
        ),
        room=room,
    )
    joints = HOME_JOINTS.copy()
    if rng.random() > c.arm_at_home:
        joints += rng.normal(0, c.joints, 6)
    state = WorldState(
        0.0,
        joints,
        float(rng.uniform(0.0, LARGEST_OPENING)),
        scene.base_from_wrist,
        scene.base_from_object,
        "hand",
        0.0,
        1.0,
    )
    seen = camera.capture(state, scene, rng)
    assert seen.color is not None
    return Frame(
        stem=f"{number:06d}",
        object_id=object_id,
        split=split,
        color=seen.color,
        depth=seen.depth,
        hand_mask=seen.hand_mask & ~seen.object_mask,
        object_mask=seen.object_mask,
        keypoints=seen.keypoints,
        keypoints_uv=project(seen.keypoints, seen.camera),
        camera=seen.camera,
        world_from_camera=camera.base_from_camera,
        background_depth=seen.background_depth,
        hold_id=scene.hold.hold_id,
        raw_depth=seen.raw_depth,
        world_from_object=scene.base_from_object,
    )

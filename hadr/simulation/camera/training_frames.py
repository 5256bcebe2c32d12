"""Frames of the camera beside the robot, for training: other holds, places, rooms than in trials.

Each frame is what `hadr.simulation.camera.robot_camera` sees of one scene: colour, what its depth
sensor measured, exact labels. The camera stands within some centimetres of its place in the trials,
so that a network learns this view and not this one calibration.
"""

from __future__ import annotations

import numpy as np

from hadr.camera import project
from hadr.data.frame import Frame
from hadr.handover.grasping.gripper import LARGEST_OPENING
from hadr.handover.poses import camera_at
from hadr.handover.simulated_ur5 import HOME_JOINTS
from hadr.simulation.camera.robot_camera import EYE, RobotCamera
from hadr.simulation.world.scenes import MIDDLE, held_scene
from hadr.simulation.world.state import WorldState
from hadr.synthesis.glass.objects import OBJECTS

HOLDS = {"train": range(400, 600), "val": range(600, 640), "test": range(640, 680)}
"""Holding poses that may be drawn for a split; none of them is one of a trial's."""
_ROOMS = {  # the trials are made in number 7
    "train": range(100, 124),
    "val": range(200, 206),
    "test": range(300, 306),
}


EYE_SPREAD, AIM_SPREAD = 0.06, 0.05
"""Largest displacement along each axis of the camera, and of the point that it looks at, metres."""
ARM_AT_HOME, JOINT_SPREAD = 0.7, 0.15
"""Share of the frames in which the arm is at home; else it is turned by this standard deviation in
each joint, radians."""
FRAME_OBJECTS = tuple(OBJECTS)
"""The objects that are held: the eight that the bundled networks know."""


def camera_frame(split: str, number: int, seed: int = 0) -> Frame:
    """Draw one frame at the camera's 256x144; the same for the same arguments.

    Args:
        split: "train", "val" or "test"; they share no hold and no room.
        number: Which frame; it chooses object, hold, place, room, camera and the arm's pose.
        seed: Seed of all of them.

    Raises:
        ValueError: The split has no frames of this camera, or the number is negative.
    """
    if split not in HOLDS:
        raise ValueError(f"split must be one of {', '.join(HOLDS)}, got {split!r}")
    if number < 0:
        raise ValueError(f"number must be 0 or more, got {number}")
    rng = np.random.default_rng([seed, number, len(split), 97])
    object_id = FRAME_OBJECTS[number % len(FRAME_OBJECTS)]
    # consecutive frames share a room, which takes as long to furnish as three frames to draw
    room = _ROOMS[split][number // (4 * len(FRAME_OBJECTS)) % len(_ROOMS[split])]
    hold = int(rng.choice(HOLDS[split]))
    scene = held_scene(object_id, hold, seed=int(rng.integers(1 << 30)))
    eye = EYE + rng.uniform(-EYE_SPREAD, EYE_SPREAD, 3)
    aim = MIDDLE + rng.uniform(-AIM_SPREAD, AIM_SPREAD, 3)
    camera = RobotCamera(base_from_camera=camera_at(eye, aim), room=room)
    joints = HOME_JOINTS.copy()
    if rng.random() > ARM_AT_HOME:
        joints += rng.normal(0, JOINT_SPREAD, 6)
    opening, held = float(rng.uniform(0.0, LARGEST_OPENING)), scene.base_from_object
    state = WorldState(0.0, joints, opening, scene.base_from_wrist, held, "hand", 0.0, 1.0)
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

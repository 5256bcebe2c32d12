"""The safety checks, each a small function of numbers, and all their thresholds in one place.

Distances are free space between the gripper's surface and the skin. The rule for speed is that of
speed and separation monitoring (ISO/TS 15066): the robot may close in on the hand only as fast as
it could still react to.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from hadr.hand import check_keypoints
from hadr.handover.grasping.collision import FLESH, hand_points
from hadr.handover.grasping.gripper import FINGER_WIDTH, fork_points

Array = npt.NDArray[np.float64]

FARTHEST_HAND = 5.0
"""A keypoint farther from the camera than this, metres, belongs to no hand."""
LARGEST_WEIGHT = 4.0
"""What the gripper carries pulls it down by no more, newtons: the heaviest glass weighs 3.6."""
HAND_PULL = 3.0
"""What pulls at the gripper harder is a person who holds the object, newtons."""
PRESSED = 0.5
"""Fingers that press harder are around something, newtons."""
PALM = (0.03, 0.20)
"""Shortest and longest way from wrist to the middle finger's knuckle, metres."""


@dataclass(frozen=True)
class SafetyConfig:
    """Thresholds; metres, seconds, metres per second.

    Attributes:
        camera_silent_after: Without a new picture for this long, stop.
        oldest_picture: An older picture counts as none.
        hand_lost_after: Without a usable hand for this long, stop.
        frozen_frames: Bitwise equal keypoints in this many pictures in a row: the camera hangs. A
            hand is never that still.
        largest_residual: A hand that differs from a rigid motion by more (root mean square) is
            holding differently.
        approach_distance: Least free space to the skin on the way to the pre-grasp.
        grasp_distance: Least free space in the final move. The fingers go around what the hand
            holds, so it is smaller.
        reaction_time: The hand may come no nearer than the least free space within this time.
        look_ahead: How much of the path before the gripper is checked.
        withdraw_speed: A hand that moves away faster is being withdrawn ...
        withdraw_distance: ... and one that went farther than this, since the grasp was chosen.
        smallest_confidence: Restored depth of a lower mean confidence is not grasped at.
        object_near: The object's points are in the hand if one is this near to its bones.
        held_margin: Something is held if the fingers stay this much wider than commanded.
        smallest_singular_value: Of the arm's Jacobian (metres and radians); below, and on the way
            down, the arm is singular.
        longest_singular: So long, seconds, it may be: an arm that only passes is not stopped.
    """

    camera_silent_after: float = 0.3
    oldest_picture: float = 0.4
    hand_lost_after: float = 0.3
    frozen_frames: int = 5
    largest_residual: float = 0.02
    approach_distance: float = 0.015
    grasp_distance: float = 0.005
    reaction_time: float = 0.15
    look_ahead: float = 0.05
    withdraw_speed: float = 0.20
    withdraw_distance: float = 0.15
    smallest_confidence: float = 0.3
    object_near: float = 0.05
    held_margin: float = 0.003
    smallest_singular_value: float = 0.005
    longest_singular: float = 0.0

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not value >= 0:
                raise ValueError(f"{item.name} must be 0 or more, got {value}")


def hand_problem(keypoints: npt.ArrayLike) -> str:
    """Say why keypoints are no hand, or nothing.

    Args:
        keypoints: Anything; a hand in the camera frame is (21, 3) metres.

    Returns:
        An empty string for a hand; else the wrong value in words.
    """
    try:
        points = check_keypoints(keypoints)
    except (TypeError, ValueError) as error:
        return str(error)
    farthest = float(np.abs(points).max())
    if farthest > FARTHEST_HAND:
        return f"a keypoint lies {farthest:.3g} m away, a hand at most {FARTHEST_HAND} m"
    palm = float(np.linalg.norm(points[9] - points[0]))
    if not PALM[0] <= palm <= PALM[1]:
        return f"no hand has a palm of {palm:.3f} m, from {PALM[0]} to {PALM[1]} m is possible"
    return ""


def line_velocity(times: Array, points: Array) -> Array:
    """Least-squares slope (3,), m/s, of points (n, 3) in metres over times (n,) in seconds."""
    since = times - times.mean()
    slope: Array = since @ (points - points.mean(axis=0)) / (since @ since)
    return slope


def path_distance(poses: Iterable[Array], width: float, keypoints: Array) -> float:
    """Least free space between gripper and hand over tool poses, metres; <= 0: they touch."""
    tree = cKDTree(hand_points(keypoints))
    path = np.concatenate([fork_points(pose, width) for pose in poses])
    return float(tree.query(path)[0].min()) - FLESH - FINGER_WIDTH / 2


def closing_speed(hand_velocity: Array | None, hand: Array, tool: Array) -> float:
    """The hand's own speed toward the tool, m/s from vectors (3,); 0 where away or not known."""
    way = tool - hand
    length = float(np.linalg.norm(way))
    if hand_velocity is None or length < 1e-9:
        return 0.0
    return max(0.0, float(hand_velocity @ way) / length)


def speed_factor(free: float, least: float, speed: float, closing: float, reaction: float) -> float:
    """Part of a speed, 0 to 1, that the robot may use; metres, m/s, seconds.

    Within the reaction time robot and hand together may use up the free space but for the least:
    (factor * speed + closing) * reaction <= free - least.
    """
    if reaction * speed == 0:
        return 1.0 if free > least else 0.0
    allowed = (free - least) / reaction - closing
    return float(np.clip(allowed / speed, 0.0, 1.0))


def withdrawal(since_chosen: Array, velocity: Array | None, away: Array, c: SafetyConfig) -> str:
    """Say that the human withdraws, or nothing; metres, m/s, `away` a unit vector, each (3,)."""
    distance = float(since_chosen @ away)
    if distance > c.withdraw_distance:
        return f"the human withdraws: the hand is {100 * distance:.0f} cm farther away"
    speed = 0.0 if velocity is None else float(velocity @ away)
    if speed > c.withdraw_speed:
        return f"the human withdraws: the hand moves away at {speed:.2f} m/s"
    return ""


def low_confidence(confidence: float | None, least: float) -> str:
    """Say that restored depth is not to be trusted, or nothing; None counts as trusted."""
    if confidence is None or (np.isfinite(confidence) and confidence >= least):
        return ""
    return f"restored depth of confidence {confidence:.2f}, needed {least:.2f}"


def object_in_hand(points: Array, keypoints: Array, near: float) -> bool:
    """Say whether any object point (n, 3) is near enough to the bones of a hand (21, 3), metres."""
    return bool(cKDTree(hand_points(keypoints)).query(points)[0].min() <= near)


def something_held(width: float, commanded: float, margin: float) -> bool:
    """Say whether the fingers were kept from closing as far as commanded; all in metres."""
    return bool(width > commanded + margin)


def hand_pull(force: Array) -> float:
    """How hard somebody pulls, N: the force on the gripper (3,), base frame, less a weight."""
    weight = np.clip(-force[2], 0.0, LARGEST_WEIGHT)
    return float(np.linalg.norm(force + np.array([0.0, 0.0, weight])))


def pushed_away(began: Array, now: Array, most: float) -> float:
    """Metres that a pre-grasp (4, 4) has gone past `most` along its approach axis, 0 or more.

    A gripper that pushes the object pushes the hand with it; a robot that follows the hand would
    then chase it.
    """
    gone = float((now[:3, 3] - began[:3, 3]) @ now[:3, 2])
    return max(0.0, gone - most)

"""The safety checks, each a small function of numbers, and all their thresholds in one place.

Distances are free space between the robot's surface and the skin. The rule for speed has the form
of speed and separation monitoring in ISO/TS 15066:2016, 5.5.4.2.3, with the standard's terms
(`Separation`). It is not a safety function in the standard's sense:

- The hand counts with the speed that was measured, where it was; the standard asks for 1.6 m/s
  where the person's speed is not monitored, by rated means: one camera is none.
- Only the hand that offers and its forearm are watched: no other hand, no head, no second person.
- The robot's speed is that of the tool point: what a turn adds at the wrist does not count.
- In the final move the gripper goes between a person's fingers. Below the protective distance hand
  and robot together may crawl (`stages.CRAWL_SPEED`) down to the least free space; a contact there
  is a matter of the standard's other mode, power and force limiting, and of the protective stop.
- No part of it is redundant or rated (ISO 13849-1, performance level d).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from hadr.camera import Array
from hadr.hand import check_keypoints
from hadr.handover.grasping.collision import hand_points

FARTHEST_HAND = 5.0
"""A keypoint farther from the camera than this, metres, belongs to no hand."""
LARGEST_WEIGHT = 4.0
"""What the gripper carries pulls it down by no more, newtons: the heaviest glass weighs 3.6."""
HAND_PULL, PULLS_NO_MORE = 3.0, 2.0
"""What pulls at the gripper harder is a person who holds the object, newtons, until it pulls no
harder than the second."""
PRESSED = 0.5
"""Fingers that press harder are around something, newtons."""
AT_THE_GLASS = 0.05
"""A hand farther from the gripper than this, metres, does not hold what it carries."""
TOWED = 0.05
"""A hand that has come along with the closed gripper so far, metres, still holds the object."""
PALM = (0.03, 0.20)
"""Shortest and longest way from wrist to the middle finger's knuckle, metres."""
THINNEST_HAND = 0.002
"""Keypoints that lie nearer to one line, metres (root mean square), do not tell how a hand turns;
those of the experiment's 48 holds lie 22 mm and more off it."""
HUMAN_SPEED = 1.6
"""Of a person whose speed is not known, m/s: ISO/TS 15066, 5.5.4.2.3."""
CAMERA_SILENT_AFTER, HAND_LOST_AFTER = 0.3, 0.3
"""Without a new picture, or a usable hand, for this long the robot stops, seconds."""
OLDEST_PICTURE = 0.4
"""A picture older than this, seconds, counts as none."""
FROZEN_FRAMES = 5
"""Bitwise equal keypoints in this many pictures in a row: the camera hangs. No hand is so still."""
LARGEST_RESIDUAL = 0.02
"""A hand that differs from a rigid motion by more, metres (root mean square), holds differently."""
APPROACH_DISTANCE, GRASP_DISTANCE = 0.015, 0.005
"""Least free space to the skin, metres, on the way to the pre-grasp and in the final move, where
the fingers go around what the hand holds."""
REACTION_TIME = 0.10
"""From a picture's arrival to the begin of braking, seconds: two steps of the workflow and the
arm's own controller. The picture's age comes on top, see `separation`."""
DECELERATION = 0.8
"""How hard the tool surely brakes, m/s2."""
ROBOT_UNCERTAINTY = 0.002
"""Of the tool's place and of the camera's calibration, metres."""
LOOK_AHEAD = 0.05
"""How much of the path before the gripper is checked, metres."""
WITHDRAW_SPEED, WITHDRAW_DISTANCE = 0.20, 0.15
"""A hand that moves away faster, m/s, or went farther since the grasp was chosen, metres, is being
withdrawn."""
SMALLEST_CONFIDENCE = 0.3
"""Restored depth of a lower mean confidence is not grasped at."""
OBJECT_NEAR = 0.05
"""The object's points are in the hand if one is this near to its bones, metres."""
HELD_MARGIN = 0.003
"""Closed fingers that stay farther apart than this, metres, hold something."""
NOT_NUMBERS = (TypeError, ValueError, OverflowError, RuntimeError)
"""What NumPy and PyTorch raise where something can't be made an array of floats."""


def hand_problem(keypoints: npt.ArrayLike) -> str:
    """Say what is wrong with anything that is no hand (21, 3) in the camera frame, metres."""
    try:
        points = check_keypoints(keypoints)
    except NOT_NUMBERS as error:
        return str(error)
    farthest = float(np.abs(points).max())
    if farthest > FARTHEST_HAND:
        return f"a keypoint lies {farthest:.3g} m away, a hand at most {FARTHEST_HAND} m"
    palm = float(np.linalg.norm(points[9] - points[0]))
    if not PALM[0] <= palm <= PALM[1]:
        return f"no hand has a palm of {palm:.3f} m, from {PALM[0]} to {PALM[1]} m is possible"
    width = float(np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1]) / 21**0.5
    if width < THINNEST_HAND:
        return f"the keypoints lie on one line within {1000 * width:.1f} mm: no turn is seen in it"
    return ""


def line_velocity(times: Array, points: Array) -> Array:
    """Least-squares slope (3,), m/s, of points (n, 3) in metres over times (n,) in seconds."""
    since = times - times.mean()
    slope: Array = since @ (points - points.mean(axis=0)) / (since @ since)
    return slope


class Separation(NamedTuple):
    """The protective separation distance S_p and its terms in ISO/TS 15066, metres.

    Attributes:
        human: S_h, by which the hand comes nearer from the picture to the robot's rest.
        robot: S_r, by which the robot does in its reaction time.
        stopping: S_s, its stopping distance.
        intrusion: C, by which a hand may be nearer than it is seen: our least free space.
        human_uncertainty: Z_d, of the hand's place.
        robot_uncertainty: Z_r, of the robot's place.
    """

    human: float
    robot: float
    stopping: float
    intrusion: float
    human_uncertainty: float
    robot_uncertainty: float

    @property
    def distance(self) -> float:
        """S_p = S_h + S_r + S_s + C + Z_d + Z_r."""
        return sum(self)


def separation(
    speed: float, closing: float, age: float, least: float, human_uncertainty: float
) -> Separation:
    """The distance that a robot must keep from a hand.

    Of the tool's speed and the hand's own toward it, m/s, the age of the picture that it was seen
    in, seconds, the least free space and the uncertainty of the hand's place, metres.
    """
    return Separation(
        human=closing * (age + REACTION_TIME + speed / DECELERATION),
        robot=speed * REACTION_TIME,
        stopping=speed**2 / (2 * DECELERATION),
        intrusion=least,
        human_uncertainty=human_uncertainty,
        robot_uncertainty=ROBOT_UNCERTAINTY,
    )


def allowed_speed(
    free: float, closing: float, age: float, least: float, human_uncertainty: float
) -> float:
    """The largest speed, m/s, whose `separation` is kept; 0 where none is.

    The free space, metres, is the least one over the next `LOOK_AHEAD` of the path. The robot's own
    way there, S_r + S_s, is thereby measured; only what it needs beyond that is subtracted.
    """
    room = free - separation(0.0, closing, age, least, human_uncertainty).distance
    if not room > 0:
        return 0.0
    by_hand = DECELERATION * room / closing if closing > 0 else np.inf
    return float(min(by_hand, stopping_speed(room + LOOK_AHEAD, closing)))


def stopping_speed(way: float, closing: float) -> float:
    """The speed, m/s, at which S_r + S_s, and what the hand goes while it brakes, is a way, m."""
    slope = REACTION_TIME + closing / DECELERATION  # way = slope v + v^2 / 2a
    root = np.sqrt(slope**2 + 2 * max(0.0, way) / DECELERATION)
    return DECELERATION * float(root - slope)


def withdrawal(since_chosen: Array, velocity: Array | None, away: Array) -> str:
    """Say that the human withdraws, or nothing; metres, m/s, `away` a unit vector, each (3,)."""
    distance = float(since_chosen @ away)
    if distance > WITHDRAW_DISTANCE:
        return f"the human withdraws: the hand is {100 * distance:.0f} cm farther away"
    speed = 0.0 if velocity is None else float(velocity @ away)
    if speed > WITHDRAW_SPEED:
        return f"the human withdraws: the hand moves away at {speed:.2f} m/s"
    return ""


def low_confidence(confidence: float | None) -> str:
    """Say that restored depth is not to be trusted, or nothing; None counts as trusted."""
    if confidence is None or (np.isfinite(confidence) and confidence >= SMALLEST_CONFIDENCE):
        return ""
    return f"restored depth of confidence {confidence:.2f}, needed {SMALLEST_CONFIDENCE:.2f}"


def object_in_hand(points: Array, keypoints: Array) -> bool:
    """Say whether any object point (n, 3) is near enough to the bones of a hand (21, 3), metres."""
    return bool(cKDTree(hand_points(keypoints)).query(points)[0].min() <= OBJECT_NEAR)


def hand_pull(force: Array, way: Array | None = None) -> float:
    """How hard somebody pulls, N: the force on the gripper (3,), base frame, less a weight.

    Given the way that the gripper goes, a unit vector (3,), less what pushes it along, too, and
    what is across counts by half: so a glass presses that is left between open fingers.
    """
    if way is not None:
        along = float(force @ way)
        force = (force - along * way) / 2 + min(0.0, along) * way
    weight = np.clip(-force[2], 0.0, LARGEST_WEIGHT)
    return float(np.linalg.norm(force + np.array([0.0, 0.0, weight])))


def pushed_away(began: Array, now: Array, most: float) -> float:
    """Metres that a pre-grasp (4, 4) has gone past `most` along its approach axis, 0 or more."""
    # a gripper that pushes the object pushes the hand; a robot that follows it would chase it
    return max(0.0, float((now[:3, 3] - began[:3, 3]) @ now[:3, 2]) - most)

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

from dataclasses import dataclass, fields
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
HAND_PULL = 3.0
"""What pulls at the gripper harder is a person who holds the object, newtons."""
PRESSED = 0.5
"""Fingers that press harder are around something, newtons."""
AT_THE_GLASS = 0.05
"""A hand farther from the gripper than this, metres, does not hold what it carries."""
PALM = (0.03, 0.20)
"""Shortest and longest way from wrist to the middle finger's knuckle, metres."""
THINNEST_HAND = 0.002
"""Keypoints that lie nearer to one line, metres (root mean square), do not tell how a hand turns;
those of the experiment's 48 holds lie 22 mm and more off it."""
HUMAN_SPEED = 1.6
"""Of a person whose speed is not known, m/s: ISO/TS 15066, 5.5.4.2.3."""


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
        reaction_time: From a picture's arrival to the begin of braking: two steps of the workflow
            and the arm's own controller. The picture's age comes on top, see `separation`.
        deceleration: How hard the tool surely brakes, metres per second squared.
        human_uncertainty: Of the keypoints: twice the standard deviation of 4 mm.
        robot_uncertainty: Of the tool's place and of the camera's calibration.
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
    reaction_time: float = 0.10
    deceleration: float = 0.8
    human_uncertainty: float = 0.008
    robot_uncertainty: float = 0.002
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
        if self.deceleration == 0:
            raise ValueError("deceleration must be more than 0")


def hand_problem(keypoints: npt.ArrayLike) -> str:
    """Say what is wrong with anything that is no hand (21, 3) in the camera frame, metres."""
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
    speed: float, closing: float, age: float, least: float, c: SafetyConfig
) -> Separation:
    """The distance that a robot must keep from a hand.

    Of the tool's speed and the hand's own toward it, m/s, the age of the picture that it was seen
    in, seconds, and the least free space, metres.
    """
    unseen = age + c.reaction_time + speed / c.deceleration
    return Separation(
        human=closing * unseen,
        robot=speed * c.reaction_time,
        stopping=speed**2 / (2 * c.deceleration),
        intrusion=least,
        human_uncertainty=c.human_uncertainty,
        robot_uncertainty=c.robot_uncertainty,
    )


def allowed_speed(free: float, closing: float, age: float, least: float, c: SafetyConfig) -> float:
    """The largest speed, m/s, whose `separation` is kept; 0 where none is.

    The free space, metres, is the least one over the next `look_ahead` of the path. The robot's own
    way there, S_r + S_s, is thereby measured; only what it needs beyond that is subtracted.
    """
    room = free - separation(0.0, closing, age, least, c).distance
    if not room > 0:
        return 0.0
    by_hand = c.deceleration * room / closing if closing > 0 else np.inf
    return float(min(by_hand, stopping_speed(room + c.look_ahead, closing, c)))


def stopping_speed(way: float, closing: float, c: SafetyConfig) -> float:
    """The speed, m/s, at which S_r + S_s, and what the hand goes while it brakes, is a way, m."""
    slope = c.reaction_time + closing / c.deceleration  # way = slope v + v^2 / 2a
    root = np.sqrt(slope**2 + 2 * max(0.0, way) / c.deceleration)
    return c.deceleration * float(root - slope)


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
    """Metres that a pre-grasp (4, 4) has gone past `most` along its approach axis, 0 or more."""
    # a gripper that pushes the object pushes the hand; a robot that follows it would chase it
    return max(0.0, float((now[:3, 3] - began[:3, 3]) @ now[:3, 2]) - most)

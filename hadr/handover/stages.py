"""The words of the workflow: its stages, what changes them, the chosen grasp, the settings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from enum import Enum
from numbers import Integral, Real
from typing import NamedTuple, get_args

import numpy as np
import numpy.typing as npt

from hadr.handover.grasping.grasps import FinalMove
from hadr.handover.robot import Robot, Workspace
from hadr.handover.safety import SafetyConfig
from hadr.handover.tracking import HandMotion

Array = npt.NDArray[np.float64]


class Stage(Enum):
    """Where a handover stands; the value is the name that people read."""

    WAIT_AND_OBSERVE = "Wait & Observe"
    APPROACH_AND_REACT = "Approach & React"
    GRASP_AND_RETRIEVE = "Grasp & Retrieve"
    FINISHED = "Finished"
    STOPPED = "Stopped"
    GOING_HOME = "Going home"
    GAVE_UP = "Gave up"


class Transition(NamedTuple):
    """One change of stage: when (seconds), from, to, and why in words."""

    time: float
    before: Stage
    after: Stage
    reason: str


@dataclass(frozen=True)
class ChosenGrasp:
    """The grasp to go for, in the base frame: tool pose (4, 4), opening in metres, final score."""

    pose: Array
    width: float
    score: float


ChooseGrasp = Callable[[Array, Array, Robot, Array | None], ChosenGrasp | None]
"""From object points (n, 3), keypoints (21, 3), the robot, and the scene's points (m, 3) or None;
points in the base frame, metres. A ValueError says that the points allow no grasp."""

FollowHand = Callable[[Array, Array], HandMotion]
"""From keypoints then and now, each (21, 3) in the base frame, to the hand's motion."""


@dataclass(frozen=True)
class HandoverConfig:
    """Distances, times and limits of the workflow; metres, radians, seconds.

    Attributes:
        back: Pre-grasp's distance behind the grasp (the paper's 10 cm).
        forward: The final move's 5 cm.
        final_move: From where those 5 cm count (ledger row 21).
        feel_ahead: After the final move the fingers go on, by this much at most, until the object
            meets the palm. 0 closes them at once, as in the paper.
        feel_aside: Where one finger runs into the object on the way in, the gripper draws back and
            goes in again this much farther to that finger's side (half as far each time the side
            changes); 0 does not feel.
        corrections: How often it does, at most. After that it closes where it is; but what it
            meets more than 3 cm before the end of its way does not fit, and there it halts.
        contact_force: What the sensor at the wrist must feel against the approach, newtons.
        tracking: False: the target stays where it was when the grasp was chosen.
        final_tracking: False: the final move does not follow the hand, as in the paper.
        look_again: At the pre-grasp choose once more from a newer picture, and take that grasp if
            it lies within `refresh_distance` and `refresh_angle` of the one before.
        refresh_distance: See `look_again`.
        refresh_angle: See `look_again`.
        calm_speed: A grasp is chosen once the hand is slower than this, metres per second
            (infinity: always) ...
        calm_window: ... over so long ...
        longest_wait: ... or has been seen for so long.
        choose_every: Least time between two searches for a grasp.
        arrive_distance: The tool is at the pre-grasp within this distance ...
        arrive_angle: ... and this angle ...
        settle_time: ... for this long.
        largest_drift: The pre-grasp may move by no more than this in the settle time, so that the
            final move starts from a calm hand. Infinity: the paper, which does not ask for it.
        restless_after: Within three times that distance and angle for this long, go on although
            the hand is not calm.
        approach_speed: Fastest motion of the tool, metres per second.
        turn_speed: Fastest turn of the tool, radians per second.
        crawl_speed: Beside a hand that does not come nearer, no slower than this.
        advance_speed: Speed of the final move and of the way back.
        approach_timeout: Longest second stage.
        grasp_timeout: Longest third stage.
        largest_push: In the final move the target goes along with the hand by no more than this
            away from the robot: beyond, it is the gripper that pushes.
        close_timeout: Longest closing of the fingers.
        squeeze: How much closer than they were opened the fingers are told to close: as far as the
            object lets them, where it is the whole opening.
        let_go_time: Time for the human to let go.
        retreat: How far back the object is pulled before it is carried off.
        back_speed: Speed of backing off from the hand after a stop.
        stand_time: How long the robot stands after a stop, and how long the cause must be gone.
        back_off: How far the gripper backs off from the hand after a stop beside it.
        tries: After so many stops, go home.
        patience: Go home where the object is not in the gripper so long after a hand was seen.
        home_timeout: Longest way home.
        safety: Thresholds of the safety checks.
        workspace: The box that no target may leave.
    """

    back: float = 0.10
    forward: float = 0.05
    final_move: FinalMove = "past_grasp"
    feel_ahead: float = 0.0
    feel_aside: float = 0.0
    corrections: int = 3
    contact_force: float = 1.5
    tracking: bool = True
    final_tracking: bool = True
    look_again: bool = False
    refresh_distance: float = 0.04
    refresh_angle: float = float(np.deg2rad(30.0))
    calm_speed: float = 0.05
    calm_window: float = 0.3
    longest_wait: float = 2.0
    choose_every: float = 0.3
    arrive_distance: float = 0.01
    arrive_angle: float = float(np.deg2rad(5.0))
    settle_time: float = 0.2
    largest_drift: float = 0.005
    restless_after: float = 2.0
    approach_speed: float = 0.25
    turn_speed: float = 1.0
    crawl_speed: float = 0.02
    advance_speed: float = 0.10
    approach_timeout: float = 13.0
    grasp_timeout: float = 13.0
    largest_push: float = 0.02
    close_timeout: float = 1.5
    squeeze: float = 0.085
    let_go_time: float = 0.3
    retreat: float = 0.15
    back_speed: float = 0.10
    stand_time: float = 0.5
    back_off: float = 0.08
    tries: int = 3
    patience: float = 20.0
    home_timeout: float = 10.0
    safety: SafetyConfig = field(default_factory=SafetyConfig)
    workspace: Workspace = field(default_factory=Workspace)

    def __post_init__(self) -> None:
        for item in fields(self):
            name, value = item.name, getattr(self, item.name)
            if item.type == "float":
                _check_number(name, value)
            elif item.type == "int":
                least = 1 if name == "tries" else 0
                if not isinstance(value, Integral):
                    raise ValueError(f"{name} must be an integer, got {value!r}")
                if value < least:
                    raise ValueError(f"{name} must be {least} or more, got {value}")
        if self.final_move not in get_args(FinalMove):
            known = ", ".join(get_args(FinalMove))
            raise ValueError(f"final_move must be one of {known}, got {self.final_move!r}")


_ABOVE_ZERO = ("approach_speed", "turn_speed", "advance_speed", "back_speed", "patience")
_ENDLESS = ("largest_drift", "calm_speed")
"""Infinity switches these limits off."""


def _check_number(name: str, value: object) -> None:
    """ValueError a setting that is no number, not finite, or too small."""
    number = isinstance(value, Real) and not isinstance(value, bool)
    size = float(value) if number else np.nan  # type: ignore[arg-type]
    if not (np.isfinite(size) or (size == np.inf and name in _ENDLESS)):
        raise ValueError(f"{name} must be a finite number, got {value!r}")
    if name in _ABOVE_ZERO and size <= 0:
        raise ValueError(f"{name} must be more than 0, got {value}")
    if size < 0:
        raise ValueError(f"{name} must be 0 or more, got {value}")

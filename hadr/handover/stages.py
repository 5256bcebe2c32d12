"""The words of the workflow: its stages, what changes them, the chosen grasp, the settings.

What chapters, the ledger or the attempts set is a field of `HandoverConfig`; what nobody sets is a
constant. Unless another source is named the values are our choice, tried in rehearsals.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from enum import Enum
from numbers import Integral, Real
from typing import NamedTuple, get_args

import numpy as np

from hadr.camera import Array
from hadr.handover.grasping.grasps import FinalMove, Way, final_travel
from hadr.handover.robot import Robot
from hadr.handover.tracking import About

CALM_SPEED, CALM_WINDOW = 0.05, 0.3
"""A grasp is chosen once the hand was slower than this, m/s, for so long, seconds, ..."""
LONGEST_WAIT = 2.0
"""... or has been seen for so long, seconds."""
CHOOSE_EVERY = 0.3
"""Least time between two searches for a grasp, seconds."""
ARRIVE_DISTANCE, ARRIVE_ANGLE, SETTLE_TIME = 0.01, float(np.deg2rad(5.0)), 0.2
"""The tool is at the pre-grasp within this distance, metres, and angle, radians, for this long,
seconds."""
CRAWL_SPEED = 0.05
"""Below the separation distance hand and robot together may be this fast, metres per second."""
GRASP_TIMEOUT, HOME_TIMEOUT = 13.0, 10.0
"""Longest third stage, and longest way home, seconds. HandoverSim's attempts end after 13 s."""
LARGEST_PUSH = 0.02
"""In the final move the target goes along with the hand by no more than this away from the robot,
metres: beyond, it is the gripper that pushes."""
CLOSE_TIMEOUT, LET_GO_TIME = 1.5, 0.3
"""Longest closing of the fingers, and how long nobody may pull before they draw back, seconds."""
GENTLE_FORCE, FIRM_FORCE = 7.0, 22.0
"""Force of a finger, newtons: while the human may still hold the object, and once the gripper alone
does."""
RETREAT, ALONE_AFTER = 0.15, 0.02
"""How far back the object is pulled before it is carried home, metres; and after how much of that
the gripper alone holds it, if nobody pulled."""
PULL_TIME = 2.0
"""After being pulled at for so long, seconds, the robot stops and gives back what it holds."""
STAND_TIME = 0.5
"""How long the robot stands after a stop, and how long the cause must be gone, seconds."""
BACK_OFF = 0.08
"""How far the gripper backs off from the hand after a stop beside it, metres."""


class Stage(Enum):
    """Where a handover stands; the value is the name that people read."""

    WAIT_AND_OBSERVE = "Wait & Observe"
    APPROACH_AND_REACT = "Approach & React"
    GRASP_AND_RETRIEVE = "Grasp & Retrieve"
    FINISHED = "Finished"
    STOPPED = "Stopped"
    GOING_HOME = "Going home"
    GAVE_UP = "Gave up"


CHANGES: dict[Stage, dict[Stage, str]] = {
    Stage.WAIT_AND_OBSERVE: {
        Stage.APPROACH_AND_REACT: "a grasp is chosen",
        Stage.STOPPED: "something is wrong",
        Stage.GOING_HOME: "no handover for too long",
    },
    Stage.APPROACH_AND_REACT: {
        Stage.GRASP_AND_RETRIEVE: "there, and all calm",
        Stage.WAIT_AND_OBSERVE: "held in another way",
        Stage.STOPPED: "something is wrong",
        Stage.GOING_HOME: "no handover for too long",
    },
    Stage.GRASP_AND_RETRIEVE: {
        Stage.FINISHED: "home with the object",
        Stage.STOPPED: "something is wrong",
    },
    Stage.STOPPED: {
        Stage.WAIT_AND_OBSERVE: "the cause is gone",
        Stage.GRASP_AND_RETRIEVE: "the cause is gone, the object held",
        Stage.STOPPED: "another cause",
        Stage.GOING_HOME: "too many stops, or too long",
    },
    Stage.GOING_HOME: {Stage.GAVE_UP: "at home, or no way there"},
    Stage.FINISHED: {},
    Stage.GAVE_UP: {},
}
"""Which stage may follow which, and when. Besides, each but the last two may give up at once: where
the robot's driver fails, or where it would go home with an object in the gripper."""


class Transition(NamedTuple):
    """One change of stage: when (seconds), from, to, and why in words."""

    time: float
    before: Stage
    after: Stage
    reason: str


@dataclass(frozen=True)
class ChosenGrasp:
    """The grasp to go for: tool pose (4, 4) in the base frame, opening on the way in, metres.

    `feel`: how far the way on past the final move was found free, see `Way`, metres.
    """

    pose: Array
    width: float
    score: float
    feel: float = 0.0


ChooseGrasp = Callable[[Array, Array, Robot, Array | None, Way], ChosenGrasp | None]
"""From object points (n, 3), keypoints (21, 3), the robot, and the scene's points (m, 3) or None;
points in the base frame, metres, and the final move. `selection.NO_GRASP` are the errors that say
that there is no grasp; any other is a defect."""


@dataclass(frozen=True)
class HandoverConfig:
    """Distances, times, limits of the workflow; metres, radians, seconds. ValueError for a bad one.

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
        about: Where the hand's motion turns about, see `hadr.handover.tracking.HandMotion`.
        largest_drift: The pre-grasp may move by no more than this in the settle time, so that the
            final move starts from a calm hand. Infinity: the paper, which does not ask for it.
        restless_after: Within three times the arrival's distance and angle for this long, go on
            although the hand is not calm.
        approach_speed: Fastest motion of the tool, metres per second.
        turn_speed: Fastest turn of the tool, radians per second.
        advance_speed: Speed of the final move and of the way back.
        back_speed: Speed of backing off from the hand after a stop.
        approach_timeout: Longest second stage.
        tries: After so many stops, go home.
        patience: Go home where the object is not in the gripper so long after a hand was seen.
        human_uncertainty: Of the keypoints, for the distance to the hand: twice the standard
            deviation of 4 mm.
        smallest_singular_value: Of the arm's Jacobian (metres and radians); below, and on the way
            down, the arm is singular.
        longest_singular: So long, seconds, it may be: an arm that only passes is not stopped.
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
    about: About = "wrist"
    largest_drift: float = 0.005
    restless_after: float = 2.0
    approach_speed: float = 0.25
    turn_speed: float = 1.0
    advance_speed: float = 0.10
    back_speed: float = 0.10
    approach_timeout: float = 13.0
    tries: int = 3
    patience: float = 20.0
    human_uncertainty: float = 0.008
    smallest_singular_value: float = 0.005
    longest_singular: float = 0.0

    def __post_init__(self) -> None:
        for item in fields(self):
            if item.type in ("float", "int"):
                _check_number(item.name, getattr(self, item.name), whole=item.type == "int")
        for name, words in (("final_move", FinalMove), ("about", About)):
            if getattr(self, name) not in get_args(words):
                known = ", ".join(get_args(words))
                raise ValueError(f"{name} must be one of {known}, got {getattr(self, name)!r}")

    @property
    def way(self) -> Way:
        """The final move, for who plans it and who goes it."""
        travel = final_travel(self.final_move, back=self.back, forward=self.forward)
        return Way(self.back, travel - self.back, self.feel_ahead)


_ABOVE_ZERO = ("approach_speed", "turn_speed", "advance_speed", "back_speed", "patience")


def _check_number(name: str, value: object, *, whole: bool) -> None:
    """ValueError a setting that is no number, not finite, or too small."""
    if whole and not isinstance(value, Integral):
        raise ValueError(f"{name} must be an integer, got {value!r}")
    number = isinstance(value, Real) and not isinstance(value, bool)
    size = float(value) if number else np.nan  # type: ignore[arg-type]
    if not (np.isfinite(size) or (size == np.inf and name == "largest_drift")):
        raise ValueError(f"{name} must be a finite number, got {value!r}")
    if name in _ABOVE_ZERO and size <= 0:
        raise ValueError(f"{name} must be more than 0, got {value}")
    least = 1 if name == "tries" else 0
    if size < least:
        raise ValueError(f"{name} must be {least} or more, got {value}")

"""The three stages of the handover as a state machine that anyone can read and replay.

Wait & Observe chooses a grasp from restored points. Approach & React goes to the pre-grasp and
follows the hand. Grasp & Retrieve closes in without looking, as in the paper. Anything that must
not go on ends in Stopped, with a reason. The logic knows a robot and observations, nothing else.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

import numpy as np

from hadr.camera import transform_points
from hadr.hand import check_keypoints
from hadr.handover.collision import hand_distance
from hadr.handover.grasps import FinalMove, final_travel, forward_of
from hadr.handover.robot import Robot
from hadr.handover.tracking import HandMotion, hand_motion
from hadr.handover.ur5 import Array, UnreachableError, check_pose


class Stage(Enum):
    """Where a handover stands; the value is the name that people read."""

    WAIT_AND_OBSERVE = "Wait & Observe"
    APPROACH_AND_REACT = "Approach & React"
    GRASP_AND_RETRIEVE = "Grasp & Retrieve"
    FINISHED = "Finished"
    STOPPED = "Stopped"


class Transition(NamedTuple):
    """One change of stage: when (seconds), from, to, and why in words."""

    time: float
    before: Stage
    after: Stage
    reason: str


@dataclass(frozen=True)
class Observation:
    """What perception says at one moment.

    Attributes:
        time: Seconds.
        keypoints: Hand in the camera frame, shape (21, 3), metres; None where no hand was found.
        object_points: Restored points of the object in the camera frame, shape (n, 3), metres;
            None where there are none.
    """

    time: float
    keypoints: Array | None = None
    object_points: Array | None = None


@dataclass(frozen=True)
class ChosenGrasp:
    """The grasp to go for, in the base frame: tool pose (4, 4), opening in metres, final score."""

    pose: Array
    width: float
    score: float


ChooseGrasp = Callable[[Array, Array, Robot], ChosenGrasp | None]
"""From object points (n, 3) and keypoints (21, 3), both in the base frame, and the robot."""


@dataclass(frozen=True)
class HandoverConfig:
    """Distances, times and limits of the workflow; metres, radians, seconds.

    Attributes:
        back: Pre-grasp's distance behind the grasp (the paper's 10 cm).
        forward: The final move's 5 cm.
        final_move: From where those 5 cm count (ledger row 21).
        arrive_distance: The tool is at the pre-grasp within this distance ...
        arrive_angle: ... and this angle ...
        settle_time: ... for this long.
        largest_drift: The pre-grasp may move by no more than this in the settle time, so that the
            open-loop move starts from a calm hand. Infinity: the paper, which does not ask for it.
        hand_lost_after: Without a hand for this long, stop.
        largest_residual: A hand that differs from a rigid motion by more is holding differently.
        smallest_hand_distance: Free space between open gripper and skin before the final move.
        approach_timeout: Longest second stage.
        grasp_timeout: Longest third stage.
        advance_speed: Speed of the open-loop moves.
        retreat: How far back the object is pulled before it is carried off.
        squeeze: How much closer than the object's width the fingers are told to close.
    """

    back: float = 0.10
    forward: float = 0.05
    final_move: FinalMove = "past_grasp"
    arrive_distance: float = 0.01
    arrive_angle: float = float(np.deg2rad(5.0))
    settle_time: float = 0.2
    largest_drift: float = 0.005
    hand_lost_after: float = 0.3
    largest_residual: float = 0.02
    smallest_hand_distance: float = 0.005
    approach_timeout: float = 13.0
    grasp_timeout: float = 13.0
    advance_speed: float = 0.10
    retreat: float = 0.15
    squeeze: float = 0.02


@dataclass
class Handover:
    """One handover in progress. Call `step` with each observation, at a steady rate.

    Attributes:
        robot: The arm.
        choose_grasp: Chooses among candidates; see `hadr.handover.selection`.
        base_from_camera: The camera's calibration, shape (4, 4), metres.
        config: Settings.
        stage: Where it stands.
        transitions: Every change of stage with its reason, oldest first.
        target: Tool pose that the robot is sent to, shape (4, 4); None before a grasp is chosen.
        motion: The hand's motion since the grasp was chosen; None before.
    """

    robot: Robot
    choose_grasp: ChooseGrasp
    base_from_camera: Array
    config: HandoverConfig = field(default_factory=HandoverConfig)
    stage: Stage = field(default=Stage.WAIT_AND_OBSERVE, init=False)
    transitions: list[Transition] = field(default_factory=list, init=False)
    target: Array | None = field(default=None, init=False)
    motion: HandMotion | None = field(default=None, init=False)
    grasp: ChosenGrasp | None = field(default=None, init=False)
    part: str = field(default="", init=False)
    _initial_keypoints: Array | None = field(default=None, init=False)
    _hand_seen: float = field(default=0.0, init=False)
    _arrived: tuple[float, Array] | None = field(default=None, init=False)
    _entered: float = field(default=0.0, init=False)
    _travelled: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        check_pose(self.base_from_camera, "base_from_camera")

    @property
    def over(self) -> bool:
        """True once the handover has finished or stopped."""
        return self.stage in (Stage.FINISHED, Stage.STOPPED)

    def step(self, observation: Observation, dt: float) -> Stage:
        """Look once and move for dt seconds.

        Args:
            observation: What perception says now.
            dt: Time until the next call, seconds.

        Returns:
            The stage after this step. Nothing raises on bad observations: they stop the robot.
        """
        if self.over:
            return self.stage
        now = observation.time
        try:
            keypoints = self._hand(observation)
            if self.stage is Stage.WAIT_AND_OBSERVE:
                self._wait_and_observe(now, keypoints, observation, dt)
            elif self.stage is Stage.APPROACH_AND_REACT:
                self._approach_and_react(now, keypoints, dt)
            else:
                self._grasp_and_retrieve(now, dt)
        except (UnreachableError, ValueError) as error:
            self._stop(now, str(error))
        return self.stage

    def _hand(self, observation: Observation) -> Array | None:
        """Keypoints in the base frame, or None; refuses a hand with NaN in it."""
        if observation.keypoints is None:
            return None
        keypoints = check_keypoints(observation.keypoints)
        self._hand_seen = observation.time
        in_base: Array = transform_points(self.base_from_camera, keypoints)
        return in_base

    def _wait_and_observe(
        self, now: float, keypoints: Array | None, observation: Observation, dt: float
    ) -> None:
        self.robot.servo_to(self.robot.tool_pose(), dt)
        if keypoints is None or observation.object_points is None:
            return
        points = transform_points(self.base_from_camera, observation.object_points)
        chosen = self.choose_grasp(points, keypoints, self.robot)
        if chosen is None:
            return
        self.grasp, self._initial_keypoints, self._arrived = chosen, keypoints, None
        self.robot.set_gripper(chosen.width)
        self._enter(Stage.APPROACH_AND_REACT, now, f"chose a grasp with score {chosen.score:.2f}")

    def _approach_and_react(self, now: float, keypoints: Array | None, dt: float) -> None:
        assert self.grasp is not None  # set before this stage is entered
        assert self._initial_keypoints is not None
        c = self.config
        if now - self._entered > c.approach_timeout:
            self._stop(now, f"pre-grasp not reached within {c.approach_timeout:.1f} s")
            return
        if keypoints is None:
            if now - self._hand_seen >= c.hand_lost_after - 1e-9:
                self._stop(now, f"no hand seen for {now - self._hand_seen:.2f} s")
            else:
                self.robot.servo_to(self.robot.tool_pose(), dt)
            return
        self.motion = hand_motion(self._initial_keypoints, keypoints)
        if self.motion.residual > c.largest_residual:
            self._enter(
                Stage.WAIT_AND_OBSERVE,
                now,
                f"the holding pose changed: keypoints {1000 * self.motion.residual:.0f} mm from "
                "a rigid motion",
            )
            return
        self.target = self.motion.move_pose(forward_of(self.grasp.pose, -c.back))
        self.robot.servo_to(self.target, dt)
        tool = self.robot.tool_pose()
        free = hand_distance(tool, self.robot.gripper_width(), keypoints)
        if free < c.smallest_hand_distance:
            self._stop(now, f"gripper {1000 * free:.0f} mm from the hand during the approach")
            return
        distance, angle = pose_distance(tool, self.target)
        if distance > c.arrive_distance or angle > c.arrive_angle:
            self._arrived = None
            return
        if (
            self._arrived is None
            or pose_distance(self._arrived[1], self.target)[0] > c.largest_drift
        ):
            self._arrived = (now, self.target)
        if now - self._arrived[0] >= c.settle_time - 1e-9:
            reason = (
                f"at the pre-grasp within {1000 * distance:.1f} mm, {np.rad2deg(angle):.1f} deg"
            )
            self.part, self._travelled = "advance", 0.0
            self._enter(Stage.GRASP_AND_RETRIEVE, now, reason)

    def _grasp_and_retrieve(self, now: float, dt: float) -> None:
        assert self.grasp is not None  # set before this stage is entered
        assert self.target is not None
        c = self.config
        if now - self._entered > c.grasp_timeout:
            self._stop(now, f"grasp not finished within {c.grasp_timeout:.1f} s")
            return
        if self.part == "advance":
            goal = final_travel(c.final_move, back=c.back, forward=c.forward)
            self._travelled = min(goal, self._travelled + c.advance_speed * dt)
            self.robot.servo_to(forward_of(self.target, self._travelled), dt)
            if self._travelled >= goal:
                self.part = "close"
                self.target = forward_of(self.target, goal)
                self.robot.set_gripper(max(0.0, self.grasp.width - c.squeeze))
        elif self.part == "close":
            width = self.robot.gripper_width()
            self.robot.servo_to(self.target, dt)
            if abs(self.robot.gripper_width() - width) < 1e-9:
                self.part, self._travelled = "retreat", 0.0
        else:
            self._travelled = min(c.retreat, self._travelled + c.advance_speed * dt)
            self.robot.servo_to(forward_of(self.target, -self._travelled), dt)
            if self._travelled >= c.retreat:
                self._enter(
                    Stage.FINISHED, now, "object pulled back to where it can be carried off"
                )

    def _enter(self, stage: Stage, now: float, reason: str) -> None:
        self.transitions.append(Transition(now, self.stage, stage, reason))
        self.stage, self._entered = stage, now

    def _stop(self, now: float, reason: str) -> None:
        self.robot.stop()
        self._enter(Stage.STOPPED, now, reason)


def pose_distance(first: Array, second: Array) -> tuple[float, float]:
    """How far two poses are apart.

    Args:
        first: Shape (4, 4), metres.
        second: Shape (4, 4), the same frame.

    Returns:
        Distance of the origins in metres, and the angle of the rotation between them in radians.
    """
    turn = first[:3, :3].T @ second[:3, :3]
    angle = float(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1.0, 1.0)))
    return float(np.linalg.norm(first[:3, 3] - second[:3, 3])), angle

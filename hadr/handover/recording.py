"""Record a handover while it runs: use `RecordedHandover` where a `Handover` is used.

The workflow under record sees exactly what is stored: keypoints and robot readings are rounded to
single precision (0.1 micrometres) on the way in. Of the object's points only the few that the
workflow's own checks need are kept; the chosen grasps are stored as they came.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from hadr.handover.grasping.collision import hand_points
from hadr.handover.observation import Observation, clean_points, number
from hadr.handover.robot import Robot
from hadr.handover.run_log import FORMAT, RunLog
from hadr.handover.safety import hand_problem
from hadr.handover.stages import ChooseGrasp, ChosenGrasp, Stage
from hadr.handover.ur5 import UnreachableError
from hadr.handover.workflow import Handover

Array = npt.NDArray[np.float64]
KEPT_POINTS = 32
"""So many points of a cloud are stored, and the one next to the hand."""


def _single(values: npt.ArrayLike) -> Array:
    """Values as they come back from the log."""
    return np.asarray(values, dtype=np.float32).astype(np.float64)


@dataclass
class StepNotes:
    """What the robot said and was told in one step."""

    tool: Array = field(default_factory=lambda: np.eye(4))
    joints: Array = field(default_factory=lambda: np.zeros(0))
    width: float = 0.0
    servo: Array | None = None
    events: list[list[Any]] = field(default_factory=list)


class RecordedRobot:
    """A robot that notes every question, answer and command.

    Args:
        robot: The robot itself.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.step = StepNotes()

    def tool_pose(self) -> Array:
        """Return base_from_tool now, shape (4, 4), metres."""
        self.step.tool = _single(self.robot.tool_pose())
        return self.step.tool.copy()

    def joint_positions(self) -> Array:
        """Return the joint angles now, shape (n,), radians."""
        self.step.joints = _single(self.robot.joint_positions())
        return self.step.joints.copy()

    def gripper_width(self) -> float:
        """Return the distance between the fingers now, metres."""
        self.step.width = float(np.float32(self.robot.gripper_width()))
        return self.step.width

    def tool_wrench(self) -> Array:
        """Return force and torque on the gripper, shape (6,), base frame."""
        wrench = _single(self.robot.tool_wrench())
        if wrench.any():
            self.step.events.append(["tool_wrench", *wrench.tolist()])
        return wrench

    @property
    def protective_stop(self) -> str:
        """Why the arm stopped by itself; empty while it did not."""
        reason = self.robot.protective_stop
        if reason:
            self.step.events.append(["protective_stop", reason])
        return reason

    def reachable(self, base_from_tool: Array) -> bool:
        """Say whether the tool could stand at this pose, shape (4, 4)."""
        answer = self.robot.reachable(base_from_tool)
        self.step.events.append(["reachable", bool(answer)])
        return answer

    def straight_way(self, base_from_tool: Array) -> bool:
        """Say whether it could go from here to a pose, shape (4, 4), without a detour."""
        return self.robot.straight_way(base_from_tool)

    def servo_to(self, base_from_tool: Array, dt: float) -> None:
        """Move toward a tool pose, shape (4, 4), for dt seconds."""
        self.step.servo = np.array(base_from_tool)
        self._noting("servo_error", lambda: self.robot.servo_to(base_from_tool, dt))

    def stop(self) -> None:
        """Stand still until `release`."""
        self.step.events.append(["stop"])
        self.robot.stop()

    def release(self) -> None:
        """Let the arm move again."""
        self.step.events.append(["release"])
        self.robot.release()

    def set_gripper(self, width: float) -> None:
        """Open or close the fingers to a width in metres."""
        self.step.events.append(["set_gripper", float(width)])
        self._noting("gripper_error", lambda: self.robot.set_gripper(width))

    def _noting(self, name: str, command: Callable[[], None]) -> None:
        try:
            command()
        except (UnreachableError, ValueError) as error:
            self.step.events.append([name, type(error).__name__, str(error)])
            raise


class RecordedHandover(Handover):
    """A handover that keeps a log of itself. Its `robot` is a `RecordedRobot` around the real one.

    The arguments are those of `Handover`.
    """

    def __post_init__(self) -> None:
        self.recorded = RecordedRobot(self.robot)
        self.robot = self.recorded
        self.choose_grasp = self._noted(self.choose_grasp)
        super().__post_init__()
        self._steps = [self.recorded.step]  # the first holds what the robot said before the run
        self._given: list[tuple[float, float, float, float, int, int]] = []
        self._hands: list[Array] = []
        self._clouds: list[Array] = []
        self._odd: dict[str, list[int]] = {}
        self._cautions: list[tuple[float, str]] = []

    def step(self, observation: Observation, dt: float) -> Stage:
        """Look once and move for dt seconds, see `Handover.step`."""
        if self.over:
            return self.stage
        notes = self.recorded.step = StepNotes()
        given, row, cloud = self._keep(observation)
        stage = super().step(given, dt)
        self._steps.append(notes)
        unknown = observation.confidence is None
        confidence = np.inf if unknown else number(observation.confidence)
        times = (number(observation.time), number(observation.taken))
        self._given.append((*times, dt, confidence, row, cloud))
        if not self._cautions or self._cautions[-1][1] != self.caution:
            self._cautions.append((self.time, self.caution))
        return stage

    def log(self) -> RunLog:
        """The run up to now."""
        steps, joints = self._steps, len(self._steps[0].joints)
        none = np.full((3, 4), np.nan)
        servo = [none if notes.servo is None else notes.servo[:3] for notes in steps[1:]]
        table = np.array(self._given, dtype=np.float64).reshape(-1, 6)
        arrays: dict[str, npt.NDArray[Any]] = {
            name: table[:, column]
            for column, name in enumerate(("time", "taken", "dt", "confidence"))
        }
        arrays["hand"], arrays["cloud"] = table[:, 4].astype(np.int32), table[:, 5].astype(np.int32)
        lists = {
            "keypoints": np.reshape(self._hands, (-1, 21, 3)),
            "points": np.reshape(self._clouds, (-1, KEPT_POINTS + 1, 3)),
            "tool": np.stack([notes.tool[:3] for notes in steps]),
            "joints": np.reshape([notes.joints for notes in steps], (-1, joints)),
            "width": np.array([notes.width for notes in steps]),
            "servo": np.reshape(servo, (-1, 3, 4)),
        }
        with np.errstate(over="ignore"):
            arrays |= {name: values.astype(np.float32) for name, values in lists.items()}
        header = {
            "format": FORMAT,
            "config": asdict(self.config),
            "base_from_camera": np.asarray(self.base_from_camera).tolist(),
            "transitions": [
                [t.time, t.before.value, t.after.value, t.reason] for t in self.transitions
            ],
            "cautions": [list(item) for item in self._cautions],
            "odd_keypoints": self._odd,
            "events": [
                [step - 1, *event] for step, notes in enumerate(steps) for event in notes.events
            ],
        }
        return RunLog(arrays, header)

    def save(self, path: str | Path) -> Path:
        """Write the log, see `RunLog.save`."""
        return self.log().save(path)

    def _keep(self, observation: Observation) -> tuple[Observation, int, int]:
        """Store an observation; give it as the workflow may see it, and its rows."""
        row = cloud = -1
        keypoints = observation.keypoints
        if keypoints is not None:
            try:
                with np.errstate(over="ignore"):
                    keypoints = _single(keypoints)
            except (TypeError, ValueError):
                keypoints = np.zeros(0)
            if keypoints.shape == (21, 3):
                same = self._hands and np.array_equal(self._hands[-1], keypoints, equal_nan=True)
                if not same:
                    self._hands.append(keypoints)
                row = len(self._hands) - 1
            else:
                keypoints = np.zeros(keypoints.shape)
                self._odd[str(len(self._given))] = list(keypoints.shape)
        points = clean_points(observation.object_points)
        if points is not None:
            kept = points[np.linspace(0, len(points) - 1, KEPT_POINTS).astype(int)]
            nearest = points[:1]
            if keypoints is not None and not hand_problem(keypoints):
                nearest = points[[cKDTree(hand_points(keypoints)).query(points)[0].argmin()]]
            kept = np.concatenate([kept, nearest])
            if not self._clouds or not np.array_equal(self._clouds[-1], kept):
                self._clouds.append(kept)
            cloud = len(self._clouds) - 1
        return replace(observation, keypoints=keypoints), row, cloud

    def _noted(self, choose: ChooseGrasp) -> ChooseGrasp:
        def chosen(
            points: Array, keypoints: Array, robot: Robot, scene: Array | None
        ) -> ChosenGrasp | None:
            events = self.recorded.step.events
            try:
                grasp = choose(points, keypoints, self.recorded.robot, scene)
                chose: list[Any] = [None]
                if grasp is not None:
                    pose = np.asarray(grasp.pose, dtype=np.float64).tolist()
                    chose = [pose, float(grasp.width), float(grasp.score)]
            except (UnreachableError, ValueError) as error:
                events.append(["choose_error", type(error).__name__, str(error)])
                raise
            except Exception as error:
                events.append(["choose_failed", type(error).__name__, str(error)])
                raise
            events.append(["chose", *chose])
            return grasp

        return chosen

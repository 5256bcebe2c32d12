"""A handover's log run again without a robot: the same transitions and commands must come out."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, cast

import numpy as np

from hadr.handover.grasping.selection import NO_GRASP
from hadr.handover.logs.run_log import COMMANDS, READINGS, RunLog
from hadr.handover.observation import Observation
from hadr.handover.robot import Robot
from hadr.handover.stages import ChosenGrasp, HandoverConfig
from hadr.handover.workflow import Handover
from hadr.records.reading import structured

SAME_PLACE = 1e-4
"""A replay's commands to the arm are the log's within this, metres; the log is rounded."""


class LoggedRobot:
    """A robot that answers what the log's robot answered, step by step, and notes its commands."""

    def __init__(self, log: RunLog) -> None:
        self._log = log
        self._events: dict[int, list[list[Any]]] = {}
        for step, *event in log.header["events"]:
            self._events.setdefault(step, []).append(event)
        self.commands: list[list[Any]] = []
        self.servo = np.full((len(log.arrays["time"]), 3, 4), np.nan)
        self.turn_to(-1)

    def turn_to(self, step: int) -> None:
        """Answer from this step on; step -1 is before the first."""
        self._step, self._left = step, [list(event) for event in self._events.get(step, [])]

    def _take(self, name: str) -> list[Any]:
        """The rest of the next event of this name in this step; empty where there is none left."""
        for position, event in enumerate(self._left):
            if event[0] == name:
                return self._left.pop(position)[1:]
        return []

    @property
    def protective_stop(self) -> str:
        """As the robot said then."""
        return "".join(self._take("protective_stop"))

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name.startswith("_"):
            raise AttributeError(name)
        return partial(self._answer, name)

    def _answer(self, name: str, *given: Any, **_: Any) -> Any:
        """What a method of the robot gave, or raised, then."""
        if name in COMMANDS:
            self.commands.append([self._step, name, *given])
        elif name == "servo_to":
            self.servo[self._step] = given[0][:3]
        self._fail(f"{name}_error")
        if name in READINGS:
            read = self._log.arrays[READINGS[name]][self._step + 1].astype(np.float64)
            if name == "tool_pose":
                return np.concatenate([read, [[0.0, 0.0, 0.0, 1.0]]])
            return read if read.ndim else float(read)
        found = self._take(name)
        return found[0] if found else True

    def choose(self, *_: object) -> ChosenGrasp | None:
        """Choose what was chosen then."""
        self._fail("choose_error")
        chose = self._take("chose")
        if not chose or chose[0] is None:
            return None
        return ChosenGrasp(np.array(chose[0], dtype=np.float64), *chose[1:])

    def _fail(self, name: str) -> None:
        failed = self._take(name)
        if failed:
            kinds = {kind.__name__: kind for kind in NO_GRASP}
            raise kinds.get(failed[0], ValueError)(failed[1])


def logged_observation(log: RunLog, step: int) -> Observation:
    """What the workflow was given in a step, counted from 0."""
    a = log.arrays
    shape = log.header["odd_keypoints"].get(str(step))
    keypoints = None if shape is None else np.broadcast_to(0.0, shape)
    if a["hand"][step] >= 0:
        keypoints = a["keypoints"][a["hand"][step]].astype(np.float64)
    row, confidence = int(a["cloud"][step]), float(a["confidence"][step])
    return Observation(
        float(a["time"][step]),
        keypoints,
        a["points"][row].astype(np.float64) if row >= 0 else None,
        confidence=None if np.isinf(confidence) else confidence,
        frame_time=float(a["taken"][step]),
    )


def replay(log: RunLog) -> Handover:
    """Run the workflow on a log; give the handover at its end.

    ValueError where another transition or command comes out than is in the log, or its settings
    are not those of this version.
    """
    robot = LoggedRobot(log)
    header = log.header
    try:
        config = structured(header["config"], HandoverConfig, "config", infinite=True)
    except ValueError as error:
        raise ValueError(f"{error}: replay the log with the version that made it") from error
    calibration = np.array(header["base_from_camera"])
    handover = Handover(cast(Robot, robot), robot.choose, calibration, config)
    with np.errstate(all="ignore"):  # what a robot said may have been no number
        for step in range(len(log.arrays["time"])):
            robot.turn_to(step)
            try:
                handover.step(logged_observation(log, step), float(log.arrays["dt"][step]))
            except ValueError:
                if not handover.over:  # an error of the robot ended the run, as it did then
                    raise
    _compare("transition", log.transitions, handover.transitions)
    told = [event for event in header["events"] if event[1] in COMMANDS]
    _compare("command", told, robot.commands)
    same = np.isclose(log.arrays["servo"], robot.servo, atol=SAME_PLACE, equal_nan=True)
    for step in np.flatnonzero(~same.all(axis=(1, 2)))[:1]:
        raise ValueError(f"the command to the arm in step {step} differs")
    return handover


def _compare(what: str, logged: list[Any], found: list[Any]) -> None:
    for place, (was, now) in enumerate(zip(logged, found, strict=False)):
        if was != now:
            raise ValueError(f"{what} {place} differs: the log has {was}, the replay {now}")
    if len(logged) != len(found):
        raise ValueError(f"the log has {len(logged)} {what}s, the replay {len(found)}")

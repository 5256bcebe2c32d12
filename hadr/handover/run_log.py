"""What a handover saw, what the robot said and was told, and why the stage changed: in one file.

A log is enough to run the workflow again: `replay` gives it the recorded observations and a robot
that answers from the log, and the same transitions must come out. So whoever doubts a stop can
step through it with a debugger, without a robot. Logs are made by `hadr.handover.recording`.
"""

from __future__ import annotations

import hashlib
import json
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from hadr.handover.observation import Observation
from hadr.handover.robot import Robot, Workspace
from hadr.handover.safety import SafetyConfig
from hadr.handover.stages import ChosenGrasp, FollowHand, HandoverConfig, Stage, Transition
from hadr.handover.tracking import hand_motion
from hadr.handover.ur5 import UnreachableError
from hadr.handover.workflow import Handover

Array = npt.NDArray[np.float64]
FORMAT = 1


@dataclass(frozen=True)
class RunLog:
    """One run.

    Attributes:
        arrays: `keypoints` (frames, 21, 3) and `points` (clouds, 33, 3) in the camera frame,
            metres. For each step: `time`, `taken` (of the picture), `dt`, seconds; `confidence`
            (infinity: not known); `hand` and `cloud`, a row of keypoints and of points, -1 for
            none; `tool` (3, 4), `joints` and `width` as the robot said; `servo` (3, 4), the
            command, NaN where there was none.
        header: Format, configuration, calibration, transitions, cautions, and the rare events,
            each with the number of its step: odd keypoints, commands to gripper and stops,
            answers, errors, chosen grasps.
    """

    arrays: Mapping[str, npt.NDArray[Any]]
    header: Mapping[str, Any]

    @property
    def transitions(self) -> list[Transition]:
        """Every change of stage as it happened."""
        return [
            Transition(float(t), Stage(before), Stage(after), str(reason))
            for t, before, after, reason in self.header["transitions"]
        ]

    @property
    def cautions(self) -> list[tuple[float, str]]:
        """When, seconds, and why the robot was slow or waited; "" where it went on."""
        return [(float(time), str(words)) for time, words in self.header["cautions"]]

    def save(self, path: str | Path) -> Path:
        """Write the log, with a checksum, as one compressed file.

        Args:
            path: Where to; `.npz` is appended where it is missing.

        Returns:
            Where it was written.
        """
        path = Path(path)
        path = path if path.suffix == ".npz" else path.with_name(path.name + ".npz")
        text = json.dumps(self.header, sort_keys=True)
        sealed = np.array(_checksum(self.arrays, text))
        content: dict[str, Any] = {**self.arrays, "header": np.array(text), "checksum": sealed}
        with path.open("wb") as file:
            np.savez_compressed(file, **content)
        return path


def read_run_log(path: str | Path) -> RunLog:
    """Read a log.

    Args:
        path: A file that `RunLog.save` wrote.

    Returns:
        The log.

    Raises:
        ValueError: The file is cut off, was changed, or is no log of this format.
        FileNotFoundError: There is no such file.
    """
    try:
        file = np.load(path, allow_pickle=False)
        if not isinstance(file, np.lib.npyio.NpzFile):
            raise ValueError("it holds a single array, a log is an .npz of several")
        with file:
            arrays = {name: file[name] for name in file.files}
        text, sealed = str(arrays.pop("header")), str(arrays.pop("checksum"))
    except FileNotFoundError:
        raise
    except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile, zlib.error) as error:
        raise ValueError(f"{path} is no run log, or is cut off or damaged: {error}") from error
    found = _checksum(arrays, text)
    if found != sealed:
        raise ValueError(
            f"{path} was changed: its content has the checksum {found[:12]}..., "
            f"the file says {sealed[:12]}..."
        )
    header = json.loads(text)
    if not isinstance(header, dict):
        raise ValueError(f"{path} is no run log: its header is no JSON object")
    if header.get("format") != FORMAT:
        raise ValueError(f"{path} has format {header.get('format')}, this version reads {FORMAT}")
    return RunLog(arrays, header)


def _checksum(arrays: Mapping[str, npt.NDArray[Any]], text: str) -> str:
    digest = hashlib.sha256(text.encode())
    for name in sorted(arrays):
        values = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {values.dtype.str} {values.shape}".encode())
        digest.update(values.tobytes())
    return digest.hexdigest()


class LoggedRobot:
    """A robot that answers what the log's robot answered, step by step.

    Args:
        log: The log.
    """

    def __init__(self, log: RunLog) -> None:
        self._log = log
        self._events: dict[int, list[list[Any]]] = {}
        for step, *event in log.header["events"]:
            self._events.setdefault(step, []).append(event)
        self._step = -1
        self._left: list[list[Any]] = []
        self.commands: list[list[Any]] = []

    def turn_to(self, step: int) -> None:
        """Answer from this step on; step -1 is before the first."""
        self._step, self._left = step, [list(event) for event in self._events.get(step, [])]

    def take(self, *names: str) -> list[Any] | None:
        """Take the next event of these names in this step; None where there is none left."""
        for position, event in enumerate(self._left):
            if event[0] in names:
                return self._left.pop(position)
        return None

    def tool_pose(self) -> Array:
        """Return base_from_tool then, shape (4, 4), metres."""
        pose = np.eye(4)
        pose[:3] = self._log.arrays["tool"][self._step + 1]
        return pose

    def joint_positions(self) -> Array:
        """Return the joint angles then, shape (n,), radians."""
        joints: Array = self._log.arrays["joints"][self._step + 1].astype(np.float64)
        return joints

    def gripper_width(self) -> float:
        """Return the distance between the fingers then, metres."""
        return float(self._log.arrays["width"][self._step + 1])

    def tool_wrench(self) -> Array:
        """Return force and torque on the gripper then, shape (6,), base frame."""
        event = self.take("tool_wrench")
        return np.array(event[1:], dtype=np.float64) if event else np.zeros(6)

    @property
    def protective_stop(self) -> str:
        """Why the arm had stopped by itself; empty where it had not."""
        event = self.take("protective_stop")
        return str(event[1]) if event else ""

    def reachable(self, base_from_tool: Array) -> bool:
        """Say what the robot said then."""
        event = self.take("reachable")
        return bool(event[1]) if event else True

    def straight_way(self, base_from_tool: Array) -> bool:
        """Not asked in a replay: the grasps are those that were chosen then."""
        return True

    def servo_to(self, base_from_tool: Array, dt: float) -> None:
        """Fail where the robot failed then."""
        self._fail("servo_error")

    def stop(self) -> None:
        """Note it."""
        self.commands.append([self._step, "stop"])

    def release(self) -> None:
        """Note it."""
        self.commands.append([self._step, "release"])

    def set_gripper(self, width: float) -> None:
        """Note it; fail where the robot failed then."""
        self.commands.append([self._step, "set_gripper", float(width)])
        self._fail("gripper_error")

    def choose(
        self, points: Array, keypoints: Array, robot: Robot, scene_points: Array | None
    ) -> ChosenGrasp | None:
        """Choose what was chosen then."""
        self._fail("choose_error")
        failed = self.take("choose_failed")
        if failed:  # neither of the errors that say there is no grasp
            raise type(failed[1], (Exception,), {})(failed[2])
        event = self.take("chose")
        if event is None or event[1] is None:
            return None
        pose, width, score = event[1:]
        return ChosenGrasp(np.array(pose, dtype=np.float64), width, score)

    def _fail(self, name: str) -> None:
        event = self.take(name)
        if event:
            kind = UnreachableError if event[1] == "UnreachableError" else ValueError
            raise kind(event[2])


def config_from(record: Mapping[str, Any]) -> HandoverConfig:
    """Rebuild the settings from `dataclasses.asdict` of them, as JSON gives it back.

    Args:
        record: Settings by their names; those that a log has not keep their standard.

    Raises:
        ValueError: A setting is unknown, as in a log of another version; the message names it.
    """
    values = dict(record)
    for name, kind in (("workspace", Workspace), ("safety", SafetyConfig)):
        part = values.get(name)
        if not isinstance(part, Mapping):
            raise ValueError(f"the log's settings have no {name}: it is of another version")
        _check_known(part, kind, f"{name}.")
    _check_known(values, HandoverConfig)
    box: dict[str, Any] = {
        name: value if name == "table" else tuple(value)
        for name, value in values["workspace"].items()
    }
    values["workspace"] = Workspace(**box)
    values["safety"] = SafetyConfig(**values["safety"])
    return HandoverConfig(**values)


def _check_known(
    values: Mapping[str, Any],
    kind: type[HandoverConfig | SafetyConfig | Workspace],
    where: str = "",
) -> None:
    unknown = sorted(set(values) - {one.name for one in fields(kind)})
    if unknown:
        raise ValueError(
            f"the log has the setting {where}{unknown[0]}, which this version does not know: "
            "replay it with the version that made it"
        )


def logged_observation(log: RunLog, step: int) -> Observation:
    """What the workflow was given in a step.

    Args:
        log: The log.
        step: Its number, from 0.
    """
    a = log.arrays
    shape = log.header["odd_keypoints"].get(str(step))
    keypoints = None if shape is None else np.zeros(shape)
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


def replay(log: RunLog, *, follow: FollowHand = hand_motion) -> Handover:
    """Run the workflow on a log.

    Args:
        log: The log.
        follow: How the hand was followed in the run.

    Returns:
        The handover at the end, its robot a `LoggedRobot`.

    Raises:
        ValueError: Another transition or command comes out than is in the log, or it has a setting
            that is unknown here.
    """
    robot = LoggedRobot(log)
    robot.turn_to(-1)
    header = log.header
    calibration = np.array(header["base_from_camera"])
    handover = Handover(robot, robot.choose, calibration, config_from(header["config"]), follow)
    for step in range(len(log.arrays["time"])):
        robot.turn_to(step)
        handover.step(logged_observation(log, step), float(log.arrays["dt"][step]))
    _compare("transition", log.transitions, handover.transitions)
    told = [e for e in header["events"] if e[1] in ("stop", "release", "set_gripper")]
    _compare("command", told, robot.commands)
    return handover


def _compare(what: str, logged: list[Any], found: list[Any]) -> None:
    for number, (was, now) in enumerate(zip(logged, found, strict=False)):
        if was != now:
            raise ValueError(f"{what} {number} differs: the log has {was}, the replay {now}")
    if len(logged) != len(found):
        raise ValueError(f"the log has {len(logged)} {what}s, the replay {len(found)}")

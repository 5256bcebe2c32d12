"""What a handover saw, what the robot said and was told, and why the stage changed: in one file.

Use `RecordedHandover` where a `Handover` is used. Its log is enough to run the workflow again
(`replay`), where the same transitions must come out: whoever doubts a stop can step through it with
a debugger, without a robot. The workflow under record sees exactly what is stored: keypoints and
the robot's answers are rounded to single precision (0.1 micrometres) on the way in. Of the object's
points only the few that the workflow's own checks need are kept; the chosen grasps are stored as
they came.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from hadr.camera import Array
from hadr.handover.grasping.collision import hand_points
from hadr.handover.grasping.grasps import Way
from hadr.handover.grasping.selection import NO_GRASP
from hadr.handover.observation import Observation, cleaned
from hadr.handover.robot import Robot, UnreachableError
from hadr.handover.safety import NOT_NUMBERS, hand_problem
from hadr.handover.stages import ChooseGrasp, ChosenGrasp, Stage, Transition
from hadr.handover.workflow import Handover
from hadr.records.reading import parse_json, read_arrays, structured
from hadr.records.writing import write_arrays

FORMAT = 2
KEPT_POINTS = 32
"""So many points of a cloud are stored, and the one next to the hand."""


@dataclass(frozen=True)
class RunLog:
    """One run.

    Attributes:
        arrays: `keypoints` (frames, 21, 3) and `points` (clouds, 33, 3) in the camera frame,
            metres. For each step: `time`, `taken` (of the picture), `dt`, seconds; `confidence`
            (infinity: not known); `hand` and `cloud`, a row of keypoints and of points, -1 for
            none; `tool` (3, 4), `joints`, `width`, `press` (of the fingers) and `wrench` (6,) as
            the robot said; `servo` (3, 4), the command, NaN where there was none.
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

    def save(self, path: Path) -> Path:
        """Write the log, with a checksum, as one .npz; give its path."""
        text = json.dumps(self.header, sort_keys=True)
        sealed = np.array(_checksum(self.arrays, text))
        content: dict[str, Any] = {**self.arrays, "header": np.array(text), "checksum": sealed}
        write_arrays(path, **content)
        return path


_SCHEMA = {
    **dict.fromkeys(("time", "taken", "dt", "confidence"), "f8 steps"),
    **dict.fromkeys(("hand", "cloud"), "i4 steps"),
    "keypoints": "f4 hands 21 3", "points": f"f4 clouds {KEPT_POINTS + 1} 3",
    "tool": "f4 answers 3 4", "joints": "f4 answers 6", "width": "f4 answers",
    "press": "f4 answers", "wrench": "f4 answers 6",
    "servo": "f4 steps 3 4", "header": "U", "checksum": "U",
}  # fmt: skip


@dataclass(frozen=True)
class _Header:
    """What a log's header must hold; the settings are `replay`'s business."""

    format: int
    config: dict[str, Any]
    base_from_camera: list[list[float]]
    transitions: list[tuple[float, Stage, Stage, str]]
    cautions: list[tuple[float, str]]
    odd_keypoints: dict[str, list[int]]
    events: list[Any]

    def __post_init__(self) -> None:
        if self.format != FORMAT:
            raise ValueError(f"format is {self.format}, this version reads {FORMAT}")
        for step in self.odd_keypoints:
            if not step.isdecimal():
                raise ValueError(f"odd_keypoints must be named by steps, got {step!r}")
        for event in self.events:
            if not _is_event(event):
                raise ValueError(f"events has {event!r:.60}, which is none")


def _is_event(event: Any) -> bool:
    match event:
        case [int(), "protective_stop", str()] | [int(), "chose", None]:
            return True
        case [int(), "chose", pose, *numbers]:
            return _is_array(pose, (4, 4)) and _is_array(numbers, (3,))
        case [int(), str(name), *given]:
            if name.endswith("_error"):
                return [type(words) for words in given] == [str, str]
            told = name in ("chose", "protective_stop")
            return not told and all(isinstance(value, int | float) for value in given)
    return False


def _is_array(values: Any, shape: tuple[int, ...]) -> bool:
    try:
        return np.array(values, dtype=np.float64).shape == shape
    except (TypeError, ValueError):
        return False


def read_run_log(path: str | Path) -> RunLog:
    """Read what `RunLog.save` wrote.

    ValueError names the file that is cut off, was changed or is no log of this format.
    """
    arrays = read_arrays(path, _SCHEMA)
    text, sealed = str(arrays.pop("header")), str(arrays.pop("checksum"))
    found = _checksum(arrays, text)
    if found != sealed:
        raise ValueError(
            f"{path} was changed: its content has the checksum {found[:12]}..., "
            f"the file says {sealed[:12]}..."
        )
    header = parse_json(text, f"{path}: header")
    structured(header, _Header, path)
    if len(arrays["tool"]) != len(arrays["time"]) + 1:
        raise ValueError(f"{path}: tool must have a row more than time")
    for name, kept in (("hand", "keypoints"), ("cloud", "points")):
        rows = arrays[name]
        if rows.min(initial=-1) < -1 or rows.max(initial=-1) >= len(arrays[kept]):
            raise ValueError(f"{path}: {name} must be rows of the {len(arrays[kept])} {kept}")
    return RunLog(arrays, header)


def _checksum(arrays: Mapping[str, npt.NDArray[Any]], text: str) -> str:
    digest = hashlib.sha256(text.encode())
    for name in sorted(arrays):
        values = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {values.dtype.str} {values.shape}".encode())
        digest.update(values.tobytes())
    return digest.hexdigest()


def _single(values: npt.ArrayLike) -> Array:
    """Values as they come back from the log."""
    return np.asarray(values, dtype=np.float32).astype(np.float64)


READINGS = {
    "tool_pose": "tool", "joint_positions": "joints", "gripper_width": "width",
    "finger_force": "press", "tool_wrench": "wrench",
}  # fmt: skip
"""What is read of the robot in each step, and the array that keeps it."""
COMMANDS = ("stop", "release", "set_gripper")
"""Commands that a replay must give again."""


def _blank() -> dict[str, Any]:
    """The notes of a step in which the robot has not said anything yet."""
    shapes = {"joints": 6, "width": (), "press": (), "wrench": 6}
    silent = {name: np.zeros(shape) for name, shape in shapes.items()}
    return {**silent, "tool": np.eye(4), "servo": np.full((3, 4), np.nan), "events": []}


class RecordedRobot:
    """A `hadr.handover.robot.Robot` that notes every question, answer and command."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.step = robot, _blank()

    @property
    def protective_stop(self) -> str:
        """As the robot says."""
        reason = self.robot.protective_stop
        if reason:
            self.step["events"].append(["protective_stop", reason])
        return reason

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name.startswith("_"):
            raise AttributeError(name)
        return partial(self._ask, name)

    def _ask(self, name: str, *given: Any, **how: Any) -> Any:
        """Call a method of the robot and note it."""
        notes = self.step
        if name in COMMANDS:
            notes["events"].append([name, *given])
        elif name == "servo_to":
            notes["servo"] = np.array(given[0])[:3]
        try:
            answer = getattr(self.robot, name)(*given, **how)
        except (UnreachableError, ValueError) as error:
            notes["events"].append([f"{name}_error", type(error).__name__, str(error)])
            raise
        if name in READINGS:
            read = _single(answer)
            notes[READINGS[name]] = read.copy()
            return read if read.ndim else float(read)
        if name == "reachable" or np.any(answer):
            notes["events"].append([name, *np.atleast_1d(answer).tolist()])
        return answer


class RecordedHandover(Handover):
    """A handover that keeps a log of itself. Its `robot` is a `RecordedRobot` around the real one.

    The arguments are those of `Handover`.
    """

    def __post_init__(self) -> None:
        self.recorded = RecordedRobot(self.robot)
        self.robot = cast(Robot, self.recorded)
        self.choose_grasp = partial(self._choose, self.choose_grasp)
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
        notes = self.recorded.step = _blank()
        given, row, cloud = self._keep(cleaned(observation))
        try:
            return super().step(given, dt)
        finally:  # a step that raised is the last one, and the log ends with it
            self._steps.append(notes)
            confidence = np.inf if given.confidence is None else given.confidence
            self._given.append((given.time, given.taken, dt, confidence, row, cloud))
            if not self._cautions or self._cautions[-1][1] != self.caution:
                self._cautions.append((self.time, self.caution))

    def log(self) -> RunLog:
        """The run up to now; one that a driver's own kind of error ended can't be replayed."""
        steps, table = self._steps, np.array(self._given, dtype=np.float64).reshape(-1, 6)
        names = ("time", "taken", "dt", "confidence", "hand", "cloud")
        arrays: dict[str, npt.NDArray[Any]] = dict(zip(names, table.T, strict=True))
        arrays |= {name: arrays[name].astype(np.int32) for name in names[4:]}
        lists = {name: np.stack([notes[name] for notes in steps]) for name in READINGS.values()}
        lists |= {
            "keypoints": np.reshape(self._hands, (-1, 21, 3)),
            "points": np.reshape(self._clouds, (-1, KEPT_POINTS + 1, 3)),
            "tool": lists["tool"][:, :3],
            "servo": np.reshape([notes["servo"] for notes in steps[1:]], (-1, 3, 4)),
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
                [step - 1, *event] for step, notes in enumerate(steps) for event in notes["events"]
            ],
        }
        return RunLog(arrays, header)

    def _keep(self, observation: Observation) -> tuple[Observation, int, int]:
        """Store an observation; give it as the workflow may see it, and its rows."""
        row = cloud = -1
        keypoints = observation.keypoints
        if keypoints is not None:
            try:
                with np.errstate(over="ignore"):
                    keypoints = _single(keypoints)
            except NOT_NUMBERS:
                keypoints = np.zeros(0)
            if keypoints.shape == (21, 3):
                same = self._hands and np.array_equal(self._hands[-1], keypoints, equal_nan=True)
                if not same:
                    self._hands.append(keypoints)
                row = len(self._hands) - 1
            else:
                keypoints = np.zeros(keypoints.shape)
                self._odd[str(len(self._given))] = list(keypoints.shape)
        points = observation.object_points
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

    def _choose(
        self,
        choose: ChooseGrasp,
        points: Array,
        keypoints: Array,
        _: Robot,
        scene: Array | None,
        way: Way,
    ) -> ChosenGrasp | None:
        """Choose a grasp, and note it or why there is none; what the search asks is not noted."""
        events = self.recorded.step["events"]
        try:
            grasp = choose(points, keypoints, self.recorded.robot, scene, way)
            chose: list[Any] = [None]
            if grasp is not None:
                pose = np.asarray(grasp.pose, dtype=np.float64).tolist()
                chose = [pose, float(grasp.width), float(grasp.score), float(grasp.feel)]
        except NO_GRASP as error:
            events.append(["choose_error", type(error).__name__, str(error)])
            raise
        events.append(["chose", *chose])
        return grasp

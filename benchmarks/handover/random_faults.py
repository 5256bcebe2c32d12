"""Does the workflow ever move unsafely while things break? Random faults, and a judge of its own.

    python benchmarks/handover/random_faults.py --runs 1000 --jobs 2 \\
        --json results/random_faults.json

Each run is a rehearsal on the arm without physics, of another of 48 holds on which the handover's
settings were found: a hand that swings, and one to three faults of perception, robot or person that
begin and end at random. Every second run has the settings of the attempts in place of the
standard's, and sees ten pictures a second, each 0.1 s late. The judge shares the arm's kinematics
and the gripper's sizes with the guard: speeds are finite differences of the recorded joints, the
arm is the surface that pictures show, the person the skin of the same pictures, where they truly
are. It does not ask for distances while the object is carried away from the hand. Runs of this
code that are in the file are not made again.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh
from scipy.spatial import ConvexHull

from hadr.camera import transform_points
from hadr.handover import ur5
from hadr.handover.grasping.selection import GraspSelection
from hadr.handover.observation import Observation
from hadr.handover.simulated_ur5 import SimulatedUR5
from hadr.handover.stages import HandoverConfig
from hadr.handover.workflow import Handover
from hadr.records.dependencies import code_digest, named_modules
from hadr.records.provenance import provenance
from hadr.records.result_file import digest, read_result_file, write_result_file
from hadr.simulation.robot.arm_shape import Part, _links, gripper_surfaces
from hadr.simulation.trials import TRIAL_OBJECTS
from hadr.simulation.trials.rehearsal import REHEARSAL_CAMERA, Moment, MovingHand, rehearse
from hadr.simulation.trials.trial import ATTEMPT_CONFIG
from hadr.simulation.world.scenes import held_scene

Array = npt.NDArray[np.float64]
DT, LATE = 1 / 30, 3
"""Seconds of a step, and the steps by which pictures are late in every second run."""
HOLDS = range(920, 926)
SPEED, ACCELERATION, TOOL_SPEED = np.pi / 4, 5.0, 0.25
"""Limits of joints, rad/s (a quarter of the UR5's) and rad/s2, and of the tool point, m/s."""
ANGLES = np.array([2, 2, 1, 2, 2, 2]) * np.pi
"""Limits of the joints' angles to either side, radians."""
TOLERANCE = 1.001
FAR, BLIND_FAR = 0.05, 0.5
"""Farther from the arm a hand is not measured, also where it is not seen; metres."""
INTO_SKIN, BLIND_WAY = 0.002, 0.010
"""The arm's own way within the skin, or toward it while blind, that counts as unsafe, metres."""
BLIND_AFTER = 0.3 + 0.15 + 2 * DT
"""Unseen for so long, seconds, a hand must have stopped the arm: its own limit, time to brake."""
TAKES = 0.06
"""Fingers that alone hold the object may open for a hand that is so near to them, metres."""


@dataclass(frozen=True)
class Fault:
    """What breaks, from when to when (seconds), and how much."""

    kind: str
    since: float
    until: float
    size: float
    direction: Array

    def on(self, time: float) -> bool:
        """Whether it lasts at a time in seconds."""
        return self.since <= time < self.until


def seen(fault: Fault, o: Observation, held: list[Observation], rng: np.random.Generator) -> Any:
    """What arrives of an observation under a fault of perception."""
    points, keypoints = o.object_points, o.keypoints
    shift = fault.size * fault.direction
    before = ([h for h in held if h.time < fault.since] or held[:1])[-1]
    if keypoints is None and fault.kind in OF_KEYPOINTS:
        return o
    match fault.kind:
        case "no hand":
            return replace(o, keypoints=None)
        case "one keypoint is NaN":
            return replace(o, keypoints=np.where(np.arange(21)[:, None] == 8, np.nan, keypoints))
        case "keypoints frozen":
            return replace(o, keypoints=before.keypoints)
        case "pictures hang":
            return replace(before, time=o.time)
        case "pictures late":
            late = [h for h in held if h.taken <= o.time - 0.5 * fault.size]
            return replace((late or held)[-1 if late else 0], time=o.time)
        case "hand reported elsewhere":
            return replace(o, keypoints=keypoints + 0.5 * shift)
        case "keypoints noisy":
            return replace(o, keypoints=keypoints + rng.normal(0, 0.03 * fault.size, (21, 3)))
        case "millimetres for metres":
            points = None if points is None else 1000 * points
            return replace(o, keypoints=1000 * keypoints, object_points=points)
        case "keypoints of another shape":
            return replace(o, keypoints=keypoints[:20])
        case "no points of the glass":
            return replace(o, object_points=None)
        case "points elsewhere":
            return o if points is None else replace(o, object_points=points + shift)
        case "confidence NaN":
            return replace(o, confidence=float("nan"))
        case "clock jumps":
            jump = float(np.sign(fault.direction[0]) * 10 ** (3 * fault.size - 1))
            return replace(o, time=o.time + jump, frame_time=o.taken + jump)
        case "no time":
            return replace(o, time=float("nan"))
        case "picture from the future":
            return replace(o, frame_time=o.taken + fault.size)
    raise ValueError(fault.kind)


PERCEPTION = (
    "no hand", "one keypoint is NaN", "keypoints frozen", "pictures hang", "pictures late",
    "hand reported elsewhere", "keypoints noisy", "millimetres for metres",
    "keypoints of another shape", "no points of the glass", "points elsewhere", "confidence NaN",
    "clock jumps", "no time", "picture from the future",
)  # fmt: skip
OLDER = ("keypoints frozen", "pictures hang", "pictures late")
OF_KEYPOINTS = (
    "one keypoint is NaN", "hand reported elsewhere", "keypoints noisy", "millimetres for metres",
    "keypoints of another shape",
)  # fmt: skip
BLIND = (*PERCEPTION[:4], "millimetres for metres", "keypoints of another shape")
"""Under these no hand can be seen where it is."""
ROBOT = (
    "protective stop", "pull at the gripper", "fingers stuck", "driver fails", "no wrench",
)  # fmt: skip
PERSON = ("the hand comes", "the hand goes", "the hand never rests")


class BrokenUR5(SimulatedUR5):
    """The arm, of which things break."""

    def __init__(self, faults: list[Fault]) -> None:
        super().__init__()
        self.faults, self.time = faults, 0.0

    def _has(self, kind: str) -> Fault | None:
        return next((f for f in self.faults if f.kind == kind and f.on(self.time)), None)

    def servo_to(self, base_from_tool: Array, dt: float, **how: Any) -> None:
        """As the arm does, or with a driver's error."""
        if self._has("driver fails"):
            raise OSError("the connection was lost")
        super().servo_to(base_from_tool, dt, **how)

    def tool_wrench(self) -> Array:
        """As the arm does, or with somebody who pulls, or with a sensor that gives no number."""
        if self._has("no wrench"):
            return np.full(6, np.nan)
        pull = self._has("pull at the gripper")
        return (
            super().tool_wrench()
            if pull is None
            else np.append(30 * pull.size * pull.direction, [0, 0, 0])
        )

    def _move_fingers(self, dt: float) -> None:
        if self._has("fingers stuck") is None:
            super()._move_fingers(dt)


@dataclass(frozen=True)
class Person(MovingHand):
    """A hand that may also come or go, metres a second along a direction, from some time on."""

    fault: Fault | None = None

    def moved(self, time: float) -> Array:
        """As `MovingHand.moved`, with that way."""
        pose = super().moved(time)
        if self.fault is not None and time > self.fault.since:
            gone = min(time, self.fault.until) - self.fault.since
            sign = -1.0 if self.fault.kind == "the hand comes" else 1.0
            pose[0, 3] += sign * min(0.6 * self.fault.size * gone, 0.35)
        return pose


def faults_of(rng: np.random.Generator) -> list[Fault]:
    """Draw one to three faults."""
    found = []
    for _ in range(rng.integers(1, 4)):
        group = [PERCEPTION, ROBOT, PERSON][rng.choice(3, p=(0.65, 0.2, 0.15))]
        since, d = rng.uniform(0, 9), rng.normal(size=3)
        until = since + float(rng.choice([DT, 0.2, 0.6, 2.0, 30.0]))
        kind = str(rng.choice(group))
        found.append(Fault(kind, since, until, rng.uniform(0.1, 1), d / np.linalg.norm(d)))
    return found


def run(number: int) -> dict[str, Any]:
    """Rehearse once, with scene and faults of this number, and judge it."""
    rng = np.random.default_rng([number, 83])
    faults = faults_of(rng)
    hold, which = divmod(number, len(TRIAL_OBJECTS))
    scene = held_scene(TRIAL_OBJECTS[which], HOLDS[hold % len(HOLDS)], number)
    camera = REHEARSAL_CAMERA
    moves = next((f for f in faults if f.kind in ("the hand comes", "the hand goes")), None)
    calm = np.inf if any(f.kind == "the hand never rests" for f in faults) else 2.0
    hand = Person(
        scene, camera, seed=number, drift=rng.uniform(0, 0.06), turn=rng.uniform(0, 0.3),
        calm_after=calm, noise=0.002, fault=moves,
    )  # fmt: skip
    robot, slow = BrokenUR5(faults), number % 2 == 1
    config = ATTEMPT_CONFIG if slow else HandoverConfig()
    handover = Handover(robot, GraspSelection(rng, camera[:3, 3]), camera, config)
    held: list[Observation] = []
    unseen: list[bool] = []

    def spoil(o: Observation) -> Observation:
        robot.time = o.time
        if (stop := robot._has("protective stop")) and o.time < stop.since + 1.5 * DT:
            robot.protective_stop = "a person pushed"
        held.append(o)
        blind = False
        if slow:
            o = replace(held[max(len(held) - 1 - LATE, 0)], time=o.time)
        # an older picture comes with the faults of its stream, whatever the order of the draw
        for fault in sorted(faults, key=lambda fault: fault.kind not in OLDER):
            if fault.kind in PERCEPTION and fault.on(o.time):
                blind |= fault.kind in BLIND
                o = seen(fault, o, held, rng)
        unseen.append(blind)
        return o

    raised, moments = "", list[Moment]()
    try:
        rehearse(
            handover, hand, dt=DT, past_stops=True, spoil=spoil, longest=40.0, moments=moments,
            picture_every=0.1 if slow else 0.0,
        )  # fmt: skip
    except OSError as error:
        raised = str(error)
    found = unsafe(moments, unseen, scene.hand(0.01).surface.vertices)
    if raised and not robot._stopped:
        found["not stopped after the driver's error"] = 1.0
    return {
        "run": number,
        "code": code(),
        "scene": scene.hold.hold_id,
        "faults": [f.kind for f in faults],
        "end": handover.stage.value,
        "stops": handover.tries,
        "raised": raised,
        "unsafe": found,
    }


def unsafe(moments: list[Moment], unseen: list[bool], skin: Array) -> dict[str, float]:
    """What a run did that must not be, with its worst value; skin in the wrist frame, metres."""
    found: dict[str, float] = {}
    if len(moments) < 3:
        return found
    joints = np.stack([m.joints for m in moments])
    velocity = np.diff(joints, axis=0) / DT
    tool = np.linalg.norm(np.diff([m.tool[:3, 3] for m in moments], axis=0), axis=1) / DT
    for name, worst, most in (
        ("joint speed, rad/s", np.abs(velocity).max(), SPEED),
        ("tool speed, m/s", tool.max(), TOOL_SPEED),
        ("joint angle, of its limit", (np.abs(joints) / ANGLES).max(), 1.0),
        ("tool below the table, m", max(-m.tool[2, 3] for m in moments), 0.0),
        ("link below the table, m", max(-m.outline[2:, 2].min() for m in moments), 0.0),
    ):
        if worst > most * TOLERANCE:
            found[name] = float(worst)
    # a stop is at once; whoever speeds up or turns round keeps the limit
    change = np.abs(np.diff(velocity, axis=0)) / DT
    moving = (np.abs(velocity[1:]) > 1e-9).any(axis=1)
    if moving.any() and (worst := change[moving].max()) > ACCELERATION * TOLERANCE:
        found["joint acceleration, rad/s2"] = float(worst)
    blind_for, toward, within = 0.0, 0.0, 0.0
    for k, (before, now) in enumerate(pairwise(moments), start=1):
        blind_for = blind_for + DT if k < len(unseen) and unseen[k] else 0.0
        toward = toward if blind_for > BLIND_AFTER else 0.0
        points = transform_points(now.base_from_wrist, skin)
        opens = now.gripper_width > before.gripper_width + 1e-6
        if before.holder == "gripper" and opens:
            away = depth_in(now, points, 2 * TAKES, links=False)
            if away > TAKES:
                found["opened with no hand there, m"] = away
        carries = now.stage.value == "Grasp & Retrieve" and now.holder == "gripper"
        still = np.allclose(before.joints, now.joints, rtol=0, atol=1e-9)
        if carries or (still and abs(now.gripper_width - before.gripper_width) < 1e-9):
            continue
        far = BLIND_FAR if blind_for > BLIND_AFTER else FAR
        gap = depth_in(now, points, far)
        within = within if gap < 0 else 0.0
        if gap >= 0 and blind_for <= BLIND_AFTER:
            continue
        its = depth_in(before, points, far)
        within += max(0.0, min(its, 0.0) - gap) if gap < 0 else 0.0
        if within > INTO_SKIN or (-gap > INTO_SKIN and gap < its - 5e-4):
            found["into the skin, m"] = max(found.get("into the skin, m", 0.0), -gap)
        if blind_for > BLIND_AFTER:
            toward += max(0.0, its - gap)
            if toward > BLIND_WAY:
                found["toward a hand unseen, m"] = toward
    return found


def depth_in(moment: Moment, points: Array, least: float = FAR, *, links: bool = True) -> float:
    """Free space of arm and gripper as they are drawn to points (n, 3), metres; minus: inside.

    Where it is larger than `least`, that; without the arm's links if they are not asked for.
    """
    near = [(moment.tool, gripper(round(moment.gripper_width, 3)))]
    if links:
        frames = ur5.BASE_LINK_FROM_DH_BASE @ ur5.joint_frames(moment.joints)
        near += zip(frames[1:], moving_links(), strict=True)
    for frame, solids in near:
        own = transform_points(np.linalg.inv(frame), points)
        lowest, highest = (np.stack([box[i] for box in solids]) for i in (1, 2))
        own = own[((own > lowest.min(0) - least) & (own < highest.max(0) + least)).all(axis=1)]
        for faces, low, high in solids:
            if not len(own):
                break
            some = own[((own > low - least) & (own < high + least)).all(axis=1)]
            if len(some):  # a convex solid is behind all of its faces
                gaps = (some @ faces[:, :3].T + faces[:, 3]).max(axis=1)
                least = min(least, float(gaps.min()))
    return least


def convex(parts: Iterable[Part]) -> list[tuple[Array, Array, Array]]:
    """Planes (k, 4) of each connected piece's convex hull, and the corners of its box."""
    pieces = [
        piece
        for surface, _ in parts
        for piece in trimesh.Trimesh(surface.vertices, surface.faces).split(only_watertight=False)
    ]
    return [
        (np.unique(ConvexHull(p.vertices).equations.round(6), axis=0), *p.bounds) for p in pieces
    ]


@cache
def moving_links() -> list[list[tuple[Array, Array, Array]]]:
    """The solids of all links that move, each in its link's frame."""
    return [convex(link) for link in _links()[1:]]


@cache
def code() -> str:
    """Checksum of this script and of the code behind it."""
    own = Path(__file__).read_text(encoding="utf-8")
    return digest({"judge": own, "library": code_digest(*named_modules(own))})


@cache
def gripper(width: float) -> list[tuple[Array, Array, Array]]:
    """The gripper's solids, open by a width in metres, in the tool's frame."""
    return convex(gripper_surfaces(np.eye(4), width))


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--json", type=Path, required=True)
    args = parser.parse_args()
    rows = list(read_result_file(args.json).rows) if args.json.exists() else []
    rows = [row for row in rows if row.get("code") == code()]
    what = "runs of the workflow on the arm without physics, with random faults, judged by geometry"
    with ProcessPoolExecutor(args.jobs) as pool:
        made = {row["run"] for row in rows}
        left = [number for number in range(args.runs) if number not in made]
        for row in pool.map(run, left):
            rows = sorted([*rows, row], key=lambda row: row["run"])
            if row["unsafe"]:
                print(row, flush=True)
            if len(rows) % 20 == 0 or len(rows) == args.runs:
                write_result_file(args.json, what, rows, provenance())
    print(Counter(row["end"] for row in rows))
    print("unsafe:", Counter(name for row in rows for name in row["unsafe"]))


if __name__ == "__main__":
    main()

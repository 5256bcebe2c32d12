"""One attempt, closed loop: world, camera, sight, workflow and judge, stepped together.

The world is stepped at 50 Hz beside the workflow. The camera takes a picture ten times a second,
and what is seen in it arrives 0.1 s later, as a real pipeline's answer does; both can be changed.
Everything random comes from the attempt's seed, so the same attempt ends in the same way.
"""

from __future__ import annotations

import time as clock
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import Any, cast

import numpy as np

from hadr.handover.grasping.selection import GraspSelection
from hadr.handover.logs.run_log import RecordedHandover, RunLog
from hadr.handover.simulated_ur5 import ArmConfig
from hadr.handover.stages import ChosenGrasp, HandoverConfig, Stage, Transition
from hadr.records.caches import file_sha256
from hadr.records.dependencies import code_digest
from hadr.records.provenance import IF_CHANGED, record_of
from hadr.simulation.camera.robot_camera import RobotCamera
from hadr.simulation.camera.sight import (
    CHECKPOINTS,
    SOURCES,
    DepthSource,
    Look,
    Sight,
    bundled_file,
    bundled_finder,
    keypoint_uncertainty,
)
from hadr.simulation.robot.motion_limits import MotionConfig
from hadr.simulation.trials.outcome import AFTER_TOUCH, Outcome, Shown, believed_of, reason_of
from hadr.simulation.world.hand_motions import motion_for
from hadr.simulation.world.judge import Judge
from hadr.simulation.world.physics import World
from hadr.simulation.world.scenes import HeldScene, held_scene
from hadr.simulation.world.state import WorldState
from hadr.synthesis.glass.objects import glass_object

ADDED = ("no-rescoring", "no-tracking", "networks")
"""What may follow a kind of depth in a condition's name, each after a dash, in this order: grasps
by their own score alone; a robot that stays with the pose that it chose; masks and keypoints from
networks."""
CONDITIONS: tuple[str, ...] = tuple(
    "-".join((source, *added))
    for count in range(len(ADDED) + 1)
    for added in combinations(ADDED, count)
    for source in SOURCES
)
"""Names of all conditions, the kinds of depth alone first."""
_CONDITION = f"be one of {', '.join(SOURCES)}, and may have -{', -'.join(ADDED)} in this order"
CODE = (
    "hadr.simulation.trials.trial",
    "hadr.models.hadr",
    "hadr.models.hadr_plus",
    "hadr.rivals.unet_hand",
)
"""Modules with which an attempt begins: this one, and those of networks that are loaded by name."""
PLANNING_TIME = 0.16
"""Seconds of the simulated world that a search for a grasp takes; the arm stands meanwhile. It is
the measured mean of 27 searches with perfect depth, in processor time on one busy core, in ten
scenes of which none is the experiment's; but a constant, so that a slower machine does not end an
attempt otherwise."""
CONTROL_STEP = 0.02
"""Seconds between two steps of the workflow."""
SLOWEST_PICTURES = 0.1
"""Fewer pictures a second than this are refused: HandoverSim's 13 seconds would see but one."""
LARGEST_LATENCY = 2.0
"""Later than this, seconds, no picture is answered."""


ATTEMPT_CONFIG = HandoverConfig(
    turn_speed=2.0,
    advance_speed=0.12,
    largest_drift=0.012,
    restless_after=1.0,
    about="centroid",
    feel_ahead=0.05,
    feel_aside=0.02,
    back_speed=0.12,
    smallest_singular_value=0.001,
    longest_singular=0.3,
)
"""Settings of all attempts, found on holds that are none of the experiment's. Keypoints with an
error of 4 mm make the pre-grasp move by more than the standard 5 mm although the hand rests, and
the program that moves this arm holds its limits nearer to a singular pose than the standard."""
ATTEMPT_ARM = ArmConfig(speed_fraction=0.6, finger_speed=0.15)
ATTEMPT_MOTION = MotionConfig(joint_acceleration=9.0, turn_speed=2.0, turn_acceleration=6.0)


@dataclass(frozen=True)
class Trial:
    """One attempt.

    Attributes:
        object_id: Which object.
        hold_number: Which of its holding poses.
        condition: One of `CONDITIONS`: whose depth the robot sees, and what of `ADDED` differs.
        seed: Seed of place, motion, noise and of the grasps' draws.
        hand_speed: Factor on the speed of the hand's motion.
        extrinsics_error_deg: The camera stands turned by this angle from what its calibration says.
        time_limit: Seconds until the attempt has failed.
        restless: What moves never comes to rest; else it dies down over two seconds.
        picture_rate: Pictures a second, 0.1 to 50: each is taken at the first step of the workflow
            at which it is due.
        latency: Seconds from a picture to what is seen in it, in whole steps of 0.02 s.
        turn_degrees: Every hand turns, by at most this angle to each side; unset: six kinds of
            motion, of which one turns by at most 18 degrees.
    """

    object_id: str
    hold_number: int
    condition: str = "hadr"
    seed: int = 0
    hand_speed: float = 1.0
    extrinsics_error_deg: float = 0.0
    time_limit: float = 13.0
    restless: bool = field(default=False, metadata=IF_CHANGED)
    picture_rate: float = field(default=10.0, metadata=IF_CHANGED)
    latency: float = field(default=0.1, metadata=IF_CHANGED)
    turn_degrees: float | None = field(default=None, metadata=IF_CHANGED)

    def __post_init__(self) -> None:
        glass_object(self.object_id)  # says which there are
        for item in fields(self):  # 60 and 60.0 are one attempt
            if "float" in str(item.type) and isinstance(value := getattr(self, item.name), int):
                object.__setattr__(self, item.name, float(value))
        often = SLOWEST_PICTURES <= self.picture_rate <= 1 / CONTROL_STEP
        steps = self.latency / CONTROL_STEP
        in_steps = 0 <= self.latency <= LARGEST_LATENCY and abs(steps - round(steps)) < 1e-9
        turns = self.turn_degrees is None or 0 < self.turn_degrees <= 90
        for name, fine, words in (
            ("hold_number", self.hold_number >= 0, "be 0 or more"),
            ("seed", self.seed >= 0, "be 0 or more"),
            ("condition", self.condition in CONDITIONS, _CONDITION),
            ("hand_speed", 0 < self.hand_speed < np.inf, "be a factor above 0"),
            ("extrinsics_error_deg", 0 <= self.extrinsics_error_deg <= 90, "lie in 0..90"),
            ("time_limit", 0 < self.time_limit < np.inf, "be seconds above 0"),
            ("picture_rate", often, f"be pictures a second, {SLOWEST_PICTURES:g} to 50"),
            ("latency", in_steps, f"lie in 0..{LARGEST_LATENCY:g}, a multiple of {CONTROL_STEP}"),
            ("turn_degrees", turns, "be above 0 and at most 90"),
        ):
            if not fine:
                raise ValueError(f"{name} must {words}, got {getattr(self, name)!r}")

    @property
    def name(self) -> str:
        """Name of the attempt's files, such as ``0004-902``."""
        return f"{self.object_id}-{self.hold_number}"

    def pictures_by(self, step: int) -> int:
        """How many pictures are due, after the first one, by a step of the workflow."""
        return int(step * CONTROL_STEP * self.picture_rate + 1e-9)

    @property
    def record(self) -> dict[str, Any]:
        """All that the attempt depends on; what all attempts share is part of the code.

        FileNotFoundError where a bundled network of this condition is not there.
        """
        sums = {name: file_sha256(path) for name, path in network_files(self.condition).items()}
        return {**record_of(self), "networks": sums, "code": _code()}


@cache  # what this process has loaded does not change
def _code() -> str:
    """Checksum of the code of all attempts."""
    return code_digest(*CODE, without=("hadr.models.networks",))  # it leads to every network


def depth_source(condition: str) -> DepthSource:
    """Where a condition's depth comes from: its name without what differs."""
    for words in reversed(ADDED):
        condition = condition.removesuffix(f"-{words}")
    return cast("DepthSource", condition)


def network_files(condition: str) -> dict[str, Path]:
    """The bundled checkpoints that a condition uses, by their names in `sight`."""
    found = ("segmentation", "keypoints") if finds_by_networks(condition) else ()
    names = (depth_source(condition), *found)
    return {name: bundled_file(name) for name in names if name in CHECKPOINTS}


def finds_by_networks(condition: str) -> bool:
    """Say whether networks find mask and keypoints, which else come from the simulator."""
    return condition.endswith("-networks")


@dataclass(frozen=True)
class Run:
    """An attempt that has been made: what was held out, how it ended, every change of stage.

    The states are of the world 25 times a second, the log is for a replay.
    """

    trial: Trial
    scene: HeldScene
    outcome: Outcome
    states: tuple[WorldState, ...]
    transitions: tuple[Transition, ...]
    log: RunLog


def run_trial(
    trial: Trial,
    *,
    spoil: Callable[[Look], Look] | None = None,
    on_step: Callable[[World, WorldState, Stage], None] | None = None,
) -> Run:
    """Make one attempt; the same for the same description, but for its wall-clock times.

    Args:
        trial: What to try.
        spoil: Puts something between the world and its sight, such as `broken_sight`.
        on_step: Told of the world, its state and the stage after each step, for watching.
    """
    started = clock.perf_counter()
    scene = held_scene(trial.object_id, trial.hold_number, trial.seed)
    motion = motion_for(
        scene,
        trial.hold_number,
        trial.seed,
        speed=trial.hand_speed,
        restless=trial.restless,
        turn=None if trial.turn_degrees is None else np.deg2rad(trial.turn_degrees),
    )
    world = World(scene, motion.moved, ATTEMPT_ARM, ATTEMPT_MOTION, trial.seed)
    camera = RobotCamera().miscalibrated(trial.extrinsics_error_deg, trial.seed)
    base_from_camera = camera.calibration
    finder = bundled_finder() if finds_by_networks(trial.condition) else None
    sight = Sight(scene, camera, depth_source(trial.condition), seed=trial.seed, finder=finder)
    look = sight.look if spoil is None else spoil(sight.look)
    rng = np.random.default_rng([trial.seed, int(trial.object_id), trial.hold_number, 67])
    by_wishes = "-no-rescoring" not in trial.condition
    choose = GraspSelection(rng, base_from_camera[:3, 3], rescoring=by_wishes)
    searches: list[float] = []  # seconds

    def select(*given: Any) -> ChosenGrasp | None:
        before = clock.perf_counter()
        try:
            return choose(*given)
        finally:
            searches.append(clock.perf_counter() - before)

    config = replace(
        ATTEMPT_CONFIG,
        tracking="-no-tracking" not in trial.condition,
        human_uncertainty=keypoint_uncertainty(by_networks=finder is not None),
    )
    handover = RecordedHandover(world.robot, select, base_from_camera, config)
    judge = Judge(scene.item.height, trial.time_limit)
    states = [world.state()]
    shown = Shown(look(states[0], True), sight.right, states[0].base_from_object)
    arriving, believed = deque([(0, shown)]), (float("nan"),) * 3
    step = ready = 0
    forces: dict[str, float] = {}
    while not judge.verdict or (
        judge.verdict == "human contact" and world.time < judge.decided_at + AFTER_TOUCH
    ):
        if trial.pictures_by(step) > trial.pictures_by(step - 1):  # the first is there already
            seen = look(states[-1], handover.stage is Stage.WAIT_AND_OBSERVE)
            new = Shown(seen, sight.right, states[-1].base_from_object)
            arriving.append((step + round(trial.latency / CONTROL_STEP), new))
        while arriving and arriving[0][0] <= step:
            _, shown = arriving.popleft()
        if step >= ready:
            searched, before = len(searches), len(handover.transitions)
            handover.step(replace(shown.observation, time=world.time), CONTROL_STEP)
            if len(searches) > searched:
                ready = step + 1 + round(PLANNING_TIME / CONTROL_STEP)
            if any(t.after is Stage.APPROACH_AND_REACT for t in handover.transitions[before:]):
                believed = believed_of(handover, shown, scene)
        world.step(CONTROL_STEP)
        state = world.state()
        states.append(state)
        judge.look(state)
        for way, force in (("touch", state.hand_force), ("through the glass", state.through_force)):
            if force > 0:
                name = f"{way}, {handover.stage.value}"
                forces[name] = max(force, forces.get(name, 0.0))
        if handover.stage is Stage.GAVE_UP:
            judge.give_up(world.time)
        if on_step is not None:
            on_step(world, state, handover.stage)
        step += 1
    chosen = [t for t in handover.transitions if t.after is Stage.APPROACH_AND_REACT]
    outcome = Outcome(
        verdict=judge.verdict,
        reason=reason_of(judge.verdict, handover),
        decided_at=judge.decided_at,
        first_grasp_at=chosen[0].time if chosen else float("nan"),
        grasps_chosen=len(chosen),
        smallest_distance=judge.smallest_distance,
        largest_force=judge.largest_force,
        motion=motion.kind,
        kind=scene.hold.kind,
        planning_wall_seconds=float(np.mean(searches)) if searches else float("nan"),
        wall_seconds=clock.perf_counter() - started,
        corrections=handover.advance.all_corrections,
        forces=forces,
        points_right=believed[0],
        points_right_at_grasp=believed[1],
        grasp_off=believed[2],
        torn=world.torn,
    )
    return Run(
        trial, scene, outcome, tuple(states[::2]), tuple(handover.transitions), handover.log()
    )

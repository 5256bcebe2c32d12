"""The three stages of the handover as a state machine that anyone can read and replay.

Wait & Observe chooses a grasp from restored points. Approach & React goes to the pre-grasp and
follows the hand. Grasp & Retrieve closes in, takes the object and pulls it back. Whatever must not
go on ends in Stopped with a reason; once the cause is gone it starts again, and after too many
stops or too long a time the arm goes home. The logic knows a robot and observations, nothing else.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from hadr.camera import Array
from hadr.handover import safety, stages
from hadr.handover.grasp_and_retrieve import ADVANCING, Advance, Retrieval
from hadr.handover.grasping.grasps import forward_of
from hadr.handover.grasping.selection import Choosing
from hadr.handover.guarded_arm import GuardedArm, HaltError
from hadr.handover.observation import HandWatch, Observation, cleaned
from hadr.handover.poses import check_pose, pose_distance
from hadr.handover.recovery import Recovery
from hadr.handover.robot import Robot, UnreachableError
from hadr.handover.stages import ChooseGrasp, ChosenGrasp, HandoverConfig, Stage, Transition
from hadr.handover.tracking import HandMotion, hand_motion

CLOCK_JUMP = 1.0
"""An observation's time that stands still, runs back, or is this much later than the one before,
seconds, is another clock's: the handover's own goes on, and counts from there."""


@dataclass
class Handover:
    """One handover in progress. Call `step` at a steady rate with the newest observation.

    Attributes:
        robot: The robot that it moves.
        choose_grasp: Chooses among candidates; see `hadr.handover.grasping.selection`.
        base_from_camera: The camera's calibration, shape (4, 4), metres.
        config: Its settings.
        stage: Where it stands.
        transitions: Every change of stage with its reason, oldest first.
        caution: Why the robot is slower than it could be or waits; empty where it is not.
        tries: How often it was stopped.
        time: Its clock, seconds: the observations' time, less all its jumps.
        target: Tool pose that the robot is sent to, shape (4, 4); None before a grasp is chosen.
        motion: The hand's motion since the grasp was chosen; None before.
        grasp: The grasp that was chosen, where the object was then; None before.
    """

    robot: Robot
    choose_grasp: ChooseGrasp
    base_from_camera: Array
    config: HandoverConfig = field(default_factory=HandoverConfig)
    stage: Stage = field(default=Stage.WAIT_AND_OBSERVE, init=False)
    transitions: list[Transition] = field(default_factory=list, init=False)
    caution: str = field(default="", init=False)
    tries: int = field(default=0, init=False)
    time: float = field(default=float("nan"), init=False)
    target: Array | None = field(default=None, init=False)
    motion: HandMotion | None = field(default=None, init=False)
    grasp: ChosenGrasp | None = field(default=None, init=False)
    _offset: float = field(default=0.0, init=False)
    _shown: float = field(default=float("nan"), init=False)
    _first_seen: float = field(default=float("inf"), init=False)
    _entered: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        check_pose(self.base_from_camera, "base_from_camera")
        self.watch = HandWatch(self.base_from_camera)
        self.arm = GuardedArm(self.robot, self.config, self.watch)
        self.choosing = Choosing(self.choose_grasp, self.watch, self.config)
        self.recovery, self.retrieval = Recovery(self.arm), Retrieval(self.arm)
        self.advance = Advance(self.arm)

    @property
    def over(self) -> bool:
        """True once the handover has finished, or was given up and the arm stands."""
        return self.stage in (Stage.FINISHED, Stage.GAVE_UP)

    @property
    def part(self) -> str:
        """Which part of the stage, see `Advance`, `Retrieval` and `Recovery`; most have none."""
        if self.stage is Stage.STOPPED:
            return self.recovery.part
        if self.stage in (Stage.GRASP_AND_RETRIEVE, Stage.FINISHED):
            return self.retrieval.part or self.advance.part
        return ""

    def step(self, observation: Observation, dt: float) -> Stage:
        """Look once and move until the next call, dt seconds, at most 0.1; give the stage then.

        The observation may be of the same picture as the one before. Nothing raises on bad ones:
        they stop the robot. Whatever the robot's driver raises stops it for good, and goes on.
        """
        if not 0 < dt <= 0.1:
            raise ValueError(f"dt must be more than 0 and at most 0.1 seconds, got {dt}")
        if self.over:
            return self.stage
        try:
            self._step(cleaned(observation), dt)
        except Exception as error:  # of a driver, or our own: whatever it is, nothing moves on
            with suppress(Exception):
                self.robot.stop()
            what = f"{type(error).__name__}: {error}"
            self._enter(Stage.GAVE_UP, f"stands where it is: {what}")
            raise
        return self.stage

    def _step(self, observation: Observation, dt: float) -> None:
        jump = self._tick(observation.time, dt)
        taken = observation.taken + self._offset
        if observation.taken == self._shown:  # the picture that it knows, whatever the clock did
            taken = float("nan")
        new = not jump and self.watch.look(replace(observation, frame_time=taken), self.time)
        if new or jump:
            self._shown = observation.taken
        if jump:  # who knows for how long
            self.watch.forget(jump)
        if self.watch.keypoints is not None:
            self._first_seen = min(self._first_seen, self.time)
        self.arm.read()
        self.caution = jump
        try:
            if jump:
                self.arm.hold(dt)
            else:
                self._act(observation, new, dt)
        except HaltError as halt:
            self._stop(str(halt), back=halt.back)
        except UnreachableError as error:
            self._stop(f"out of reach: {error}")

    def _tick(self, time: float, dt: float) -> str:
        """Move the clock on; say where the observations' clock jumped."""
        if np.isnan(self.time):
            self.time = time if np.isfinite(time) else 0.0
            return ""
        ahead = time + self._offset - self.time
        if 0 < ahead <= CLOCK_JUMP:
            self.time = time + self._offset
            return ""
        self.time += dt
        if not np.isfinite(time):
            return "an observation without a time"
        self._offset = self.time - time
        return f"the clock jumped by {ahead - dt:+.2f} s"

    def _act(self, observation: Observation, new: bool, dt: float) -> None:
        halted = self.arm.reading.protective_stop
        if halted and not (self.stage is Stage.STOPPED and self.part == "still"):
            raise HaltError(f"protective stop: {halted}", back=True)
        if self.stage is Stage.GOING_HOME:
            self._go_home(dt)
        elif self.stage is Stage.STOPPED:
            self._recover(observation, dt)
        elif self.stage is not Stage.GRASP_AND_RETRIEVE and self._impatient:
            self._leave(self._impatient, observation)
        elif self.stage is Stage.WAIT_AND_OBSERVE:
            self._wait_and_observe(observation, new, dt)
        else:
            self.arm.check_joints(self.time)
            if self.stage is Stage.APPROACH_AND_REACT:
                self._approach_and_react(new, dt)
            else:
                self._grasp_and_retrieve(new, dt)
            self.caution = self.caution or self.arm.caution

    @property
    def _waited(self) -> float:
        """For how long, seconds: since a hand was seen first; with an object, in this stage."""
        return self.time - (self._entered if self.arm.around_something else self._first_seen)

    @property
    def _impatient(self) -> str:
        """Say that it has waited for too long; or nothing."""
        patience = self.config.patience
        return f"no handover within {patience:.0f} s" * (self._waited > patience)

    # Wait & Observe

    def _wait_and_observe(self, observation: Observation, new: bool, dt: float) -> None:
        c, choosing = self.config, self.choosing
        self.arm.hold(dt)
        chosen = None
        if choosing.ready(observation, self.time, new=new):
            chosen = choosing.search(observation, self.time, self.robot)
        self.caution = choosing.caution
        if chosen is None or self.watch.keypoints is None:
            return
        way = self.arm.ahead(forward_of(chosen.pose, -c.back), within=np.inf)
        free = self.arm.free(*way, width=chosen.width)
        if free < safety.APPROACH_DISTANCE:
            choosing.refuse(f"the hand is {1000 * free:.0f} mm from the way to the grasp")
            self.caution = choosing.caution
            return
        self._take(chosen)
        self._enter(Stage.APPROACH_AND_REACT, f"chose a grasp with score {chosen.score:.2f}")

    def _take(self, chosen: ChosenGrasp) -> None:
        hand = self.watch.keypoints
        assert hand is not None
        self.grasp, self._chosen_hand, self.motion = chosen, hand, None
        self.target = forward_of(chosen.pose, -self.config.back)
        way = self.watch.middle - self.arm.reading.tool[:3, 3]
        self._away = way / max(float(np.linalg.norm(way)), 1e-9)
        self._arrived: tuple[float, Array] | None = None
        self._there_since: float | None = None
        self.arm.alone = self.arm.closed = False
        self.robot.set_gripper(chosen.width, stages.GENTLE_FORCE)

    # Approach & React

    def _approach_and_react(self, new: bool, dt: float) -> None:
        c, now = self.config, self.time
        if now - self._entered > c.approach_timeout:
            raise HaltError(f"pre-grasp not reached within {c.approach_timeout:.1f} s")
        if not self._see(new, dt):
            return
        assert self.target is not None  # set before this stage is entered
        assert self.grasp is not None
        path, least = self.arm.ahead(self.target), safety.APPROACH_DISTANCE
        factor = self.arm.allowed(path, least, c.approach_speed)
        self.arm.go(self.target, c.approach_speed, dt, factor=factor, swing=True)
        distance, angle = pose_distance(self.arm.reading.tool, self.target)
        if distance > 3 * stages.ARRIVE_DISTANCE or angle > 3 * stages.ARRIVE_ANGLE:
            self._there_since = None
        elif self._there_since is None:
            self._there_since = now
        waited = 0.0 if self._there_since is None else now - self._there_since
        restless = waited >= c.restless_after
        if not restless and (distance > stages.ARRIVE_DISTANCE or angle > stages.ARRIVE_ANGLE):
            self._arrived = None
            return
        if (
            self._arrived is None
            or pose_distance(self._arrived[1], self.target)[0] > c.largest_drift
        ):
            self._arrived = (now, self.target)
        if now - self._arrived[0] < stages.SETTLE_TIME - 1e-9 and not restless:
            return
        self._began, self.retrieval = self.target, Retrieval(self.arm)
        self.advance.begin(self.grasp.feel)
        reason = f"at the pre-grasp within {1000 * distance:.1f} mm, {np.rad2deg(angle):.1f} deg"
        self._enter(Stage.GRASP_AND_RETRIEVE, reason + (", the hand not calm" if restless else ""))

    def _see(self, new: bool, dt: float) -> bool:
        """Renew the target from the hand; hold and say False where there is none now."""
        c, watch = self.config, self.watch
        trouble = watch.trouble(self.time)
        if trouble:
            raise HaltError(trouble)
        if watch.keypoints is None:
            self.caution = watch.problem
            self.arm.hold(dt)
            return False
        assert self.grasp is not None  # set before these stages are entered
        moved = watch.middle - self._chosen_hand.mean(axis=0)
        jumped = watch.jumped if new else ""  # the grasp is for where it was
        leaving = jumped or safety.withdrawal(moved, watch.velocity(0.15), self._away)
        if leaving:
            raise HaltError(leaving, back=True)
        follows = c.tracking and (c.final_tracking or self.stage is Stage.APPROACH_AND_REACT)
        if not (new and follows):
            return True
        self.motion = hand_motion(self._chosen_hand, watch.keypoints, about=c.about)
        if self.motion.residual > safety.LARGEST_RESIDUAL:
            off = f"keypoints {1000 * self.motion.residual:.0f} mm from a rigid motion"
            if self.stage is Stage.GRASP_AND_RETRIEVE:
                raise HaltError(f"the holding pose changed: {off}", back=True)
            self._observe_again(f"the holding pose changed: {off}")
            self.arm.hold(dt)
            return False
        self.target = self.motion.move_pose(forward_of(self.grasp.pose, -c.back))
        if self.stage is Stage.GRASP_AND_RETRIEVE:
            pushed = safety.pushed_away(self._began, self.target, stages.LARGEST_PUSH)
            self.target = forward_of(self.target, -pushed)
            self.arm.check_target(forward_of(self.target, self.advance.travelled))
        else:
            self.arm.check_target(self.target)
        return True

    # Grasp & Retrieve

    def _grasp_and_retrieve(self, new: bool, dt: float) -> None:
        now = self.time
        assert self.grasp is not None  # set before this stage is entered
        assert self.target is not None
        if now - self._entered > stages.GRASP_TIMEOUT:
            raise HaltError(f"grasp not finished within {stages.GRASP_TIMEOUT:.1f} s", back=True)
        if self.part not in ADVANCING:
            if self.retrieval.step(now, dt):
                self._enter(Stage.FINISHED, "at home with the object, still held")
            return
        if not self._see(new, dt):
            return
        pose = self.advance.step(self.target, dt)
        self.caution = "; ".join(filter(None, (self.advance.words, self.arm.caution)))
        if pose is not None:
            self.target = pose
            self.retrieval.begin(now, pose)

    # Stopped and home

    def _stop(self, reason: str, *, back: bool = False) -> None:
        if self.stage is Stage.GOING_HOME:
            self._give_up(reason)
            return
        if self.stage is Stage.STOPPED and self.part == "back" and not back:
            self.recovery.stay(self.time)  # no way farther back: stand
            self.caution = reason
            return
        self.tries += 1
        distance = stages.BACK_OFF
        straight = self.stage is Stage.GRASP_AND_RETRIEVE
        if straight:  # beside the object: out as it came in
            back, distance = True, max(distance, self.advance.travelled)
        opening = None if self.grasp is None else self.grasp.width
        if not back:
            distance, opening = 0.0, None
        self.recovery.begin(self.time, back=distance, opening=opening, straight=straight)
        self._enter(Stage.STOPPED, reason)

    def _recover(self, observation: Observation, dt: float) -> None:
        clear = self.recovery.step(self.time, dt)
        self.caution = self.recovery.trouble
        # out from beside the object first, however long it took
        waits = self.recovery.part == "clear" or self.arm.reading.protective_stop
        if waits and self._impatient:
            self._leave(self._impatient, observation)
            return
        if not clear:
            return
        if self.tries >= self.config.tries:
            self._leave(f"stopped {self.tries} times", observation)
        elif self.retrieval.part and self.arm.around_something:
            self.caution = self.retrieval.blocked(self.time)
            if self.caution:
                return
            self.arm.release()
            self.retrieval.enter(self.retrieval.part, self.time)
            self._enter(Stage.GRASP_AND_RETRIEVE, "the cause of the stop is gone, object held")
        else:
            self.arm.release()
            self._observe_again("the cause of the stop is gone")

    def _give_up(self, reason: str) -> None:
        self.robot.stop()
        self._enter(Stage.GAVE_UP, f"stands where it is: {reason}")

    def _observe_again(self, reason: str) -> None:
        self.choosing.start()
        self._enter(Stage.WAIT_AND_OBSERVE, reason)

    def _leave(self, reason: str, observation: Observation) -> None:
        if self.arm.around_something:
            self._give_up(f"{reason} with an object in the gripper")
            return
        why = self.choosing.obstacle(observation, self.time)
        if not why and self.stage is Stage.WAIT_AND_OBSERVE:
            why = self.choosing.reason
        self.robot.stop()  # it may be on its way back
        self.arm.release()
        self._enter(Stage.GOING_HOME, reason + (f"; {why}" if why else ""))

    def _go_home(self, dt: float) -> None:
        # with nothing to carry away it stands then
        self.caution = self.watch.blind(self.time) or self.arm.held_back(self.arm.home)
        if self.caution:
            self.arm.hold(dt)
        elif self.arm.homeward(self.time, dt):
            self.robot.stop()
            self._enter(Stage.GAVE_UP, "at home without the object")
        if not self.over and self.time - self._entered > stages.HOME_TIMEOUT:
            raise HaltError(f"home not reached within {stages.HOME_TIMEOUT:.0f} s")
        self.caution = self.caution or self.arm.caution

    def _enter(self, stage: Stage, reason: str) -> None:
        if stage is not Stage.GAVE_UP and stage not in stages.CHANGES[self.stage]:
            raise RuntimeError(f"{stage.value} may not follow {self.stage.value}: {reason}")
        self.transitions.append(Transition(self.time, self.stage, stage, reason))
        self.stage, self._entered = stage, self.time

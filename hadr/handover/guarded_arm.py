"""The robot as the workflow moves it: at a limited speed, and no nearer to the hand than allowed.

Stages say where to go; here stands how: read the arm once a step, slow down near the hand, hold
still. The robot is told to go to a reference that moves at a limited speed, never straight to a
target far away: so it can be slowed by any factor, and a target that jumps does not make the arm
jump. What follows a stop is in `hadr.handover.recovery`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from hadr.camera import Array
from hadr.handover import safety, ur5
from hadr.handover.grasping.collision import between_pads, hand_distance, hand_gaps
from hadr.handover.observation import HandWatch
from hadr.handover.poses import between, pose_distance, toward, turn_between
from hadr.handover.robot import Robot
from hadr.handover.stages import ARRIVE_ANGLE, ARRIVE_DISTANCE, CRAWL_SPEED, HandoverConfig

NO_NEARER = 0.004
"""Beside a hand that touches the gripper the arm may move, but not nearer by more, metres."""
ALIKE = 0.001
"""A way off a hand that leads no nearer than this, metres, leads no nearer."""
UNSEEN = 0.5
"""Part of the speed on the ways back while the camera shows no hand."""
SOON = 0.1
"""How fast a hand closes in is measured by letting it go on for so many seconds."""
LEAD, LEAD_ANGLE = 0.05, 0.3
"""The reference runs ahead of the tool by no more than this, metres and radians."""
SWING_ROOM = 0.05
"""Only with so much space to the skin, metres, may the arm leave the straight way to its target."""


class HaltError(Exception):
    """The robot must stop now: why, and whether the gripper opens and backs off."""

    def __init__(self, reason: str, *, back: bool = False) -> None:
        super().__init__(reason)
        self.back = back


def too_near(free: float, least: float) -> str:
    """Say that the hand leaves less free space than the least, metres."""
    where = f"{1000 * free:.0f} mm from the gripper's path"
    return f"hand {where}, at least {1000 * least:.0f} mm are needed"


class Reading(NamedTuple):
    """What the robot says at the start of a step; a wrench that is none is NaN."""

    tool: Array
    joints: Array
    width: float
    press: float
    wrench: Array
    protective_stop: str


@dataclass
class GuardedArm:
    """A robot with a reference that runs before it; poses (4, 4) in metres, base frame.

    `reading` is what it said at the start of this step, `home` where the tool was at the start;
    `caution` says why it is slower than it could be; `closed` is True once the fingers have closed
    around the object, `alone` once the gripper alone holds it.
    """

    robot: Robot
    config: HandoverConfig
    watch: HandWatch
    reading: Reading = field(init=False)
    home: Array = field(init=False)
    caution: str = field(default="", init=False)
    closed: bool = field(default=False, init=False)
    alone: bool = field(default=False, init=False)
    _reference: Array | None = field(default=None, init=False)
    _holding: bool = field(default=False, init=False)
    _trail: list[Array] = field(default_factory=list, init=False)
    _singular: float = field(default=np.inf, init=False)
    _regular_at: float = field(default=-np.inf, init=False)
    _pulls: dict[bool, bool] = field(default_factory=dict, init=False)
    _of: Reading | None = field(default=None, init=False)
    _links: dict[bytes, Array] = field(default_factory=dict, init=False)
    _known: dict[tuple[object, ...], Array] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        self.read()
        self.home = self.reading.tool

    def read(self) -> None:
        """Ask the robot once; everything in this step goes by the answer."""
        robot = self.robot
        wrench = np.asarray(robot.tool_wrench(), dtype=np.float64)
        self.reading = Reading(
            robot.tool_pose(),
            robot.joint_positions(),
            robot.gripper_width(),
            robot.finger_force(),
            wrench if wrench.shape == (6,) else np.full(6, np.nan),
            robot.protective_stop,
        )
        self.caution = ""
        tool = self.reading.tool
        if not self._trail or pose_distance(tool, self._trail[-1])[0] > 0.005:
            self._trail = [*self._trail[-99:], tool]

    def came_from(self, distance: float) -> Array:
        """Where the tool was so many metres back on its way."""
        poses = [*self._trail, self.reading.tool]
        for last, pose in zip(poses[:0:-1], poses[-2::-1], strict=True):
            distance -= pose_distance(last, pose)[0]
            if distance <= 0:
                return pose
        return poses[0]

    def check_joints(self, now: float) -> None:
        """HaltError an arm that is nearly singular for too long, seconds, and gets more so."""
        c = self.config
        value, before = ur5.singularity(self.reading.joints), self._singular
        self._singular = value
        if value >= c.smallest_singular_value:
            self._regular_at = now
        elif value < before and now - self._regular_at > c.longest_singular:
            raise HaltError(
                f"the arm is singular: smallest singular value {value:.4f} and falling", back=True
            )

    def check_target(self, target: Array) -> None:
        """HaltError where a tool pose is beyond the arm's reach or workspace."""
        if not self.robot.reachable(target):
            raise HaltError(f"target {np.round(target[:3, 3], 2)} m is out of reach")

    def allowed(
        self, near: Sequence[Array], least: float, speed: float, *, usual: float | None = None
    ) -> float:
        """Part of a wanted speed, m/s, that the hand beside the next tool poses leaves, 0 to 1.

        0 where no hand is known; HaltError where it leaves less than the least free space, metres.
        The caution is of the usual speed, where that is another.
        """
        watch = self.watch
        if watch.keypoints is None:
            self.caution = watch.problem
            return 0.0
        free = self.free(*near)
        if free < least:
            raise HaltError(too_near(free, least), back=True)
        soon, closing = watch.soon(SOON), safety.HUMAN_SPEED
        if soon is not None:
            closing = max(0.0, free - self.free(*near, hand=soon)) / SOON
        off = self.config.human_uncertainty
        factor = min(1.0, safety.allowed_speed(free, closing, watch.age, least, off) / speed)
        crawl = min(CRAWL_SPEED - closing, safety.stopping_speed(free - least, 0.0))
        factor = max(factor, min(1.0, crawl / speed))
        part = factor * speed / (usual or speed)
        if part < 1:
            self.caution = f"hand {1000 * free:.0f} mm away: {100 * part:.0f} % of the speed"
        return factor

    def leaving(self, *path: Array, speed: float, now: float) -> float:
        """Part of a speed on a way off the hand, over tool poses: `UNSEEN` where none is seen.

        It is 1 where no pose is nearer to the hand than the arm is now, else what is `allowed`.
        HaltError where it leads to within `safety.GRASP_DISTANCE` of the hand, nearer to one within
        `NO_NEARER`, or near to where one was last seen.
        """
        watch = self.watch
        trouble = watch.trouble(now) or watch.problem
        here, there = (self.free(*poses, hand=watch.last) for poses in ((), path))
        if not trouble and here > NO_NEARER and there < here - ALIKE:
            return self.allowed(path, min(here, safety.GRASP_DISTANCE), speed)
        if self.nearer(*path) and (here <= NO_NEARER or there < safety.APPROACH_DISTANCE):
            where = f"{1000 * there:.0f} mm from the gripper's path"
            seen = f"hand {where}, and the way leads nearer"
            raise HaltError(
                f"the hand was last seen {where}; {trouble}" if trouble else seen, back=True
            )
        self.caution = trouble
        return UNSEEN if trouble else 1.0

    def nearer(self, *path: Array) -> bool:
        """Whether a way over tool poses leads nearer to the hand, as it was last seen, than now.

        Of a hand that touches the robot no part may get deeper into it, however deep another is.
        """
        if self.watch.last is None:
            return False
        here, there = (self._gaps(poses, None, self.watch.last) for poses in ((), path))
        return bool((np.minimum(here, max(here.min(), 0.0)) - there).max() > NO_NEARER)

    def homeward(self, now: float, dt: float) -> bool:
        """Go on home for dt seconds, but not into the hand; True once there."""
        home, speed = self.home, self.config.approach_speed
        factor = self.leaving(*self.ahead(home), speed=speed, now=now)
        self.go(home, speed, dt, factor=factor, swing=True)
        distance, angle = pose_distance(self.reading.tool, home)
        return distance < ARRIVE_DISTANCE and angle < ARRIVE_ANGLE

    def wrench(self) -> Array:
        """Force in newtons and torque in N m on the gripper, shape (6,); HaltError without them."""
        if not np.isfinite(self.reading.wrench).all():
            raise HaltError("the sensor at the wrist gives no number", back=True)
        return self.reading.wrench

    @property
    def around_something(self) -> bool:
        """True where both fingers press, or have closed and are kept apart.

        A width that is no number counts as apart: what cannot be known to be lost is not dropped.
        """
        apart = self.closed and not self.reading.width <= safety.HELD_MARGIN
        return apart or self.reading.press > safety.PRESSED

    def free(self, *path: Array, width: float | None = None, hand: Array | None = None) -> float:
        """Least free space between robot and skin, metres.

        It is that of the gripper and of the arm's links on all tool poses, and of the links now.
        Left out, poses, opening (metres) and hand are those of now; infinity where none is known.
        """
        hand = self.watch.keypoints if hand is None else hand
        return np.inf if hand is None else float(self._gaps(path, width, hand).min())

    def beside(self, hand: Array | None) -> float:
        """Free space between the gripper alone and a hand's skin, metres; infinity without one."""
        tool, width = self.reading.tool, self.reading.width
        return np.inf if hand is None else hand_distance(tool, width, hand)

    @property
    def pinching(self) -> bool:
        """Whether a bone of the hand that is seen is between the gripper's pads."""
        hand, now = self.watch.keypoints, self.reading
        return hand is not None and between_pads(now.tool, now.width, hand)

    def held_back(self, goal: Array) -> str:
        """Say that a way to a tool pose would drag a hand, harder than one may be; or nothing.

        What pushes the gripper along is no reason to stay.
        """
        way = goal[:3, 3] - self.reading.tool[:3, 3]
        pull = self.pull(way / max(float(np.linalg.norm(way)), 1e-9))
        return f"something holds the gripper back with {pull:.1f} N" * (pull > 0)

    def pull(self, way: Array | None = None) -> float:
        """How hard somebody pulls, newtons, see `safety.hand_pull`; 0 where nobody does.

        Who pulls harder than `safety.HAND_PULL` pulls until it is `safety.PULLS_NO_MORE` or less:
        the sensor's noise about one limit would say now one thing, now the other.
        """
        pull, on_way = safety.hand_pull(self.reading.wrench[:3], way), way is not None
        least = safety.PULLS_NO_MORE if self._pulls.get(on_way) else safety.HAND_PULL
        self._pulls[on_way] = pull > least
        return pull if pull > least else 0.0

    def _gaps(self, path: Sequence[Array], width: float | None, hand: Array) -> Array:
        """What `free` is the least of: the space to each ball of the person, metres, (m,)."""
        now, names = self.reading, [pose.tobytes() for pose in path]
        width = now.width if width is None else width
        if self._of is not now:  # much is asked several times in a step
            self._of, self._links, self._known = now, {b"": ur5.link_surfaces(now.joints)}, {}
        key = (*names, width, hand.tobytes())
        if key not in self._known:
            links, tools = self._links, np.array(path or [now.tool])
            new = [i for i, name in enumerate(names) if name not in links]
            if new:
                arms = ur5.joints_toward(now.joints, tools[new] @ np.linalg.inv(now.tool))
                links |= zip((names[i] for i in new), ur5.link_surfaces(arms), strict=True)
            met = np.concatenate([links[name] for name in (b"", *names)])
            self._known[key] = hand_gaps(tools, width, hand, met)
        return self._known[key]

    def ahead(self, goal: Array, *, within: float | None = None) -> list[Array]:
        """Poses from the tool on toward a goal, within so many metres; `LOOK_AHEAD` if left out."""
        look = safety.LOOK_AHEAD if within is None else within
        way, angle = pose_distance(self.reading.tool, goal)
        part = min(1.0, look / max(way, 0.1 * angle, 1e-9))  # a turn moves the fingers too
        tool, turn = self.reading.tool, turn_between(self.reading.tool, goal)
        return [tool, between(tool, goal, part * 0.5, turn), between(tool, goal, part, turn)]

    def go(
        self, goal: Array, speed: float, dt: float, *, factor: float = 1.0, swing: bool = False
    ) -> None:
        """Move toward a tool pose for dt seconds, at a part of a speed, m/s, and of the turn's.

        Where the tool cannot go straight the arm stands, or swings if it may and has the room.
        """
        if factor <= 0:
            self.hold(dt)
            return
        tool, turn = self.reading.tool, factor * self.config.turn_speed * dt
        start = tool if self._reference is None else self._reference
        ahead = toward(start, goal, factor * speed * dt, turn)
        self._reference, self._holding = toward(tool, ahead, LEAD, LEAD_ANGLE), False
        swing = swing and self.free(hand=self.watch.last) >= SWING_ROOM
        self.robot.servo_to(self._reference, dt, speed=factor * speed, swing=swing)

    def hold(self, dt: float) -> None:
        """Stay where the tool was when the hold began."""
        if not self._holding or self._reference is None:
            self._reference, self._holding = self.reading.tool.copy(), True
        self.robot.servo_to(self._reference, dt, swing=False)

    def release(self) -> None:
        """Move again after a stop, from wherever the tool is."""
        self.robot.release()
        self._reference, self._holding = None, False

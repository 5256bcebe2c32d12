"""Grasp & Retrieve: the final move to where the fingers close, and the way back with the object.

As the paper has it, the fingers go on by a fixed length. Depth that is some centimetres off then
closes them on an edge, so an arm with a sensor at its wrist may feel: where one finger runs into
the object, the gripper draws back and goes in again farther to that side (half as far each time
the side changes, so that it does not swing between two places); and where nothing was met at the
end, it goes on until the object meets the palm. Which of hand and object it met, it can't feel: a
hand as near as that has already stopped it, as far as the hand's place is known. Then the fingers
close, as long as a hand is seen and not between them, feel whether they hold something, and draw
back gently. Whenever somebody pulls at the object they wait. Once they have come a little way
without, they hold it firmly and carry it home.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hadr.camera import Array
from hadr.handover import safety, stages
from hadr.handover.grasping.grasps import FEELING_STEP, forward_of
from hadr.handover.grasping.gripper import LARGEST_OPENING
from hadr.handover.guarded_arm import GuardedArm, HaltError, too_near
from hadr.handover.poses import pose_distance

FAR_FROM_GOAL = 0.02
"""The final move waits for a tool that is farther behind than this, metres."""
KEEPS_UP = 2.0
"""To follow a hand that moves, the tool may be so many times as fast as it goes in."""
BLOCKED_TIME = 1.0
"""So long it stands where the hand is in the rest of its way, but not near, seconds."""
DRAW_BACK = 0.03
"""So far the gripper draws back before it goes to the side, metres."""
TOO_SOON = 0.03
"""What both fingers meet farther than this before the end is wider than they are apart, metres."""
ON_A_FINGER = 0.25
"""A contact farther from the middle than this part of the opening is on a finger."""

SMALLEST_STEP = 0.3
"""A step aside of less than this part of the first is not made."""

PINCHED = "a finger between the gripper's pads"
"""What stops the fingers that close, and what they wait for once they are closed."""

THINNEST = 0.001
"""Fingers that both press and are farther apart than this, metres, hold something."""
STILL, STILL_FOR = 0.0005, 0.2
"""Fingers that move by less than this, metres, for so long, seconds, stand."""

ADVANCING = ("advance", "draw back", "feel")
"""The parts of the final move."""


@dataclass
class Advance:
    """The final move.

    Attributes:
        arm: The arm.
        aside: How far the grasp was moved along the closing axis by what was felt, metres.
        corrections: How often.
        all_corrections: How often in all final moves of this handover.
        travelled: How far the fingers have come from the pre-grasp, metres.
    """

    arm: GuardedArm
    all_corrections: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self.begin()

    @property
    def part(self) -> str:
        """What it does: "advance", "draw back", or "feel" once it goes on past its end."""
        if self._back_to is not None:
            return "draw back"
        return "feel" if self.travelled >= self._planned < self._end else "advance"

    @property
    def words(self) -> str:
        """What it felt and what it does about it; empty on the planned way."""
        if self._felt:
            return self._felt
        return "goes on, feeling for the object" if self.part == "feel" else ""

    @property
    def _planned(self) -> float:
        """The final move's end without feeling, metres from the pre-grasp."""
        way = self.arm.config.way
        return way.back + way.forward

    def begin(self, feel: float = np.inf) -> None:
        """Start at the pre-grasp of a grasp whose way is free so far past its end, metres."""
        self._end, self._feel = self._planned, feel
        self.travelled = self.aside = self._side = self._blocked = self._held = 0.0
        self.corrections, self._felt = 0, ""
        self._back_to: float | None = None

    def step(self, pre_grasp: Array, dt: float) -> Array | None:
        """Go on for dt seconds; give the pose at which the fingers shall close, None before.

        The pre-grasp (4, 4) is given as it has moved with the hand, metres, base frame. HaltError
        where the hand is too near (on the way on or back), the object does not fit between the
        fingers, something pulls at the gripper for long, or the wrist's sensor gives no number.
        """
        arm, c = self.arm, self.arm.config
        target = pre_grasp.copy()
        target[:3, 3] += self.aside * pre_grasp[:3, 0]
        if self.arm.watch.keypoints is None:  # neither on nor back nor shut beside an unseen hand
            arm.caution = self.arm.watch.problem
            arm.hold(dt)
            return None
        # what presses against the approach is felt below
        arm.caution = arm.held_back(forward_of(target, self.travelled - safety.LOOK_AHEAD))
        self._held = self._held + dt if arm.caution else 0.0
        if self._held > stages.PULL_TIME:
            raise HaltError(arm.caution, back=True)
        if arm.caution:
            arm.hold(dt)
            return None
        if self._back_to is not None:
            self._draw_back(target, dt)
            return None
        here = forward_of(target, self.travelled)
        soon = forward_of(target, min(self._end, self.travelled + safety.LOOK_AHEAD))
        later = [forward_of(target, s) for s in np.linspace(self.travelled, self._end, 4)]
        near = [arm.reading.tool, here, soon]
        most = KEEPS_UP * c.advance_speed
        factor = arm.allowed(near, safety.GRASP_DISTANCE, most, usual=c.advance_speed)
        factor *= self._free_later(later, dt)
        if pose_distance(arm.reading.tool, here)[0] < FAR_FROM_GOAL:
            self.travelled = min(self._end, self.travelled + self._slow(factor) * dt)
        here = forward_of(target, self.travelled)
        arm.go(here, most, dt, factor=factor)
        arrived = pose_distance(arm.reading.tool, here)[0] < stages.ARRIVE_DISTANCE
        met = self._met_at()
        if met is not None:
            on_finger = abs(met) > ON_A_FINGER * arm.reading.width
            if on_finger and self._go_aside(target, met):
                return None
            short = self._end - self.travelled
            if c.feel_aside > 0 and short > TOO_SOON:
                raise HaltError(
                    f"the gripper met the object {1000 * short:.0f} mm before the end of its way: "
                    "it does not fit between the fingers here",
                    back=True,
                )
            self._felt = f"{self._contact(met)}: closes here"
            return arm.reading.tool
        if self.travelled >= self._end and arrived and not self._farther(target):
            return here
        return None

    def _slow(self, factor: float) -> float:
        """The speed on the way in, m/s, where the tool may have a part of `KEEPS_UP` times it."""
        return min(1.0, factor * KEEPS_UP) * self.arm.config.advance_speed

    def _free_later(self, path: list[Array], dt: float) -> float:
        """1 where the rest of the way is free; else 0 for a while, as keypoints err for a while."""
        free, least = self.arm.free(*path), safety.GRASP_DISTANCE
        self._blocked = self._blocked + dt if free < least else 0.0
        if self._blocked > BLOCKED_TIME + 1e-9:
            raise HaltError(too_near(free, least), back=True)
        if self._blocked:
            self.arm.caution = f"waits: {too_near(free, least)}"
        return float(not self._blocked)

    def _met_at(self) -> float | None:
        """Where something presses against the gripper: metres along the closing axis, or None."""
        c, tool = self.arm.config, self.arm.reading.tool
        if c.feel_ahead <= 0 and c.feel_aside <= 0:
            return None
        wrench = self.arm.wrench()
        force = -float(wrench[:3] @ tool[:3, 2])
        if force <= c.contact_force:
            return None
        return float(wrench[3:] @ tool[:3, 1]) / force

    def _contact(self, met: float) -> str:
        """Say what was met: so far along the closing axis, metres, as seen from the base."""
        tool, width = self.arm.reading.tool, self.arm.reading.width
        if abs(met) <= ON_A_FINGER * width:
            return "the palm met the object"
        side = float(np.sign(met)) * tool[:3, 0]
        outward = tool[:2, 3] / max(float(np.linalg.norm(tool[:2, 3])), 1e-9)
        parts = {
            ("to the left", "to the right"): side[1] * outward[0] - side[0] * outward[1],
            ("up", "down"): side[2],
            ("outward", "inward"): side[:2] @ outward,
        }
        (one, other), part = max(parts.items(), key=lambda item: abs(item[1]))
        return f"a finger met the object {1000 * abs(met):.0f} mm {one if part > 0 else other}"

    def _go_aside(self, target: Array, met: float) -> bool:
        """Draw back and go in again farther to the side of a contact; False where it can't be."""
        c, side = self.arm.config, float(np.sign(met))
        step = abs(self._side) or c.feel_aside
        if side * self._side < 0:
            step /= 2
        moved = forward_of(target, self._end)
        moved[:3, 3] += side * step * target[:3, 0]
        left = self.corrections < c.corrections and step > SMALLEST_STEP * c.feel_aside
        if not (left and self._clear(moved)):
            return False
        self.corrections += 1
        self.all_corrections += 1
        self._felt = (
            f"{self._contact(met)}: draws back, goes {1000 * step:.0f} mm aside "
            f"({self.corrections} of {c.corrections})"
        )
        self._back_to = max(0.0, self.travelled - DRAW_BACK)
        self._side = side * step
        return True

    def _draw_back(self, target: Array, dt: float) -> None:
        arm, c = self.arm, self.arm.config
        assert self._back_to is not None
        soon = forward_of(target, max(self._back_to, self.travelled - safety.LOOK_AHEAD))
        factor, most = 1.0, KEEPS_UP * c.advance_speed
        if arm.nearer(soon):
            factor = arm.allowed([soon], safety.GRASP_DISTANCE, most, usual=c.advance_speed)
        self.travelled = max(self._back_to, self.travelled - self._slow(factor) * dt)
        here = forward_of(target, self.travelled)
        arm.go(here, most, dt, factor=factor)
        near = pose_distance(arm.reading.tool, here)[0] < stages.ARRIVE_DISTANCE
        if self.travelled <= self._back_to and near:
            self.aside += self._side
            self._back_to, self._felt = None, ""

    def _farther(self, target: Array) -> bool:
        """Whether the fingers may go on, feeling for the object; the end of the way moves on."""
        last = self._planned + min(self.arm.config.way.feel, self._feel)
        end = min(last, self._end + FEELING_STEP)
        if end <= self._end or not self._clear(forward_of(target, end)):
            return False
        self._end = end
        return True

    def _clear(self, pose: Array) -> bool:
        """Whether a tool pose (4, 4) keeps off the hand and can be reached."""
        arm = self.arm
        if arm.watch.keypoints is None:
            return False
        return arm.free(pose) >= safety.GRASP_DISTANCE and arm.robot.reachable(pose)


@dataclass
class Retrieval:
    """The end of the third stage, from the closing of the fingers on.

    Its `part` is close, let go, retreat, carry.
    """

    arm: GuardedArm
    part: str = field(default="", init=False)

    def begin(self, now: float, pose: Array) -> None:
        """Tell the fingers to close at a tool pose (4, 4), as far as the object lets them."""
        self._pose, self._travelled = pose, 0.0
        self._open = min(self.arm.reading.width, LARGEST_OPENING)  # what is measured may be more
        self.arm.alone = self.arm.closed = False
        self._check_hand(now)
        self.arm.robot.set_gripper(0.0, stages.GENTLE_FORCE)
        self._still = (now, self.arm.reading.width)
        self.enter("close", now)

    def step(self, now: float, dt: float) -> bool:
        """Go on for dt seconds; True once the object is home.

        HaltError where nothing is between the fingers, or a hand is, or none is seen while they
        close; where somebody pulls at it or has a finger in the grip for long, the hand is in the
        way, or the sensor at the wrist gives no number.
        """
        arm, c = self.arm, self.arm.config
        if self.part == "close":
            arm.go(self._pose, c.advance_speed, dt)
            self._check_hand(now)
            if abs(arm.reading.width - self._still[1]) > STILL:
                self._still = (now, arm.reading.width)
            late = now - self._since > stages.CLOSE_TIMEOUT
            if now - self._still[0] >= STILL_FOR or late:
                self._check_held("the fingers closed on nothing")
                if arm.reading.press > safety.PRESSED:
                    arm.closed = True
                    self._together = arm.reading.tool[:3, 3], arm.watch.last
                    self.enter("let go", now)
                elif late:
                    apart = f"stand {1000 * arm.reading.width:.0f} mm apart and press on nothing"
                    raise HaltError(f"the fingers {apart}", back=True)
            return False
        slipped, dropped = "slipped out of the fingers", "was dropped on the way back"
        self._check_held(f"the object {slipped if self.part == 'let go' else dropped}")
        if self._pulled(now):
            arm.hold(dt)
        elif self.part == "let go":
            arm.go(self._pose, c.advance_speed, dt)
            if now - self._since >= stages.LET_GO_TIME - 1e-9:
                self.enter("retreat", now)
        elif self.part == "carry":
            return arm.homeward(now, dt)
        else:
            goal, held = forward_of(self._pose, -stages.RETREAT), self._travelled
            factor = arm.leaving(*arm.ahead(goal), speed=c.advance_speed, now=now)
            self._travelled = min(stages.RETREAT, held + factor * c.advance_speed * dt)
            goal = forward_of(self._pose, -self._travelled)
            arm.go(goal, c.advance_speed, dt, factor=factor, swing=arm.alone)
            if held < stages.ALONE_AFTER <= self._travelled:
                arm.robot.set_gripper(0.0, stages.FIRM_FORCE)
                arm.alone = True
            near = pose_distance(arm.reading.tool, goal)[0] < stages.ARRIVE_DISTANCE
            if self._travelled >= stages.RETREAT and near:
                self.enter("carry", now)
        return False

    def _check_hand(self, now: float) -> None:
        """HaltError where the hand is in the gripper that closes, or is not seen."""
        arm = self.arm
        words, within = "", -arm.beside(arm.watch.keypoints)
        unseen = arm.watch.trouble(now)
        if within > 2 * arm.config.human_uncertainty:  # it is around what the hand holds
            words = f"hand {1000 * within:.0f} mm within the gripper"
        elif arm.pinching:
            words = PINCHED
        if unseen or words:
            if not (unseen and arm.around_something):  # the fingers don't stop by themselves
                arm.robot.set_gripper(self._open, stages.GENTLE_FORCE)
            raise HaltError(unseen or words, back=True)

    def blocked(self, now: float) -> str:
        """Say that the hand is in the rest of the way back, or nothing."""
        arm, c = self.arm, self.arm.config
        if self.part not in ("retreat", "carry"):
            return ""
        goal = arm.home if self.part == "carry" else forward_of(self._pose, -stages.RETREAT)
        try:
            arm.leaving(*arm.ahead(goal), speed=c.advance_speed, now=now)
        except HaltError as halt:
            return str(halt)
        return ""

    def _pulled(self, now: float) -> bool:
        """Whether somebody pulls at the object, has a finger in the grip, or goes along with it.

        The wait for the hand to let go begins anew.
        """
        self.arm.wrench()  # a sensor without a number halts it
        pull = self.arm.pull()
        words = f"somebody pulls at the object with {pull:.1f} N" * (pull > 0)
        words = words or PINCHED * self.arm.pinching or self._in_tow()
        if not words:
            self._pulled_from = now
            return False
        if now - self._pulled_from > stages.PULL_TIME:
            raise HaltError(words, back=True)
        self.arm.caution = words
        self._since = now
        return True

    def _in_tow(self) -> str:
        """Say that the hand has come along with the fingers since they closed; or nothing.

        Nobody need pull hard for that. It is seen a picture's age late.
        """
        arm, hand, c = self.arm, self.arm.watch.keypoints, self.arm.config
        tool, then = self._together
        way = arm.reading.tool[:3, 3] - tool
        length = float(np.linalg.norm(way))
        speed = c.approach_speed if self.part == "carry" else c.advance_speed
        late = safety.TOWED / 2 + speed * arm.watch.age
        if hand is None or then is None or length < max(safety.TOWED, 2 * late):
            return ""
        if np.linalg.norm((hand - then).mean(axis=0) - way) > late:
            return ""
        return f"the hand has come along by {100 * length:.0f} cm: it holds the object"

    def _check_held(self, words: str) -> None:
        width = self.arm.reading.width
        # a stem is thin
        if not width > (THINNEST if self.arm.around_something else safety.HELD_MARGIN):
            gap = f"{1000 * width:.0f} mm apart, told 0"
            raise HaltError(f"{words}: object dropped or lost (fingers {gap})", back=True)

    def enter(self, part: str, now: float) -> None:
        """Begin a part, or go on with it after a stop."""
        self.part, self._since, self._pulled_from = part, now, now

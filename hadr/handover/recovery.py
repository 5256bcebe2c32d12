"""What the arm does after a stop, until it may start again.

It stands; after a protective stop, until a person has released it. Fingers that are around
something stay so, unless a hand that is seen at the gripper pulls at it, or has a finger between
the pads, all the while: they never drop it. Nor do empty ones open into a hand beside them.
Else, beside the hand, they open and the arm backs off; from a hand that is then still too near it
backs off farther. No way back brings it nearer to the hand, or drags what holds the gripper back.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from hadr.camera import Array
from hadr.handover import safety
from hadr.handover.grasping.grasps import forward_of
from hadr.handover.guarded_arm import GuardedArm, HaltError
from hadr.handover.poses import between, pose_distance
from hadr.handover.stages import BACK_OFF, GENTLE_FORCE, STAND_TIME

MOST_YIELDS = 3
"""So often the gripper backs off farther from a hand that follows it."""
LONGEST_OPENING = 1.5
"""Longest wait for the fingers to open, seconds."""


@dataclass
class Recovery:
    """What happens after a stop; its `part` is still, open, back, clear.

    `trouble` says what forbids to start again; empty where nothing does.
    """

    arm: GuardedArm
    part: str = field(default="", init=False)
    trouble: str = field(default="", init=False)

    def begin(self, now: float, *, back: float, opening: float | None, straight: bool) -> None:
        """Stop the arm; then open the fingers to a width and back off so many metres, or none.

        Straight is along the approach axis; else it goes along the way that the tool came.
        """
        self.arm.robot.stop()
        self._back, self._opening, self._straight = back, opening, straight
        self._yields, self._clear_from, self._travelled = 0, now, 0.0
        self._left_alone_at = now
        self._goal = self.arm.reading.tool
        self._enter("still", now)

    def step(self, now: float, dt: float) -> bool:
        """Go on for dt seconds; True where the arm may start again: the cause is gone for good."""
        arm, watch = self.arm, self.arm.watch
        free = arm.free()
        self.trouble = watch.trouble(now) or watch.problem
        holds = arm.around_something  # then the hand may be as near as it was when it gave
        if not (self.trouble or holds):
            near = f"hand {1000 * free:.0f} mm from the gripper" * (free < safety.APPROACH_DISTANCE)
            self.trouble = arm.held_back(self._goal) or near
        if self.trouble or not self._pulled():
            self._left_alone_at = now
        if arm.reading.protective_stop:
            self.trouble = "a person must release the protective stop"
        elif self.part == "still" and now - self._since >= STAND_TIME - 1e-9:
            pulled = now - self._left_alone_at >= STAND_TIME - 1e-9
            leaves = self._back > 0 and (pulled or not holds)
            if leaves:
                arm.release()
                arm.alone, arm.closed, self._shut = False, holds, arm.reading.width
                here, wide = (arm.free(width=w, hand=watch.last) for w in (None, self._opening))
                if not holds and wide < min(here, 0.0):
                    self._opening = None  # they would open into the hand, and hold nothing
                if self._opening is not None:
                    arm.robot.set_gripper(self._opening, GENTLE_FORCE)
            self._enter("open" if leaves else "clear", now)
        elif self.part == "open":
            self._open(now, dt)
        elif self.part == "back":
            self._go_back(now, dt)
        elif self.part == "clear" and not holds:
            self._yield(now, free)
        if self.trouble or self.part in ("open", "back"):
            self._clear_from = now
        return self.part == "clear" and now - self._clear_from >= STAND_TIME - 1e-9

    def _open(self, now: float, dt: float) -> None:
        """Wait for the fingers, then begin to back off; HaltError if they stay around something."""
        arm = self.arm
        arm.hold(dt)
        if not arm.reading.width <= self._shut + 0.002:
            arm.closed = False  # they have opened
        wide = self._opening is None or arm.reading.width >= self._opening - 0.002
        late = now - self._since > LONGEST_OPENING
        if late and not wide and arm.closed:
            arm.robot.set_gripper(0.0, GENTLE_FORCE)  # lest they open later, where no hand is
            raise HaltError("the fingers do not open")
        if wide or late:
            arm.closed = False
            straight = forward_of(arm.reading.tool, -self._back)
            self._back_to(straight if self._straight else arm.came_from(self._back), now)

    def _go_back(self, now: float, dt: float) -> None:
        """Back off on, but wait where something holds the gripper back."""
        arm, speed = self.arm, self.arm.config.back_speed
        late = now - self._since > self._back / speed + 1.0
        if self._nearer(self._goal):
            self.stay(now)
        elif arm.held_back(self._goal):
            arm.hold(dt)
            if late:
                self.stay(now)
        else:
            self._travelled = min(self._back, self._travelled + speed * dt)
            goal = between(self._from, self._goal, self._travelled / self._back)
            arm.go(goal, 2 * speed, dt)
            near = pose_distance(arm.reading.tool, goal)[0] < 0.002
            if self._travelled >= self._back and (near or late):
                self.stay(now)

    def _pulled(self) -> bool:
        """Whether a hand at the gripper pulls or has a finger in the grip; no other one does."""
        arm = self.arm
        beside = arm.beside(arm.watch.keypoints) <= safety.AT_THE_GLASS
        return arm.pinching or (arm.pull() > 0 and beside)

    def stay(self, now: float) -> None:
        """Back off no farther; stand and wait for the cause to go."""
        self.arm.robot.stop()
        self._enter("clear", now)

    def _yield(self, now: float, free: float) -> None:
        """Back off farther from a hand that has been too near for long enough."""
        arm = self.arm
        if free >= safety.APPROACH_DISTANCE or arm.watch.trouble(now):
            self._apart_at = now
            return
        if now - self._apart_at < 2 * STAND_TIME or self._yields >= MOST_YIELDS:
            return
        back = forward_of(arm.reading.tool, -BACK_OFF)
        self._apart_at = now
        if self._nearer(back):
            return
        arm.release()
        self._yields += 1
        self._back = BACK_OFF
        self._back_to(back, now)

    def _back_to(self, goal: Array, now: float) -> None:
        """Begin to back off to a pose (4, 4), `_back` metres away."""
        self._from, self._goal, self._travelled = self.arm.reading.tool, goal, 0.0
        self._enter("back", now)

    def _nearer(self, goal: Array) -> bool:
        """Whether the way to a pose (4, 4) leads to the hand, as it was last seen."""
        return self.arm.nearer(*self.arm.ahead(goal, within=BACK_OFF))

    def _enter(self, part: str, now: float) -> None:
        self.part, self._since, self._apart_at = part, now, now

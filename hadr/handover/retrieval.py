"""Close the fingers, feel whether they hold something, wait for the hand to let go, pull back."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from hadr.handover import safety
from hadr.handover.grasping.grasps import forward_of
from hadr.handover.guarded_arm import GuardedArm, HaltError
from hadr.handover.pacing import pose_distance

Array = npt.NDArray[np.float64]

STILL = 0.0005
"""Fingers that move by less than this, metres, stand ..."""
STILL_FOR = 0.2
"""... if they do so for this long, seconds."""


@dataclass
class Retrieval:
    """The end of the third stage, from the closing of the fingers on.

    Attributes:
        arm: The arm.
        part: close, let go, retreat.
    """

    arm: GuardedArm
    part: str = field(default="", init=False)
    _pose: Array = field(init=False)
    _told: float = field(default=0.0, init=False)
    _since: float = field(default=0.0, init=False)
    _still: tuple[float, float] = field(default=(0.0, 0.0), init=False)
    _travelled: float = field(default=0.0, init=False)

    def begin(self, now: float, pose: Array, width: float) -> None:
        """Tell the fingers to close.

        Args:
            now: Seconds.
            pose: Where the tool stays meanwhile, shape (4, 4), metres.
            width: The grasp's width, metres.
        """
        self._pose, self._told = pose, max(0.0, width - self.arm.config.squeeze)
        self.arm.robot.set_gripper(self._told)
        self._still = (now, self.arm.reading.width)
        self._enter("close", now)

    def step(self, now: float, dt: float, *, factor: float = 1.0) -> bool:
        """Go on for dt seconds.

        Args:
            now: Seconds.
            dt: Seconds.
            factor: Part of the speed of the way back that is used.

        Returns:
            True where the object is pulled back and still held.

        Raises:
            HaltError: Nothing is between the fingers.
        """
        arm, c = self.arm, self.arm.config
        if self.part == "close":
            arm.go(self._pose, c.advance_speed, dt)
            if abs(arm.reading.width - self._still[1]) > STILL:
                self._still = (now, arm.reading.width)
            if now - self._still[0] >= STILL_FOR or now - self._since > c.close_timeout:
                self._check_held("the fingers closed on nothing")
                self._enter("let go", now)
        elif self.part == "let go":
            self._check_held("the object slipped out of the fingers")
            arm.go(self._pose, c.advance_speed, dt)
            if now - self._since >= c.let_go_time - 1e-9:
                self._travelled = 0.0
                self._enter("retreat", now)
        else:
            self._check_held("the object was dropped on the way back")
            self._travelled = min(c.retreat, self._travelled + factor * c.advance_speed * dt)
            goal = forward_of(self._pose, -self._travelled)
            arm.go(goal, 2 * c.advance_speed, dt)
            near = pose_distance(arm.reading.tool, goal)[0] < c.arrive_distance
            return self._travelled >= c.retreat and near
        return False

    def _check_held(self, words: str) -> None:
        width = self.arm.reading.width
        if not safety.something_held(width, self._told, self.arm.config.safety.held_margin):
            gap = f"{1000 * width:.0f} mm apart, told {1000 * self._told:.0f}"
            raise HaltError(f"{words}: object dropped or lost (fingers {gap})", back=True)

    def _enter(self, part: str, now: float) -> None:
        self.part, self._since = part, now

"""Who judges an attempt: HandoverSim's rules, from the true state of the world alone.

Success: both fingers hold the object, the hand has let go, and the object's middle has stayed
within 15 cm of the goal for 0.1 s. Failures: human contact, drop, time-out (13 s). Source:
HandoverSim's published benchmark; a distance and a force that it has not are reported beside.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from hadr.camera import Array
from hadr.simulation.world.state import WorldState

Verdict = Literal["", "success", "human contact", "drop", "time-out", "gave up"]
"""Empty while nothing is decided. "gave up": the robot ended the attempt by itself, without the
object; HandoverSim would let it stand until the time is out."""


GOAL: Array = np.array([0.34, 0.12, 0.38])
"""Where the object is to be carried, base frame, metres: the tool's waiting place."""
GOAL_RADIUS, HOLD_TIME = 0.15, 0.1
"""How near its middle must come, metres, and how long it must stay there, seconds."""
FALLEN = 0.05
"""An object that nobody holds is dropped once it is so far below where it was held last, metres:
until then it may lean in the open hand."""


@dataclass
class Judge:
    """Looks at each state in turn.

    Attributes:
        height: Of the object, from its foot to its top, metres: its middle is what counts.
        time_limit: An attempt that takes longer, seconds, has failed.
        verdict: The first thing that was decided; it stays.
        decided_at: When, seconds; NaN before.
        largest_force: On the hand so far, newtons.
        smallest_distance: To it until the verdict, metres.
    """

    height: float
    time_limit: float = 13.0
    verdict: Verdict = field(default="", init=False)
    decided_at: float = field(default=float("nan"), init=False)
    largest_force: float = field(default=0.0, init=False)
    smallest_distance: float = field(default=float("inf"), init=False)
    _at_goal_since: float | None = field(default=None, init=False)
    _held_at: float = field(default=float("nan"), init=False)

    def look(self, state: WorldState) -> Verdict:
        """Take one more state into account, in the order of time, and say what is decided."""
        self.largest_force = max(self.largest_force, state.hand_force)
        if not self.verdict:  # afterwards a hand may come as near as it likes
            self.smallest_distance = min(self.smallest_distance, state.hand_distance)
        now = state.time
        middle = state.base_from_object[:3, 3] + state.base_from_object[:3, 2] * self.height / 2
        near = float(np.linalg.norm(middle - GOAL)) <= GOAL_RADIUS
        self._at_goal_since = _since(self._at_goal_since, near and state.holder == "gripper", now)
        if state.holder != "nobody":
            self._held_at = middle[2]
        if self.verdict:
            return self.verdict
        if state.hand_force > 0:
            self._decide("human contact", now)
        elif self._held_at - middle[2] > FALLEN:
            self._decide("drop", now)
        elif _lasted(self._at_goal_since, now, HOLD_TIME):
            self._decide("success", now)
        elif now > self.time_limit:
            self._decide("time-out", now)
        return self.verdict

    def give_up(self, time: float) -> None:
        """The robot has ended the attempt without the object; nothing changes once decided."""
        if not self.verdict:
            self._decide("gave up", time)

    def _decide(self, verdict: Verdict, time: float) -> None:
        self.verdict, self.decided_at = verdict, time


def _since(before: float | None, holds: bool, now: float) -> float | None:
    if not holds:
        return None
    return now if before is None else before


def _lasted(since: float | None, now: float, time: float) -> bool:
    return since is not None and now - since >= time - 1e-9

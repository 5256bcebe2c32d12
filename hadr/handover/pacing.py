"""How fast the tool goes to where it is sent: a reference that moves at a limited speed.

The robot is told to go to the reference, never straight to a target far away. So it can be slowed
by any factor, and a target that jumps does not make the arm jump.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

Array = npt.NDArray[np.float64]


def pose_distance(first: Array, second: Array) -> tuple[float, float]:
    """How far two poses are apart.

    Args:
        first: Shape (4, 4), metres.
        second: Shape (4, 4), the same frame.

    Returns:
        Distance of the origins in metres, and the angle of the rotation between them in radians.
    """
    turn = first[:3, :3].T @ second[:3, :3]
    angle = float(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1.0, 1.0)))
    return float(np.linalg.norm(first[:3, 3] - second[:3, 3])), angle


def between(first: Array, second: Array, part: float) -> Array:
    """A pose on the way from one pose to another.

    Args:
        first: Shape (4, 4), metres.
        second: Shape (4, 4), the same frame.
        part: 0 gives the first, 1 the second.

    Returns:
        Shape (4, 4): on the straight line, turned about the one axis that leads there.
    """
    if part >= 1.0:
        return second.copy()
    turn = Rotation.from_matrix(first[:3, :3].T @ second[:3, :3]).as_rotvec()
    pose = first.copy()
    pose[:3, :3] = first[:3, :3] @ Rotation.from_rotvec(part * turn).as_matrix()
    pose[:3, 3] += part * (second[:3, 3] - first[:3, 3])
    return pose


def toward(first: Array, second: Array, distance: float, angle: float) -> Array:
    """Go from one pose toward another, by at most a distance and an angle.

    Args:
        first: Shape (4, 4), metres.
        second: Shape (4, 4), the same frame.
        distance: Metres.
        angle: Radians.

    Returns:
        Shape (4, 4); exactly the second where it lies within both.
    """
    way, turn = pose_distance(first, second)
    part = min(distance / max(way, 1e-12), angle / max(turn, 1e-12))
    return between(first, second, part)


@dataclass
class Pace:
    """The reference pose on its way.

    Attributes:
        lead: The reference runs ahead of the tool by no more than this, metres ...
        lead_angle: ... and this, radians.
        reference: Where the robot is told to go, shape (4, 4), metres; None before the first.
    """

    lead: float = 0.05
    lead_angle: float = 0.3
    reference: Array | None = None
    _holding: bool = field(default=False, init=False)

    def go(self, tool: Array, goal: Array, distance: float, angle: float) -> Array:
        """Move the reference toward a goal.

        Args:
            tool: Where the tool is, shape (4, 4), metres.
            goal: Where it shall go, shape (4, 4), metres.
            distance: How far the reference may move, metres.
            angle: How far it may turn, radians.

        Returns:
            The reference, shape (4, 4).
        """
        start = tool if self.reference is None else self.reference
        ahead = toward(start, goal, distance, angle)
        self.reference, self._holding = toward(tool, ahead, self.lead, self.lead_angle), False
        return self.reference

    def hold(self, tool: Array) -> Array:
        """Keep the reference where the tool, shape (4, 4), was when the hold began."""
        if not self._holding or self.reference is None:
            self.reference, self._holding = tool.copy(), True
        return self.reference

    def forget(self) -> None:
        """Start anew from wherever the tool is at the next call."""
        self.reference, self._holding = None, False

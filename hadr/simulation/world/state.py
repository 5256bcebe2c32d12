"""What is true in the world at one moment: what pictures are drawn from and judges look at."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Holder = Literal["hand", "both", "gripper", "nobody"]
"""Who holds the object: the hand alone, hand and fingers, the fingers alone, or it is falling."""


@dataclass(frozen=True)
class WorldState:
    """The world at one moment; base frame, metres, radians, newtons, seconds.

    Attributes:
        time: Since the start.
        joints: The arm's joint angles, shape (6,).
        gripper_width: Distance between the fingers' pads.
        base_from_wrist: Pose of the hand, shape (4, 4).
        base_from_object: Pose of the object, shape (4, 4).
        holder: Who holds the object.
        hand_force: Largest force of the robot on the hand since the state before, newtons.
        hand_distance: Smallest distance of robot and hand now; 0 where they touch.
    """

    time: float
    joints: Array
    gripper_width: float
    base_from_wrist: Array
    base_from_object: Array
    holder: Holder
    hand_force: float
    hand_distance: float


class HandPath(Protocol):
    """How the hand moves, whatever the robot does."""

    def moved(self, time: float) -> Array:
        """Return base_now_from_base_start for a time in seconds, shape (4, 4); I at time 0."""
        ...

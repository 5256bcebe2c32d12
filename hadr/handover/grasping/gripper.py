"""Our gripper: its sizes, its lines for drawings, its boxes for the checks; metres.

Two fingers as far apart as a Robotiq 2F-85 opens, on a bar before a round body. All else imports
the sizes from here. Checks, physics and pictures simplify it in different ways; where they differ,
each value has a name of its own, so that the difference can be seen.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LARGEST_OPENING = 0.085
"""Widest distance between the fingers, as of a Robotiq 2F-85."""
FLANGE_FROM_TOOL: Array = np.eye(4)
FLANGE_FROM_TOOL[2, 3] = 0.16
"""Where the tool point stands, between the fingertips, seen from the flange, shape (4, 4)."""
FINGER_WIDTH, FINGER_HEIGHT, FINGER_LENGTH = 0.01, 0.02, 0.06
"""A finger along the closing, height and approach axes; its pad is as high as it is."""
PAD_THICKNESS = 0.003
"""Of the pad on a finger, a part of the finger's width; in pictures."""
BAR_LENGTH = 0.02
"""The bar behind the fingers along the approach axis; in checks it is as high as a finger."""
BAR_HEIGHT = 0.025
"""Its height in physics."""
PALM_SIZE: tuple[float, float, float] = (0.08, 0.06, 0.10)
"""The body behind the fingers along closing, height and approach, as checks have it: a box."""
STEM_RADIUS, STEM_LENGTH = 0.03, 0.06
"""The same in physics: a cylinder behind the bar; and the line that stands for it in drawings."""


def fork(width: float) -> Array:
    """The gripper's centre lines for an opening in metres: left and right finger, bar, stem.

    Returns:
        Segments in the tool frame (x closing, z approach, origin between the fingertips), shape
        (4, 2, 3), metres.
    """
    x, back = width / 2 + FINGER_WIDTH / 2, -FINGER_LENGTH
    ends = [
        [(-x, 0, 0), (-x, 0, back)],
        [(x, 0, 0), (x, 0, back)],
        [(-x, 0, back), (x, 0, back)],
        [(0, 0, back), (0, 0, back - STEM_LENGTH)],
    ]
    return np.array(ends, dtype=np.float64)


def fork_points(base_from_tool: Array, width: float) -> Array:
    """Points along the fork's four lines at a tool pose (4, 4): (36, 3), metres."""
    along = np.linspace(0.0, 1.0, 9)[None, :, None]
    segments = fork(width)
    points = (segments[:, None, 0] * (1 - along) + segments[:, None, 1] * along).reshape(-1, 3)
    return points @ base_from_tool[:3, :3].T + base_from_tool[:3, 3]


def gripper_boxes(widths: Array, *, behind: float = 0.0, ahead: float = 0.0) -> Array:
    """The gripper's body, or what it sweeps along its approach axis.

    Args:
        widths: Openings, shape (n,), metres.
        behind: The way begins this far behind the tool pose, metres.
        ahead: It ends this far past the tool pose, metres.

    Returns:
        Lower and upper corners in the tool frame (x closing, y height, z approach), shape
        (n, 4, 2, 3), metres: left finger, right finger, bar, palm.
    """
    inner = np.asarray(widths, dtype=np.float64) / 2
    outer, one = inner + FINGER_WIDTH, np.ones(len(inner))
    tall, wide, thick = FINGER_HEIGHT / 2, PALM_SIZE[0] / 2, PALM_SIZE[1] / 2
    bar, palm = -FINGER_LENGTH - BAR_LENGTH, -FINGER_LENGTH - PALM_SIZE[2]
    rows = [
        (-outer, -inner, tall, -FINGER_LENGTH, 0.0),
        (inner, outer, tall, -FINGER_LENGTH, 0.0),
        (-outer, outer, tall, bar, -FINGER_LENGTH),
        (-wide * one, wide * one, thick, palm, -FINGER_LENGTH),
    ]
    boxes = np.empty((len(inner), 4, 2, 3))
    for i, (low, high, half, back, front) in enumerate(rows):
        boxes[:, i, 0, 0], boxes[:, i, 1, 0] = low, high
        boxes[:, i, :, 1] = -half, half
        boxes[:, i, :, 2] = back - behind, front + ahead
    return boxes

"""Our gripper: sizes, the boxes of planning, guard and physics, lines for drawings; metres.

Two fingers as far apart as a Robotiq 2F-85 opens, on a bar before a palm. All else imports the
sizes from here.
"""

from __future__ import annotations

import numpy as np

from hadr.camera import Array

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
"""The bar behind the fingers along the approach axis; the fingers slide along it."""
BAR_HEIGHT = 0.025
"""Its height."""
PALM_SIZE: tuple[float, float, float] = (0.08, 0.06, 0.085)
"""The body behind the fingers along closing, height and approach. Behind it, up to the flange, is
the cap of the arm's last link."""
STEM_LENGTH = 0.06
"""The line that stands for the palm in drawings."""


def fork(width: float) -> Array:
    """The gripper's centre lines for an opening in metres: left and right finger, bar, stem.

    Segments (4, 2, 3) in the tool frame: x closing, z approach, origin between the fingertips.
    """
    x, back = width / 2 + FINGER_WIDTH / 2, -FINGER_LENGTH
    ends = [
        [(-x, 0, 0), (-x, 0, back)],
        [(x, 0, 0), (x, 0, back)],
        [(-x, 0, back), (x, 0, back)],
        [(0, 0, back), (0, 0, back - STEM_LENGTH)],
    ]
    return np.array(ends, dtype=np.float64)


def gripper_boxes(widths: Array, *, behind: float = 0.0, ahead: float = 0.0) -> Array:
    """The gripper's body, or what it sweeps along its approach axis, for openings (n,), metres.

    The way begins so far behind the tool pose and ends so far ahead. Lower and upper corners in the
    tool frame (x closing, y height, z approach), (n, 4, 2, 3): left and right finger, bar, palm.
    """
    inner = np.asarray(widths, dtype=np.float64) / 2
    outer, one = inner + FINGER_WIDTH, np.ones(len(inner))
    tall, bar, palm = FINGER_HEIGHT / 2, LARGEST_OPENING / 2 + FINGER_WIDTH, PALM_SIZE[0] / 2
    root = -FINGER_LENGTH
    rows = [
        (-outer, -inner, tall, root, 0.0),
        (inner, outer, tall, root, 0.0),
        (-bar * one, bar * one, BAR_HEIGHT / 2, root - BAR_LENGTH, root),
        (-palm * one, palm * one, PALM_SIZE[1] / 2, root - PALM_SIZE[2], root),
    ]
    boxes = np.empty((len(inner), 4, 2, 3))
    for i, (low, high, half, back, front) in enumerate(rows):
        boxes[:, i, 0, 0], boxes[:, i, 1, 0] = low, high
        boxes[:, i, :, 1] = -half, half
        boxes[:, i, :, 2] = back - behind, front + ahead
    return boxes

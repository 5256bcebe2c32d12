"""Sizes of gripper, table and floor in one place, metres; all else imports them from here.

The gripper is ours: two fingers as far apart as a Robotiq 2F-85 opens, on a bar before a round
body. Checks, physics and pictures simplify it in different ways; where they differ, each value has
a name of its own, so that the difference can be seen.
"""

from __future__ import annotations

LARGEST_OPENING = 0.085
"""Widest distance between the fingers, as of a Robotiq 2F-85."""
FLANGE_TO_TOOL = 0.16
"""Distance of the tool point, between the fingertips, from the flange."""
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

TABLE_NEAR, TABLE_FAR = -0.40, 0.42
"""Edges of the robot's table along x, base frame; its top lies at z = 0."""
TABLE_HALF_WIDTH, TABLE_THICKNESS = 0.80, 0.03
"""Along y, and downward, in physics: wide, so that nothing falls past it."""
ROOM_TABLE_HALF_WIDTH, ROOM_TABLE_THICKNESS = 0.65, 0.04
"""The same before the robot's camera."""
FILM_TABLE_HALF_WIDTH, FILM_TABLE_THICKNESS = 0.45, 0.035
"""The same in films, whose view from the side a wider table would hide."""
FLOOR, FILM_FLOOR = -0.75, -0.74
"""Heights of the floor in physics and before the camera, and in films."""

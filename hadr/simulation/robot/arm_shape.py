"""What the arm looks like: the UR5's housings and tubes, and the gripper on its flange.

Each link is built once in its own DH frame; a pose only moves it. The parts are for pictures and
for the camera's depth: rounded solids of about the real sizes, a centimetre off in places.
"""

from __future__ import annotations

from hadr.handover import ur5
from hadr.handover.grasping.gripper import FLANGE_FROM_TOOL
from hadr.records.caches import kept
from hadr.simulation.robot.gripper import gripper_surfaces
from hadr.simulation.robot.solids import (
    LID,
    METAL,
    SEAM,
    SHELL,
    TUBE,
    Array,
    Color,
    Part,
    bar,
    colored,
    round_bar,
)
from hadr.synthesis.glass.surfaces import Surface

_S = ur5.SHOULDER_OFFSET
_E = _S + ur5.ELBOW_OFFSET
_ELBOW, _WRIST = -ur5.DH_A[1], -ur5.DH_A[2]
_TO_WRIST = _E - ur5.DH_D[3]
_BARS: tuple[tuple[int, Color, str, float, float, float, float, float, float], ...] = (
    (0, SEAM, "z", 0.0575, 0.03, 0.042, 0, 0, 0.006),
    (1, SHELL, "y", 0.060, 0.042 - ur5.DH_D[0], 0.062, 0, 0, 0.026),
    (1, SHELL, "z", 0.060, -0.050, _S - 0.066, 0, 0, 0.006),
    (1, LID, "z", 0.056, -0.064, -0.045, 0, 0, 0.008),
    (1, SEAM, "z", 0.0565, _S - 0.07, _S - 0.058, 0, 0, 0.006),
    (2, SHELL, "z", 0.060, _S - 0.062, _S + 0.054, _ELBOW, 0, 0.012),
    (2, SHELL, "z", 0.057, _S - 0.058, _S + 0.050, 0, 0, 0.012),
    (2, SHELL, "x", 0.055, 0.045, 0.095, 0, _S, 0.005),
    (2, SHELL, "x", 0.057, _ELBOW - 0.1, _ELBOW - 0.045, 0, _S, 0.005),
    (2, LID, "z", 0.056, _S + 0.05, _S + 0.068, _ELBOW, 0, 0.008),
    (2, LID, "z", 0.053, _S + 0.046, _S + 0.063, 0, 0, 0.008),
    (2, TUBE, "x", 0.052, 0.0, _ELBOW, 0, _S, 0.006),
    (2, SEAM, "z", 0.052, _S - 0.064, _S - 0.05, 0, 0, 0.006),
    (3, SHELL, "z", 0.053, _E - 0.046, _S - 0.062, _WRIST, 0, 0.012),
    (3, SHELL, "z", 0.040, _E - 0.038, _E + 0.046, 0, 0, 0.010),
    (3, SHELL, "x", 0.043, 0.03, 0.07, 0, _E, 0.004),
    (3, SHELL, "x", 0.048, _WRIST - 0.09, _WRIST - 0.04, 0, _E, 0.005),
    (3, LID, "z", 0.050, _E - 0.058, _E - 0.04, _WRIST, 0, 0.008),
    (3, LID, "z", 0.037, _E - 0.05, _E - 0.034, 0, 0, 0.007),
    (3, TUBE, "x", 0.0415, 0.0, _WRIST, 0, _E, 0.006),
    (3, SEAM, "z", 0.036, _E + 0.04, _E + 0.05, 0, 0, 0.006),
    (4, SHELL, "y", 0.038, _TO_WRIST + 0.049, 0.040, 0, 0, 0.012),
    (4, SHELL, "z", 0.038, -0.040, 0.046, 0, 0, 0.006),
    (4, LID, "z", 0.036, -0.051, -0.036, 0, 0, 0.007),
    (4, SEAM, "z", 0.0345, 0.04, 0.05, 0, 0, 0.006),
    (5, SHELL, "y", 0.038, -0.040, ur5.DH_D[4] - 0.049, 0, 0, 0.012),
    (5, SHELL, "z", 0.038, -0.040, 0.032, 0, 0, 0.006),
    (5, LID, "z", 0.036, -0.051, -0.036, 0, 0, 0.007),
    (5, SEAM, "z", 0.0345, 0.028, 0.037, 0, 0, 0.006),
    (6, SHELL, "z", 0.0375, 0.035 - ur5.DH_D[5], -0.010, 0, 0, 0.005),
    (6, METAL, "z", 0.0315, -0.02, 0.0, 0, 0, 0.002),
)
"""Round bars of link 0 (base) to link 6 (flange), each in its own DH frame: link, colour, axis,
radius, from and to along the axis, the axis's x and z, and the edges' fillet; metres."""


@kept(1)
def _links() -> tuple[tuple[Part, ...], ...]:
    """The parts of each link, one surface a colour."""
    foot = round_bar(((0.075, 0.0), (0.075, 0.014), (0.064, 0.024), (0.061, 0.036)), 0.004)
    looks: list[dict[Color, list[Surface]]] = [{SHELL: [foot]}, *({} for _ in range(6))]
    for link, color, axis, radius, low, high, x, z, fillet in _BARS:
        solid = bar(axis, radius, low, high, (x, 0, z), fillet)
        looks[link].setdefault(color, []).append(solid)
    return tuple(colored(*look.items()) for look in looks)


def arm_surfaces(joints: Array, gripper_width: float) -> list[Part]:
    """The arm at joint angles (6,) in radians, with its gripper open by a width in metres.

    Gives closed surfaces in the base frame (metres) with their linear RGB reflectance.
    """
    frames = ur5.BASE_LINK_FROM_DH_BASE @ ur5.joint_frames(joints)
    parts = [
        (surface.moved(frame), color)
        for frame, link in zip(frames, _links(), strict=True)
        for surface, color in link
    ]
    return parts + gripper_surfaces(frames[6] @ FLANGE_FROM_TOOL, gripper_width)

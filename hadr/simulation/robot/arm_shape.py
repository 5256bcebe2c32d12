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
    Part,
    bar,
    colored,
    round_bar,
)


@kept(1)
def _links() -> tuple[tuple[Part, ...], ...]:
    """The parts of link 0 (base) to link 6 (flange), each in its own DH frame."""
    s = ur5.SHOULDER_OFFSET
    e = s + ur5.ELBOW_OFFSET
    elbow, wrist = -ur5.DH_A[1], -ur5.DH_A[2]
    to_wrist = -(ur5.DH_D[3] - e)
    base = round_bar(((0.075, 0.0), (0.075, 0.014), (0.064, 0.024), (0.061, 0.036)), 0.004)
    return (
        colored((SHELL, [base]), (SEAM, [bar("z", 0.0575, 0.03, 0.042)])),
        colored(
            (
                SHELL,
                [
                    bar("y", 0.060, 0.042 - ur5.DH_D[0], 0.062, fillet=0.026),
                    bar("z", 0.060, -0.050, s - 0.066),
                ],
            ),
            (LID, [bar("z", 0.056, -0.064, -0.045, fillet=0.008)]),
            (SEAM, [bar("z", 0.0565, s - 0.07, s - 0.058)]),
        ),
        colored(
            (
                SHELL,
                [
                    bar("z", 0.060, s - 0.062, s + 0.054, (elbow, 0, 0), fillet=0.012),
                    bar("z", 0.057, s - 0.058, s + 0.050, fillet=0.012),
                    bar("x", 0.055, 0.045, 0.095, (0, 0, s), fillet=0.005),
                    bar("x", 0.057, elbow - 0.1, elbow - 0.045, (0, 0, s), fillet=0.005),
                ],
            ),
            (
                LID,
                [
                    bar("z", 0.056, s + 0.05, s + 0.068, (elbow, 0, 0), 0.008),
                    bar("z", 0.053, s + 0.046, s + 0.063, fillet=0.008),
                ],
            ),
            (TUBE, [bar("x", 0.052, 0.0, elbow, (0, 0, s))]),
            (SEAM, [bar("z", 0.052, s - 0.064, s - 0.05)]),
        ),
        colored(
            (
                SHELL,
                [
                    bar("z", 0.053, e - 0.046, s - 0.062, (wrist, 0, 0), 0.012),
                    bar("z", 0.040, e - 0.038, e + 0.046, fillet=0.010),
                    bar("x", 0.043, 0.03, 0.07, (0, 0, e), 0.004),
                    bar("x", 0.048, wrist - 0.09, wrist - 0.04, (0, 0, e), 0.005),
                ],
            ),
            (
                LID,
                [
                    bar("z", 0.050, e - 0.058, e - 0.04, (wrist, 0, 0), 0.008),
                    bar("z", 0.037, e - 0.05, e - 0.034, fillet=0.007),
                ],
            ),
            (TUBE, [bar("x", 0.0415, 0.0, wrist, (0, 0, e))]),
            (SEAM, [bar("z", 0.036, e + 0.04, e + 0.05)]),
        ),
        colored(
            (
                SHELL,
                [
                    bar("y", 0.038, to_wrist + 0.049, 0.040, fillet=0.012),
                    bar("z", 0.038, -0.040, 0.046),
                ],
            ),
            (LID, [bar("z", 0.036, -0.051, -0.036, fillet=0.007)]),
            (SEAM, [bar("z", 0.0345, 0.04, 0.05)]),
        ),
        colored(
            (
                SHELL,
                [
                    bar("y", 0.038, -0.040, ur5.DH_D[4] - 0.049, fillet=0.012),
                    bar("z", 0.038, -0.040, 0.032),
                ],
            ),
            (LID, [bar("z", 0.036, -0.051, -0.036, fillet=0.007)]),
            (SEAM, [bar("z", 0.0345, 0.028, 0.037)]),
        ),
        colored(
            (SHELL, [bar("z", 0.0375, 0.035 - ur5.DH_D[5], -0.010, fillet=0.005)]),
            (METAL, [bar("z", 0.0315, -0.02, 0.0, fillet=0.002)]),
        ),
    )


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

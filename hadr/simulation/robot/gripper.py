"""Our gripper (`hadr.handover.grasping.gripper`) in the world: body and look."""

from __future__ import annotations

from typing import Any

import numpy as np

from hadr.handover.grasping.gripper import (
    FINGER_HEIGHT,
    FINGER_LENGTH,
    FINGER_WIDTH,
    FLANGE_FROM_TOOL,
    LARGEST_OPENING,
    PAD_THICKNESS,
    gripper_boxes,
)
from hadr.records.caches import kept
from hadr.simulation.robot.solids import (
    BODY,
    LID,
    METAL,
    SEAM,
    Array,
    Part,
    bar,
    box,
    colored,
    rounded_block,
)

GRIPPER_MASSES: dict[str, float] = {"palm": 0.5, "bar": 0.25, "finger": 0.06}
"""Masses in kilograms; one finger."""
GRIPPER_GEOMS: tuple[str, ...] = ("left_finger", "right_finger", "bar", "palm")
"""Names of the collision shapes."""
_GIVE = 0.002
_BODY_TOP, _BODY_END = -0.145, -0.082


def add_gripper(spec: Any, tool: Any, touch: dict[str, int], *, sliding: bool) -> None:
    """Add palm, bar and two fingers, the boxes of `gripper_boxes`, to the body of the tool frame.

    `spec` is a `mujoco.MjSpec`; `touch` says what collides. Fingers that do not slide stand open.
    """
    import mujoco  # the look needs none

    boxes = gripper_boxes(np.array([LARGEST_OPENING]))[0]
    for name, (low, high) in zip(GRIPPER_GEOMS[2:], boxes[2:], strict=True):
        tool.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=(low + high) / 2,
            size=(high - low) / 2,
            mass=GRIPPER_MASSES[name],
            **touch,
        )
    for name, side in (("left", -1.0), ("right", 1.0)):
        # at joint position 0 the finger closes in the middle
        middle = side * (FINGER_WIDTH / 2 + (0.0 if sliding else LARGEST_OPENING / 2))
        body = tool.add_body(
            name=f"{name}_finger", pos=[middle, 0, -FINGER_LENGTH / 2], gravcomp=1.0
        )
        if sliding:
            body.add_joint(
                name=f"{name}_finger",
                type=mujoco.mjtJoint.mjJNT_SLIDE,
                axis=[side, 0, 0],
                limited=True,
                range=[0.0, LARGEST_OPENING / 2],
                armature=0.1,
                damping=2.0,
            )
        body.add_geom(
            name=f"{name}_finger",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[FINGER_WIDTH / 2, FINGER_HEIGHT / 2, FINGER_LENGTH / 2],
            mass=GRIPPER_MASSES["finger"],
            # rubber pads: they give way by about a millimetre and resist twisting
            condim=4,
            friction=[1.0, 0.02, 0.001],
            solref=[0.015, 1.0],
            solimp=[0.8, 0.95, 0.002, 0.5, 2.0],
            priority=1,
            **touch,
        )
    if sliding:
        _couple_fingers(spec)


def _couple_fingers(spec: Any) -> None:
    """Both fingers move by the same way, drawn by one motor; its length is half the opening."""
    import mujoco

    spec.add_equality(
        name="fingers",
        type=mujoco.mjtEq.mjEQ_JOINT,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        name1="left_finger",
        name2="right_finger",
        data=[0, 1, *[0] * 10],
        solref=[0.005, 1.0],
    )
    tendon = spec.add_tendon(name="fingers")
    tendon.wrap_joint("left_finger", 0.5)
    tendon.wrap_joint("right_finger", 0.5)
    motor = spec.add_actuator(
        name="fingers",
        target="fingers",
        trntype=mujoco.mjtTrn.mjTRN_TENDON,
        gaintype=mujoco.mjtGain.mjGAIN_FIXED,
        biastype=mujoco.mjtBias.mjBIAS_AFFINE,
        forcelimited=True,
        forcerange=[-14.0, 14.0],
    )
    motor.gainprm[0] = 6000.0
    motor.biasprm[:3] = [0.0, -6000.0, -60.0]


@kept(1)
def _housing() -> tuple[Part, ...]:
    """The fixed parts in the tool frame."""
    reach = LARGEST_OPENING / 2 + FINGER_WIDTH + 0.004
    rail = box((-reach, -0.009, _BODY_END - 0.012), (reach, 0.009, _BODY_END + 0.008))
    return colored(
        (
            BODY,
            [
                rounded_block(0.042, 0.034, _BODY_TOP, _BODY_END - 0.004),
                rounded_block(0.057, 0.020, _BODY_END - 0.018, _BODY_END),
            ],
        ),
        (METAL, [bar("z", 0.0335, -FLANGE_FROM_TOOL[2, 3], _BODY_TOP + 0.006, fillet=0.003), rail]),
        (LID, [bar("z", 0.0352, _BODY_TOP - 0.006, _BODY_TOP - 0.002, fillet=0.001)]),
    )


@kept(1)
def _finger() -> tuple[Part, ...]:
    """The finger on the side of +x in the tool frame, its pad's face in the plane x = 0."""
    y, tip = FINGER_HEIGHT / 2, FINGER_LENGTH
    return colored(
        (
            METAL,
            [
                box((PAD_THICKNESS, -y, -tip), (FINGER_WIDTH, y, 0.0)),
                box((0.0, -0.009, 0.001 - tip), (PAD_THICKNESS + 0.001, 0.009, -0.042)),
                box((-0.002, -0.013, -tip - 0.014), (FINGER_WIDTH + 0.003, 0.013, -tip)),
            ],
        ),
        (SEAM, [box((0.0, -y, -0.042), (PAD_THICKNESS, y, 0.0))]),
    )


def gripper_surfaces(tool: Array, width: float) -> list[Part]:
    """The gripper's look at a tool pose (4, 4), open by a width, metres.

    ValueError for a width beyond 0 to 85 mm by more than 2 mm: soft pads give way by so much.
    """
    if not -_GIVE <= width <= LARGEST_OPENING + _GIVE:
        raise ValueError(f"gripper_width must lie between 0 and {LARGEST_OPENING} m, got {width}")
    parts = [(surface.moved(tool), color) for surface, color in _housing()]
    for turn in (np.diag([1.0, 1.0, 1.0, 1.0]), np.diag([-1.0, -1.0, 1.0, 1.0])):
        turn[0, 3] = turn[0, 0] * max(0.0, width) / 2
        parts += [(surface.moved(tool @ turn), color) for surface, color in _finger()]
    return parts

"""The UR5 with a two-finger gripper as a MuJoCo model, written by program from the DH numbers.

Nothing here is a mesh from a manufacturer: the joints come from `hadr.handover.ur5`, the masses are
the published ones, and each link is made of the capsules of `ur5.link_capsules`. Body i
stands in DH frame i - 1 and turns about its z axis, so that MuJoCo's forward kinematics is the DH
product itself.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from hadr.camera import Array
from hadr.handover import ur5
from hadr.handover.grasping.gripper import (
    FINGER_HEIGHT,
    FINGER_LENGTH,
    FINGER_WIDTH,
    FLANGE_FROM_TOOL,
    LARGEST_OPENING,
    gripper_boxes,
)
from hadr.simulation.robot.arm_shape import TABLE_FAR, TABLE_NEAR

ROBOT, HAND, OBJECT, GROUND = 1, 2, 4, 8
"""Bits that say what collides with what."""

LINKS: tuple[str, ...] = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
"""The moving links, each behind the joint of the same number."""
LINK_MASSES: tuple[float, ...] = (3.7, 8.393, 2.33, 1.219, 1.219, 0.1879)
"""Published masses of the six links in kilograms."""
ARM_TORQUES: tuple[float, ...] = (150.0, 150.0, 150.0, 28.0, 28.0, 28.0)
"""Largest joint torques in newton metres."""

GRIPPER_MASSES: dict[str, float] = {"palm": 0.5, "bar": 0.25, "finger": 0.06}
"""Masses in kilograms; one finger."""
GRIPPER_GEOMS: tuple[str, ...] = ("left_finger", "right_finger", "bar", "palm")
"""Names of the collision shapes."""
_POSITION_GAINS = (6000.0, 6000.0, 4000.0, 900.0, 900.0, 500.0)
_SPEED_GAINS = (450.0, 450.0, 260.0, 40.0, 40.0, 18.0)
_ARMATURES = (0.2, 0.2, 0.2, 0.05, 0.05, 0.05)


def add_arm(spec: mujoco.MjSpec, *, sliding: bool = True) -> None:
    """Add arm and gripper, its base at the world's origin; fingers that do not slide stand open."""
    spec.compiler.autolimits, spec.compiler.degree = False, False
    base = spec.worldbody.add_body(name="base_link", quat=quaternion_of(ur5.BASE_LINK_FROM_DH_BASE))
    base.add_geom(
        name="base",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        fromto=[0, 0, 0, 0, 0, 0.08],
        size=[0.075, 0, 0],
        mass=4.0,
        **_touch(on_table=True),
    )
    parent, parent_from_body = base, np.eye(4)
    for index, name in enumerate(LINKS):
        parent = parent.add_body(
            name=name,
            pos=parent_from_body[:3, 3],
            quat=quaternion_of(parent_from_body),
            gravcomp=1.0,
        )
        parent.add_joint(
            name=f"joint_{index + 1}",
            type=mujoco.mjtJoint.mjJNT_HINGE,
            axis=[0, 0, 1],
            limited=True,
            range=[ur5.JOINT_LOWER[index], ur5.JOINT_UPPER[index]],
            armature=_ARMATURES[index],
            actfrclimited=True,
            actfrcrange=[-ARM_TORQUES[index], ARM_TORQUES[index]],
        )
        segments = _segments(index)
        lengths = [float(np.linalg.norm(end - start)) + 0.05 for start, end in segments]
        for part, (start, end) in enumerate(segments):
            parent.add_geom(
                name=name if part == 0 else f"{name}_{part}",
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                fromto=[*start, *end],
                size=[ur5.LINK_RADII[index], 0, 0],
                mass=LINK_MASSES[index] * lengths[part] / sum(lengths),
                **_touch(on_table=index == 0),
            )
        for part, point in enumerate(_joint_points(index)):
            parent.add_site(name=f"{name}_point_{part}", pos=point, size=[0.002, 0, 0])
        _add_servo(spec, index)
        parent_from_body = ur5.link_transform(index, 0.0)
    flange = parent.add_body(
        name="flange",
        pos=parent_from_body[:3, 3],
        quat=quaternion_of(parent_from_body),
        gravcomp=1.0,
    )
    tool = flange.add_body(
        name="tool",
        pos=FLANGE_FROM_TOOL[:3, 3],
        quat=quaternion_of(FLANGE_FROM_TOOL),
        gravcomp=1.0,
    )
    tool.add_site(name="tool", pos=[0, 0, 0], size=[0.002, 0, 0])
    _add_gripper(spec, tool, _touch(), sliding=sliding)


def _add_gripper(spec: mujoco.MjSpec, tool: Any, touch: dict[str, int], *, sliding: bool) -> None:
    """Add palm, bar and two fingers, the boxes of `gripper_boxes`, to the tool frame's body."""
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


def _couple_fingers(spec: mujoco.MjSpec) -> None:
    """Both fingers move by the same way, drawn by one motor; its length is half the opening."""
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


def _add_servo(spec: mujoco.MjSpec, index: int) -> None:
    """A position and a speed actuator on one joint: together they follow a path without lag."""
    gains = {"position": _POSITION_GAINS[index], "speed": _SPEED_GAINS[index]}
    for kind, gain in gains.items():
        servo = spec.add_actuator(
            name=f"{kind}_{index + 1}",
            target=f"joint_{index + 1}",
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            gaintype=mujoco.mjtGain.mjGAIN_FIXED,
            biastype=mujoco.mjtBias.mjBIAS_AFFINE,
        )
        servo.gainprm[0] = gain
        servo.biasprm[1 if kind == "position" else 2] = -gain


def kinematic_model() -> mujoco.MjModel:
    """The arm alone, fingers open and fixed, with the table: all shapes may collide."""
    spec = mujoco.MjSpec()
    add_arm(spec, sliding=False)
    add_table(spec)
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 1
    return spec.compile()


def add_table(spec: mujoco.MjSpec) -> None:
    """Add the robot's own table, whose top is z = 0: so wide that nothing falls past it."""
    spec.worldbody.add_geom(
        name="table",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=[round((TABLE_NEAR + TABLE_FAR) / 2, 6), 0.0, -0.015],
        size=[(TABLE_FAR - TABLE_NEAR) / 2, 0.80, 0.015],
        contype=GROUND,
        conaffinity=OBJECT,
    )


_LINK_OF = np.array([link for link, _, _ in ur5.LINK_LINES])
"""The link of each row of `ur5.link_capsules`."""


def _segments(index: int) -> list[tuple[Array, Array]]:
    """Centre lines of one link in its body's frame, metres."""
    rows = ur5.link_capsules(np.zeros(6))[index == _LINK_OF]
    return list(zip(_in_body(index, rows[:, :3]), _in_body(index, rows[:, 3:6]), strict=True))


def _joint_points(index: int) -> Array:
    """The points of `ur5.link_outline` beyond the shoulder that this link carries, metres."""
    ends = [end for link, _, end in ur5.LINK_LINES if link == index > 0]
    return _in_body(index, ur5.link_outline(np.zeros(6))[ends])


def _in_body(index: int, points: Array) -> Array:
    """Points (n, 3) of a link at joint angles 0, from `dh_base` into its body's frame."""
    frame = ur5.joint_frames(np.zeros(6))[index]
    local: Array = (points - frame[:3, 3]) @ frame[:3, :3]
    return local


def _touch(*, on_table: bool = False) -> dict[str, int]:
    """The robot's shapes touch the hand, the object and the table that it does not stand on."""
    return {"contype": ROBOT, "conaffinity": HAND | OBJECT | (0 if on_table else GROUND)}


def pose_of(seen: Any) -> Array:
    """Where MuJoCo's data have a body or a site: its pose in the world, shape (4, 4), metres."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = seen.xmat.reshape(3, 3), seen.xpos
    return pose


def quaternion_of(pose: Array) -> Array:
    """Rotation of a pose (4, 4) as MuJoCo's quaternion (w, x, y, z)."""
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(pose[:3, :3]).ravel())
    return quaternion

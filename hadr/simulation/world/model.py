"""The world of one attempt as a MuJoCo model: arm, table, floor, the human's hand, the object.

The hand is one body of capsules with skin that gives way. It holds the object by a weld that can be
switched off; only then its fingers open and it collides with the object
(`hadr.simulation.world.letting_go`). Robot, object and table collide, and robot and hand.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from hadr.camera import Array
from hadr.hand import FINGERS, keypoints_from_skeleton
from hadr.handover.grasping.collision import FLESH, FOREARM_LENGTH, FOREARM_RADIUS, LINES
from hadr.simulation.robot.arm_model import (
    GROUND,
    HAND,
    OBJECT,
    ROBOT,
    add_arm,
    add_table,
    quaternion_of,
)
from hadr.simulation.robot.arm_shape import FLOOR
from hadr.simulation.world.object_parts import convex_parts, handle_capsules, mass_properties
from hadr.simulation.world.scenes import HeldScene
from hadr.synthesis.glass.shape import GlassObject

TIMESTEP = 0.002
"""Seconds of one step of the physics."""
HAND_MASS = 0.6
"""Effective mass of a hand in kilograms, as ISO/TS 15066 has it."""
HAND_INERTIA = 0.003
"""Moment of inertia of the hand about each axis, kg m2."""


def world_model(scene: HeldScene) -> mujoco.MjModel:
    """Compile a scene's world: free bodies `hand` and `object`, the weld `grip` between them.

    The weld's forces and torques are about the middle of the fingertips.
    """
    spec = mujoco.MjSpec()
    spec.option.timestep = TIMESTEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10.0
    spec.option.noslip_iterations = 4
    # the search among a body's shapes goes by where they were compiled, but fingers open
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_MIDPHASE
    add_arm(spec)
    add_table(spec)
    spec.worldbody.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        pos=[0, 0, FLOOR],
        size=[3, 3, 0.1],
        contype=GROUND,
        conaffinity=OBJECT,
    )
    _add_hand(spec, scene)
    _add_object(spec, scene)
    wrist_from_object = scene.hold.wrist_from_object
    object_from_wrist = np.linalg.inv(wrist_from_object)[:3]
    fingers = keypoints_from_skeleton(scene.skeleton.joints)
    tips = np.array([*fingers[[joints[-1] for joints in FINGERS.values()]].mean(axis=0), 1.0])
    spec.add_equality(
        name="grip",
        type=mujoco.mjtEq.mjEQ_WELD,
        objtype=mujoco.mjtObj.mjOBJ_BODY,
        name1="hand",
        name2="object",
        # one point in the object's frame, in the hand's, and how the one is turned in the other
        data=[*object_from_wrist @ tips, *tips[:3], *quaternion_of(wrist_from_object), 1.0, 0],
        solref=[0.01, 1.0],
    )
    return spec.compile()


def hand_capsules(scene: HeldScene) -> list[tuple[str, Array, Array, float]]:
    """The hand's shapes in the wrist frame: name, start (3,), end (3,), radius; metres."""
    points = keypoints_from_skeleton(scene.skeleton.joints)
    girth = scene.hold.shape.scale * scene.hold.shape.girth
    shapes = []
    for (parent, child), radius in zip(LINES, FLESH.tolist(), strict=True):
        name = f"bone_{parent}_{child}"
        shapes.append((name, points[parent], points[child], radius * girth))
    elbow = points[0] + np.array([0.0, -FOREARM_LENGTH, 0.0])
    near = points[0] + np.array([0.0, -FOREARM_RADIUS, 0.0])
    shapes.append(("human_forearm", near, elbow, FOREARM_RADIUS))
    return shapes


def _add_hand(spec: mujoco.MjSpec, scene: HeldScene) -> None:
    body = _free_body(spec, "hand", scene.base_from_wrist)
    body.gravcomp = 1.0  # the arm's muscles carry it
    points = keypoints_from_skeleton(scene.skeleton.joints)
    _set_inertia(body, HAND_MASS, points.mean(axis=0), HAND_INERTIA * np.eye(3))
    for name, start, end, radius in hand_capsules(scene):
        body.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=[*start, *end],
            size=[radius, 0, 0],
            mass=0.0,
            contype=HAND,
            conaffinity=ROBOT,
            # soft skin, whatever touches it
            priority=2,
            solref=[0.03, 1.0],
            solimp=[0.7, 0.9, 0.005, 0.5, 2.0],
            friction=[0.5, 0.005, 0.0001],
        )


def _add_object(spec: mujoco.MjSpec, scene: HeldScene) -> None:
    body = _free_body(spec, "object", scene.base_from_object)
    item: GlassObject = scene.item
    wall = mass_properties(item)
    _set_inertia(body, wall.mass, wall.center, wall.inertia)
    touch: dict[str, Any] = {
        "mass": 0.0,
        "contype": OBJECT,
        "conaffinity": ROBOT | GROUND,
        "condim": 4,
        "friction": [0.6, 0.005, 0.0001],
    }
    for index, corners in enumerate(convex_parts(item)):
        mesh = spec.add_mesh(name=f"part_{index}")
        mesh.uservert = corners.ravel().tolist()
        body.add_geom(
            name=f"part_{index}",
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=f"part_{index}",
            **touch,
        )
    for index, (start, end, radius) in enumerate(handle_capsules(item)):
        body.add_geom(
            name=f"handle_{index}",
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=[*start, *end],
            size=[radius, 0, 0],
            **touch,
        )


def _free_body(spec: mujoco.MjSpec, name: str, pose: Array) -> Any:
    body = spec.worldbody.add_body(name=name, pos=pose[:3, 3], quat=quaternion_of(pose))
    body.add_freejoint(name=name)
    return body


def _set_inertia(body: Any, mass: float, center: Array, inertia: Array) -> None:
    """Give a body its mass, centre (3,) and inertia (3, 3) about the centre."""
    body.explicitinertial = True
    body.mass, body.ipos = mass, center
    xx, yy, zz = np.diag(inertia)
    body.fullinertia = [xx, yy, zz, inertia[0, 1], inertia[0, 2], inertia[1, 2]]

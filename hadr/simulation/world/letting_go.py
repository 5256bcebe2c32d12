"""How a person lets go: the fingers stretch, together, and the hand draws back.

As far, and on that one of some ways, as touches glass and gripper least, as a person does who sees
both; a finger stops before the gripper. All on a compiled model of `hadr.simulation.world.model`.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable
from itertools import pairwise, product

import mujoco
import numpy as np

from hadr.camera import Array
from hadr.hand import FINGERS
from hadr.simulation.robot.arm_model import OBJECT
from hadr.simulation.world.model import hand_capsules
from hadr.simulation.world.scenes import OPENING_STEPS, HeldScene

IN_THE_HOLLOW = 0.008
"""A finger deeper in the object's solid stand-in, metres, is in its hollow; skin gives way less."""
WITHDRAW_DISTANCE = 0.15
"""How far the hand draws back, metres."""
STRETCHES: Array = np.arange(2, OPENING_STEPS + 1, 2) / OPENING_STEPS
"""How far the fingers may want to open, see `HeldScene.opened`."""
_WAYS = [[0, -1, 0], [0, -1, -1], [0, 0, -1], [1, -1, -1], [-1, -1, -1], [1, -1, 0], [-1, -1, 0]]
DIRECTIONS: Array = np.array(_WAYS) / np.linalg.norm(_WAYS, axis=1, keepdims=True)
"""Ways on which a hand may draw back, wrist frame: along the forearm, to the hand's back, to both,
and all but the second also to either side."""
_ENOUGH = 0.003
_STEPS = (0.01, 0.02, 0.04, 0.06, 0.09, 0.12, WITHDRAW_DISTANCE)


def pose_hand(model: mujoco.MjModel, scene: HeldScene) -> None:
    """Move a model's capsules to where a scene's fingers are."""
    for name, start, end, _ in hand_capsules(scene):
        geom = model.geom(name)
        geom.pos = (start + end) / 2
        mujoco.mju_quatZ2Vec(geom.quat, end - start)


def touch_object(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Let the hand collide with the object from now on, but for what is in its hollow now.

    The object's parts are solid, so what is deep in them is in what truly is a hollow; it does not
    collide later either.
    """
    hand, item = model.body("hand").id, model.body("object").id
    parts = np.flatnonzero(model.geom_bodyid == item)
    for shape in np.flatnonzero(model.geom_bodyid == hand):
        if _nearest(model, data, [int(shape)], parts) > -IN_THE_HOLLOW:
            model.geom_conaffinity[shape] |= OBJECT
    model.body_conaffinity[hand] |= OBJECT


def way_off(
    model: mujoco.MjModel, data: mujoco.MjData, scene: HeldScene, robot: Array
) -> tuple[Array, Array]:
    """How far each finger opens, (5,) in tenths, and the direction of the hand, (3,), base frame.

    A finger stops before one of the robot's shapes, whose numbers are given. To be called after
    `touch_object`.
    """
    model, data = copy.copy(model), copy.copy(data)
    hand, item = model.body("hand").id, model.body("object").id
    shapes = np.flatnonzero(model.geom_bodyid == hand)
    outside = shapes[(model.geom_conaffinity[shapes] & OBJECT) > 0]
    parts = np.flatnonzero(model.geom_bodyid == item)
    fingers = [
        [model.geom(f"bone_{a}_{b}").id for a, b in pairwise(joints)] for joints in FINGERS.values()
    ]
    start = model.joint("hand").qposadr[0]
    place, rotation = data.qpos[start : start + 3].copy(), data.xmat[hand].reshape(3, 3).copy()
    free_to = np.zeros(len(fingers))
    for share in np.arange(1, OPENING_STEPS + 1) / OPENING_STEPS:
        pose_hand(model, scene.opened(np.full(len(fingers), share)))
        mujoco.mj_kinematics(model, data)
        gaps = np.array([_nearest(model, data, bones, robot) for bones in fingers])
        free_to[(gaps >= _ENOUGH) & np.isclose(free_to, share - 1 / OPENING_STEPS)] = share
    best, chosen = -np.inf, (free_to, -rotation[:, 1])
    for stretch, direction in product(STRETCHES, DIRECTIONS @ rotation.T):
        shares, free = np.minimum(stretch, free_to), _ENOUGH
        pose_hand(model, scene.opened(shares))
        for back in _STEPS:
            data.qpos[start : start + 3] = place + back * direction
            mujoco.mj_kinematics(model, data)
            free = min(free, _nearest(model, data, shapes, robot))
            free = min(free, _nearest(model, data, outside, parts))
            if free <= best:
                break
        if free > best:
            best, chosen = free, (shares, direction)
        if best >= _ENOUGH:
            break
    return chosen


def _nearest(
    model: mujoco.MjModel, data: mujoco.MjData, some: Iterable[int], others: Iterable[int]
) -> float:
    """Smallest distance of two groups of shapes, metres, at most `_ENOUGH`; negative: overlap."""
    return min(
        float(mujoco.mj_geomDistance(model, data, int(one), int(other), _ENOUGH, None))
        for one in some
        for other in others
    )

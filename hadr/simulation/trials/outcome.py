"""How an attempt ended, why, and what the robot went by: what a result's row says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hadr.camera import Array, transform_points
from hadr.handover.grasping.grasps import forward_of
from hadr.handover.grasping.gripper import FINGER_LENGTH
from hadr.handover.observation import Observation
from hadr.handover.stages import Stage
from hadr.handover.workflow import Handover
from hadr.simulation.world.judge import Verdict
from hadr.simulation.world.object_parts import distance_outside
from hadr.simulation.world.scenes import HeldScene

AT_GRASP = 0.03
"""Points of the object this near to the place between the fingers, metres, are those at a grasp."""
AFTER_TOUCH = 1.0
"""So long goes an attempt on after the robot has touched the hand, to tell the force, seconds."""


@dataclass(frozen=True)
class Outcome:
    """How an attempt ended; seconds, metres, newtons.

    Attributes:
        verdict: The judge's word.
        reason: In words, in which stage it failed and, as far as the workflow knew, why it was slow
            or stood.
        decided_at: Simulated time of the verdict.
        first_grasp_at: Simulated time at which the first grasp was chosen; NaN without one.
        grasps_chosen: How often one was chosen.
        smallest_distance: Of robot and hand.
        largest_force: Of the robot on the hand, up to `AFTER_TOUCH` after a first touch.
        motion: Kind of the hand's motion.
        kind: Kind of the hold.
        planning_wall_seconds: Mean real time of one search for a grasp; NaN without one.
        wall_seconds: Real time of the whole attempt.
        corrections: How often a finger met the object and the gripper went in again beside.
        forces: Largest force on the hand by way and stage, newtons, such as "touch, Stopped" or
            "through the glass, Grasp & Retrieve", up to the same time.
        points_right: Share of the object's points that lie within 2 cm of its true surface, along
            their rays, when the last grasp was chosen; NaN without one.
        points_right_at_grasp: The same of those within `AT_GRASP` of the middle between the fingers
            at the end of the way in; NaN without any.
        grasp_off: How far that place was from the object, as `distance_outside`.
        torn: Whether the object was torn out of the hand, which had not let go.
    """

    verdict: Verdict
    reason: str
    decided_at: float
    first_grasp_at: float
    grasps_chosen: int
    smallest_distance: float
    largest_force: float
    motion: str
    kind: str
    planning_wall_seconds: float
    wall_seconds: float
    corrections: int
    forces: dict[str, float]
    points_right: float
    points_right_at_grasp: float
    grasp_off: float
    torn: bool


class Shown(NamedTuple):
    """What was seen in a picture, which of its points are right, the object's true pose then."""

    observation: Observation
    right: npt.NDArray[np.bool_] | None
    base_from_object: Array


def believed_of(handover: Handover, shown: Shown, scene: HeldScene) -> tuple[float, float, float]:
    """What the chosen grasp goes by: right points, those at the grasp, its way from the object."""
    assert handover.grasp is not None
    points, right = shown.observation.object_points, shown.right
    end = handover.config.way.forward - FINGER_LENGTH / 2  # the tool point is at the fingers' tips
    place = forward_of(handover.grasp.pose, end)[:3, 3]
    in_object = np.linalg.inv(shown.base_from_object) @ [*place, 1.0]
    off = distance_outside(scene.item, in_object[:3])
    if points is None or right is None:
        return float("nan"), float("nan"), off
    away = np.linalg.norm(transform_points(handover.base_from_camera, points) - place, axis=1)
    near = right[away <= AT_GRASP]
    return float(right.mean()), float(near.mean()) if len(near) else float("nan"), off


def reason_of(verdict: Verdict, handover: Handover) -> str:
    """Why an attempt ended as it did, in words; see `Outcome.reason`."""
    if not handover.transitions:
        return f"no grasp was chosen: {handover.choosing.caution or handover.caution}"
    last = handover.transitions[-1].reason
    if verdict == "success":
        return "the object is at the goal, still held"
    stage, part = handover.stage, ""
    told = stage in (Stage.STOPPED, Stage.FINISHED)  # why it stands there is what entering it said
    if verdict == "gave up" or (told and verdict != "time-out"):
        return last
    if stage in (Stage.GRASP_AND_RETRIEVE, Stage.STOPPED) and handover.part:
        part = f", {handover.part}"
    why = last if told else handover.caution
    return f"{verdict} in {stage.value}{part}" + (f": {why}" if why else "")

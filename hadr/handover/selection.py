"""From restored points to the one grasp to go for: sample, filter, rescore, check the reach."""

from dataclasses import dataclass, field

import numpy as np

from hadr.handover.candidates import sample_grasps
from hadr.handover.collision import free_of_hand, free_of_object
from hadr.handover.grasps import Grasps, forward_of
from hadr.handover.rescoring import Directions, Form, Weights, rescore
from hadr.handover.robot import Robot
from hadr.handover.stages import ChosenGrasp
from hadr.handover.ur5 import Array

HALF_TURN: Array = np.diag([-1.0, -1.0, 1.0, 1.0])
"""Turns the gripper about its approach axis; a parallel gripper grasps the same either way."""


@dataclass(frozen=True)
class GraspSelection:
    """Chooses a grasp as the paper's first stage does; call it with points, hand and robot.

    Attributes:
        rng: Source of the candidates' draws.
        viewpoint: Where the camera stands in the base frame, shape (3,), metres.
        directions: Robot to human, and down, in the base frame.
        form: Which reading of the score, see `hadr.handover.rescoring`.
        weights: Weights of the score.
        attempts: How many candidates are tried.
        back: Distance of the pre-grasp, metres.
        forward: How far past the grasp the fingertips end, metres.
        clearance: Free space to keep to the skin, metres.
    """

    rng: np.random.Generator
    viewpoint: Array
    directions: Directions = field(default_factory=Directions)
    form: Form = "intended"
    weights: Weights = field(default_factory=Weights)
    attempts: int = 400
    back: float = 0.10
    forward: float = 0.05
    clearance: float = 0.02

    def __call__(
        self,
        points: Array,
        keypoints: Array,
        robot: Robot,
        scene_points: Array | None = None,
    ) -> ChosenGrasp | None:
        """Choose a grasp.

        Args:
            points: Object's points in the base frame, shape (n, 3), metres.
            keypoints: Hand in the base frame, shape (21, 3), metres.
            robot: Says what it can reach.
            scene_points: What is not the object, base frame, shape (m, 3), metres; not used.

        Returns:
            The best grasp whose pre-grasp, grasp and final pose can all be reached; None where no
            candidate is left.

        Raises:
            ValueError: The points allow no candidate at all, see `sample_grasps`.
        """
        grasps = self.candidates(points)
        free = free_of_object(grasps, points, forward=self.forward)
        free &= free_of_hand(grasps, keypoints, forward=self.forward, clearance=self.clearance)
        grasps = grasps.select(free)
        scores = rescore(grasps, self.directions, form=self.form, weights=self.weights)
        for row in np.argsort(-scores, kind="stable"):
            pose = self._turned(grasps.poses[row], robot)
            if pose is not None:
                return ChosenGrasp(pose, float(grasps.widths[row]), float(scores[row]))
        return None

    def candidates(self, points: Array) -> Grasps:
        """Candidates around points (n, 3) in the base frame, before any filter."""
        return sample_grasps(
            points, self.rng, viewpoint=self.viewpoint, attempts=self.attempts, frame="base"
        )

    def _turned(self, pose: Array, robot: Robot) -> Array | None:
        """The reachable one of a pose and its half turn, the one nearer to the tool's own turn."""
        closing = robot.tool_pose()[:3, 0]
        both = sorted((pose, pose @ HALF_TURN), key=lambda p: -float(p[:3, 0] @ closing))
        for option in both:
            stops = (-self.back, 0.0, self.forward)
            if all(robot.reachable(forward_of(option, stop)) for stop in stops):
                return option
        return None

"""From restored points to the one grasp to go for: sample, filter, rescore, check the reach."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from hadr.handover.dimensions import LARGEST_OPENING
from hadr.handover.grasping.candidates import NoCandidateError, completed, sample_grasps
from hadr.handover.grasping.collision import free_of_object, free_of_scene, way_to_hand
from hadr.handover.grasping.grasps import Grasps, forward_of
from hadr.handover.grasping.rescoring import Directions, Form, Weights, rescore
from hadr.handover.grasping.unseen_side import turned_about_axis
from hadr.handover.robot import Robot
from hadr.handover.stages import ChosenGrasp
from hadr.handover.ur5 import Array

HALF_TURN: Array = np.diag([-1.0, -1.0, 1.0, 1.0])
"""Turns the gripper about its approach axis; a parallel gripper grasps the same either way."""

CandidateSource = Callable[[Array], Grasps]
"""From the object's points in the base frame (n, 3), metres, to candidates in the base frame."""


@dataclass(frozen=True)
class GraspSelection:
    """Chooses a grasp as the paper's first stage does; call it with points, hand and robot.

    Attributes:
        rng: Source of the candidates' draws.
        viewpoint: Where the camera stands in the base frame, shape (3,), metres.
        directions: Robot to human, and down, in the base frame.
        form: Which reading of the score, see `hadr.handover.grasping.rescoring`.
        weights: Weights of the score.
        attempts: How many contacts are tried.
        back: Distance of the pre-grasp, metres.
        forward: How far past the grasp the fingertips end, metres.
        clearances: Free space to keep to the skin, metres: the second is tried where the first
            leaves no grasp that can be reached, and so on.
        friction: Coefficient that a grasp may need at most.
        rescoring: False orders the candidates by their own score alone.
        widest: The gripper's widest opening, metres; it opens as far as hand and object allow.
        most_checked: How many of the best of one round are asked for their reach, at most.
        rounds: How often candidates are drawn anew while none is left.
        source: Where the candidates come from instead of `sample_grasps`, such as
            `hadr.handover.grasping.graspnet.DetectedGrasps`.
    """

    rng: np.random.Generator
    viewpoint: Array
    directions: Directions = field(default_factory=Directions)
    form: Form = "intended"
    weights: Weights = field(default_factory=Weights)
    attempts: int = 800
    back: float = 0.10
    forward: float = 0.05
    clearances: tuple[float, ...] = (0.02, 0.012)
    friction: float = 0.6
    rescoring: bool = True
    widest: float = LARGEST_OPENING
    most_checked: int = 25
    rounds: int = 4
    source: CandidateSource | None = None

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
            scene_points: Measured points of anything else (hand, arm, table) in the base frame,
                shape (m, 3), metres.

        Returns:
            The best grasp whose pre-grasp, grasp and final pose can all be reached, and to whose
            pre-grasp a straight way leads, or, without such a one, the best to which any way does;
            None where no candidate is left.

        Raises:
            ValueError: The points are too few or not finite, see `sample_grasps`.
        """
        seen = np.asarray(points, dtype=np.float64)
        taken = self._taken_space(self.rng.permutation(seen)[:2000])
        for number in range(self.rounds):
            try:
                grasps = self.candidates(seen)
            except NoCandidateError:
                continue
            aside = _ASIDE if number < self.rounds - 1 else _ASIDE[:1]  # at last: as it stands
            chosen = self._best(grasps, taken, keypoints, robot, scene_points, aside)
            if chosen is not None:
                return chosen
        return None

    def candidates(self, points: Array) -> Grasps:
        """Candidates around points (n, 3) in the base frame, before any filter."""
        if self.source is not None:
            return self.source(points)
        return sample_grasps(
            points,
            self.rng,
            viewpoint=self.viewpoint,
            toward=self.directions.robot_to_human if self.rescoring else None,
            attempts=self.attempts,
            friction=self.friction,
            frame="base",
        )

    def _taken_space(self, points: Array) -> Array:
        """Where the object may be: points in random order (n, 3), seen and guessed (m, 3)."""
        whole, normals = completed(points, self.viewpoint)
        return np.concatenate([whole, turned_about_axis(whole, normals)])

    def scores(self, grasps: Grasps) -> Array:
        """What the grasps are ordered by, shape (n,)."""
        if not self.rescoring:
            return grasps.scores
        return rescore(grasps, self.directions, form=self.form, weights=self.weights)

    def _best(
        self,
        grasps: Grasps,
        points: Array,
        keypoints: Array,
        robot: Robot,
        scene_points: Array | None,
        aside: Array,
    ) -> ChosenGrasp | None:
        """The best of some candidates that is free and can be reached, moved aside (n, 3) too."""
        back, forward = self.back, self.forward
        room = way_to_hand(grasps, keypoints, back=back, forward=forward)
        grasps = grasps.select(room >= min(self.clearances))
        grasps = grasps.select(free_of_object(grasps, points, back=back, forward=forward))
        if scene_points is not None and len(scene_points):
            few = _thinned(scene_points)
            free = free_of_scene(grasps, few, points, back=back, forward=forward)
            grasps = grasps.select(free)
        room = way_to_hand(grasps, keypoints, back=back, forward=forward)
        scores = self.scores(grasps)
        best_first = np.argsort(-scores, kind="stable")
        tried: list[Array] = []
        roundabout: ChosenGrasp | None = None
        for clearance in self.clearances:
            for row in best_first[room[best_first] >= clearance]:
                pose = grasps.poses[row]
                if len(tried) >= self.most_checked:
                    return roundabout
                if any(_alike(pose, other) for other in tried):
                    continue
                tried.append(pose)
                for reached in self._turned(pose, robot, aside):
                    one = grasps.select(np.array([row]))
                    width = self._opening(one, points, keypoints, scene_points, clearance)
                    found = ChosenGrasp(reached, width, float(scores[row]))
                    if robot.straight_way(forward_of(reached, -self.back)):
                        return found
                    roundabout = roundabout or found
        return roundabout

    def _opening(
        self,
        grasp: Grasps,
        points: Array,
        keypoints: Array,
        scene_points: Array | None,
        clearance: float,
    ) -> float:
        """How wide the fingers may open on the way in, metres: an error to the side is forgiven."""
        least = float(grasp.widths[0])
        for width in np.linspace(self.widest, least, 4)[:-1]:
            if width <= least:
                break
            wide = replace(grasp, widths=np.array([width]))
            room = way_to_hand(wide, keypoints, back=self.back, forward=self.forward)
            if room[0] < clearance:
                continue
            if not free_of_object(wide, points, back=self.back, forward=self.forward)[0]:
                continue
            if scene_points is not None and len(scene_points):
                few = _thinned(scene_points)
                if not free_of_scene(wide, few, points, back=self.back, forward=self.forward)[0]:
                    continue
            return float(width)
        return least

    def _turned(self, pose: Array, robot: Robot, aside: Array) -> list[Array]:
        """The reachable ones of a pose and its half turn, the nearer to the tool's turn first."""
        closing = robot.tool_pose()[:3, 0]
        both = sorted((pose, pose @ HALF_TURN), key=lambda p: -float(p[:3, 0] @ closing))
        stops = [(-self.back, side) for side in aside]
        stops += [(0.0, np.zeros(3)), (self.forward, np.zeros(3))]
        return [
            option
            for option in both
            if all(robot.reachable(_moved(forward_of(option, s), side)) for s, side in stops)
        ]


_ASIDE = 0.03 * np.array([[0, 0, 0], [0, 0, 1], [0, 0, -1], [0, 1, 0], [0, -1, 0]])
"""So far the pre-grasp may move with the hand and must still be within reach, metres."""


def _moved(pose: Array, shift: Array) -> Array:
    moved = pose.copy()
    moved[:3, 3] += shift
    return moved


def _alike(pose: Array, other: Array) -> bool:
    """Whether two poses are so near that what one cannot reach the other cannot either."""
    near = float(np.abs(pose[:3, 3] - other[:3, 3]).max()) < 0.02
    turned = float(np.trace(pose[:3, :3].T @ other[:3, :3])) > 1 + 2 * np.cos(np.deg2rad(12.0))
    return near and turned


def _thinned(points: Array, most: int = 1000) -> Array:
    """At most that many of the points, evenly over their order."""
    if len(points) <= most:
        return points
    rows: NDArray[np.int64] = np.linspace(0, len(points) - 1, most).astype(np.int64)
    return points[rows]

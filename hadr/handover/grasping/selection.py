"""From restored points to the one grasp to go for: sample, filter, rescore, check the reach.

When to search is decided here too: in a fresh picture, of an object in a calm hand, and not too
often.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from hadr.camera import Array, transform_points
from hadr.handover import safety, stages, ur5
from hadr.handover.grasping.candidates import (
    FINGER_REACH,
    NoCandidateError,
    completed,
    sample_grasps,
)
from hadr.handover.grasping.collision import (
    free_of_object,
    free_of_scene,
    hand_distance,
    links_gaps,
    person,
    way_to_hand,
)
from hadr.handover.grasping.grasps import FEELING_STEP, PAPER_WAY, Grasps, Way, forward_of
from hadr.handover.grasping.gripper import LARGEST_OPENING
from hadr.handover.grasping.rescoring import Directions, rescore
from hadr.handover.grasping.unseen_side import turned_about_axis
from hadr.handover.observation import HandWatch, Observation
from hadr.handover.poses import check_pose
from hadr.handover.robot import Robot, UnreachableError
from hadr.handover.stages import ChooseGrasp, ChosenGrasp, HandoverConfig

HALF_TURN: Array = np.diag([-1.0, -1.0, 1.0, 1.0])
"""Turns the gripper about its approach axis; a parallel gripper grasps the same either way."""

NO_GRASP = (NoCandidateError, UnreachableError, np.linalg.LinAlgError)
"""What a search may raise that says there is no grasp now; anything else is a defect."""
CandidateSource = Callable[[Array], Grasps]
"""From the object's points in the base frame (n, 3), metres, to candidates in the base frame."""


CLEARANCES = (0.02, 0.012)
"""Free space to keep to the skin, metres: the second is tried where the first leaves no grasp that
can be reached."""
REACHES = (0.05, 0.04, 0.03, 0.025)
"""How far the fingers reach over the object in each round of candidates, metres: on what a hand
holds nearly all around, only the rim is free. GraspNet's depths are 1 to 4 cm."""
MOST_CHECKED = 25
"""How many of the best of one round are asked for their reach, at most."""


@dataclass(frozen=True)
class GraspSelection:
    """Chooses a grasp as the paper's first stage does; call it with points, hand and robot.

    Attributes:
        rng: Draws the candidates.
        viewpoint: Where the camera stands in the base frame, shape (3,), metres.
        rescoring: False orders the candidates by their own score alone.
        source: Where the candidates come from instead of `sample_grasps`, such as
            `hadr.handover.grasping.graspnet.DetectedGrasps`.
    """

    rng: np.random.Generator
    viewpoint: Array
    rescoring: bool = True
    source: CandidateSource | None = None

    def __call__(
        self,
        points: Array,
        keypoints: Array,
        robot: Robot,
        scene_points: Array | None = None,
        way: Way = PAPER_WAY,
    ) -> ChosenGrasp | None:
        """Choose a grasp; see `ChooseGrasp` for what is given.

        Returns:
            The best grasp whose pre-grasp, grasp and final pose can all be reached, past which the
            hand can draw back along its forearm, and to whose pre-grasp a straight way leads, or,
            without such a one, the best to which any way does; None where no candidate is left. It
            says how much of the way on past the final move is free and within reach.

        Raises:
            NoCandidateError: There were none from the start.
            ValueError: The points are too few or not finite, see `sample_grasps`.
        """
        seen = np.asarray(points, dtype=np.float64)
        whole, normals = completed(self.rng.permutation(seen)[:2000], self.viewpoint)
        taken = np.concatenate([whole, turned_about_axis(whole, normals)])  # where it may be
        scene = np.zeros((0, 3)) if scene_points is None else _thinned(scene_points)
        none: NoCandidateError | None = None
        roundabout: ChosenGrasp | None = None
        for number, reach in enumerate(REACHES):
            try:
                grasps, none = self.candidates(seen, reach), None
            except NoCandidateError as error:
                none = error
                continue
            aside = _ASIDE if number < len(REACHES) - 1 else _ASIDE[:1]  # at last: as it stands
            around = _Surroundings(taken, scene, keypoints, robot, Way(*way[:2]), way.feel)
            chosen, straight = self._best(grasps, around, aside)
            if straight:
                return chosen
            roundabout = roundabout or chosen
        if none is not None and roundabout is None:
            raise none
        return roundabout

    def candidates(self, points: Array, reach: float = FINGER_REACH) -> Grasps:
        """Candidates around points (n, 3) in the base frame, before any filter.

        A source of its own is not told the fingers' reach, metres.
        """
        if self.source is not None:
            return self.source(points)
        toward = Directions().robot_to_human if self.rescoring else None
        return sample_grasps(
            points, self.rng, viewpoint=self.viewpoint, toward=toward, reach=reach, frame="base"
        )

    def _best(
        self, grasps: Grasps, around: _Surroundings, aside: Array
    ) -> tuple[ChosenGrasp | None, bool]:
        """The best that is free and within reach, also moved aside (n, 3); is the way straight?"""
        room = around.room(grasps)
        near = room >= min(CLEARANCES)
        grasps, room = grasps.select(near), room[near]
        free = around.free(grasps)
        grasps, room = grasps.select(free), room[free]
        scores = rescore(grasps, Directions()) if self.rescoring else grasps.scores
        best_first = np.argsort(-scores, kind="stable")
        tried: list[Array] = []
        roundabout: ChosenGrasp | None = None
        for clearance in CLEARANCES:
            for row in best_first[room[best_first] >= clearance]:
                pose = grasps.poses[row]
                if len(tried) >= MOST_CHECKED:
                    return roundabout, False
                if any(_alike(pose, other) for other in tried):
                    continue
                tried.append(pose)
                for reached in around.turned(pose, aside):
                    ends = (forward_of(reached, s) for s in (-around.way.back, around.way.last))
                    if not all(around.arm_clear(end, clearance) for end in ends):
                        continue
                    one = grasps.select(np.array([row]))
                    one = replace(one, widths=np.array([around.opening(one, clearance)]))
                    feel = around.feeling(one, reached, clearance)
                    found = ChosenGrasp(reached, float(one.widths[0]), float(scores[row]), feel)
                    if not around.hand_leaves(found):
                        continue
                    if around.robot.straight_way(forward_of(reached, -around.way.back)):
                        return found, True
                    roundabout = roundabout or found
        return roundabout, False


@dataclass(frozen=True)
class _Surroundings:
    """What a grasp must keep off, and the arm that must reach it; base frame, metres.

    `way` is without feeling, `feel` the most of that.
    """

    points: Array
    scene: Array
    keypoints: Array
    robot: Robot
    way: Way
    feel: float

    def room(self, grasps: Grasps) -> Array:
        """Free space to the skin on the way in, (n,)."""
        return way_to_hand(grasps, self.keypoints, self.way)

    def free(self, grasps: Grasps) -> NDArray[np.bool_]:
        """Which keep off the object's points and those of anything else on the way in, (n,)."""
        off_scene = free_of_scene(grasps, self.scene, self.points, way=self.way)
        return free_of_object(grasps, self.points, self.way) & off_scene

    def opening(self, grasp: Grasps, clearance: float) -> float:
        """How wide the fingers may open on the way in: an error to the side is forgiven."""
        least = float(grasp.widths[0])
        for width in np.linspace(LARGEST_OPENING, least, 4)[:-1]:
            if width <= least:
                break
            wide = replace(grasp, widths=np.array([width]))
            if self.room(wide)[0] >= clearance and self.free(wide)[0]:
                return float(width)
        return least

    def turned(self, pose: Array, aside: Array) -> list[Array]:
        """The reachable ones of a pose and its half turn, the nearer to the tool's turn first."""
        closing, way = self.robot.tool_pose()[:3, 0], self.way
        both = sorted((pose, pose @ HALF_TURN), key=lambda p: -float(p[:3, 0] @ closing))
        stops = [(-way.back, side) for side in aside]
        stops += [(s, np.zeros(3)) for s in np.linspace(-way.back, way.last, 4)[1:]]
        return [
            option
            for option in both
            if all(self.robot.reachable(_moved(forward_of(option, s), side)) for s, side in stops)
        ]

    def arm_clear(self, pose: Array, clearance: float) -> bool:
        """Whether the arm's links keep off the person with the tool at a pose."""
        links = ur5.link_surfaces(self.robot.joints_at(pose))
        return bool(links_gaps(links, person(self.keypoints)).min() >= clearance)

    def hand_leaves(self, grasp: ChosenGrasp) -> bool:
        """Whether the hand that has given can draw back along its forearm past gripper and arm."""
        pose, back = forward_of(grasp.pose, self.way.last), self.keypoints[0] - self.keypoints[9]
        back = back / max(float(np.linalg.norm(back)), 1e-9)
        links = ur5.link_surfaces(self.robot.joints_at(pose))
        return all(
            hand_distance(pose, grasp.width, self.keypoints + way * back, links) >= _PASSES
            for way in _DRAWN_BACK
        )

    def feeling(self, grasp: Grasps, pose: Array, clearance: float) -> float:
        """How far on past the final move a grasp, turned to a pose, is free and within reach."""
        feel = 0.0
        while feel + FEELING_STEP <= self.feel + 1e-9:
            way = self.way._replace(feel=feel + FEELING_STEP)
            end = forward_of(pose, way.last)
            if not (
                way_to_hand(grasp, self.keypoints, way)[0] >= clearance
                and free_of_scene(grasp, self.scene, self.points, way=way)[0]
                and self.robot.reachable(end)
                and self.arm_clear(end, clearance)
            ):
                break
            feel += FEELING_STEP
        return feel


_DRAWN_BACK, _PASSES = (0.03, 0.06, 0.10, 0.15), 0.006
"""How far a hand that has given draws back, and the free space that it then needs, metres."""
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


def _thinned(points: Array) -> Array:
    """At most 1000 of the points, evenly over their order."""
    if len(points) <= 1000:
        return points
    rows: NDArray[np.int64] = np.linspace(0, len(points) - 1, 1000).astype(np.int64)
    return points[rows]


@dataclass
class Choosing:
    """Decides when to search for a grasp, and keeps what went wrong in words.

    `caution` says why there is no grasp, `reason` what the newest picture that one could have been
    chosen from lacked: it stays while a picture is bad for another reason, until the next search.
    """

    choose_grasp: ChooseGrasp
    watch: HandWatch
    config: HandoverConfig
    caution: str = field(default="", init=False)
    reason: str = field(default="", init=False)
    _found: str = field(default="", init=False)
    _hand_from: float = field(default=float("inf"), init=False)
    _searched_at: float = field(default=-float("inf"), init=False)

    def obstacle(self, observation: Observation, now: float) -> str:
        """Why no grasp may be chosen from this observation now, or an empty string."""
        watch = self.watch
        trouble = watch.trouble(now)
        if trouble or watch.keypoints is None:
            return trouble or watch.problem
        if observation.object_points is None:
            return "no points of the object"
        doubt = safety.low_confidence(observation.confidence)
        if doubt:
            return doubt
        points = transform_points(watch.base_from_camera, observation.object_points)
        if not safety.object_in_hand(points, watch.keypoints):
            return "the object is not in the hand"
        return ""

    def start(self) -> None:
        """Begin to wait for a calm hand."""
        self._hand_from = float("inf")
        self.caution = self.reason = self._found = ""

    def ready(self, observation: Observation, now: float, *, new: bool) -> bool:
        """Say whether to search now, in a new picture; the reason against it is in `caution`."""
        watch = self.watch
        seen = watch.keypoints is not None
        self._hand_from = min(self._hand_from, now) if seen else float("inf")
        obstacle = self.obstacle(observation, now)
        self.caution = obstacle or self.reason
        if obstacle or not new:
            return False
        velocity = watch.velocity(stages.CALM_WINDOW)
        calm = velocity is not None and bool(np.linalg.norm(velocity) < stages.CALM_SPEED)
        if not calm and now - self._hand_from < stages.LONGEST_WAIT:
            self.caution = self.reason = "the hand is not calm yet"
            return False
        self.caution = self.reason = self._found
        return now - self._searched_at >= stages.CHOOSE_EVERY - 1e-9

    def search(self, observation: Observation, now: float, robot: Robot) -> ChosenGrasp | None:
        """Search an observation without an `obstacle`; None, and a `caution`, without a grasp.

        RuntimeError where the search raised a ValueError that does not say there is no grasp: it
        would pass for a bad picture. All other errors pass through as they are.
        """
        watch, points, scene = self.watch, observation.object_points, observation.scene_points
        assert points is not None  # else that was the obstacle
        assert watch.keypoints is not None
        self._searched_at = now
        points = transform_points(watch.base_from_camera, points)
        if scene is not None:
            scene = transform_points(watch.base_from_camera, scene)
        chosen: ChosenGrasp | None = None
        try:
            chosen = self.choose_grasp(points, watch.keypoints, robot, scene, self.config.way)
            if chosen is not None:
                check_pose(chosen.pose, "the chosen grasp")
            self.refuse("" if chosen else "no grasp: none that is free and within reach")
        except NO_GRASP as error:
            self.refuse(f"no grasp: {error}")
        except ValueError as error:
            raise RuntimeError(f"the choice of a grasp failed: {error}") from error
        return chosen

    def refuse(self, why: str) -> None:
        """Keep why the last search led to nothing; an empty string: it led to a grasp."""
        self.caution = self.reason = self._found = why

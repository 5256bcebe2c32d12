"""When a grasp is chosen: from a fresh picture, of an object in a calm hand, not too often."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from hadr.camera import transform_points
from hadr.handover import safety
from hadr.handover.observation import HandWatch, Observation, clean_points, number
from hadr.handover.robot import Robot
from hadr.handover.stages import ChooseGrasp, ChosenGrasp, HandoverConfig
from hadr.handover.ur5 import UnreachableError, check_pose

Array = npt.NDArray[np.float64]


@dataclass
class Choosing:
    """Decides when to search for a grasp, and keeps what went wrong in words.

    Attributes:
        choose_grasp: Searches; see `hadr.handover.grasping.selection`.
        watch: The newest hand.
        config: Settings.
        caution: Why there is no grasp; empty after one was found.
        reason: What the newest picture that a grasp could have been chosen from lacked. It stays,
            unlike `caution`, while a picture is bad for another reason, until the next search.
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
        """Why no grasp may be chosen from this observation, or an empty string.

        Args:
            observation: The newest one.
            now: The workflow's clock, seconds.
        """
        limits, watch = self.config.safety, self.watch
        trouble = watch.trouble(now)
        if trouble or watch.keypoints is None:
            return trouble or watch.problem
        points = clean_points(observation.object_points)
        if points is None:
            return "no points of the object"
        confidence = None if observation.confidence is None else number(observation.confidence)
        doubt = safety.low_confidence(confidence, limits.smallest_confidence)
        if doubt:
            return doubt
        points = transform_points(watch.base_from_camera, points)
        if not safety.object_in_hand(points, watch.keypoints, limits.object_near):
            return "the object is not in the hand"
        return ""

    def start(self) -> None:
        """Begin to wait for a calm hand."""
        self._hand_from = float("inf")
        self.caution = self.reason = self._found = ""

    def ready(self, observation: Observation, now: float, *, new: bool) -> bool:
        """Say whether to search now; the reason against it stands in `caution`.

        Args:
            observation: The newest one.
            now: The workflow's clock, seconds.
            new: It shows a new picture.
        """
        c, watch = self.config, self.watch
        seen = watch.keypoints is not None
        self._hand_from = min(self._hand_from, now) if seen else float("inf")
        obstacle = self.obstacle(observation, now)
        self.caution = obstacle or self.reason
        if obstacle or not new:
            return False
        velocity = watch.velocity(c.calm_window)
        calm = velocity is not None and bool(np.linalg.norm(velocity) < c.calm_speed)
        if not calm and now - self._hand_from < c.longest_wait:
            self.caution = self.reason = "the hand is not calm yet"
            return False
        self.caution = self.reason = self._found
        return now - self._searched_at >= c.choose_every - 1e-9

    def search(self, observation: Observation, now: float, robot: Robot) -> ChosenGrasp | None:
        """Search for a grasp.

        Args:
            observation: One without an `obstacle`.
            now: The workflow's clock, seconds.
            robot: Says what it can reach.

        Returns:
            The grasp in the base frame; None, and the reason in `caution`, where there is none or
            the detector failed, in whatever way.
        """
        self._searched_at = now
        chosen, why = self._chosen(observation, robot)
        self.refuse(why)
        return chosen

    def refuse(self, why: str) -> None:
        """Keep why the last search led to nothing; an empty string: it led to a grasp."""
        self.caution = self.reason = self._found = why

    def _chosen(self, observation: Observation, robot: Robot) -> tuple[ChosenGrasp | None, str]:
        """The grasp, or why there is none."""
        watch, scene = self.watch, clean_points(observation.scene_points)
        points = clean_points(observation.object_points)
        if points is None or watch.keypoints is None:
            return None, self._found
        if scene is not None:
            scene = transform_points(watch.base_from_camera, scene)
        points = transform_points(watch.base_from_camera, points)
        try:
            chosen = self.choose_grasp(points, watch.keypoints, robot, scene)
            if chosen is not None:
                check_pose(chosen.pose, "the chosen grasp")
        except (UnreachableError, ValueError, np.linalg.LinAlgError) as error:
            return None, f"no grasp: {error}"
        except Exception as error:  # a user's detector may raise anything; the arm goes on
            return None, f"no grasp: the detector failed: {type(error).__name__}: {error}"
        return chosen, "" if chosen else "no grasp: none that is free and within reach"

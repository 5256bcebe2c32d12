"""What perception tells the workflow, and how much of it can be trusted.

Nothing in an observation is believed: a hand with NaN in it, a picture from the future, the same
keypoints again and again are named and leave the robot standing; nothing here raises.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from hadr.camera import Array, transform_points
from hadr.handover import safety
from hadr.handover.tracking import best_similarity

FEWEST_POINTS = 30
"""An object of fewer points is none."""
FASTEST_HAND, NEAR_HAND = 0.8, 0.02
"""A hand that would have moved faster, m/s, and more than so far, metres, since it was believed is
doubted: until it is back, or has had the time to go there."""
SAME_LAG, DATED_BY = 0.1, 5
"""So many pictures whose lags differ by no more, seconds, tell what a clock shows that jumped."""
TURN_WINDOW, TURN_NOISE = 0.3, 0.3
"""How fast a hand turns is measured over so many seconds; so fast, rad/s, keypoints with an error
of 4 mm seem to turn at rest, and what is slower counts as resting."""
FARTHEST_POINT = 5.0
"""Points farther than this from the camera, metres, are none."""


@dataclass(frozen=True)
class Observation:
    """What perception says at one moment.

    Attributes:
        time: Now, seconds.
        keypoints: Hand in the camera frame, shape (21, 3), metres; None where no hand was found.
        object_points: Restored points of the object in the camera frame, shape (n, 3), metres;
            None where there are none.
        scene_points: Measured points of hand, arm and table, which are not the object, in the
            camera frame, shape (m, 3), metres; None where there are none.
        confidence: Mean confidence of the object's restored depth, 0 to 1; None: not known.
        frame_time: When the picture was taken, seconds; None: now. Observations of the same
            picture have the same `frame_time`.
    """

    time: float
    keypoints: Array | None = None
    object_points: Array | None = None
    scene_points: Array | None = None
    confidence: float | None = None
    frame_time: float | None = None

    @property
    def taken(self) -> float:
        """When the picture was taken, seconds."""
        return self.time if self.frame_time is None else self.frame_time


def cleaned(observation: Observation) -> Observation:
    """The same, times and confidence as finite numbers or NaN, and without what is no point.

    Of each cloud the finite points within `FARTHEST_POINT`; None where none are left, or fewer than
    `FEWEST_POINTS` of the object. The keypoints are `HandWatch`'s business.
    """
    confidence = observation.confidence
    return Observation(
        _number(observation.time),
        observation.keypoints,
        _points(observation.object_points, FEWEST_POINTS),
        _points(observation.scene_points, 1),
        None if confidence is None else _number(confidence),
        _number(observation.taken),
    )


def _points(points: npt.ArrayLike | None, fewest: int) -> Array | None:
    """The usable points of anything, or None where there are fewer."""
    if points is None:
        return None
    try:
        cloud = np.asarray(points, dtype=np.float64)
    except safety.NOT_NUMBERS:
        return None
    if cloud.ndim != 2 or cloud.shape[1] != 3:
        return None
    cloud = cloud[(np.abs(cloud) <= FARTHEST_POINT).all(axis=1)]  # False for NaN
    return cloud if len(cloud) >= fewest else None


def _number(value: object) -> float:
    """A finite number as a float, NaN for anything else."""
    if not isinstance(value, (int, float, np.number)) or isinstance(value, complex):
        return float("nan")
    try:
        found = float(value)
    except (OverflowError, TypeError):
        return float("nan")
    return found if np.isfinite(found) else float("nan")


@dataclass
class HandWatch:
    """The newest hand in the base frame, and what is wrong with the pictures.

    Both times of the first observations are believed to be of one clock. Where a picture is from
    the future, or older than one before, one of two clocks has jumped: late pictures come in order.
    After `DATED_BY` such pictures in a row with one lag, over `safety.CAMERA_SILENT_AFTER`, all are
    dated anew. No clock tells how late they are; it is assumed, as late as before: the one that
    lags least is as old as the oldest of the last that were believed, when those came. What is only
    too old is never believed, whether late or by a jump while no picture came: `blind` names it,
    for a person. Who sleeps and then reads a queue of old pictures cannot be told from a clock that
    jumped: give the newest.

    Attributes:
        base_from_camera: The camera's calibration, shape (4, 4), metres.
        keypoints: The hand in the newest picture, base frame, shape (21, 3), metres; None where
            there is none that can be used.
        last: The newest hand that could be used, as `keypoints`; None before the first.
        frame_time: When the newest picture was taken, seconds; NaN before the first.
        problem: What is wrong with the newest picture's hand; empty where nothing is.
        jumped: That the newest picture's hand, doubted before, is elsewhere after all; else empty.
    """

    base_from_camera: Array
    keypoints: Array | None = field(default=None, init=False)
    last: Array | None = field(default=None, init=False)
    frame_time: float = field(default=float("nan"), init=False)
    problem: str = field(default="", init=False)
    jumped: str = field(default="", init=False)

    def __post_init__(self) -> None:
        self._looked = self._started = self._frame_came = self._hand_came = float("nan")
        self._in_camera: Array | None = None
        self._doubted: Array | None = None
        self._told = self._latest = self._odd_since = float("nan")
        self._shift, self._ages, self._lags = 0.0, list[float](), list[float]()
        self._equal, self._path = 1, list[tuple[float, Array]]()

    def look(self, observation: Observation, now: float) -> bool:
        """Take in an observation at a time in seconds; say whether it shows a new picture.

        One from the future, older than `OLDEST_PICTURE` or than the one before is none.
        """
        self._looked = now
        if np.isnan(self._started):
            self._started = now
        taken = self._dated(observation.taken, now)
        if np.isnan(taken):
            return False
        self.frame_time, self._frame_came = taken, now
        self.keypoints, self.jumped, hand = None, "", observation.keypoints
        self.problem = "no hand in the picture" if hand is None else safety.hand_problem(hand)
        if self.problem:
            self._equal = 1
            return True
        in_camera = np.array(hand, dtype=np.float64)
        same = self._in_camera is not None and np.array_equal(in_camera, self._in_camera)
        self._equal = self._equal + 1 if same else 1
        self._in_camera = in_camera
        in_base = transform_points(self.base_from_camera, in_camera)
        if self.last is not None:
            since = taken - self._path[-1][0]
            moved = float(np.linalg.norm(in_base - self.last, axis=1).max())  # by turning, too
            if moved > NEAR_HAND + FASTEST_HAND * since:
                self.problem = f"the hand jumped {100 * moved:.0f} cm within {since:.2f} s"
                self._doubted = in_base
                return True
            doubted = self._doubted if self._doubted is not None else in_base + np.inf
            if np.linalg.norm(in_base - doubted, axis=1).max() < moved:
                self.jumped = f"the hand is elsewhere: it jumped {100 * moved:.0f} cm"
        self._doubted = None
        self.keypoints = self.last = in_base
        self._hand_came = now
        self._path = [p for p in self._path if p[0] > taken - 1.0] + [(taken, in_base)]
        return True

    def _dated(self, told: float, now: float) -> float:
        """When a picture was taken, seconds, by what it tells; NaN: it is not to be looked at."""
        taken = told + self._shift
        lag, fresh = now - taken, now - safety.OLDEST_PICTURE <= taken <= now + 1e-6
        if fresh and not taken <= self.frame_time:
            self._told = self._latest = taken
            self._ages, self._lags = [*self._ages[1 - DATED_BY :], lag], []
            return taken
        if taken == self._told or np.isnan(taken) or not self._ages:
            return float("nan")
        before, self._told = self._told, taken
        if self._latest < taken <= now + 1e-6:  # it may be late
            self._latest, self._lags = taken, []
        elif not self._lags or taken < before or lag < min(self._lags) - SAME_LAG:
            self._odd_since, self._lags = now, [lag]
        else:
            least = min(self._lags)
            self._lags = [*self._lags, lag] if lag <= least + SAME_LAG else [least]
        lasted = now - self._odd_since >= safety.CAMERA_SILENT_AFTER - 1e-9
        if not lasted or len(self._lags) < DATED_BY:
            return float("nan")
        self._shift += min(self._lags) - max(self._ages)
        self._told, self._lags = float("nan"), []
        return self._dated(told, now)

    @property
    def middle(self) -> Array:
        """Mean of the newest hand's keypoints in the base frame, shape (3,), metres."""
        middle: Array = self._path[-1][1].mean(axis=0)
        return middle

    @property
    def age(self) -> float:
        """Of the newest picture when it was last looked, seconds."""
        return self._looked - self.frame_time

    def velocity(self, window: float) -> Array | None:
        """Velocity (3,) of the hand's middle over the last seconds, m/s, base frame.

        It is over two pictures at least. None where they do not reach back over half of the window.
        """
        if not self._path:
            return None
        newest = self._path[-1][0]
        recent = [p for p in self._path if p[0] >= newest - window - 1e-6]
        recent = recent if len(recent) > 1 else self._path[-2:]
        if newest - recent[0][0] < window / 2:
            return None
        times = np.array([p[0] for p in recent])
        return safety.line_velocity(times, np.stack([p[1].mean(axis=0) for p in recent]))

    def soon(self, ahead: float) -> Array | None:
        """The hand (21, 3) in so many seconds, if it moves and turns on; None where not known.

        One that turns in its place carries its forearm around.
        """
        velocity = self.velocity(0.15)
        if velocity is None or self.keypoints is None:
            return None
        newest, middle = self._path[-1][0], self.middle
        first, then = next(p for p in self._path if p[0] >= newest - TURN_WINDOW - 1e-6)
        turn = np.eye(3)
        with suppress(ValueError):  # keypoints in one place or on one line have no turn
            turn = best_similarity(then, self.keypoints).rotation
        angle = cv2.Rodrigues(turn)[0][:, 0] / max(newest - first, 1e-3)
        rate = float(np.linalg.norm(angle))
        part = ahead * max(0.0, rate - TURN_NOISE) / max(rate, TURN_NOISE)
        turned = (self.keypoints - middle) @ cv2.Rodrigues(part * angle)[0].T
        hand: Array = middle + turned + ahead * velocity
        return hand

    def forget(self, problem: str) -> None:
        """Take the newest hand for unknown until there is another picture."""
        self.keypoints, self.problem = None, problem

    def blind(self, now: float) -> str:
        """Say that at a time in seconds nothing comes from the camera, or always the same."""
        silent = now - (self._started if np.isnan(self._frame_came) else self._frame_came)
        if silent >= safety.CAMERA_SILENT_AFTER - 1e-9:
            words = f"the camera stopped: no new picture for {silent:.2f} s"
            if self._lags:
                words += f", its clock jumped by {max(self._ages) - min(self._lags):+.2f} s"
            elif self._latest > self.frame_time:
                words += f", what comes is {now - self._latest:.2f} s old, or its clock is off"
            return words
        if self._equal >= safety.FROZEN_FRAMES:
            return f"keypoints frozen: the same in {self._equal} pictures in a row"
        return ""

    def trouble(self, now: float) -> str:
        """Why the robot may not move on what is seen at a time in seconds, or an empty string."""
        lost = now - (self._started if np.isnan(self._hand_came) else self._hand_came)
        unseen = lost >= safety.HAND_LOST_AFTER - 1e-9
        words = f"no hand seen for {lost:.2f} s: {self.problem}" if unseen else ""
        return self.blind(now) or words

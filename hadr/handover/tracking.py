"""Following the hand: the rigid motion of 21 keypoints, and what it does to a grasp.

The paper's section on the handover workflow: the translation is the wrist's displacement, the
rotation comes from the singular value decomposition of the keypoints' covariance about the wrist.
A finger that moves by itself turns that fit. The robust form, off unless asked for, finds the
keypoints that move as one body and leaves out the others.
"""

from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hadr.camera import Array
from hadr.hand import FINGERS, KEYPOINT_NAMES, check_keypoints

About = Literal["wrist", "origin", "centroid"]
Flip = Literal["v", "r"]

PALM: tuple[int, ...] = (0, *(FINGERS[finger][0] for finger in FINGERS))
"""Wrist and roots of the fingers: the keypoints that no finger can move."""
LEAST_CUT = 0.006
"""Keypoints that miss the fit by less than this are never left out, metres."""
LARGEST_CUT = 0.015
"""Keypoints that miss it by more always are, metres."""
FEWEST = 4
"""Fewer keypoints than this are no group that moves as one body."""
LONGEST_PALM = 2.0
"""A wrist farther than this from the middle finger's knuckle is not written in metres."""


@dataclass(frozen=True)
class HandMotion:
    """A rigid motion of the hand between two moments, both seen in one frame.

    Attributes:
        rotation: Proper rotation R, shape (3, 3).
        initial_wrist: Where the wrist was, X_i0, shape (3,), metres.
        current_wrist: Where it is now, X_c0, shape (3,), metres.
        residual: Root mean square distance in metres between the moved initial keypoints and the
            current ones: what is not rigid (fingers, noise). Outliers do not count.
        about: "wrist" turns about the wrist, X' = R (X - X_i0) + X_c0. "origin" reads the paper's
            figure by the letter, X' = R X + (X_c0 - X_i0), and turns about the frame's origin,
            which throws a grasp off as soon as R is not the identity (ledger row 19). "centroid"
            turns about the keypoints' middle, the least squares of them all: an error of the
            wrist's keypoint does not shift everything; `current_wrist` is then where the fit puts
            the wrist.
        outliers: Names of the keypoints that the robust form left out.
        robust: Whether the robust form was asked for and found a group that moves as one body.
    """

    rotation: Array
    initial_wrist: Array
    current_wrist: Array
    residual: float
    about: About = "wrist"
    outliers: tuple[str, ...] = ()
    robust: bool = False

    @property
    def current_from_initial(self) -> Array:
        """The motion as a transform, shape (4, 4), metres, of points in the keypoints' frame."""
        transform = np.eye(4)
        turns = np.eye(3) if self.about == "origin" else self.rotation
        transform[:3, :3] = self.rotation
        transform[:3, 3] = self.current_wrist - turns @ self.initial_wrist
        return transform

    @property
    def angle(self) -> float:
        """Angle of the rotation in radians, 0 to pi."""
        return float(np.arccos(np.clip((np.trace(self.rotation) - 1) / 2, -1.0, 1.0)))

    def move_points(self, points: Array) -> Array:
        """Move points (..., 3) in metres, given where they were at the initial moment."""
        transform = self.current_from_initial
        moved: Array = np.asarray(points) @ transform[:3, :3].T + transform[:3, 3]
        return moved

    def move_pose(self, pose: Array) -> Array:
        """Move a grasp or any other pose (4, 4) that is fixed to the hand."""
        matrix = np.asarray(pose, dtype=np.float64)
        if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
            raise ValueError(f"pose must be a finite (4, 4) transform, got shape {matrix.shape}")
        return self.current_from_initial @ matrix


def best_rotation(
    initial: Array, current: Array, *, flip: Flip = "v", weights: Array | None = None
) -> Array:
    """The rotation (3, 3) that carries one centred point set onto another, by least squares.

    H = initial^T W current = U S V^T and R = V U^T. If det R < 0 the best orthogonal matrix is a
    mirror; the best rotation has the sign of V's last column flipped first.

    Args:
        initial: Points relative to the pivot, shape (n, 3), metres.
        current: The same points later.
        flip: "r" flips the last column of R instead, the other reading of the paper's sentence:
            a proper rotation too, but a wrong one (ledger, row 20).
        weights: W's diagonal, shape (n,), 0 or more; all 1 if left out.

    Raises:
        ValueError: The points lie on one line or in one place: the rotation is not determined.
    """
    weighted = initial if weights is None else initial * weights[:, None]
    u, s, vt = np.linalg.svd(weighted.T @ current)
    # s holds products of spreads (square metres): s[1] vanishes when either set is a line
    if not s[1] > 1e-9 * s[0]:
        raise ValueError(
            "the rotation is not determined: the points of one set lie on a line through the "
            f"pivot or in one place (singular values of H: {s[0]:.3g}, {s[1]:.3g}, {s[2]:.3g})"
        )
    v = vt.T.copy()
    rotation: Array = v @ u.T
    if np.linalg.det(rotation) < 0:
        if flip == "r":
            rotation[:, 2] *= -1
        else:
            v[:, 2] *= -1
            rotation = v @ u.T
    return rotation


class Similarity(NamedTuple):
    """What carries points x onto scale * rotation @ x + shift."""

    scale: float
    rotation: Array
    shift: Array


def best_similarity(
    initial: Array,
    current: Array,
    *,
    scaled: bool = False,
    weights: Array | None = None,
) -> Similarity:
    """Carry points (n, 3) onto the same ones later, about their centroids, by least squares.

    The scale is 1 unless it shall be fitted too; weights and errors as of `best_rotation`.
    Source: Umeyama, Least-squares estimation of transformation parameters between two point
    patterns, 1991, equations 38 to 43.
    """
    share = np.ones(len(initial)) if weights is None else weights
    share = share / share.sum()
    before, now = initial - share @ initial, current - share @ current
    rotation = best_rotation(before, now, weights=share)
    turned = before @ rotation.T
    scale = 1.0
    if scaled:
        scale = float(share @ (turned * now).sum(axis=1) / (share @ (turned**2).sum(axis=1)))
    return Similarity(scale, rotation, share @ current - scale * rotation @ (share @ initial))


def hand_motion(
    initial: Array, current: Array, *, about: About = "wrist", robust: bool = False
) -> HandMotion:
    """Rigid motion of the hand from its keypoints (21, 3), metres, at two moments, in one frame.

    `robust` looks for the largest group of keypoints that moves as one body; the others are left
    out and named. The fit turns about the group's middle, so that an error of the wrist's keypoint
    does not shift everything; `current_wrist` is then where the fit puts the wrist. Where no four
    keypoints move as one body, as in keypoints of much noise, the plain form is used, and `robust`
    of the answer is False. `about` is as in `HandMotion`. ValueError for keypoints of another
    shape, with NaN or not in metres, or all on one line or in one place.
    """
    before, now = check_keypoints(initial), check_keypoints(current)
    for keypoints in (before, now):
        palm = float(np.linalg.norm(keypoints[9] - keypoints[0]))
        if palm > LONGEST_PALM:
            raise ValueError(
                f"keypoints must be metres: a palm of {palm:.3g} looks like "
                + ("centimetres" if palm < 30 else "millimetres")
            )
    found = _robust_motion(before, now, about) if robust else None
    if found is not None:
        return found
    if about == "centroid":
        fit = best_similarity(before, now)
        rotation, wrist = fit.rotation, fit.rotation @ before[0] + fit.shift
    else:
        rotation, wrist = best_rotation(before - before[0], now - now[0]), now[0]
    misfit = (((before - before[0]) @ rotation.T + wrist - now) ** 2).sum(axis=1)
    return HandMotion(rotation, before[0], wrist, float(np.sqrt(misfit.mean())), about)


def _robust_motion(before: Array, now: Array, about: About) -> HandMotion | None:
    """The better of two fits: one begun from the palm, one from all keypoints; None without any."""
    palm = np.zeros(len(before))
    palm[list(PALM)] = 1.0
    try:
        fits = [_trimmed(before, now, start) for start in (palm, np.ones(len(before)))]
    except ValueError:  # those that were kept lie on one line
        return None
    fit, inlier, miss = min(fits, key=lambda f: float((np.minimum(f[2], LARGEST_CUT) ** 2).sum()))
    if np.count_nonzero(inlier) < FEWEST:
        return None
    residual = float(np.sqrt((miss[inlier] ** 2).mean()))
    outliers = tuple(KEYPOINT_NAMES[i] for i in np.flatnonzero(~inlier))
    wrist = fit.rotation @ before[0] + fit.shift
    return HandMotion(fit.rotation, before[0], wrist, residual, about, outliers, robust=True)


def _trimmed(before: Array, now: Array, used: Array) -> tuple[Similarity, NDArray[np.bool_], Array]:
    """Fit, leave out what misses by three spreads, until nothing changes: fit, kept, misses."""
    for _ in range(12):
        fit = best_similarity(before, now, weights=used)
        miss = np.linalg.norm(before @ fit.rotation.T + fit.shift - now, axis=1)
        spread = 1.4826 * float(np.median(miss[used > 0]))
        inlier: NDArray[np.bool_] = miss <= np.clip(3 * spread, LEAST_CUT, LARGEST_CUT)
        if np.count_nonzero(inlier) < FEWEST or np.array_equal(inlier, used):
            break
        used = inlier.astype(np.float64)
    return fit, inlier, miss


FORGOTTEN_AFTER = 0.5
"""After so long without a hand that could be followed `HandFilter` begins anew, seconds."""
PLACE_GAIN, TURN_GAIN, SHAPE_GAIN = 0.5, 0.25, 0.2
"""Least share of the newest picture in the filtered place, turn and shape."""
FULL_PLACE, FULL_TURN = 0.02, np.deg2rad(40)
"""So far from what was expected, metres and radians, the newest picture is taken as it is."""
FARTHEST_STEP = 0.1
"""A hand this far from where it was expected is not followed but given as it is seen, metres."""


@dataclass
class HandFilter:
    """Steadies keypoints that a network finds anew in each picture, of a hand that moves as a body.

    Place and turn are those of an alpha-beta filter, the shape is a fading mean. What is given lies
    at most `FULL_PLACE` / 4 and `FULL_TURN` / 4 from the picture's own place and turn: so much may
    its noise hide. A hand that jumps is left to `hadr.handover.observation.HandWatch`.

    Source: Benedict and Bordner 1962, "Synthesis of an optimal set of radar track-while-scan
    smoothing equations", for the relation of the two gains.
    """

    _given: Array | None = field(default=None, init=False)
    _steady: Array = field(default_factory=lambda: np.zeros((21, 3)), init=False)
    _time: float = field(default=float("nan"), init=False)
    _seen: int = field(default=0, init=False)
    _place: Array = field(default_factory=lambda: np.zeros(3), init=False)
    _velocity: Array = field(default_factory=lambda: np.zeros(3), init=False)
    _turn: Array = field(default_factory=lambda: np.eye(3), init=False)
    _spin: Array = field(default_factory=lambda: np.zeros(3), init=False)
    _shape: Array = field(default_factory=lambda: np.zeros((21, 3)), init=False)

    def steadied(self, time: float, keypoints: Array) -> Array:
        """Take in a picture's keypoints (21, 3), metres, and the time it was taken at; steady them.

        Times, in seconds, rise from call to call; the keypoints' frame does not move. The same
        keypoints as before get the same answer.
        """
        if self._given is not None and np.array_equal(keypoints, self._given):
            return self._steady  # a camera that hangs must be seen to
        self._steady = self._filtered(time, keypoints)
        self._given = np.array(keypoints)
        return self._steady

    def _filtered(self, time: float, keypoints: Array) -> Array:
        since, middle = time - self._time, keypoints.mean(axis=0)
        if not np.isfinite(middle).all():
            return keypoints
        if not self._seen or not 0 < since <= FORGOTTEN_AFTER:
            return self._begin(time, keypoints)
        place = self._place + since * self._velocity
        turn = Rotation.from_rotvec(since * self._spin).as_matrix() @ self._turn
        missed = middle - place
        if np.linalg.norm(missed) > FARTHEST_STEP:
            return keypoints
        try:
            found = best_rotation(self._shape, keypoints - middle)
        except ValueError:  # no hand: for whoever looks at it
            return keypoints
        turned = Rotation.from_matrix(found @ turn.T).as_rotvec()
        share, slope = _gains(float(np.linalg.norm(missed)), PLACE_GAIN, FULL_PLACE)
        self._place = place + share * missed
        self._velocity = self._velocity + slope / since * missed
        share, slope = _gains(float(np.linalg.norm(turned)), TURN_GAIN, FULL_TURN)
        self._turn = Rotation.from_rotvec(share * turned).as_matrix() @ turn
        self._spin = self._spin + slope / since * turned
        self._seen, self._time = self._seen + 1, time
        own = (keypoints - middle) @ found  # as it would be unturned
        self._shape = self._shape + max(SHAPE_GAIN, 1 / self._seen) * (own - self._shape)
        return self._place + self._shape @ self._turn.T

    def _begin(self, time: float, keypoints: Array) -> Array:
        self._time, self._seen, self._place = time, 1, keypoints.mean(axis=0)
        self._velocity, self._spin, self._turn = np.zeros(3), np.zeros(3), np.eye(3)
        self._shape = keypoints - self._place
        return keypoints


def _gains(missed: float, least: float, full: float) -> tuple[float, float]:
    """Gains of place and of velocity times the step, for what was missed by so much."""
    share = float(np.clip(missed / full, least, 1.0))
    return share, share**2 / (2 - share)

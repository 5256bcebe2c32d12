"""How sure is a restored pixel, and is that true?

HADR-plus predicts a distribution of depth, so it can say how wide its answer is. Such a number
orders pixels, but it is no probability. `fit_confidence` maps it to one with a meaning, on frames
with known depth that the network has not learned from: *the error is below the tolerance, 2 cm
where nothing else is said*. The map only rises, so it changes no order. A network whose score says
nothing about centimetres, such as HADR's probability of a voxel of 25 cm, gets no confidence.

Two questions show what a confidence is worth. *Is it honest?* Of the pixels that say 0.8, 80
percent should be right: `reliability`. *Does it know anything?* Leaving out the least sure pixels
should lower the error of the rest, at best as much as leaving out the worst ones: `sparsification`.
A constant confidence can be perfectly honest and know nothing.

Source: isotonic calibration: Zadrozny and Elkan 2002; expected calibration error: Naeini et al.
2015; sparsification against an oracle: Ilg et al. 2018.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import isotonic_regression
from scipy.special import expit

from hadr.camera import BoolArray, FloatArray
from hadr.records.reading import structured

TOLERANCE_M = 0.02
"""An error below this is what a confidence speaks of, metres."""
DROPPED = tuple(number / 20 for number in range(20))
"""Shares of the pixels that are dropped, least sure first, where nothing else is said."""


@dataclass(frozen=True)
class Calibration:
    """A rising map from a network's score to the probability that the error is small.

    Args:
        scores: Scores at the knots, rising, each 0..1.
        probabilities: Probability at each knot, not falling, each 0..1.
        tolerance_m: The error is small below this, metres.
        pixels: Number of pixels it was fitted on.
        frames: Number of frames these come from.

    Raises:
        ValueError: The knots do not rise, lie outside 0..1, or differ in number; the tolerance is
            not positive.
    """

    scores: tuple[float, ...]
    probabilities: tuple[float, ...]
    tolerance_m: float = TOLERANCE_M
    pixels: int = 0
    frames: int = 0

    def __post_init__(self) -> None:
        x, y = np.asarray(self.scores, float), np.asarray(self.probabilities, float)
        if x.ndim != 1 or x.shape != y.shape or not x.size:
            raise ValueError(
                f"a calibration needs as many probabilities as scores, got {y.size} and {x.size}"
            )
        if not (np.isfinite(x).all() and np.isfinite(y).all()) or (np.diff(x) <= 0).any():
            raise ValueError(f"scores must rise, got {self.scores}")
        if (np.diff(y) < 0).any() or min(*x, *y) < 0 or max(*x, *y) > 1:
            raise ValueError(
                f"probabilities must not fall and all must lie in 0..1, got {self.probabilities}"
            )
        if not self.tolerance_m > 0:
            raise ValueError(f"tolerance_m must be positive metres, got {self.tolerance_m}")

    def __call__(self, score: FloatArray) -> npt.NDArray[np.float32]:
        """Map scores, any shape, to probabilities; linear between the knots, constant beyond."""
        return np.interp(score, self.scores, self.probabilities).astype(np.float32)


def fit_calibration(
    score: FloatArray, error_m: FloatArray, *, bins: int = 20, frames: int = 0
) -> Calibration:
    """Fit the map from score, 0..1, to the share of pixels whose error is below `TOLERANCE_M`.

    The N pixels, from so many `frames`, are sorted by score and cut into `bins` of equal number;
    the bins' shares of small errors are made to rise by pooling neighbours (isotonic regression),
    and each pool becomes one knot at its mean score. Pooling needs no shape to be assumed, and few
    knots do not follow the chance of single frames.
    """
    s, e = np.asarray(score, float), np.abs(np.asarray(error_m, float))
    order = np.argsort(s, kind="stable")
    s, right = s[order], (e[order] < TOLERANCE_M).astype(float)
    # Equal scores stay in one bin: a bin begins where its first score begins.
    edges = np.searchsorted(s, s[(np.arange(bins) * s.size) // bins])
    starts = np.unique(edges)
    count = np.diff(np.append(starts, s.size)).astype(float)
    level = np.add.reduceat(s, starts) / count
    share = np.add.reduceat(right, starts) / count
    fitted = isotonic_regression(share, weights=count)
    first = fitted.blocks[:-1]
    weight = np.add.reduceat(count, first)
    knots = np.add.reduceat(level * count, first) / weight
    return Calibration(
        scores=tuple(float(x) for x in knots),
        probabilities=tuple(float(x) for x in np.clip(fitted.x[first], 0, 1)),
        pixels=s.size,
        frames=frames,
    )


FLOOR_M = 0.001
"""Added to a spread before the logarithm: differences below a millimetre mean nothing."""


@dataclass(frozen=True)
class ConfidenceRule:
    """How the spread that a network predicts becomes the probability that a pixel is right.

    Args:
        center: Mean of the signal (`signal_of`) over the calibration pixels.
        scale: Its standard deviation, positive.
        calibration: From the score, the logistic function of the standardised signal, to the
            probability.
    """

    center: float
    scale: float
    calibration: Calibration

    def __post_init__(self) -> None:
        if not self.scale > 0:
            raise ValueError(f"the scale of a confidence must be positive, got {self.scale}")

    def score(self, signal: FloatArray) -> npt.NDArray[np.float64]:
        """Standardise the signal, any shape, and bring it to 0..1."""
        return np.asarray(expit((np.asarray(signal, np.float64) - self.center) / self.scale))

    def __call__(self, signal: FloatArray) -> npt.NDArray[np.float32]:
        """Give the probability that each pixel is right, from its signal, any shape."""
        return self.calibration(self.score(signal))

    def ordering(self, signal: FloatArray) -> npt.NDArray[np.float64]:
        """Order pixels by their probability, equal ones by their score; larger = surer."""
        return self(signal).astype(np.float64) + 1e-6 * self.score(signal)

    def to_dict(self) -> dict[str, Any]:
        """The rule as built-in types, as checkpoints' records store it."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> ConfidenceRule:
        """Build the rule from a record; ValueError where it is none, further keys are left."""
        return structured(values, cls, "confidence", further=True)


def signal_of(output: Any) -> Any:
    """Minus the logarithm of HADR-plus's (spread + 1 mm) (torch), 0 where not restored: (B, H, W).

    Larger = surer.
    """
    return -(output.spread.clamp(min=0) + FLOOR_M).log() * output.restored


def fit_confidence(signal: FloatArray, error_m: FloatArray, *, frames: int = 0) -> ConfidenceRule:
    """Fit the rule of a network that predicts a distribution, on pixels of so many frames.

    From the signal (`signal_of`) and the error in metres of each restored pixel, (N,); ValueError
    where there is none, the shapes differ, or a value is not finite.
    """
    values, errors = np.asarray(signal, np.float64), np.asarray(error_m, np.float64)
    if not values.size or values.shape != errors.shape:
        raise ValueError(
            f"a confidence needs a signal and an error a pixel, got {values.size} and {errors.size}"
        )
    if not (np.isfinite(values).all() and np.isfinite(errors).all()):
        raise ValueError("a confidence needs finite signals and errors")
    center, scale = float(values.mean()), max(float(values.std()), 1e-9)
    score = expit((values - center) / scale)
    return ConfidenceRule(center, scale, fit_calibration(score, error_m, frames=frames))


@dataclass(frozen=True)
class Reliability:
    """What a confidence says and what is true, bin by bin.

    Attributes:
        said: Mean confidence in each bin, shape (10,); NaN in an empty one.
        true: Share of the pixels that are right, shape (10,); NaN in an empty one.
        count: Pixels in each bin, shape (10,).
    """

    said: npt.NDArray[np.float64]
    true: npt.NDArray[np.float64]
    count: npt.NDArray[np.int64]

    @property
    def expected_error(self) -> float:
        """Expected calibration error: mean of |said - true|, each bin weighing as its pixels."""
        filled = self.count > 0
        gap = np.abs(self.said[filled] - self.true[filled])
        return float((gap * self.count[filled]).sum() / self.count.sum())


def reliability(confidence: FloatArray, right: BoolArray) -> Reliability:
    """Compare a confidence, 0..1, shape (N,), with whether it is `right`, shape (N,) bool.

    There are ten equally wide bins; the last one holds 1.

    Raises:
        ValueError: There is no pixel, the shapes differ, or a confidence lies outside 0..1.
    """
    c, r = np.asarray(confidence, float).ravel(), np.asarray(right, bool).ravel()
    if c.size == 0 or c.shape != r.shape:
        raise ValueError(f"need a confidence and an answer each, got {c.size} and {r.size}")
    if not ((c >= 0) & (c <= 1)).all():
        raise ValueError(f"confidence must lie in 0..1, got {c.min():g} to {c.max():g}")
    place = np.minimum((c * 10).astype(np.int64), 9)
    count = np.bincount(place, minlength=10)
    with np.errstate(invalid="ignore"):
        said = np.bincount(place, weights=c, minlength=10) / count
        true = np.bincount(place, weights=r, minlength=10) / count
    return Reliability(said, true, count)


@dataclass(frozen=True)
class Sparsification:
    """The error of what is kept when the least sure pixels are dropped.

    Attributes:
        dropped: Share of the pixels that is dropped, shape (K,).
        rmse_m: RMSE of the kept pixels in metres, shape (K,).
        oracle_rmse_m: The same when the pixels with the largest errors are dropped: the best that
            any confidence can do.
        random_rmse_m: The same when chance decides (its expectation): the RMSE of all.
    """

    dropped: npt.NDArray[np.float64]
    rmse_m: npt.NDArray[np.float64]
    oracle_rmse_m: npt.NDArray[np.float64]
    random_rmse_m: float


def sparsification(
    confidence: FloatArray, error_m: FloatArray, dropped: Sequence[float] = DROPPED
) -> Sparsification:
    """Drop the least sure pixels step by step.

    Pixels of equal confidence count with their mean squared error, as if chance chose among them;
    so the result depends on no order of the pixels.

    Args:
        confidence: Shape (N,); only its order counts.
        error_m: Error of each pixel in metres, shape (N,).
        dropped: Shares to drop, each in [0, 1).

    Raises:
        ValueError: There is no pixel, the shapes differ, or a share is out of its range.
    """
    c, e = np.asarray(confidence, float).ravel(), np.asarray(error_m, float).ravel()
    if c.size == 0 or c.shape != e.shape:
        raise ValueError(f"need a confidence and an error each, got {c.size} and {e.size}")
    shares = np.asarray(dropped, float)
    if not ((shares >= 0) & (shares < 1)).all():
        raise ValueError(f"dropped must lie in [0, 1), got {shares.tolist()}")
    kept = np.maximum(np.rint((1 - shares) * c.size).astype(int), 1)
    squared = e**2
    values, place = np.unique(-c, return_inverse=True)  # the surest first
    size = np.bincount(place, minlength=len(values))
    mean = np.bincount(place, weights=squared, minlength=len(values)) / size

    def rmse(sorted_squared: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return np.asarray(np.sqrt(np.cumsum(sorted_squared)[kept - 1] / kept))

    return Sparsification(
        dropped=shares,
        rmse_m=rmse(np.repeat(mean, size)),
        oracle_rmse_m=rmse(np.sort(squared)),
        random_rmse_m=float(np.sqrt(squared.mean())),
    )


def learned_range(true_depth: FloatArray) -> tuple[float, float]:
    """The nearest and farthest known depth (N,) of objects in training, and 2 cm more, metres."""
    known = true_depth[np.isfinite(true_depth) & (true_depth > 0)]
    if not known.size:
        raise ValueError("no depth of any object: the learned range is unknown")
    return max(float(known.min()) - TOLERANCE_M, 0.0), float(known.max()) + TOLERANCE_M


def within_learned(output: Any, depth_range_m: tuple[float, float] | None) -> Any:
    """Mark restored pixels whose answer the network can have learned (torch): (B, H, W), bool.

    Not learned are depths outside of the range that training has shown, metres (None: unknown), and
    answers of HADR that its clamp has cut off: the network wanted an answer outside of the voxel
    that it chose. How many there are `results/confidence` says (`coverage`).
    """
    good = output.restored & (output.depth > 0)
    if depth_range_m is not None:
        good = good & (output.depth >= depth_range_m[0]) & (output.depth <= depth_range_m[1])
    return good & ~output.clamped if hasattr(output, "clamped") else good

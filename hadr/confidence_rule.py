"""From what a network says about its own answer to a probability that it is right.

With each restored pixel a network gives some signals of how sure it may be (`hadr.models.signals`).
None of them is a probability that a user could check. `fit_confidence` makes one of them, on frames
with known depth that the network has not learned from:

1. a logistic regression from the signals to "right to 2 cm", whose weights may not be negative, so
   that a pixel never becomes less sure because a signal says that it is surer;
2. the rising map of `hadr.confidence.fit_calibration` from its score to the share of right pixels.

Which signals enter is decided by cross-validation over frames: each alone, or all. What comes out
are a few dozen numbers, which a checkpoint's record holds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit

from hadr.camera import BoolArray, FloatArray
from hadr.confidence import (
    DROPPED,
    TOLERANCE_M,
    Calibration,
    fit_calibration,
    sparsification,
)

Numbers = NDArray[np.float64]

PENALTY = 1e-3
"""Weight of the squared weights in the logistic regression, on standardised signals."""


@dataclass(frozen=True)
class ConfidenceRule:
    """How a network's signals become the probability that a restored pixel is right.

    Args:
        signals: Names of the signals that enter.
        center: Mean of each signal over the calibration pixels.
        scale: Its standard deviation.
        weights: Weight of each standardised signal, not negative.
        calibration: From the score, which is the logistic function of the weighted sum, to the
            probability.

    Raises:
        ValueError: There is no signal, lengths differ, a weight is negative or a scale is not
            positive.
    """

    signals: tuple[str, ...]
    center: tuple[float, ...]
    scale: tuple[float, ...]
    weights: tuple[float, ...]
    calibration: Calibration

    def __post_init__(self) -> None:
        lengths = [len(self.center), len(self.scale), len(self.weights)]
        if not self.signals or set(lengths) != {len(self.signals)}:
            raise ValueError(
                f"each of the signals {self.signals} needs a centre, a scale and a weight, got "
                f"{lengths[0]}, {lengths[1]} and {lengths[2]}"
            )
        if min(self.weights) < 0 or min(self.scale) <= 0:
            raise ValueError(
                f"weights must not be negative and scales positive, got {self.weights} and "
                f"{self.scale}"
            )

    def score(self, signals: Mapping[str, FloatArray]) -> Numbers:
        """Join the signals to one score.

        Args:
            signals: Signals by name, arrays of one shape; larger = surer.

        Returns:
            Scores 0..1, of the same shape.

        Raises:
            ValueError: A signal is missing.
        """
        missing = [name for name in self.signals if name not in signals]
        if missing:
            raise ValueError(
                f"the confidence needs the signal {missing[0]!r}, the network gives "
                f"{', '.join(sorted(signals))}"
            )
        parts = zip(self.signals, self.center, self.scale, self.weights, strict=True)
        total = np.zeros(np.shape(signals[self.signals[0]]))
        for name, center, scale, weight in parts:
            total += weight * (np.asarray(signals[name], dtype=np.float64) - center) / scale
        return np.asarray(expit(total))

    def __call__(self, signals: Mapping[str, FloatArray]) -> NDArray[np.float32]:
        """Give the probability that each pixel is right; arguments as `score`."""
        return self.calibration(self.score(signals))

    def to_dict(self) -> dict[str, Any]:
        """The rule as built-in types, for JSON."""
        return {
            "signals": list(self.signals),
            "center": list(self.center),
            "scale": list(self.scale),
            "weights": list(self.weights),
            "calibration": self.calibration.to_dict(),
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> ConfidenceRule:
        """Build the rule from `to_dict` or from the same read from JSON; further keys are left."""
        return cls(
            signals=tuple(str(name) for name in values["signals"]),
            center=tuple(float(x) for x in values["center"]),
            scale=tuple(float(x) for x in values["scale"]),
            weights=tuple(float(x) for x in values["weights"]),
            calibration=Calibration.from_dict(values["calibration"]),
        )


@dataclass(frozen=True)
class Option:
    """One choice of signals, measured on frames left out of its fit, fold by fold.

    Attributes:
        signals: Names of the signals.
        mean_rmse_m: Mean over all shares dropped of the RMSE of the rest, metres.
        rmse_at_90_m: RMSE of the surest 90 %, metres.
        log_loss: Mean negative log-likelihood of "right", nats a pixel.
    """

    signals: tuple[str, ...]
    mean_rmse_m: float
    rmse_at_90_m: float
    log_loss: float


def fit_confidence(
    signals: Mapping[str, FloatArray],
    error_m: FloatArray,
    frame: NDArray[np.integer],
    *,
    tolerance_m: float = TOLERANCE_M,
    folds: int = 6,
    bins: int = 20,
) -> tuple[ConfidenceRule, tuple[Option, ...]]:
    """Fit the rule, choosing the signals by cross-validation.

    The choice with the smallest log loss wins: a confidence is a probability, and that is the
    proper score of one.

    Args:
        signals: Signals of each restored pixel by name, each (N,); larger = surer.
        error_m: Restored minus true depth in metres, shape (N,).
        frame: Frame of each pixel, shape (N,); folds are runs of neighbouring frames, so that two
            frames of one hold are seldom on both sides.
        tolerance_m: What "right" means, metres.
        folds: Number of parts in cross-validation; fewer where there are fewer frames.
        bins: Most knots of the calibration.

    Returns:
        The rule, and what each choice of signals reached, the best first.

    Raises:
        ValueError: No signals or pixels, shapes differ, or fewer than two frames.
    """
    values = _columns(signals, error_m, frame)
    error = np.asarray(error_m, dtype=np.float64)
    right = np.abs(error) < tolerance_m
    names = tuple(signals)
    part = _folds(frame, folds)

    def fit(chosen: Sequence[str], rows: BoolArray) -> ConfidenceRule:
        columns = values[:, [names.index(name) for name in chosen]][rows]
        center, spread = columns.mean(axis=0), columns.std(axis=0)
        scale = np.where(spread > 1e-9, spread, 1.0)
        standard = (columns - center) / scale
        weights = np.ones(1)  # of a single signal only the order counts
        if len(chosen) > 1:
            weights = _logistic_weights(standard, right[rows])
        score = expit(standard @ weights)
        found = fit_calibration(
            score,
            error[rows],
            tolerance_m=tolerance_m,
            bins=bins,
            frames=len(np.unique(frame[rows])),
        )
        return ConfidenceRule(
            signals=tuple(chosen),
            center=tuple(map(float, center)),
            scale=tuple(map(float, scale)),
            weights=tuple(map(float, weights)),
            calibration=found,
        )

    def measure(chosen: tuple[str, ...]) -> Option:
        probability = np.zeros(len(error))
        squares, at_90 = np.zeros(len(DROPPED)), 0.0
        for number in range(part.max() + 1):
            held = part == number
            rule = fit(chosen, ~held)
            given = {name: values[held, names.index(name)] for name in chosen}
            probability[held] = rule(given)
            # Ranked within the fold: each fold's rule has another scale.
            curve = sparsification(ordering(probability[held], rule.score(given)), error[held])
            squares += held.sum() * curve.rmse_m**2
            at_90 += held.sum() * float(curve.rmse_m[np.isclose(curve.dropped, 0.1)][0]) ** 2
        sure = np.clip(probability, 1e-3, 1 - 1e-3)
        return Option(
            signals=chosen,
            mean_rmse_m=float(np.sqrt(squares / len(error)).mean()),
            rmse_at_90_m=float(np.sqrt(at_90 / len(error))),
            log_loss=float(-np.mean(np.where(right, np.log(sure), np.log(1 - sure)))),
        )

    choices = [(name,) for name in names] + ([names] if len(names) > 1 else [])
    options = sorted(map(measure, choices), key=lambda option: option.log_loss)
    return fit(options[0].signals, np.ones(len(error), bool)), tuple(options)


def ordering(probability: FloatArray, score: FloatArray) -> Numbers:
    """Order pixels by their probability, and equal ones by the score it was made from.

    Args:
        probability: Shape (N,), 0..1; has steps.
        score: Shape (N,), 0..1.

    Returns:
        Shape (N,); larger = surer.
    """
    return np.asarray(probability, dtype=np.float64) + 1e-6 * np.asarray(score, dtype=np.float64)


def _logistic_weights(standard: Numbers, right: BoolArray) -> Numbers:
    """Weights of a penalised logistic regression, none negative, shape (K,)."""
    target = right.astype(np.float64)

    def loss(weights: Numbers) -> tuple[float, Numbers]:
        logit = weights[0] + standard @ weights[1:]
        residual = expit(logit) - target
        value = np.mean(np.logaddexp(0, logit) - target * logit)
        value += PENALTY * (weights[1:] ** 2).sum()
        slope = standard.T @ residual / len(target) + 2 * PENALTY * weights[1:]
        return float(value), np.concatenate(([residual.mean()], slope))

    bounds = [(None, None)] + [(0, None)] * standard.shape[1]
    start = np.zeros(standard.shape[1] + 1)
    return np.asarray(minimize(loss, start, jac=True, bounds=bounds).x[1:], dtype=np.float64)


def _columns(
    signals: Mapping[str, FloatArray], error_m: FloatArray, frame: NDArray[np.integer]
) -> Numbers:
    if not signals:
        raise ValueError("no signals to make a confidence of")
    shapes = {name: np.shape(values) for name, values in signals.items()}
    shapes |= {"error_m": np.shape(error_m), "frame": np.shape(frame)}
    if len(set(shapes.values())) != 1 or np.ndim(error_m) != 1 or np.size(error_m) == 0:
        raise ValueError(f"signals, errors and frames must all be (N,), N > 0, got {shapes}")
    if len(np.unique(frame)) < 2:
        raise ValueError("choosing signals needs pixels of at least 2 frames, got 1")
    values = np.stack([np.asarray(v, dtype=np.float64) for v in signals.values()], axis=1)
    if not np.isfinite(values).all():
        odd = int((~np.isfinite(values)).sum())
        raise ValueError(f"{odd} values of the signals are not finite")
    return values


def _folds(frame: NDArray[np.integer], folds: int) -> NDArray[np.int64]:
    """Give each pixel its fold: runs of neighbouring frames, as equal as can be."""
    frames, place = np.unique(frame, return_inverse=True)
    count = min(folds, len(frames))
    return np.asarray(place * count // len(frames), dtype=np.int64)

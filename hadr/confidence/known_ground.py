"""Does a frame look like those that a network has learned from?

A calibrated confidence speaks for frames like those it was fitted on, and for no others. So a
checkpoint keeps its *ground*: the range of each feature (`hadr.confidence.frame_features`) in
training, how they belong together, and what the network itself usually sees
(`hadr.confidence.sight`). A frame far beyond a range, or farther from the training's mean than
nearly all validation frames, lies outside, and gets no probability.

A network that learned from perfect depth is asked about a camera's. Its ground then has two
*fields*, one of each kind of depth, each with a calibration of its own.

Source: Mahalanobis distance in features as a sign of strange inputs: Lee et al. 2018; shrunk
covariance: Ledoit and Wolf 2004.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hadr.camera import Array, FloatArray
from hadr.confidence.calibration import ConfidenceRule
from hadr.confidence.frame_features import FEATURES, Features
from hadr.confidence.sight import Observation, Sight, rounded
from hadr.records.reading import structured

KEPT = 0.99
"""Share of the validation frames that are to lie inside."""
ENDS = 0.01
"""Share of the training frames that lies beyond either end of a range."""
BEYOND = 1.5
"""A feature may lie so many half ranges from the middle of its range."""


@dataclass(frozen=True)
class Verdict:
    """Whether a frame lies on a network's ground.

    Attributes:
        inside: Whether it does; None where the ground is not known.
        score: How far out it lies: up to 1 is inside; NaN where the ground is not known.
        why: What lies outside, in words; empty inside.
        field: The field that it was compared with, the nearest one; "" where there is none.
        features: What was measured, lengths in metres.
    """

    inside: bool | None
    score: float = np.nan
    why: tuple[str, ...] = ()
    field: str = ""
    features: Features = dataclasses.field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """The verdict as built-in types, for a report."""
        return {
            "inside": self.inside,
            "score": round(self.score, 4) if np.isfinite(self.score) else None,
            "compared_with": self.field or None,
            "why": list(self.why),
            "features": {name: float(f"{value:.4g}") for name, value in self.features.items()},
        }


@dataclass(frozen=True)
class Field:
    """The ground of one kind of depth, in D features.

    Attributes:
        names: The features.
        low: Lower end of each one's range in training, metres or shares, shape (D,).
        high: Upper end of each one's range in training, shape (D,).
        mean: Means on the features' scales, shape (D,).
        spread: Standard deviations on the features' scales, shape (D,).
        correlation: Shrunk covariance of the standardised features, shape (D, D).
        limit: Distances from the mean up to this are inside.
        rule: What the network's confidence means here; None: what its record says.
    """

    names: tuple[str, ...]
    low: Array
    high: Array
    mean: Array
    spread: Array
    correlation: Array
    limit: float
    rule: ConfidenceRule | None = None

    @classmethod
    def fit(
        cls,
        training: Sequence[Features],
        validation: Sequence[Features],
        rule: ConfidenceRule | None = None,
    ) -> Field:
        """Fit ranges and density on training frames, and the limit on validation frames.

        The rule says what the network's confidence means on such frames. ValueError where there is
        no frame of one of them.
        """
        if not training or not validation:
            raise ValueError(
                "a ground needs training and validation frames, got "
                f"{len(training)} and {len(validation)}"
            )
        names = tuple(n for n in FEATURES if any(n in one for one in training))
        values = _on_scale(training, names)
        mean, spread = np.nanmean(values, axis=0), np.nanstd(values, axis=0)
        slack = np.array([FEATURES[name].slack for name in names])
        spread = np.maximum(spread, slack)
        standard = np.nan_to_num((values - mean) / spread)
        correlation = shrunk_covariance(standard)
        # What hardly varied in training may differ by its slack.
        np.fill_diagonal(correlation, np.maximum(correlation.diagonal(), 1))
        plain = np.array([[one.get(n, np.nan) for n in names] for one in training])
        low, high = np.nanquantile(plain, (ENDS, 1 - ENDS), axis=0)
        whole = cls(names, low, high, mean, spread, correlation, 1.0, rule)
        distances = [whole.distance(one) for one in validation]
        finite = [one for one in distances if np.isfinite(one)] or [1.0]
        return dataclasses.replace(whole, limit=max(float(np.quantile(finite, KEPT)), 1.0))

    def distance(self, features: Features) -> float:
        """Mahalanobis distance from the mean, a feature in the mean; missing ones don't count."""
        (off,) = (_on_scale([features], self.names) - self.mean) / self.spread
        known = np.isfinite(off)
        if not known.any():
            return np.inf
        # The pseudoinverse: of few training frames, and rounded, the matrix may have no inverse.
        inverse = np.linalg.pinv(self.correlation[np.ix_(known, known)], hermitian=True)
        return float(np.sqrt(max(off[known] @ inverse @ off[known], 0) / known.sum()))

    def beyond(self, features: Features) -> dict[str, float]:
        """Tell how far each known feature lies from the middle of its range; 1 is its end."""
        found = {}
        for name, *ends in zip(self.names, self.low, self.high, strict=True):
            if name in features:
                one = FEATURES[name]
                low, high, here = one.scale(np.array([*ends, features[name]]))
                half = max((high - low) / 2, one.slack)
                found[name] = float(abs(here - (high + low) / 2) / half)
        return found

    def score(self, features: Features) -> float:
        """How far out a frame lies; up to 1 is inside."""
        farthest = max(self.beyond(features).values(), default=np.inf)
        return max(self.distance(features) / self.limit, farthest / BEYOND)

    def why(self, features: Features) -> tuple[str, ...]:
        """Say what is unlike the training: what lies out of its range, the farthest first."""
        beyond = self.beyond(features)
        order = sorted(beyond, key=lambda name: -beyond[name])
        out = [name for name in order if beyond[name] > BEYOND]
        if out:
            return tuple(self._said(name, features[name]) for name in out[:3])
        (off,) = (_on_scale([features], self.names) - self.mean) / self.spread
        name = self.names[int(np.nanargmax(np.abs(off)))]
        said = self._said(name, features[name])
        return (f"no such combination of measurements was learned (above all: {said})",)

    def _said(self, name: str, value: float) -> str:
        place = self.names.index(name)
        return FEATURES[name].said(value, self.low[place], self.high[place])

    def to_dict(self) -> dict[str, Any]:
        """The field as built-in types, rounded, for a checkpoint's record."""
        below = np.tril_indices(len(self.names))
        return {
            "features": list(self.names),
            **{name: rounded(getattr(self, name)) for name in _ARRAYS},
            "correlation": rounded(self.correlation[below]),
            "limit": float(f"{self.limit:.5g}"),
            "confidence": None if self.rule is None else self.rule.to_dict(),
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Field:
        """Build it from `to_dict`, also through JSON; ValueError for unknown features or fields."""
        stored = structured(values, _StoredField, "field", further=True)
        names = tuple(stored.features)
        if unknown := sorted(set(names) - set(FEATURES)):
            raise ValueError(f"a ground has the features {', '.join(FEATURES)}, got {unknown}")
        square = np.zeros((len(names), len(names)))
        square[np.tril_indices(len(names))] = stored.correlation
        low, high, mean, spread = (np.asarray(getattr(stored, name)) for name in _ARRAYS)
        return cls(
            names,
            low,
            high,
            mean,
            spread,
            correlation=square + np.tril(square, -1).T,
            limit=stored.limit,
            rule=None if stored.confidence is None else ConfidenceRule.from_dict(stored.confidence),
        )


_ARRAYS = ("low", "high", "mean", "spread")


@dataclass(frozen=True)
class Ground:
    """All that a network knows of the frames that it learned from.

    Attributes:
        fields: Ground by kind of depth, such as "learned" and "measured".
        sight: What the network usually sees.
    """

    fields: Mapping[str, Field]
    sight: Sight

    def judge(self, one: Observation) -> Verdict:
        """Compare a frame with the ground."""
        found = self.sight.with_strangeness(one)
        scores = {name: field.score(found) for name, field in self.fields.items()}
        name = min(scores, key=lambda name: scores[name])
        inside = scores[name] <= 1
        why = () if inside else self.fields[name].why(found)
        return Verdict(inside, scores[name], why, name, found)

    def to_dict(self) -> dict[str, Any]:
        """The ground as built-in types, for a checkpoint's record."""
        fields = {name: field.to_dict() for name, field in self.fields.items()}
        return {"fields": fields, "sight": self.sight.to_dict()}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Ground:
        """Build it from `to_dict`, or from the same read from JSON; further keys are left."""
        structured(values, _StoredGround, "ground", further=True)
        fields = {name: Field.from_dict(field) for name, field in values["fields"].items()}
        return cls(fields, Sight.from_dict(values["sight"]))


@dataclass(frozen=True)
class _StoredField:
    """A field as records store it."""

    features: list[str]
    low: list[float]
    high: list[float]
    mean: list[float]
    spread: list[float]
    correlation: list[float]
    limit: float
    confidence: dict[str, Any] | None

    def __post_init__(self) -> None:
        count = len(self.features)
        held = {len(getattr(self, name)) for name in _ARRAYS}
        if held != {count} or len(self.correlation) != count * (count + 1) // 2:
            raise ValueError(f"{', '.join(_ARRAYS)} and correlation must be of {count} features")


@dataclass(frozen=True)
class _StoredGround:
    """A ground as records store it."""

    fields: dict[str, dict[str, Any]]
    sight: dict[str, Any]


def shrunk_covariance(values: FloatArray) -> Array:
    """Covariance of centred values, shape (N, D), shrunk toward a sphere (Ledoit and Wolf 2004)."""
    count, size = values.shape
    plain = values.T @ values / count
    sphere = np.trace(plain) / size * np.eye(size)
    away = ((plain - sphere) ** 2).sum()
    noise = ((((values**2).sum(axis=1)) ** 2).mean() - (plain**2).sum()) / count
    share = min(noise / away, 1.0) if away > 0 else 1.0
    return np.asarray((1 - share) * plain + share * sphere)


def _on_scale(frames: Sequence[Features], names: Sequence[str]) -> Array:
    """Features of frames on their scales, shape (frames, features); NaN where missing."""
    columns = [FEATURES[n].scale(np.array([one.get(n, np.nan) for one in frames])) for n in names]
    return np.stack(columns, axis=1)

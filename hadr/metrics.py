"""Depth metrics: RMSE, REL, MAE and the delta thresholds, and how they are averaged.

`predicted` and `truth` are z-depth in metres, shape (H, W), 0 or NaN where missing; `mask`, (H, W)
bool, marks the pixels that count. A pixel can be scored where the mask is set and the true depth is
valid. Where the prediction is missing there, `missing` decides:

* ``exclude``: the pixel is left out, and ``coverage`` tells how many remain. A method that
  answers only where it is easy looks good under this policy, so read it beside the coverage.
* ``zero``: the hole is scored as the depth 0 that stands in the image; it fails every delta.
* ``error``: a missing prediction is a mistake and raises.

A number says how it was averaged: over the pixels of one frame, as the mean of the frames'
numbers (as the published evaluation does), or over the pixels of all frames pooled. The three
differ, and no table here mixes them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from hadr.camera import BoolArray, FloatArray, valid_depth

if TYPE_CHECKING:
    import pandas as pd

Missing = Literal["exclude", "zero", "error"]
Averaging = Literal["frame", "per-frame mean", "pooled"]
Values = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Metric:
    """A row of the table: what is averaged over pixels, and how the result is shown.

    Attributes:
        heading: What stands above a column, with the unit that is shown.
        factor: From the stored number to the shown one.
        of_pixel: From predicted and true depth in metres, shape (N,), to what is averaged, (N,).
        finish: From the average to the number.
        larger_is_better: Which of two numbers is the better one.
    """

    heading: str
    factor: float
    of_pixel: Callable[[Values, Values], npt.NDArray[Any]]
    finish: Callable[[float], float] = float
    larger_is_better: bool = False

    def text(self, value: float | None, digits: int = 2, sign: str = "") -> str:
        """Write a stored number as a table shows it; a dash where there is none."""
        if value is None or math.isnan(value):
            return "–"
        return f"{self.factor * value:{sign}.{digits}f}"


def _delta(threshold: float) -> Metric:
    """Percent of the pixels with max(p / t, t / p) below the threshold."""

    def of_pixel(p: Values, t: Values) -> npt.NDArray[Any]:
        ratio = np.full(p.shape, np.inf)  # a hole or a negative depth is within no threshold
        front = p > 0
        ratio[front] = np.maximum(p[front] / t[front], t[front] / p[front])
        return np.where(ratio < threshold, 100.0, 0.0)

    return Metric(f"δ{threshold:.2f} (%)", 1, of_pixel, larger_is_better=True)


METRICS: dict[str, Metric] = {
    "rmse_m": Metric("RMSE (cm)", 100, lambda p, t: (p - t) ** 2, math.sqrt),
    "rel": Metric("REL (%)", 100, lambda p, t: np.abs(p - t) / t),
    "mae_m": Metric("MAE (cm)", 100, lambda p, t: np.abs(p - t)),
    "delta_105": _delta(1.05),
    "delta_110": _delta(1.10),
    "delta_125": _delta(1.25),
}
"""The metrics by their field in `DepthMetrics`, which is also their key in result files. A new one
needs a row here and a field there; evaluations, tables and reports take it from here."""


@dataclass(frozen=True)
class DepthMetrics:
    """The quality of restored depth, of one frame or of several.

    Args:
        rmse_m: Root of the mean squared error, metres.
        rel: Mean of the absolute error divided by the true depth.
        mae_m: Mean absolute error, metres.
        delta_105: Percent of the scored pixels with max(p / t, t / p) < 1.05.
        delta_110: The same for 1.10.
        delta_125: The same for 1.25.
        pixels: Number of scored pixels; where it is 0, the numbers above are NaN.
        coverage: Share, 0 to 1, of the pixels that could be scored (mask set, truth valid) for
            which a depth was predicted, whatever the policy.
        frames: Number of frames with scored pixels.
        averaging: How the numbers were averaged.
    """

    rmse_m: float
    rel: float
    mae_m: float
    delta_105: float
    delta_110: float
    delta_125: float
    pixels: int
    coverage: float
    frames: int = 1
    averaging: Averaging = "frame"

    def to_dict(self) -> dict[str, float | int | str | None]:
        """The fields by name, for JSON; NaN becomes None."""
        return {
            key: None if isinstance(value, float) and math.isnan(value) else value
            for key, value in asdict(self).items()
        }


@dataclass(frozen=True)
class _Sums:
    """Sums over pixels from which every metric follows; they add up over frames."""

    scorable: int
    predicted: int
    pixels: int
    totals: dict[str, float]

    def metrics(self, frames: int, averaging: Averaging) -> DepthMetrics:
        share = 1.0 / self.pixels if self.pixels else math.nan
        return DepthMetrics(
            **{name: METRICS[name].finish(total * share) for name, total in self.totals.items()},
            pixels=self.pixels,
            coverage=self.predicted / self.scorable,
            frames=frames,
            averaging=averaging,
        )


def _scored(
    predicted: FloatArray, truth: FloatArray, mask: BoolArray, missing: Missing
) -> tuple[BoolArray, BoolArray, BoolArray]:
    """Where a pixel could be scored, where it was predicted too, and where it is scored."""
    for name, depth in (("predicted", predicted), ("truth", truth)):
        if depth.ndim != 2 or not np.issubdtype(depth.dtype, np.floating):
            raise ValueError(f"{name} must be (H, W) float metres, got {depth.shape} {depth.dtype}")
    if predicted.shape != truth.shape:
        raise ValueError(f"predicted has shape {predicted.shape}, but truth has {truth.shape}")
    if mask.shape != truth.shape or mask.dtype != np.bool_:
        raise ValueError(f"mask must be {truth.shape} bool, got {mask.shape} {mask.dtype}")
    if missing not in get_args(Missing):
        raise ValueError(f"missing must be one of {get_args(Missing)}, got {missing!r}")
    if np.isinf(predicted[mask]).any():
        raise ValueError("predicted holds infinite depth inside the mask; 0 or NaN means missing")

    scorable = mask & valid_depth(truth)
    if not scorable.any():
        raise ValueError(
            f"nothing to score: the mask selects {int(mask.sum())} pixels, none with a true depth"
        )
    answered = scorable & ~np.isnan(predicted) & (predicted != 0)
    if missing == "error" and (answered != scorable).any():
        absent = int(scorable.sum() - answered.sum())
        raise ValueError(
            f"{absent} of {int(scorable.sum())} pixels of the mask have no predicted depth"
        )
    return scorable, answered, scorable if missing == "zero" else answered


def depth_errors(
    predicted: FloatArray, truth: FloatArray, mask: BoolArray, *, missing: Missing = "exclude"
) -> npt.NDArray[np.float64]:
    """The signed error of each scored pixel, predicted minus true: positive lies behind.

    Returns:
        Metres, shape (H, W); NaN where a pixel is not scored.

    Raises:
        ValueError: Shapes or types differ, the prediction is infinite somewhere in the mask, no
            pixel of the mask has a true depth, or ``missing`` is ``error`` and one is missing.
    """
    _, _, scored = _scored(predicted, truth, mask, missing)
    error = np.full(truth.shape, np.nan)
    error[scored] = np.nan_to_num(predicted[scored].astype(float)) - truth[scored].astype(float)
    return error


def _sums(predicted: FloatArray, truth: FloatArray, mask: BoolArray, missing: Missing) -> _Sums:
    scorable, answered, scored = _scored(predicted, truth, mask, missing)
    p = np.nan_to_num(predicted[scored].astype(np.float64))
    t = truth[scored].astype(np.float64)
    return _Sums(
        scorable=int(scorable.sum()),
        predicted=int(answered.sum()),
        pixels=int(scored.sum()),
        totals={name: float(np.sum(metric.of_pixel(p, t))) for name, metric in METRICS.items()},
    )


def frame_metrics(
    predicted: FloatArray, truth: FloatArray, mask: BoolArray, *, missing: Missing = "exclude"
) -> DepthMetrics:
    """Score one frame; errors as :func:`depth_errors`.

    A negative depth is not missing: it is scored, and fails every delta. Where nothing was
    predicted and ``exclude`` is set, the numbers are NaN and ``pixels`` is 0.
    """
    return _sums(predicted, truth, mask, missing).metrics(1, "frame")


def mean_over_frames(frames: Iterable[DepthMetrics]) -> DepthMetrics:
    """Average the frames' numbers; every frame counts the same, however few pixels it has.

    Frames in which nothing was scored can't enter the mean: ``frames`` counts those that did,
    while ``coverage`` is the mean over all of them; ``pixels`` is the total.

    Raises:
        ValueError: There is no frame, or one of them is itself an average.
    """
    listed = list(frames)
    if not listed:
        raise ValueError("no frames to average over")
    averages = sorted({m.averaging for m in listed} - {"frame"})
    if averages:
        raise ValueError(f"expected single frames' metrics, got {averages[0]!r} ones")
    scored = [m for m in listed if m.pixels > 0]
    means = {
        name: float(np.mean([getattr(m, name) for m in scored])) if scored else math.nan
        for name in METRICS
    }
    return replace(
        listed[0],
        **means,
        pixels=sum(m.pixels for m in listed),
        coverage=float(np.mean([m.coverage for m in listed])),
        frames=len(scored),
        averaging="per-frame mean",
    )


def pooled(
    frames: Iterable[tuple[FloatArray, FloatArray, BoolArray]], *, missing: Missing = "exclude"
) -> DepthMetrics:
    """Score the pixels of all frames as if they were one image; a large object counts more.

    Args:
        frames: (predicted, truth, mask) of each frame, as :func:`frame_metrics` takes them. An
            iterator will do: only sums are kept.
        missing: As for one frame.

    Raises:
        ValueError: There is no frame, or as :func:`depth_errors`.
    """
    parts = [_sums(*frame, missing) for frame in frames]
    if not parts:
        raise ValueError("no frames to pool")
    total = _Sums(
        scorable=sum(s.scorable for s in parts),
        predicted=sum(s.predicted for s in parts),
        pixels=sum(s.pixels for s in parts),
        totals={name: math.fsum(s.totals[name] for s in parts) for name in METRICS},
    )
    return total.metrics(sum(s.pixels > 0 for s in parts), "pooled")


_SMALLER = ("error", "shape", "pooled", "loss", "time of", "memory")
_LARGER = ("success", "rate", ">", "1.0", "100 %")
"""Words in a column's heading, beside the metrics' names, that tell which number is best."""


def best_in_bold(table: pd.DataFrame, groups: Iterable[Iterable[int]]) -> pd.DataFrame:
    """Set the best number of each column in bold, by the words in the column's heading.

    Args:
        table: Cells of text that begin with their number; a cell without one is left alone.
        groups: Numbers of the rows that compete with each other; rows in no group never do.
    """
    named: dict[bool, list[str]] = {False: [*_SMALLER], True: [*_LARGER]}
    for metric in METRICS.values():
        named[metric.larger_is_better].append(metric.heading.partition(" ")[0])
    table, together = table.copy(), [list(group) for group in groups]
    for column, heading in enumerate(table.columns):
        sign = -1 if any(word in heading for word in named[True]) else 1
        if sign > 0 and not any(word in heading for word in named[False]):
            continue
        for group in together:
            found = {row: re.match(r"[-+]?\d+(\.\d+)?", table.iat[row, column]) for row in group}
            numbers = {row: sign * float(text[0]) for row, text in found.items() if text}
            for row, number in numbers.items():
                if number == min(numbers.values()) < max(numbers.values()):
                    table.iat[row, column] = f"**{table.iat[row, column]}**"
    return table


def format_table(rows: Mapping[str, DepthMetrics], best: Iterable[str] = ()) -> str:
    """Set metrics as a Markdown table, one row a method, and say how they were averaged.

    A number that does not exist is a dash; among the rows ``best`` the best are bold. ValueError
    where there is no row, or the rows are averaged in different ways.
    """
    import pandas as pd

    if not rows:
        raise ValueError("no rows for the table")
    ways = sorted({m.averaging for m in rows.values()})
    if len(ways) > 1:
        raise ValueError(f"a table must not mix averages, got {' and '.join(ways)}")
    cells = pd.DataFrame({"method": list(rows)})
    for name, metric in METRICS.items():
        cells[metric.heading] = [metric.text(getattr(row, name)) for row in rows.values()]
    cells["coverage (%)"] = [f"{100 * row.coverage:.1f}" for row in rows.values()]
    cells = best_in_bold(cells, [[list(rows).index(name) for name in best]])
    sides = ["left"] + ["right"] * (len(METRICS) + 1)
    table = cells.to_markdown(index=False, disable_numparse=True, colalign=sides)
    counts = sorted({m.frames for m in rows.values()})
    over = str(counts[0]) if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    caption = {
        "frame": "Over the pixels of one frame.",
        "per-frame mean": f"Mean of the frames' numbers, {over} frames.",
        "pooled": f"Pooled over the pixels of {over} frames.",
    }[ways[0]]
    return f"{table}\n\n{caption}"

"""Rows of the tables from rows of runs: seeds averaged, methods compared, errors over holds."""

from __future__ import annotations

import statistics
from collections.abc import Hashable, Iterable, Mapping, Sequence
from typing import Any

from hadr.metrics import METRICS

REFERENCE = "hand-median"
"""The method that all others are compared with frame by frame."""


def table_rows(
    rows: Sequence[Mapping[str, Any]], holds: Mapping[str, Sequence[str]] | None = None
) -> list[dict[str, Any]]:
    """Bring rows of `Bench.measure` to those of a result file: one a method and split.

    In the order of their first appearance; numbers are means over the seeds, beside them each
    seed's (``by_seed``), their standard deviation (``seed_sd``, n - 1; None for one seed), and the
    first seed's configuration; each frame's mean over the seeds is compared with the hand's median
    depth (``against_hand_median``, `paired`). Without the holds of each split's frames each frame
    is one.
    """
    groups: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["split"], row["method"]), []).append(row)
    known = holds or {}
    gaps = {
        split: against(rows, split, REFERENCE, known.get(split))
        for split in dict.fromkeys(split for split, _ in groups)
    }
    table = []
    for (split, method), group in groups.items():
        row, frames = _averaged(group), _over_seeds(group)
        if method in gaps[split]:
            row["against_hand_median"] = gaps[split][method]
        of = known.get(split)
        row["rmse_standard_error_m"] = standard_error(frames["rmse_m"], of or frames["stems"])
        row["holds"] = len(set(of)) if of else None
        table.append(row)
    return table


def against(
    rows: Sequence[Mapping[str, Any]],
    split: str,
    reference: str,
    holds: Sequence[str] | None = None,
) -> dict[str, dict[str, Any]]:
    """Compare all methods of a split with one of them, frame by frame.

    The rows are `Bench.measure`'s, `holds` the hold of each frame of the split (without it each is
    one of its own). Gives `paired` by name; nothing where the reference has no row.
    """
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        if row["split"] == split:
            groups.setdefault(row["method"], []).append(row)
    if reference not in groups:
        return {}
    other = _over_seeds(groups.pop(reference))
    return {name: paired(_over_seeds(group), other, holds) for name, group in groups.items()}


def _over_seeds(group: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Each frame's RMSE, the mean over the seeds."""
    listed = [row["per_frame"] for row in group]
    if any(frames["stems"] != listed[0]["stems"] for frames in listed):
        raise ValueError(f"the seeds of {group[0]['method']} were scored on different frames")
    errors = [statistics.fmean(each) for each in zip(*(f["rmse_m"] for f in listed), strict=True)]
    return {"stems": listed[0]["stems"], "rmse_m": errors}


def paired(
    own: Mapping[str, Any], reference: Mapping[str, Any], holds: Sequence[str] | None = None
) -> dict[str, Any]:
    """Compare the RMSE of two methods (`Scores.per_frame`) frame by frame.

    Returns:
        Mean of own minus the reference's RMSE in metres, its standard error over holds (without
        them each frame is one), on how many frames the own one is smaller, and their number.

    Raises:
        ValueError: The frames are not the same, in the same order.
    """
    if list(own["stems"]) != list(reference["stems"]):
        raise ValueError(
            f"only the same frames can be compared, got {len(own['stems'])} and "
            f"{len(reference['stems'])} that differ in name or order"
        )
    gaps = [mine - other for mine, other in zip(own["rmse_m"], reference["rmse_m"], strict=True)]
    return {
        "mean_difference_m": statistics.fmean(gaps) if gaps else None,
        "standard_error_m": standard_error(gaps, holds or list(range(len(gaps)))),
        "better_on_frames": sum(gap < 0 for gap in gaps),
        "frames": len(gaps),
    }


def standard_error(values: Sequence[float], groups: Sequence[Hashable]) -> float | None:
    """Estimate how far a mean may be off when values come in groups that are alike.

    The deviations from the mean are summed within each group first (cluster-robust). With groups
    of one it is the ordinary standard error; None for fewer than two groups.
    """
    if not values:
        return None
    mean, sums = statistics.fmean(values), dict[Hashable, float]()
    for value, group in zip(values, groups, strict=True):
        sums[group] = sums.get(group, 0.0) + value - mean
    count = len(sums)
    if count < 2:
        return None
    total = sum(off**2 for off in sums.values())
    return float((count / (count - 1) * total) ** 0.5 / len(values))


def _by_object(listed: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Mean RMSE of each object's frames in metres, over all seeds."""
    errors: dict[str, list[float]] = {}
    for frames in listed:
        for stem, error in zip(frames["stems"], frames["rmse_m"], strict=True):
            errors.setdefault(stem.split("/")[0], []).append(error)
    return {name: sum(errors[name]) / len(errors[name]) for name in sorted(errors)}


def _mean(values: Sequence[float | None]) -> float | None:
    """Mean over the seeds; None where one of them has no value (nothing was restored)."""
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if known and len(known) == len(values) else None


def _any(answers: Iterable[bool | None]) -> bool | None:
    """Whether one is true; None where none is and one is unknown."""
    found = set(answers)
    return True if True in found else None if None in found else False


def _averaged(group: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    first = dict(group[0])
    left_out = ("seed", "per_frame", "provenance", "sha256")
    row = {name: value for name, value in first.items() if name not in left_out}
    row["by_object"] = _by_object([r["per_frame"] for r in group])
    for name, value in row.items():
        if isinstance(value, float):
            row[name] = sum(r[name] for r in group) / len(group)
    for part in ("pooled", "restored"):
        columns = [r[part] for r in group]
        row[part] = {name: _mean([c[name] for c in columns]) for name in columns[0]}
    return {
        **row,
        "seeds": [r["seed"] for r in group],
        "by_seed": {name: [r.get(name) for r in group] for name in METRICS},
        "seed_sd": {name: _spread([r[name] for r in group if name in r]) for name in METRICS},
        "config_sha256": [r["config_sha256"] for r in group],
        "provenance": {
            **{
                name: sorted({r["provenance"].get(name) or "unknown" for r in group})
                for name in ("commit", "trained_at")
                if name in first["provenance"]
            },
            "uncommitted_changes": _any(r["provenance"].get("uncommitted_changes") for r in group),
            "versions": first["provenance"].get("versions"),
            "machine": first["provenance"]["machine"],
            "data_sha256": first.get("configuration", {}).get("data", {}).get("sha256"),
        },
    }


def _spread(values: Sequence[float]) -> float | None:
    """Standard deviation with n - 1; None for one value."""
    return statistics.stdev(values) if len(values) > 1 else None

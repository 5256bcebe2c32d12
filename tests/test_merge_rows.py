"""`benchmarks/networks/merge_rows.py`: rows of later trainings in the place of older ones."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from hadr.experiments.averages import table_rows
from hadr.metrics import METRICS
from hadr.records.result_file import ResultFile

STEMS = ["0000/a", "0000/b", "0004/a", "0004/b"]


def run(method: str, seed: int) -> dict[str, Any]:
    errors = np.random.default_rng([seed, len(method)]).uniform(0.01, 0.05, 4)
    scores = dict.fromkeys(METRICS, float(errors.mean()))
    return {
        "method": method,
        "split": "known",
        **scores,
        "pooled": {"rmse_m": float(errors.max())},
        "restored": {"rmse_m": float(errors.min())},
        "epochs": 7,
        "training_s": 100.0 + seed,
        "seed": seed,
        "config_sha256": f"{method}-{seed}",
        "per_frame": {"stems": STEMS, "rmse_m": errors.tolist()},
        "provenance": {"commit": str(seed), "trained_at": str(seed), "machine": "one"},
    }


def made(*runs: tuple[str, int]) -> ResultFile:
    rows = [run("hand-median", 0), *(run(*each) for each in runs)]
    holds = {"known": ["a", "b", "a", "b"]}
    provenance = {"data": {"sha256": "frames"}}
    return ResultFile("rows", table_rows(rows, holds), provenance)


def test_more_seeds_join_the_row_that_is_there(load_benchmark: Callable[[str], ModuleType]) -> None:
    merge_rows = load_benchmark("networks/merge_rows")
    old, new = made(("lidf", 0), ("tode", 0)), made(("lidf", 1), ("lidf", 2), ("tode", 0))
    median, joined, other = merge_rows.merged(new, old, ["lidf"])
    expected = made(("lidf", 0), ("lidf", 1), ("lidf", 2)).rows[1]
    assert [median, other] == [old.rows[0], old.rows[2]]

    pair, whole = joined.pop("against_hand_median"), expected.pop("against_hand_median")
    assert pair["mean_difference_m"] == pytest.approx(whole["mean_difference_m"])
    assert pair["standard_error_m"] >= whole["standard_error_m"]
    assert "better_on_frames" not in pair
    assert joined.pop("rmse_standard_error_m") >= expected.pop("rmse_standard_error_m")
    for part in ("pooled", "restored", "by_object", "seed_sd"):
        assert joined.pop(part) == pytest.approx(expected.pop(part)), part
    numbers = [name for name, value in expected.items() if isinstance(value, float)]
    assert {*METRICS, "training_s"} <= {*numbers}
    for name in numbers:
        assert joined.pop(name) == pytest.approx(expected.pop(name)), name
    assert joined == expected  # seeds, each seed's numbers, commits, what is no mean

    again = ResultFile("rows", [median, joined | expected, other], old.provenance)
    with pytest.raises(ValueError, match=r"lidf.* has seeds {0, 1, 2} there, and {1, 2} come"):
        merge_rows.merged(new, again, ["lidf"])


def test_a_row_of_the_same_seeds_is_replaced(load_benchmark: Callable[[str], ModuleType]) -> None:
    merge_rows = load_benchmark("networks/merge_rows")
    old, new = made(("tode", 0)), made(("tode", 0), ("tode", 1), ("dfnet", 0))
    assert merge_rows.merged(new, old, ["tode"])[1] == new.rows[1]
    added = merge_rows.merged(new, old, ["dfnet"])
    assert [row["method"] for row in added] == ["hand-median", "dfnet", "tode"]


def test_a_part_of_the_ablation_is_held_against_the_full_model_again(
    load_benchmark: Callable[[str], ModuleType],
) -> None:
    merge_rows = load_benchmark("networks/merge_rows")
    old, new = made(("full", 0), ("no-hand", 0)), made(("no-hand", 1))
    gap = {"mean_difference_m": 0.1, "standard_error_m": 0.002, "better_on_frames": 3, "frames": 4}
    old.rows[2]["against_full"], new.rows[1]["against_full"] = gap, None
    _, full, part = merge_rows.merged(new, old, ["no-hand"])
    assert part["seeds"] == [0, 1]
    less = part["rmse_m"] - full["rmse_m"]
    assert part["against_full"] == {
        "mean_difference_m": less, "standard_error_m": 0.002, "frames": 4,
    }  # fmt: skip

"""How long each step took when it was last measured: what a plan's estimates are drawn from.

    results/tiny/run_times.json              all steps of `hadr reproduce --preset tiny`
    results/mini/{known,...,handover}.json   at preset mini, from the rows of the tables themselves
    results/mini/run_times.json              chapters that take longer there
    results/training/paper_step.json         preset paper: one step of HADR, measured alone

A step that nobody has timed has no estimate: the plan says so instead of guessing.
"""

from __future__ import annotations

import json
import statistics
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hadr.records.checkout import checkout_root
from hadr.records.provenance import machine_text, provenance
from hadr.records.result_file import read_result_file, read_sealed, write_result_file

NAME = "run_times.json"
TRAINING_CHAPTERS = ("06_training",)
"""Chapters that train a network of the preset: their time at tiny says nothing about mini."""
_TABLES = ("known", "unknown", "ablation", "ledger")
_OF_HADR = (
    "hadr", "no-hand", "no-aggregation", "no-point-fusion", "hand-2d", "coded-weights",
    "wrist-translation", "clamped-probability", "hadr-long",
)  # fmt: skip
"""Methods that are HADR, or nearly: where its step alone was timed, theirs is taken to be alike."""


@dataclass(frozen=True)
class RunTimes:
    """Recorded times of one preset, in wall-clock seconds.

    Attributes:
        training: Of a frame and an epoch, by method.
        scoring: Of a run's test frames, by method.
        chapters: Of a chapter, by its name.
        attempts: Of one attempt of the handover, by arm.
        conditions: Of a test frame that is scored under another condition, by the condition's name.
    """

    training: Mapping[str, float]
    scoring: Mapping[str, float]
    chapters: Mapping[str, float]
    attempts: Mapping[str, float]
    conditions: Mapping[str, float]

    def of_run(self, method: str, epochs: int, frames: int) -> float | None:
        """Estimate a run of the tables: what is left of its training, and its scoring.

        Args:
            method: The system.
            epochs: Epochs that are left; 0 for a method that learns nothing.
            frames: Training frames.

        Returns:
            Seconds; None where no such training was timed.
        """
        scoring = self.scoring.get(method)
        if epochs == 0:
            return scoring
        rate = self.training.get(method)
        return None if rate is None else epochs * frames * rate + (scoring or 0.0)


def read_run_times(size: str, results: Path | None = None) -> RunTimes:
    """Read what was recorded for a preset.

    Args:
        size: "tiny", "mini" or "paper".
        results: The folder of result files; where it is left out, the checkout's.

    Returns:
        The times; without any where the files are not at hand. At preset mini, a chapter without
        a time of its own is taken to be as long as at preset tiny, but for those that train.

    Raises:
        ValueError: A file was changed by hand.
    """
    if results is None:
        try:
            results = checkout_root() / "results"
        except FileNotFoundError:
            return RunTimes({}, {}, {}, {}, {})
    noted = _rows(results / "tiny" / NAME)
    chapters = {r["step"]: float(r["seconds"]) for r in noted if r["part"] == "chapter"}
    # masks and keypoints are predicted by the same bundled networks at every preset
    given = {r["step"]: float(r["seconds_a_frame"]) for r in noted if r["part"] == "condition"}
    if size == "tiny":
        attempts = {r["step"]: r["seconds_an_attempt"] for r in noted if r["part"] == "handover"}
        tables = [row for row in noted if row["part"] == "table"]
        return RunTimes(*_training(tables), chapters, attempts, given)
    # an attempt is the same at both larger presets: it takes the bundled networks
    attempts = {r["arm"]: r["mean_wall_seconds"] for r in _rows(results / "mini" / "handover.json")}
    if size == "mini":
        own = [r for r in _rows(results / "mini" / NAME) if r["part"] == "chapter"]
        chapters = {name: s for name, s in chapters.items() if name not in TRAINING_CHAPTERS}
        chapters |= {row["step"]: float(row["seconds"]) for row in own}
        tables = [row for name in _TABLES for row in _rows(results / "mini" / f"{name}.json")]
        return RunTimes(*_training(tables), chapters, attempts, given)
    training = {}
    if (path := results / "training" / "paper_step.json").is_file():
        tried = [one for one in read_sealed(path)["tried"] if one["fits"]]
        rate = min(min(one["seconds"]) / one["batch_size"] for one in tried)
        training = dict.fromkeys(_OF_HADR, rate)
    return RunTimes(training, {}, {}, attempts, given)


def write_run_times(out: Path) -> Path | None:
    """Note how long the finished steps of a reproduction took.

    Args:
        out: The folder of `hadr reproduce`, with any of ``tables`` and ``results.json``.

    Returns:
        ``run_times.json`` in it; None where no step is finished that was timed.

    Raises:
        ValueError: A table was changed by hand.
    """
    rows: dict[str, dict[str, Any]] = {}
    for name in _TABLES:
        path = out / "tables" / f"{name}.json"
        for row in _rows(path):
            told = {
                "step": row["configuration"]["run"],
                "part": "table",
                **{key: row.get(key) for key in _TIMED},
            }
            rows[told["step"]] = told
    for name, seconds in _condition_times(out / "runs").items():
        rows[f"given {name}"] = {"step": name, "part": "condition", "seconds_a_frame": seconds}
    chapters = out / "results.json"
    if chapters.is_file():
        measured = json.loads(chapters.read_text(encoding="utf-8"))["chapters"]
        for name, entry in measured.items():
            rows[name] = {"step": name, "part": "chapter", "seconds": entry["duration_s"]}
    for row in _rows(out / "tables" / "handover.json"):
        rows[f"handover/{row['arm']}"] = {
            "step": row["arm"],
            "part": "handover",
            "attempts": row["attempts"],
            "seconds_an_attempt": row["mean_wall_seconds"],
        }
    if not rows:
        return None
    path = out / NAME
    write_result_file(
        path,
        "wall-clock seconds of each step of `hadr reproduce`",
        list(rows.values()),
        {**provenance(), "machine": machine_text()},
    )
    return path


_TIMED = ("training_s", "epochs", "training_frames", "evaluation_s", "threads", "seeds")


def _rows(path: Path) -> tuple[dict[str, Any], ...]:
    return read_result_file(path).rows if path.is_file() else ()


def _condition_times(runs: Path) -> dict[str, float]:
    """Mean seconds a frame of the scores under each condition that lie below a folder of runs."""
    found: dict[str, list[float]] = {}
    for path in sorted(runs.glob("*/*/seed-*/given/*.json")):
        row = json.loads(path.read_text(encoding="utf-8"))
        if row.get("evaluation_s") is not None:
            found.setdefault(row["given"], []).append(row["evaluation_s"] / row["frames"])
    return {name: statistics.fmean(each) for name, each in found.items()}


def _training(rows: Iterable[Mapping[str, Any]]) -> tuple[dict[str, float], dict[str, float]]:
    """Mean seconds of training, a frame and epoch, and of scoring, by method."""
    trained: dict[str, list[float]] = {}
    scored: dict[str, list[float]] = {}
    for row in rows:
        run = row["configuration"]["run"] if "configuration" in row else row["step"]
        method = run.split("/")[1]
        if row.get("evaluation_s") is not None:
            scored.setdefault(method, []).append(float(row["evaluation_s"]))
        if row.get("training_s") is not None:
            looks = row["epochs"] * row["training_frames"]
            trained.setdefault(method, []).append(row["training_s"] / looks)
    means = ({m: statistics.fmean(v) for m, v in found.items()} for found in (trained, scored))
    training, scoring = means
    return training, scoring

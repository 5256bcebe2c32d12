"""Train and score what a table needs: resumable, one folder a run, one file a row.

    OUT/known/hadr/seed-0/last.safetensors   the training, which goes on where it was stopped
    OUT/known/hadr/seed-0/row.json           the finished row; it is what "done" means

A row is measured again when its recipe, its data or its protocol is another than the file says, or
when the file was changed by another hand: it ends with a checksum. A training of another recipe or
of other data is set aside (``seed-0.old-1``) before a new one begins.
"""

from __future__ import annotations

import contextlib
import csv
import json
import statistics
import time
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any

import torch
from filelock import FileLock, Timeout
from lightning_fabric import Fabric

from hadr.experiments.scoring import COLUMNS, EVALUATION_SIZE, Scores, score_cheap, score_network
from hadr.experiments.splits import Experiment, Part, data_digest, open_part
from hadr.experiments.systems import system
from hadr.provenance import machine_text, plain, provenance, write_json
from hadr.result_file import digest
from hadr.training.batches import Corruption, FrameTensors, load_frames
from hadr.training.loop import LAST, train
from hadr.training.presets import Preset

REFERENCE = "hand-median"
"""The method that all others are compared with frame by frame."""
ROW, HISTORY = "row.json", "history.csv"


@dataclass(frozen=True)
class Run:
    """One training with its evaluation.

    Attributes:
        experiment: "known" or "unknown".
        method: A system's name.
        seed: Seed of the training; methods that learn nothing have seed 0 only.
    """

    experiment: Experiment
    method: str
    seed: int = 0

    @property
    def name(self) -> str:
        """The run's name, and its folder: such as ``known/hadr/seed-0``."""
        return f"{self.experiment}/{self.method}/seed-{self.seed}"


class Bench:
    """What all runs share: the data folders, the size of preset, the corruption, the output.

    Args:
        roots: Data folders in TransHand's layout.
        out: Folder of the runs.
        size: Preset of all systems: "tiny", "mini" or "paper".
        corruption: How the frames' depth is corrupted, in training and test.
        limit: Take at most so many frames of each part, evenly spread; None takes all.
        accelerator: Where networks are trained and scored: "cpu", or "cuda" for the first GPU.
    """

    def __init__(
        self,
        roots: Sequence[str | Path],
        out: str | Path,
        size: str = "mini",
        corruption: Corruption = "oracle",
        limit: int | None = None,
        accelerator: str = "cpu",
    ) -> None:
        self.roots = tuple(Path(root) for root in roots)
        self.accelerator = accelerator
        self.out, self.size, self.corruption, self.limit = Path(out), size, corruption, limit
        self._frames: dict[tuple[str, str, tuple[int, int]], FrameTensors] = {}
        self.other_frames: dict[Any, FrameTensors] = {}
        """Test frames under other conditions, by a key that names all of them."""
        self._digest: str | None = None

    @property
    def data(self) -> dict[str, Any]:
        """What the frames are, for the record: a digest of the folders, corruption, limit."""
        if self._digest is None:
            self._digest = digest([data_digest(root) for root in self.roots])
        return {"sha256": self._digest, "corruption": self.corruption, "limit": self.limit}

    @property
    def device(self) -> str:
        """Name of what networks are trained and scored on."""
        return "cpu" if self.accelerator == "cpu" else torch.cuda.get_device_name()

    def count(self, run: Run, part: Part) -> int:
        """Count the frames of one part without reading them."""
        number = len(open_part(self.roots, run.experiment, part))
        return number if self.limit is None else min(number, self.limit)

    def source(self, run: Run, part: Part) -> Any:
        """Open one part of a run's frames, read when asked for."""
        source = open_part(self.roots, run.experiment, part)
        if self.limit is None or len(source) <= self.limit:
            return source
        return [source[number * len(source) // self.limit] for number in range(self.limit)]

    def frames(self, run: Run, part: Part, size: tuple[int, int]) -> FrameTensors:
        """Load one part of a run's frames; the last few loads are kept."""
        key = (run.experiment, part, size)
        if key not in self._frames:
            while len(self._frames) > 3:
                del self._frames[next(iter(self._frames))]
            self._frames[key] = load_frames(
                self.source(run, part),
                size,
                self.corruption,
                keep_all=part == "test",  # so that the same frames come at every size
                progress=f"reading {run.experiment} {part}",
            )
        return self._frames[key]

    def configuration(self, run: Run) -> dict[str, Any]:
        """Everything on which a run's numbers depend, the code's version aside."""
        recipe = system(run.method, self.size).recipe
        return {
            "run": run.name,
            "recipe": None if recipe is None else recipe.to_dict(),
            "data": self.data,
            "evaluation_size": list(EVALUATION_SIZE),
        }

    def finished(self, run: Run) -> dict[str, Any] | None:
        """Give the run's row if it was measured with this configuration, else None."""
        return sealed_row(self.out / run.name / ROW, self.configuration(run))

    def epochs_done(self, run: Run) -> int:
        """Count the epochs that a run's training has behind it."""
        with contextlib.suppress(OSError):
            text = (self.out / run.name / HISTORY).read_text(encoding="utf-8")
            return max(len(text.splitlines()) - 1, 0)
        return 0

    def curve(self, run: Run) -> dict[str, list[float]] | None:
        """Give a training's seconds so far and validation RMSE after each epoch, None without."""
        with contextlib.suppress(OSError, KeyError, ValueError):
            text = (self.out / run.name / HISTORY).read_text(encoding="utf-8")
            rows = list(csv.DictReader(text.splitlines()))
            seconds = list(accumulate(float(row["seconds"]) for row in rows))
            return {
                "seconds": [round(value, 1) for value in seconds],
                "validation_rmse_m": [float(row["validation_rmse_m"]) for row in rows],
            }
        return None

    def measure(self, run: Run) -> dict[str, Any]:
        """Train a run's system as far as it is not, score it, and keep the row.

        Args:
            run: What to measure.

        Returns:
            The row: names, the scores, training time, parameters, provenance.

        Raises:
            ValueError: Another process makes this run now.
        """
        found = self.finished(run)
        if found is not None:
            return found
        folder = self.out / run.name
        folder.mkdir(parents=True, exist_ok=True)
        try:
            with FileLock(folder.with_name(f".{folder.name}.lock"), timeout=0):
                return self.finished(run) or self._measure(run)
        except Timeout as error:
            raise ValueError(
                f"{run.name} is being made by another process in {self.out}"
            ) from error

    def _measure(self, run: Run) -> dict[str, Any]:
        recipe = system(run.method, self.size).recipe
        started = time.perf_counter()
        if recipe is None:
            test = self.frames(run, "test", EVALUATION_SIZE)
            scores, trained = score_cheap(test, run.method), dict[str, Any]()
        else:
            scores, trained = self._train_and_score(run, recipe)
        row = {
            "method": run.method,
            "split": run.experiment,
            "seed": run.seed,
            **scores.columns(),
            **trained,
            "evaluation_s": time.perf_counter() - started - trained.get("training_s_now", 0.0),
            "config_sha256": digest(self.configuration(run)),
            "configuration": self.configuration(run),
            "curve": self.curve(run),
            "per_frame": scores.per_frame(),
            "provenance": {**provenance(), "machine": machine_text()},
        }
        row.pop("training_s_now", None)
        return seal_row(self.out / run.name / ROW, row)

    def holds(self, experiment: Experiment, stems: Sequence[str]) -> list[str]:
        """Say which hold each test frame of an experiment shows (`FrameSource.holds`)."""
        return open_part(self.roots, experiment, "test").holds(stems)

    def _train_and_score(self, run: Run, recipe: Preset) -> tuple[Scores, dict[str, Any]]:
        began = time.perf_counter()
        folder = self.out / run.name
        data = {"experiment": run.experiment, **self.data}
        set_aside_another(folder, recipe, data)
        trained = train(
            recipe,
            self.frames(run, "train", recipe.size),
            self.frames(run, "val", recipe.size),
            folder=folder,
            seed=run.seed,
            data=data,
            resume=(folder / LAST).exists(),
            fabric=Fabric(accelerator=self.accelerator, devices=1, precision=recipe.precision),
        )
        now = time.perf_counter() - began
        test = self.frames(run, "test", recipe.size)
        truth = self.frames(run, "test", EVALUATION_SIZE)
        columns = {
            "parameters": sum(p.numel() for p in trained.model.parameters()),
            "epochs": len(trained.history),
            "training_frames": len(self.frames(run, "train", recipe.size)),
            "training_s": sum(row["seconds"] for row in trained.history),
            "training_s_now": now,
            "threads": torch.get_num_threads(),
            "device": self.device,
        }
        return score_network(trained.model, test, truth), columns


def sealed_row(path: Path, configuration: Mapping[str, Any]) -> dict[str, Any] | None:
    """Read a row, if it is there, whole, untouched, and was measured with this configuration."""
    with contextlib.suppress(OSError, ValueError):
        row = json.loads(path.read_text(encoding="utf-8"))
        if isinstance(row, dict) and row.get("config_sha256") == digest(configuration):
            sealed = {name: value for name, value in row.items() if name != "sha256"}
            return row if row.get("sha256") == digest(sealed) else None
    return None


def seal_row(path: Path, row: Mapping[str, Any]) -> dict[str, Any]:
    """Write a row with the checksum by which `sealed_row` knows it."""
    content = dict(plain(row))
    content.pop("sha256", None)
    content["sha256"] = digest(content)
    write_json(path, content)
    return content


def set_aside_another(folder: Path, recipe: Preset, data: Mapping[str, Any]) -> Path | None:
    """Move a training of another recipe or other data out of the way, so that nothing is lost.

    Args:
        folder: The training's folder.
        recipe: What is to be trained there.
        data: On what.

    Returns:
        Where the earlier training lies now, beside the folder; None where there was none.
    """
    record = (folder / LAST).with_suffix(".json")
    if not record.is_file():
        return None
    found = json.loads(record.read_text(encoding="utf-8"))
    asked = json.loads(json.dumps(plain({"preset": recipe.to_dict(), "data": data})))
    if {name: found.get(name) for name in asked} == asked:
        return None
    number = 1
    while (aside := folder.with_name(f"{folder.name}.old-{number}")).exists():
        number += 1
    return folder.rename(aside)


def table_rows(
    rows: Sequence[Mapping[str, Any]], holds: Mapping[str, Sequence[str]] | None = None
) -> list[dict[str, Any]]:
    """Bring runs to the rows of a result file: one a method and split, seeds averaged.

    Args:
        rows: Rows of `Bench.measure`.
        holds: Hold of each frame, by split; without it each frame counts as a hold of its own.

    Returns:
        In the order of their first appearance; numbers are means over the seeds, beside them each
        seed's (``by_seed``), their standard deviation (``seed_sd``, n - 1; None for one seed), the
        first seed's configuration, and each frame's mean over the seeds compared with the hand's
        median depth (`paired`).
    """
    groups: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["split"], row["method"]), []).append(row)
    table = [_averaged(group) for group in groups.values()]
    for row, group in zip(table, groups.values(), strict=True):
        reference = groups.get((row["split"], REFERENCE))
        frames, known = _over_seeds(group), (holds or {}).get(row["split"])
        if reference is not None and row["method"] != REFERENCE:
            row["against_hand_median"] = paired(frames, reference[0]["per_frame"], known)
        row["rmse_standard_error_m"] = standard_error(frames["rmse_m"], known or frames["stems"])
        row["holds"] = len(set(known)) if known else None
    return table


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
    """Compare two methods frame by frame.

    Args:
        own: RMSE of each frame with the frames' names (`Scores.per_frame`).
        reference: The other method's, of the same frames in the same order.
        holds: Hold of each frame; without it each frame counts as a hold of its own.

    Returns:
        Mean of own minus the reference's RMSE in metres, its standard error over holds, on how
        many frames the own one is smaller, and the number of frames.

    Raises:
        ValueError: The frames are not the same.
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
    of one it is the ordinary standard error.

    Args:
        values: The values.
        groups: Group of each.

    Returns:
        The standard error of the mean; None for fewer than two groups.
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
        "by_seed": {name: [r.get(name) for r in group] for name in COLUMNS},
        "seed_sd": {name: _spread([r[name] for r in group if name in r]) for name in COLUMNS},
        "config_sha256": [r["config_sha256"] for r in group],
        "provenance": {
            "commit": sorted({str(r["provenance"].get("commit")) for r in group}),
            "versions": first["provenance"].get("versions"),
            "machine": first["provenance"]["machine"],
            "data_sha256": first.get("configuration", {}).get("data", {}).get("sha256"),
        },
    }


def _spread(values: Sequence[float]) -> float | None:
    """Standard deviation with n - 1; None for one value."""
    return statistics.stdev(values) if len(values) > 1 else None

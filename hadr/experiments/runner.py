"""Train and score what a table needs: resumable, one folder a run, one file a row.

    OUT/known/hadr/seed-0/last.safetensors   the training, which goes on where it was stopped
    OUT/known/hadr/seed-0/row.json           the finished row; it is what "done" means

A row is measured again when its recipe, its data, its protocol or its code is another than the file
says (`hadr.records.dependencies`), or when the file was changed by another hand: it ends with a
checksum. A training of another recipe, of other data or by other code is set aside
(``seed-0.old-1``) before a new one begins; code that only scores does not count there. On demand a
finished training of other code counts too: its row says at which commit it was trained.
"""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from itertools import accumulate
from pathlib import Path
from typing import Any

import torch
from torch import nn

from hadr.corruption import Corruption
from hadr.data.folders import data_digest
from hadr.experiments.protocol import Experiment, Part, open_part
from hadr.experiments.scoring import (
    EVALUATION_SIZE,
    Scores,
    cheap_depth,
    hand_offset,
    score_depth,
    score_network,
)
from hadr.experiments.systems import recipe_of
from hadr.models.networks import network_of
from hadr.records.dependencies import code_digest
from hadr.records.provenance import plain, provenance
from hadr.records.result_file import digest, seal_row, sealed_row
from hadr.training.checkpoints import read_record
from hadr.training.frames.batches import FrameTensors, load_frames
from hadr.training.loop import Trained, train
from hadr.training.recipe import Preset
from hadr.training.training_folder import HISTORY, LAST

ROW = "row.json"
TABLES_OF_NETWORKS = (
    "hadr.experiments.systems", "hadr.models.networks", "hadr.training.presets",
)  # fmt: skip
"""Modules that lead to every network: a run depends on its own, and on its recipe and its row of
the table as values."""


@cache  # what this process has loaded does not change
def code_of(network: str | None, *modules: str) -> str:
    """Checksum of a run's code, from first modules on; network None: it learns nothing."""
    if network is None:
        return code_digest(*modules, without=TABLES_OF_NETWORKS)
    row = network_of(network)
    code = code_digest(*modules, *row.modules, without=TABLES_OF_NETWORKS)
    return digest([code, row.loss, row.slow])


@dataclass(frozen=True)
class Run:
    """One training with its evaluation.

    Attributes:
        experiment: "known", "unknown" or "by-frame".
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


@dataclass(eq=False)
class Bench:
    """What all runs share: the data folders, the size of preset, the corruption, the output.

    Attributes:
        roots: Data folders in TransHand's layout.
        out: Folder of the runs.
        size: Preset of all systems: "tiny", "mini", "imagenet" or "paper".
        corruption: How the frames' depth is corrupted, in training and test.
        limit: Take at most so many frames of each part, evenly spread; None takes all.
        accelerator: Where networks are trained and scored: "cpu", or "cuda" for the first GPU.
        keep_trained: A finished training of the same recipe, data and seed counts also where other
            code has made it.
    """

    roots: Sequence[Path]
    out: Path
    size: str = "mini"
    corruption: Corruption = "oracle"
    limit: int | None = None
    accelerator: str = "cpu"
    keep_trained: bool = False
    _frames: dict[Hashable, FrameTensors] = field(default_factory=dict, init=False)

    @cached_property
    def data(self) -> dict[str, Any]:
        """What the frames are, for the record: a digest of the folders, corruption, limit."""
        content = digest([data_digest(root) for root in self.roots])
        return {"sha256": content, "corruption": self.corruption, "limit": self.limit}

    def data_of(self, run: Run, recipe: Preset) -> dict[str, Any]:
        """What a run is trained on and by which code, for the record of its training."""
        code = code_of(recipe.network, "hadr.training.loop", "hadr.experiments.protocol")
        now = {"experiment": run.experiment, **self.data, "code": code}
        there = self.out / run.name / LAST
        if self.keep_trained and there.is_file():
            record = read_record(there)
            then = {**now, "code": record["data"].get("code")}
            whole = record["epochs"] == recipe.epochs
            if whole and not _is_another(there.parent, recipe, then):
                return then
        return now

    @property
    def device(self) -> str:
        """Name of what networks are trained and scored on."""
        return "cpu" if self.accelerator == "cpu" else torch.cuda.get_device_name()

    def source(self, run: Run, part: Part) -> Any:
        """Open one part of a run's frames, read when asked for."""
        source = open_part(self.roots, run.experiment, part)
        if self.limit is None or len(source) <= self.limit:
            return source
        return [source[number * len(source) // self.limit] for number in range(self.limit)]

    def frames(self, run: Run, part: Part, size: tuple[int, int]) -> FrameTensors:
        """Load one part of a run's frames; the last few loads are kept."""

        def load() -> FrameTensors:
            return load_frames(
                self.source(run, part),
                size,
                self.corruption,
                keep_all=part == "test",  # so that the same frames come at every size
                progress=f"reading {run.experiment} {part}",
            )

        return self.kept((run.experiment, part, size), load)

    def kept(self, key: Hashable, load: Callable[[], FrameTensors]) -> FrameTensors:
        """Load frames, or give them again if they are among the last few that were loaded."""
        if key not in self._frames:
            while len(self._frames) > 3:
                del self._frames[next(iter(self._frames))]
            self._frames[key] = load()
        return self._frames[key]

    def configuration(self, run: Run) -> dict[str, Any]:
        """Everything on which a run's numbers depend."""
        recipe = recipe_of(run.method, self.size)
        return {
            "run": run.name,
            "recipe": None if recipe is None else recipe.to_dict(),
            "data": self.data,
            "evaluation_size": list(EVALUATION_SIZE),
            "code": code_of(recipe and recipe.network, "hadr.experiments.runner"),
        }

    def finished(self, run: Run) -> dict[str, Any] | None:
        """Give the run's row if it was measured with this configuration, else None."""
        return sealed_row(self.out / run.name / ROW, self.configuration(run))

    def epochs_done(self, run: Run) -> int:
        """Count a training's epochs so far; 0 if it would be set aside, or can't be read."""
        recipe = recipe_of(run.method, self.size)
        try:
            if recipe and _is_another(self.out / run.name, recipe, self.data_of(run, recipe)):
                return 0
        except ValueError:  # the run itself says what is wrong with it
            return 0
        with contextlib.suppress(OSError):
            rows = (self.out / run.name / HISTORY).read_text(encoding="utf-8").splitlines()
            return len(rows) - 1  # under their head
        return 0

    def measure(self, run: Run) -> dict[str, Any]:
        """Train a run's system as far as it is not, score it, and keep the row, which it gives.

        Commit, threads and device of a training that went on elsewhere are its last epoch's.
        """
        found = self.finished(run)
        if found is not None:
            return found
        folder = self.out / run.name
        recipe = recipe_of(run.method, self.size)
        origin, columns = provenance(), dict[str, Any]()
        curve: dict[str, list[float]] | None = None
        started = time.perf_counter()
        if recipe is None:
            scores = self.score_cheap(run)
        else:
            set_aside_another(folder, recipe, self.data_of(run, recipe))
            trained = self.train(run, recipe, folder)
            made_with = read_record(folder / LAST)["made_with"]
            origin["trained_at"] = made_with.get("commit")
            started = time.perf_counter()
            scores = self.score(run, recipe, trained.model)
            columns = {
                "parameters": sum(p.numel() for p in trained.model.parameters()),
                "epochs": len(trained.history),
                "training_frames": len(self.frames(run, "train", recipe.size)),
                "training_s": sum(row["seconds"] for row in trained.history),
                "threads": made_with.get("threads", torch.get_num_threads()),
                "device": made_with.get("device", self.device),
            }
            seconds = accumulate(row["seconds"] for row in trained.history)
            curve = {
                "seconds": [round(value, 1) for value in seconds],
                "validation_rmse_m": [row["validation_rmse_m"] for row in trained.history],
            }
        row = {
            "method": run.method,
            "split": run.experiment,
            "seed": run.seed,
            **scores.columns(),
            **columns,
            "evaluation_s": time.perf_counter() - started,
            "config_sha256": digest(self.configuration(run)),
            "configuration": self.configuration(run),
            "curve": curve,
            "per_frame": scores.per_frame(),
            "provenance": origin,
        }
        return seal_row(self.out / run.name / ROW, row)

    def holds(self, experiment: Experiment, stems: Sequence[str]) -> list[str]:
        """Say which hold each test frame of an experiment shows (`FrameSource.holds`)."""
        return open_part(self.roots, experiment, "test").holds(stems)

    def train(self, run: Run, recipe: Preset, folder: Path) -> Trained:
        """Train on a run's frames, with its seed; a training that is in the folder goes on."""
        return train(
            recipe,
            self.frames(run, "train", recipe.size),
            self.frames(run, "val", recipe.size),
            folder=folder,
            seed=run.seed,
            data=self.data_of(run, recipe),
            resume=(folder / LAST).exists(),
            device=self.accelerator,
        )

    def score_cheap(self, run: Run) -> Scores:
        """Score a method without a network on a run's test frames."""
        test = self.frames(run, "test", EVALUATION_SIZE)
        if run.method != "hand-offset":
            return score_depth(cheap_depth(test, run.method), test)
        offset = hand_offset(self.frames(run, "train", EVALUATION_SIZE))
        return score_depth(cheap_depth(test, "hand-median") + offset, test)

    def score(self, run: Run, recipe: Preset, model: nn.Module) -> Scores:
        """Score a trained network on a run's test frames."""
        test = self.frames(run, "test", recipe.size)
        return score_network(model, test, self.frames(run, "test", EVALUATION_SIZE))


def set_aside_another(folder: Path, recipe: Preset, data: Mapping[str, Any]) -> Path | None:
    """Move a training of another recipe, data or code out of the way, so that nothing is lost."""
    if not _is_another(folder, recipe, data):
        return None
    number = 1
    while (aside := folder.with_name(f"{folder.name}.old-{number}")).exists():
        number += 1
    return folder.rename(aside)


def _is_another(folder: Path, recipe: Preset, data: Mapping[str, Any]) -> bool:
    """Whether a training lies in this folder that is of another recipe, other data or code."""
    if not (folder / LAST).is_file():
        return False
    found = read_record(folder / LAST)
    asked = json.loads(json.dumps(plain({"preset": recipe.to_dict(), "data": data})))
    return bool({name: found.get(name) for name in asked} != asked)

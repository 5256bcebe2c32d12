"""The same trained networks under other conditions: predicted masks, predicted keypoints, sensor.

Nothing is trained here. A condition of a run is measured once and kept beside its row, as
``OUT/known/hadr/seed-0/given/PREDICTED-MASK.json``. The bundled segmentation and keypoint networks
predict, or OUT's own; what they find is given to all methods alike. The score is on the true mask's
pixels.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from hadr.data.samples import samples_dir
from hadr.experiments.averages import paired, standard_error
from hadr.experiments.protocol import Experiment
from hadr.experiments.runner import Bench, Run, code_of
from hadr.experiments.scoring import EVALUATION_SIZE, score_cheap, score_network
from hadr.experiments.systems import PARTS
from hadr.models.networks import RIVALS
from hadr.records.caches import file_sha256
from hadr.records.provenance import provenance
from hadr.records.result_file import digest, seal_row, sealed_row
from hadr.training.checkpoints import load_checkpoint
from hadr.training.frames.batches import FrameTensors
from hadr.training.frames.predicted import load_given
from hadr.training.recipe import Given
from hadr.training.training_folder import LAST


def _checkpoints() -> Path:
    """The bundled networks' folder; where there are no samples, a name that opening them tells."""
    try:
        return samples_dir() / "checkpoints"
    except FileNotFoundError:
        return Path("data_samples") / "checkpoints"


CHECKPOINTS = _checkpoints()
FINDERS = "segmentation", "hand-keypoints"
TRUE = "all true"
BOTH = "predicted mask and keypoints"


def keypoints_given(bench: Bench) -> dict[str, Given]:
    """What the table of keypoints compares, by its words."""
    _, hands = _finders(bench, "known")
    return {TRUE: Given(), "predicted keypoints": Given(keypoints=hands)}


def masks_given(bench: Bench) -> dict[str, Given]:
    """What the table of masks compares; no sensor was simulated for preset imagenet's frames."""
    masks, hands = _finders(bench, "known")
    found = {
        TRUE: Given(),
        "predicted mask": Given(masks=masks),
        "simulated sensor": Given("sensor"),
        BOTH: Given(masks=masks, keypoints=hands),
        f"simulated sensor, {BOTH}": Given("sensor", masks, hands),
    }
    near = bench.size == "imagenet"
    return {n: given for n, given in found.items() if not (near and given.corruption == "sensor")}


def all_given(bench: Bench) -> dict[str, Given]:
    """All true, or all predicted: what the table of the ablation compares."""
    masks, hands = _finders(bench, "known")
    return {TRUE: Given(), BOTH: Given(masks=masks, keypoints=hands)}


def unknown_given(bench: Bench) -> dict[str, Given]:
    """What is compared on unknown objects: nothing, where no finders of OUT are strangers to them.

    The bundled ones have learned from all eight objects.
    """
    masks, hands = _finders(bench, "unknown")
    return {} if not (Path(masks).is_file() and Path(hands).is_file()) else {
        TRUE: Given(),
        "predicted mask": Given(masks=masks),
        "predicted keypoints": Given(keypoints=hands),
        BOTH: Given(masks=masks, keypoints=hands),
    }  # fmt: skip


def _finders(bench: Bench, experiment: Experiment) -> tuple[str, str]:
    """Those that find masks and keypoints: of preset imagenet OUT's own, if it has them.

    Such have learned from that preset's training frames, that of keypoints before from those of
    `mini`. Else the bundled ones, but for unknown objects.
    """
    strangers = experiment == "unknown"
    home = bench.out / "nets" / ("unknown" if strangers else "")
    own = [home / kind / LAST for kind in FINDERS]
    is_own = strangers or (bench.size == "imagenet" and all(path.is_file() for path in own))
    bundled = [CHECKPOINTS / f"{kind}-imagenet.safetensors" for kind in FINDERS]
    masks, hands = map(str, own if is_own else bundled)
    return masks, hands


LONG = ("hadr-long", "unet-hand-long", "hadr-plus-long")
WITH_HAND = ("hand-median", "hadr", "unet-hand", "hadr-plus", *LONG)
"""Methods that are given keypoints."""
IN_CONDITIONS = ("hand-median", "hadr", *RIVALS, "unet-hand", "hadr-plus", *LONG)
"""Methods that the tables of conditions have."""
CONDITION_TABLES: Mapping[
    str, tuple[Experiment, Callable[[Bench], dict[str, Given]], Sequence[str]]
] = {
    "segmentation": ("known", masks_given, IN_CONDITIONS),
    "keypoints": ("known", keypoints_given, WITH_HAND),
    "ablation_predicted": ("known", all_given, (*PARTS, "hadr")),
    "unknown_predicted": ("unknown", unknown_given, IN_CONDITIONS),
}
"""The tables of conditions: on which objects, what is given, and which methods they have."""


def condition_of(run: Run, name: str) -> Path:
    """Where a condition's row lies, below the folder of all runs."""
    words = name.upper().replace(",", "").replace(" ", "-")
    return Path(run.name) / "given" / f"{words}.json"


def measure_condition(bench: Bench, run: Run, name: str, given: Given) -> dict[str, Any]:
    """Score a finished run under another condition, or read what was measured."""
    found = finished_condition(bench, run, name, given)
    if found is not None:
        return found
    finished = bench.finished(run)
    if finished is None:
        raise ValueError(f"{run.name} is not finished: its network can't be scored as {name!r}")
    started = time.perf_counter()
    truth = condition_frames(bench, run, EVALUATION_SIZE, given)
    if run.method == "hand-median":
        scores = score_cheap(truth, "hand-median")
    else:
        model, meta = load_checkpoint(bench.out / run.name / LAST)
        if meta["epochs"] != finished["epochs"]:
            raise ValueError(
                f"{run.name} has a row after {finished['epochs']} epochs and a network after "
                f"{meta['epochs']}: delete its folder, or wait for the process that trains it"
            )
        size = (int(meta["width"]), int(meta["height"]))
        scores = score_network(model.eval(), condition_frames(bench, run, size, given), truth)
    found_mask, true = truth.inputs.mask, truth.object_mask
    overlap = (found_mask & true).sum((1, 2)) / (found_mask | true).sum((1, 2)).clamp(min=1)
    seen = (truth.inputs.keypoints != 0).flatten(1).any(dim=1)
    apart = (truth.inputs.keypoints - truth.true_keypoints).norm(dim=-1)[seen]
    row = {
        "method": run.method,
        "split": run.experiment,
        "seed": run.seed,
        "given": name,
        **given.record(),
        **scores.columns(),
        "mask_iou": float(overlap.mean()),
        "keypoints_m": float(apart.mean()),
        "evaluation_s": time.perf_counter() - started,
        "config_sha256": digest(configuration(bench, run, name, given)),
        "per_frame": scores.per_frame(),
        "provenance": provenance(),
    }
    return seal_row(bench.out / condition_of(run, name), row)


def finished_condition(bench: Bench, run: Run, name: str, given: Given) -> dict[str, Any] | None:
    """Give a condition's row if it was measured with this configuration, else None."""
    path = bench.out / condition_of(run, name)
    return sealed_row(path, configuration(bench, run, name, given)) if path.exists() else None


def configuration(bench: Bench, run: Run, name: str, given: Given) -> dict[str, Any]:
    """Everything on which a condition's numbers depend."""
    return {
        **bench.configuration(run),
        "scored_by": code_of(None, "hadr.experiments.conditions"),
        "row": (bench.finished(run) or {}).get("sha256"),  # another training is another condition
        "given": name,
        "corruption": given.corruption,
        "predicted_by": [
            file_sha256(Path(path)) for path in (given.masks, given.keypoints) if path != "true"
        ],
    }


def condition_frames(bench: Bench, run: Run, size: tuple[int, int], given: Given) -> FrameTensors:
    """Read a run's test frames under a condition; what they were read from is kept by the bench.

    Depth within the mask that is given is erased, as `hadr restore` does.
    """

    def load() -> FrameTensors:
        frames = load_given(bench.source(run, "test"), size, given, keep_all=True)
        depth = torch.where(frames.inputs.mask, 0.0, frames.inputs.depth)
        return replace(frames, inputs=replace(frames.inputs, depth=depth))

    return bench.kept((run.experiment, given, size), load)


def condition_rows(
    bench: Bench, table: str, holds: Mapping[str, Sequence[str]]
) -> list[dict[str, Any]]:
    """Gather the finished rows of a table of conditions, the methods in the tables' order.

    Each has ``against_true``: the same method compared, frame by frame, with itself when all is
    true, and ``against_hadr``: with HADR under the same condition. `holds` are the holds of each
    experiment's test frames.
    """
    experiment, given_by, methods = CONDITION_TABLES[table]
    conditions, groups = given_by(bench), holds.get(experiment)
    found = {}
    for method in methods:
        run = Run(experiment, method, _first_seed(bench, experiment, method))
        found[method] = {n: finished_condition(bench, run, n, g) for n, g in conditions.items()}
    rows = []
    for method, measured in found.items():
        for name, row in measured.items():
            if row is None:
                continue
            frames = row["per_frame"]
            left_out = ("per_frame", "sha256")
            shown = {key: value for key, value in row.items() if key not in left_out}
            shown["rmse_standard_error_m"] = standard_error(
                frames["rmse_m"], groups or frames["stems"]
            )
            if (reference := measured[TRUE]) is not None and row is not reference:
                shown["against_true"] = paired(frames, reference["per_frame"], groups)
            other = found.get("hadr", {}).get(name)
            if method != "hadr" and other is not None:
                shown["against_hadr"] = _with_median(frames, other["per_frame"], groups)
            rows.append(shown)
    return rows


def _with_median(
    own: Mapping[str, Any], reference: Mapping[str, Any], holds: Sequence[str] | None
) -> dict[str, Any]:
    """Compare as `paired`, with the median difference: one lost frame does not move it."""
    gaps = [mine - its for mine, its in zip(own["rmse_m"], reference["rmse_m"], strict=True)]
    return {**paired(own, reference, holds), "median_difference_m": statistics.median(gaps)}


def _first_seed(bench: Bench, experiment: Experiment, method: str) -> int:
    """The smallest seed with which a method was trained; 0 where it was not."""
    names = [path.parent.name for path in bench.out.glob(f"{experiment}/{method}/seed-*/given")]
    numbers = [int(name[5:]) for name in names if name[5:].isdigit()]
    return min(numbers, default=0)


def conditions_of(runs: Sequence[Run], bench: Bench) -> list[tuple[Run, str, Given]]:
    """List the conditions that the tables need of some runs, each once, of the first seed alone."""
    seeds = {(run.experiment, run.method): run.seed for run in reversed(runs)}
    wanted = {
        (experiment, name, method): given
        for experiment, given_by, methods in CONDITION_TABLES.values()
        for name, given in given_by(bench).items()
        for method in methods
        if (experiment, method) in seeds
    }
    order = [(experiment, name) for experiment, name, _ in wanted]
    return [
        (Run(experiment, method, seeds[experiment, method]), name, given)
        for (experiment, name, method), given in sorted(
            wanted.items(), key=lambda item: order.index(item[0][:2])
        )
    ]

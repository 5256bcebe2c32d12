"""The same four trials for each network: its published schedule, and a cosine at three rates.

    python benchmarks/networks/tune.py --data DIR data_samples/frames \\
        --json results/mini/tuning.json

DIR is what `hadr generate --preset mini` has made. A trial trains the network of preset `mini` on
part of the training frames for a third of its epochs, and is scored on validation frames. Of the
two objects that the tables keep unknown not a frame is read, and of the others no test frame. A
trial that the file has is kept (`switches.run`), so a stopped run goes on.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from switches import Bench, Change, Frames, run

from hadr.experiments.protocol import open_part
from hadr.experiments.scoring import EVALUATION_SIZE, score_network
from hadr.models.hadr import HADRConfig
from hadr.training.loop import train
from hadr.training.presets import preset
from hadr.training.recipe import Preset

PUBLISHED: dict[str, dict[str, Any]] = {
    "hadr": {"schedule": "step"},
    "lidf": {"schedule": "step"},
    "dfnet": {"schedule": "step", "milestones": (5 / 40, 15 / 40, 25 / 40, 35 / 40), "decay": 0.2},
    "swindrnet": {"learning_rate": 1e-4},
    "tode": {"schedule": "step", "milestones": (20 / 40, 30 / 40, 35 / 40)},
    "unet-hand": {"schedule": "step"},
}
"""What makes preset `mini` the published schedule; the U-Net, published nowhere, has HADR's."""
RATES = {"cosine, third of the rate": 1 / 3, "cosine": 1.0, "cosine, three times the rate": 3.0}
TRIALS = ("published", *RATES)
FINE = "cosine, patches of 2 pixels"
"""A trial of HADR alone: does its backbone see too little with patches of 4 pixels?"""
FASTER = "cosine, ten times the rate"
"""A trial of DFNet alone, whose best rate was the highest of those that all had."""
MORE = {"hadr": (FINE,), "dfnet": (FASTER,)}
"""Trials that one network alone had."""


def recipe_of(change: Change, epochs: int) -> Preset:
    """Give the recipe of a trial."""
    network, trial = change.turned.split(", ", 1)
    recipe = preset("mini", network)
    drop = round(recipe.drop_epoch / recipe.epochs * epochs)
    true_voxel = min(recipe.true_voxel_epochs, 1)
    recipe = replace(recipe, epochs=epochs, drop_epoch=drop, true_voxel_epochs=true_voxel)
    if trial == "published":
        return replace(recipe, **{"learning_rate": 1e-3, **PUBLISHED[network]})
    if trial == FINE:
        assert isinstance(recipe.model, HADRConfig)
        small = {"embed_dim": 24, "depths": (1, 1, 2, 1), "heads": (1, 2, 4, 8)}  # the same time
        backbone = replace(recipe.model.backbone, patch=2, **small)  # type: ignore[arg-type]
        return replace(recipe, model=replace(recipe.model, backbone=backbone))
    rate = 1e-2 if trial == FASTER else 1e-3 * RATES[trial]
    whole = round(2 / 3 * epochs)  # LIDF's second stage begins with an epoch
    restarts = (whole / epochs,) if network == "lidf" else ()
    return replace(
        recipe,
        schedule="cosine",
        milestones=(),
        learning_rate=rate,
        restarts=restarts,
    )


def trial_row(change: Change, seed: int, recipe: Preset, frames: Frames) -> dict[str, Any]:
    """Train one trial and score it."""
    began = time.perf_counter()
    trained = train(recipe, frames.read("learned", recipe.size), seed=seed)
    seconds = time.perf_counter() - began
    given, truth = (frames.read("others", size) for size in (recipe.size, EVALUATION_SIZE))
    return {
        "network": recipe.network,
        "trial": change.turned.split(", ", 1)[1],
        "learning_rate": recipe.learning_rate,
        **score_network(trained.model, given, truth).columns(),
        "training_s": round(seconds, 1),
    }


FRAMES = 1000
"""Training frames of a trial."""
BENCH = Bench(
    f"Networks of preset mini trained for {{}} epochs on {FRAMES} of the training frames of six "
    "objects and scored on their validation frames: means over frames, metres; one seed; the "
    "published schedule is squeezed into the trial",
    recipe_of,
    [
        (Change(f"{name}, {trial}"), 0)
        for name in PUBLISHED
        for trial in (*TRIALS, *MORE.get(name, ()))
    ],
    trial_row,
    epochs=4,
)


def main() -> None:
    """Run the trials."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, nargs="+", required=True)
    parser.add_argument("--epochs", type=int)
    parser.add_argument("--json", type=Path, required=True, help="file of the results")
    args = parser.parse_args()
    parts = (open_part(args.data, "unknown", part) for part in ("train", "val"))
    run(BENCH, Frames(args.data, *parts, most=FRAMES), args.json, args.epochs)


if __name__ == "__main__":
    main()

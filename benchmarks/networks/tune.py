"""The same four trials for each network: its published schedule, and a cosine at three rates.

    python benchmarks/networks/tune.py --data DIR data_samples/frames --out ROWS \\
        --json results/mini/tuning.json

DIR is what `hadr generate --preset mini` has made. A trial trains the network of preset `mini` on
part of the training frames for a third of its epochs, and is scored on validation frames. Of the
two objects that the tables keep unknown not a frame is read, and of the others no test frame. A
trial that is finished in ROWS is kept, so a stopped run goes on, and several processes can share
the work (`--networks`).
"""

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from hadr.data.folders import data_digest
from hadr.experiments.protocol import Part, open_part
from hadr.experiments.runner import code_of
from hadr.experiments.scoring import EVALUATION_SIZE, score_network
from hadr.models.hadr import HADRConfig
from hadr.records.provenance import plain, provenance, write_json
from hadr.records.result_file import digest, write_result_file
from hadr.training.frames.batches import FrameTensors, load_frames
from hadr.training.loop import evenly, train
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


def recipe_of(network: str, trial: str, epochs: int) -> Preset:
    """Give the recipe of a trial."""
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


def measure(recipe: Preset, train_frames: FrameTensors, val: Any, truth: Any) -> dict[str, Any]:
    """Train one trial and score it."""
    began = time.perf_counter()
    trained = train(recipe, train_frames, seed=0)
    seconds = time.perf_counter() - began
    return {**score_network(trained.model, val, truth).columns(), "training_s": round(seconds, 1)}


def main() -> None:
    """Run the trials."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, nargs="+", required=True)
    parser.add_argument("--epochs", type=int, default=4)
    parser.add_argument("--frames", type=int, default=1000, help="training frames of a trial")
    parser.add_argument("--networks", nargs="+", default=list(PUBLISHED), choices=PUBLISHED)
    parser.add_argument("--out", type=Path, required=True, help="a file for each finished trial")
    parser.add_argument("--json", type=Path, help="the result, once all trials are finished")
    args = parser.parse_args()
    torch.set_num_threads(1)
    data = digest([data_digest(root) for root in args.data])
    args.out.mkdir(parents=True, exist_ok=True)
    frames: dict[tuple[str, tuple[int, int]], FrameTensors] = {}

    def part(name: Part, size: tuple[int, int]) -> FrameTensors:
        if (name, size) not in frames:
            source = open_part(args.data, "unknown", name)
            loaded = load_frames(source, size, keep_all=name == "val")
            frames[name, size] = evenly(loaded, args.frames) if name == "train" else loaded
        return frames[name, size]

    rows = []
    for network in PUBLISHED:
        for trial in (*TRIALS, *MORE.get(network, ())):
            recipe = recipe_of(network, trial, args.epochs)
            code = code_of(recipe.network, "hadr.experiments.runner")
            sha = digest([recipe.to_dict(), data, args.frames, code])
            path = args.out / f"{network}-{trial.replace(' ', '-').replace(',', '')}.json"
            done = json.loads(path.read_text()) if path.exists() else None
            if done is None or done["config_sha256"] != sha:
                if network not in args.networks:
                    continue
                val, truth = part("val", recipe.size), part("val", EVALUATION_SIZE)
                done = {
                    "network": network,
                    "trial": trial,
                    "learning_rate": recipe.learning_rate,
                    **measure(recipe, part("train", recipe.size), val, truth),
                    "config_sha256": sha,
                }
                write_json(path, plain(done))
            print(f"{network}, {trial}: {done['rmse_m']:.4f} m", flush=True)
            rows.append(done)
    if args.json is None or len(rows) < len(PUBLISHED) * len(TRIALS) + sum(map(len, MORE.values())):
        return
    write_result_file(
        args.json,
        f"Networks of preset mini trained for {args.epochs} epochs on {args.frames} of the "
        "training frames of six objects and scored on their validation frames: means over frames, "
        "metres; one seed; the published schedule is squeezed into the trial",
        rows,
        {**provenance(), "data": {"sha256": data}, "seed": 0},
    )


if __name__ == "__main__":
    main()

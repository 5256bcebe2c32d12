"""Each of HADR-plus's changes taken out once: a short training each, scored on validation frames.

    python benchmarks/ablate_plus.py --data DIR data_samples/frames \\
        --out ROWS --json results/mini/hadr-plus-ablation.json

DIR is what `hadr generate --preset mini` has made. All trainings have the same seed, steps and
schedule, that of preset `mini` squeezed into `--epochs`. A row that is finished in ROWS is kept
while recipe and data are the same, so a stopped run goes on, and two processes can share the
work (`--rows`). No test frame is read.
"""

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from hadr.experiments.averages import paired
from hadr.experiments.protocol import data_digest, open_part
from hadr.experiments.runner import code_of
from hadr.experiments.scoring import EVALUATION_SIZE, score_network
from hadr.models.hadr_plus import HADRPlusConfig
from hadr.records.provenance import machine_text, provenance, write_json
from hadr.records.result_file import digest, write_result_file
from hadr.training.frames.batches import load_frames
from hadr.training.loop import train
from hadr.training.presets import preset
from hadr.training.recipe import Preset

ROWS: dict[str, dict[str, Any]] = {
    "full": {},
    "no plane": {"plane": False},
    "no hand vector": {"hand_vector": False},
    "no keypoint maps": {"keypoint_maps": False},
    "no hand at all": {"hand_vector": False, "keypoint_maps": False},
    "no depth relative to the hand's": {"hand_depth": False},
    "no metric crop": {"metric_crop": False},
    "one candidate": {"candidates": 1},
    "no colour": {"color": False},
    "no mirror, no roll": {"mirror": 0.0, "roll_deg": 0.0},
    "stretched scenes added": {"stretch": 1.2},
}
"""What each row changes in the network or in its training."""


def recipe_of(changes: dict[str, Any], epochs: int) -> Preset:
    """Give the recipe of a row."""
    recipe = preset("mini", "hadr-plus")
    assert isinstance(recipe.model, HADRPlusConfig)
    own = {name: value for name, value in changes.items() if hasattr(recipe, name)}
    rest = {name: value for name, value in changes.items() if name not in own}
    return replace(recipe, epochs=epochs, **own, model=replace(recipe.model, **rest))


def measure(name: str, recipe: Preset, parts: dict[str, Any]) -> dict[str, Any]:
    """Train one row and score it."""
    began = time.perf_counter()
    trained = train(recipe, parts["train"], seed=0)
    seconds = time.perf_counter() - began
    scores = score_network(trained.model, parts["val"], parts["truth"])
    row = {
        "network": name,
        "out": ROWS[name],
        "parameters": sum(p.numel() for p in trained.model.parameters()),
        "training_s": round(seconds, 1),
        **scores.columns(),
        "per_frame": scores.per_frame(),
    }
    print(f"{name}: {row['rmse_m']:.4f} m after {seconds:.0f} s", flush=True)
    return row


def main() -> None:
    """Run the ablation."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, nargs="+", required=True)
    parser.add_argument("--epochs", type=int, default=4)
    parser.add_argument("--rows", nargs="+", default=list(ROWS), choices=ROWS)
    parser.add_argument("--out", type=Path, required=True, help="a file for each finished row")
    parser.add_argument("--json", type=Path, help="the result, once all rows are finished")
    args = parser.parse_args()
    torch.set_num_threads(1)
    data = digest([data_digest(root) for root in args.data])
    parts: dict[str, Any] = {}
    for name in args.rows:
        recipe = recipe_of(ROWS[name], args.epochs)
        code = code_of("hadr.experiments.runner", recipe.network)
        sha = digest([recipe.to_dict(), data, EVALUATION_SIZE, code])
        path = args.out / f"{name.replace(' ', '-')}.json"
        if path.exists() and json.loads(path.read_text())["config_sha256"] == sha:
            continue
        if not parts:
            size = (recipe.width, recipe.height)
            val = open_part(args.data, "known", "val")
            parts = {
                "train": load_frames(open_part(args.data, "known", "train"), size),
                "val": load_frames(val, size, keep_all=True),
                "truth": load_frames(val, EVALUATION_SIZE, keep_all=True),
            }
        args.out.mkdir(parents=True, exist_ok=True)
        write_json(path, {**measure(name, recipe, parts), "config_sha256": sha})
    files = [args.out / f"{name.replace(' ', '-')}.json" for name in ROWS]
    if args.json is None or not all(path.exists() for path in files):
        return
    rows = [json.loads(path.read_text()) for path in files]
    frames = [row.pop("per_frame") for row in rows]
    holds = open_part(args.data, "known", "val").holds(frames[0]["stems"])
    for row, own in zip(rows, frames, strict=True):
        row["against_full"] = paired(own, frames[0], holds)
    write_result_file(
        args.json,
        f"HADR-plus of preset mini trained for {args.epochs} epochs on the known objects' "
        "training frames, one part taken out, scored on their validation frames (means over "
        "frames, metres); one seed",
        rows,
        {**provenance(), "machine": machine_text(), "data": {"sha256": data}, "seed": 0},
    )


if __name__ == "__main__":
    main()

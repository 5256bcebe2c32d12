"""Each network of preset `mini` learns four frames by heart.

    python benchmarks/networks/overfit.py --json results/training/overfit.json

A network that cannot has a fault that no amount of data heals. Chance is off (augmentation,
stochastic depth), each step sees all four frames, and the learned network is scored in evaluation
mode. DFNet and SwinDRNet then learn on with their batch normalisation as it is in evaluation: what
it computes from four small pictures differs by millimetres from what it keeps of them. Goals:
depth 2 mm (mean absolute error), keypoints 3 mm, masks 0.98 intersection over union.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch.nn.functional import interpolate

from hadr.data.samples import open_samples
from hadr.models.hadr import HADR
from hadr.models.network_input import ray_points
from hadr.models.networks import NETWORKS, RIVALS
from hadr.ray_voxels import pair_of_true_point
from hadr.records.provenance import provenance
from hadr.records.result_file import read_result_file, write_result_file
from hadr.rivals.lidf import LIDF
from hadr.rivals.swindrnet import SwinDRNet
from hadr.training.frames.batches import FrameTensors, load_frames
from hadr.training.loop import train
from hadr.training.presets import preset
from hadr.training.recipe import Preset
from hadr.training.tasks.task import Task

GOALS: dict[str, tuple[str, float]] = {
    "hadr": ("validation_mae_m", 0.002),
    "hadr-plus": ("validation_mae_m", 0.002),
    "unet-hand": ("validation_mae_m", 0.002),
    **dict.fromkeys(RIVALS, ("validation_mae_m", 0.002)),
    "hand-keypoints": ("validation_keypoints_m", 0.003),
    "segmentation": ("validation_iou_missing", 0.02),
}
"""Of each network the number that counts, and how small it shall become."""
STEPS = dict.fromkeys(("hadr", "lidf", "dfnet", "swindrnet"), 2000)
"""Networks that need more steps than 600: after those HADR is at 4 mm, DFNet and SwinDRNet at 6."""

FROZEN_STEPS = {"dfnet": 2000, "swindrnet": 600}
"""Networks that learn on with frozen batch normalisation, and for how many steps."""


def without_chance(recipe: Preset, steps: int) -> Preset:
    """Give the recipe that sees the same four frames in every step."""
    return replace(
        recipe, model=calm(recipe.model), epochs=steps, batch_size=4, ray_stride=1,
        schedule="cosine", milestones=(), restarts=(2 / 3,) if recipe.network == "lidf" else (),
        learning_rate=2e-3, warmup_epochs=10, true_voxel_epochs=steps // 3, augment=False,
        mirror=0.0, zoom=1.0, roll_deg=0.0, average_decay=None, precision="32-true",
    )  # fmt: skip


def calm(config: Any) -> Any:
    """Give a network's configuration without stochastic depth, dropout and perturbed ends."""
    off: dict[str, Any] = {
        name: 0.0
        for name in ("drop_path", "dropout", "perturb_probability")
        if hasattr(config, name)
    }
    if hasattr(config, "backbone"):
        off["backbone"] = calm(config.backbone)
    return replace(config, **off)


def learn(network: str, steps: int) -> dict[str, object]:
    """Train a network on four frames of different objects and score it on them."""
    recipe = without_chance(preset("mini", network), steps)
    samples = open_samples("train")
    frames = load_frames([samples[number * len(samples) // 4] for number in range(4)], recipe.size)
    began = time.perf_counter()
    trained = train(recipe, frames, seed=0)
    more = FROZEN_STEPS.get(network, 0)
    before = Task(recipe).validate(trained.model, frames, 4)
    learn_frozen(recipe, trained.model, frames, more)
    seconds = time.perf_counter() - began
    scores = Task(recipe).validate(trained.model, frames, 4)
    if isinstance(trained.model, HADR | LIDF):
        scores |= where_a_voxel_is(trained.model, frames)
    if isinstance(trained.model, SwinDRNet):
        scores["least_mae_of_its_grid_m"] = least_error_of_a_quarter(frames)
    name, goal = GOALS[network]
    row: dict[str, object] = {
        "network": network,
        "commit": provenance().get("commit"),
        "steps": steps,
        "seconds": seconds,
        "counts": name,
        "reached": scores[name],
        "goal": goal,
        "is_reached": scores[name] <= goal,
        **scores,
        **({"frozen_steps": more, "before_frozen": before[name]} if more else {}),
    }
    print(f"{network}: {name} {scores[name]:.4f} after {steps} steps, goal {goal}", flush=True)
    return row


def learn_frozen(recipe: Preset, model: torch.nn.Module, frames: FrameTensors, steps: int) -> None:
    """Let a network learn on in evaluation mode, its rate falling from 5e-4 to 0."""
    task, batch = Task(recipe), frames.take(range(len(frames)))
    optimizer = torch.optim.Adam(model.parameters(), lr=5e-4)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, max(steps, 1))
    generator = torch.Generator().manual_seed(0)
    model.eval()
    for _ in range(steps):
        loss = task.losses(model, batch, recipe.epochs, generator)["loss"]
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        schedule.step()


def least_error_of_a_quarter(frames: FrameTensors, steps: int = 1500) -> float:
    """Find the least mean absolute error, metres, of depth images of a quarter of the size.

    SwinDRNet's heads answer at a quarter of the picture's width and height, and their answer is
    enlarged: not even the best one follows a rim. The error of such an image is convex in its
    pixels, so gradient steps find the least.
    """
    true, mask = frames.true_depth, frames.object_mask & (frames.true_depth > 0)
    height, width = true.shape[1:]
    coarse = torch.full((len(frames), 1, -(-height // 4), -(-width // 4)), 0.6, requires_grad=True)
    optimizer = torch.optim.Adam([coarse], lr=0.02)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    error = torch.zeros(())
    for _ in range(steps):
        miss = (
            interpolate(coarse, (height, width), mode="bilinear", align_corners=False)[:, 0] - true
        ).abs()
        error = torch.stack(
            [one[there].mean() for one, there in zip(miss, mask, strict=True)]
        ).mean()
        optimizer.zero_grad()
        error.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        schedule.step()
    return float(error.detach())


def where_a_voxel_is(model: HADR | LIDF, frames: FrameTensors) -> dict[str, float]:
    """Measure HADR or LIDF on rays with their true voxel among the candidates, and count them.

    Only voxels in which something was measured are candidates; on the other rays the network cannot
    be right, however well it has learned.
    """
    with torch.no_grad():
        output = model(frames.inputs)
    frame, row, column = output.rays.unbind(dim=1)
    truth = frames.true_depth[frame, row, column]
    points = ray_points(output.rays, truth, frames.inputs.intrinsics)
    pair = pair_of_true_point(output.pairs, output.occupied, points, model.config.grid)
    error = (output.depth[frame, row, column] - truth).abs()
    return {
        "mae_where_true_voxel_m": float(error[pair >= 0].mean()),
        "share_with_true_voxel": float((pair >= 0).float().mean()),
    }


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, help="file of the results")
    parser.add_argument("--networks", nargs="+", default=list(NETWORKS), choices=NETWORKS)
    parser.add_argument("--steps", type=int, help="of each network (600; HADR 2000)")
    parser.add_argument("--threads", type=int, default=torch.get_num_threads())
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    rows = [learn(network, args.steps or STEPS.get(network, 600)) for network in args.networks]
    if args.json:
        if args.json.exists():  # rows of networks that were not asked for are kept
            kept = read_result_file(args.json).rows
            rows += [row for row in kept if row["network"] not in args.networks]
            rows.sort(key=lambda row: list(NETWORKS).index(str(row["network"])))
        write_result_file(
            args.json,
            "four frames of data_samples learned by heart, preset mini, scored in evaluation mode",
            rows,
            {**provenance(), "threads": args.threads},
        )


if __name__ == "__main__":
    main()

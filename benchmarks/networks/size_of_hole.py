"""Do the networks measure distance by the size of the hole? The hole grows and shrinks.

    python benchmarks/networks/size_of_hole.py --runs OUT/runs --data DIR data_samples/frames \\
        --json results/mini/size_of_hole.json

OUT and DIR are what `hadr reproduce --preset mini` and `hadr generate --preset mini` have made. The
hole that a glass leaves in the depth is made wider or narrower all round by a share of its radius
(the radius of the disc of the same area); a pixel that no longer lies in it takes the depth of the
nearest one outside. Colours and hand stay. Who takes a larger hole for a nearer glass then places
the glass nearer: of two equal glasses the one whose picture is 1 + s times as wide stands at
1 / (1 + s) of the distance. As a control, what the widest hole adds is cut elsewhere and the
glass's own stays. Measured is by how much the median depth moves over the pixels that lie in all
holes; frames in which fewer than 20 of them are left are not counted. A step of less than a pixel
changes nothing, so each row says by how much the holes did grow in the mean (the square root of
the areas' ratio, minus 1). A network that looks through a window keeps the window of the true hole.
HADR-plus lays its crop around the hole that it is given, and mostly does not see what is cut
elsewhere.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import torch
from finished_runs import arguments, open_runs, trained, write_rows
from torch import Tensor

from hadr.experiments.averages import standard_error
from hadr.experiments.systems import LEARNED, LONGER
from hadr.experiments.tables import TABLES
from hadr.rivals.classical import nearest_valid
from hadr.training.evaluation import predict
from hadr.training.frames.augmentation import through_view
from hadr.training.frames.batches import FrameTensors
from hadr.training.loop import evenly

SHARES = (-0.25, -0.15, 0.15, 0.25, 0.35)
"""By which share of its radius the hole grows or shrinks."""
LEAST_PIXELS = 20

Bools = npt.NDArray[np.bool_]


def resized(mask: Bools, share: float) -> Bools:
    """Grow or shrink a mask all round by a share of its radius, shape (H, W)."""
    step = share * np.sqrt(mask.sum() / np.pi)
    outside = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    inside = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    grown: Bools = outside <= step if share >= 0 else inside > -step
    return grown


def with_holes(frames: FrameTensors, share: float) -> FrameTensors:
    """Give each frame a hole that is wider or narrower."""
    inputs = frames.inputs
    masks, depths = [], []
    for mask, depth in zip(inputs.mask.numpy(), inputs.depth.numpy(), strict=True):
        hole = resized(mask, share)
        filled = np.where(hole, 0, nearest_valid(depth, mask & ~hole)) if share < 0 else depth
        masks.append(hole)
        depths.append(np.where(hole, 0, filled).astype(np.float32))
    return _given(frames, masks, depths)


def with_hole_elsewhere(frames: FrameTensors) -> FrameTensors:
    """Cut what the widest hole adds half a picture aside, and leave the glass's own as it is."""
    inputs = frames.inputs
    masks, depths = [], []
    for mask, depth in zip(inputs.mask.numpy(), inputs.depth.numpy(), strict=True):
        added = np.roll(resized(mask, max(SHARES)) & ~mask, mask.shape[1] // 2, axis=1)
        masks.append(mask | added)
        depths.append(np.where(added, 0, depth).astype(np.float32))
    return _given(frames, masks, depths)


def _given(
    frames: FrameTensors, masks: Sequence[Bools], depths: Sequence[npt.NDArray[np.float32]]
) -> FrameTensors:
    mask, depth = torch.from_numpy(np.stack(masks)), torch.from_numpy(np.stack(depths))
    return replace(frames, inputs=replace(frames.inputs, mask=mask, depth=depth))


def grown(frames: FrameTensors, other: FrameTensors) -> float:
    """By which share the holes' radius has grown, the mean over the frames."""
    before, after = (one.inputs.mask.flatten(1).sum(dim=1) for one in (frames, other))
    return float(((after / before).sqrt() - 1).mean())


def median_depths(model: torch.nn.Module, frames: FrameTensors, cores: Tensor) -> list[float]:
    """Median restored depth over each frame's core, metres; NaN where nothing is restored."""
    depth = torch.cat([output.depth.cpu() for output in predict(model, frames)])
    listed = []
    for one, core in zip(depth, cores, strict=True):
        known = one[core & (one > 0)]
        listed.append(float(known.median()) if len(known) else float("nan"))
    return listed


def measure(
    model: torch.nn.Module, frames: FrameTensors, cores: Tensor, holds: Sequence[str]
) -> dict[str, Any]:
    """Say by how much a network's median depth moves with each hole."""
    own = median_depths(model, frames, cores)

    def moved(other: FrameTensors) -> dict[str, float | None]:
        gaps = {
            number: after - before
            for number, (after, before) in enumerate(
                zip(median_depths(model, other, cores), own, strict=True)
            )
            if np.isfinite(after - before)
        }
        return {
            "moved_m": float(np.mean(list(gaps.values()))),
            "standard_error_m": standard_error(list(gaps.values()), [holds[n] for n in gaps]),
        }

    true = zip(frames.true_depth, cores, strict=True)
    return {
        "frames": len(frames),
        "depth_m": float(np.mean([depth[core & (depth > 0)].median() for depth, core in true])),
        "by_share": [
            {"share": share, "grown": grown(frames, other), **moved(other)}
            for share in SHARES
            for other in [with_holes(frames, share)]
        ],
        "elsewhere": moved(with_hole_elsewhere(frames)),
    }


def main() -> None:
    """Run the benchmark."""
    parser = arguments(__doc__)
    parser.add_argument("--frames", type=int, default=224, help="of each split, evenly spread")
    args = parser.parse_args()
    bench = open_runs(args)
    rows = []
    methods = (*LEARNED, *LONGER)
    for run, recipe, model in chain(*(trained(bench, split, methods) for split in TABLES)):
        frames = evenly(bench.frames(run, "test", recipe.size), args.frames)
        if view := getattr(model.config, "view", None):
            frames = through_view(frames.take(range(len(frames))), view)
            model.config = replace(model.config, view=None)
        cores = [resized(mask, min(SHARES)) for mask in frames.inputs.mask.numpy()]
        counted = [number for number, core in enumerate(cores) if core.sum() >= LEAST_PIXELS]
        frames = frames.take(counted)
        core = torch.from_numpy(np.stack([cores[number] for number in counted]))
        columns = measure(model, frames, core, bench.holds(run.experiment, frames.stems))
        rows.append({"method": run.method, "split": run.experiment, **columns})
        widest = columns["by_share"][-1]["moved_m"]
        print(
            f"{run.name}: a hole wider by {max(SHARES):.0%} moves the glass by {widest:+.4f} m, "
            f"one elsewhere by {columns['elsewhere']['moved_m']:+.4f} m",
            flush=True,
        )
    what = (
        f"By how much the restored median depth of the glass moves on test frames, preset "
        f"{args.preset}, when its hole is wider or narrower by a share of its radius, and when "
        "what the widest adds is cut elsewhere; metres, standard errors over holds"
    )
    write_rows(args.json, what, rows, bench)


if __name__ == "__main__":
    main()

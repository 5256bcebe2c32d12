"""Keep what the networks of finished runs restore of five test frames, for a picture of them all.

    python benchmarks/networks/restored_pictures.py --preset imagenet --runs OUT/runs --data DIR \\
        --near data_samples/near --json results/imagenet/restored.json

Which frames: in the order of HADR's RMSE those below which 5, 25, 50, 75 and 95 % of the others
lie. They are copied as they are into a data folder of their own; the restored depth on the glass
goes into `restored.npz` beside the JSON file, in steps of 0.1 mm, under `METHOD/OBJECT/STEM`.
"""

from __future__ import annotations

import shutil
from dataclasses import fields
from pathlib import Path

import numpy as np
from finished_runs import arguments, finished, open_runs, trained, write_rows

from hadr.data.transhand import FrameFiles, TransHand
from hadr.experiments.runner import Bench, Run
from hadr.experiments.systems import LEARNED, SEEING
from hadr.figures.depth.restored_glass import frames_at
from hadr.metrics import frame_metrics
from hadr.training.evaluation import predict_depth

SHARES = (0.05, 0.25, 0.5, 0.75, 0.95)
STEP_M = 1e-4


def copy_frame(files: FrameFiles, root: Path, near: Path) -> None:
    """Copy a frame's files to the same places below another root."""
    for part in fields(FrameFiles):
        source = getattr(files, part.name)
        if isinstance(source, Path):
            target = near / source.relative_to(root)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, target)


def chosen_frames(bench: Bench) -> list[str]:
    """Choose by the rule above."""
    scored = finished(bench, Run("known", "hadr"))["per_frame"]
    return [scored["stems"][n] for n in frames_at(scored["rmse_m"], SHARES)]


def main() -> None:
    """Run it."""
    parser = arguments(__doc__)
    parser.add_argument("--near", type=Path, help="data folder of the frames")
    parser.add_argument("--frames", nargs="+", metavar="OBJECT/STEM", help="these, by no rule")
    args = parser.parse_args()
    bench = open_runs(args)
    names = args.frames or chosen_frames(bench)
    for root in args.data if args.near else ():
        for files in TransHand(root, "test").files:
            if f"{files.object_id}/{files.stem}" in names:
                copy_frame(files, root, args.near)
    kept, rows = {}, []
    for run, recipe, model in trained(bench, "known", (*LEARNED, *SEEING)):
        frames = bench.frames(run, "test", recipe.size)
        given = frames.take([frames.stems.index(name) for name in names])
        for n, depth in enumerate(predict_depth(model, given)):
            mask, truth = given.object_mask[n].numpy(), given.true_depth[n].numpy()
            steps = np.rint(np.where(mask, depth, 0) / STEP_M)
            kept[f"{run.method}/{names[n]}"] = steps.astype("<u2")
            error = frame_metrics(depth, truth, mask, missing="zero").rmse_m
            rows.append({"method": run.method, "frame": names[n], "rmse_m": error})
        print(run.method, flush=True)
    np.savez_compressed(args.json.with_suffix(".npz"), **kept)
    what = "RMSE of five test frames at their own size, metres, chosen by their place in HADR's"
    write_rows(args.json, what, rows, bench)


if __name__ == "__main__":
    main()

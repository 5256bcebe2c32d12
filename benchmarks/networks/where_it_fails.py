"""Where the trained networks of the tables fail: place or shape, which objects, how new a pose.

    python benchmarks/networks/where_it_fails.py --runs out/runs --data DIR data_samples/frames \\
        --json results/mini/errors.json

`hadr reproduce` has made the runs from the same data folders. Test frames are only looked at here,
after all trainings are done; nothing is chosen by them.
"""

from typing import Any

from finished_runs import arguments, open_runs, write_rows
from frame_errors import frame_error, hand_poses, pose_distance, summary

from hadr.experiments.averages import paired
from hadr.experiments.runner import Bench, Run
from hadr.experiments.scoring import EVALUATION_SIZE, restored_depth, score_network
from hadr.experiments.systems import LEARNED, LONGER, PARTS, SEEING, recipe_of
from hadr.experiments.tables import TABLES
from hadr.rivals.lidf import LIDF
from hadr.training.checkpoints import load_checkpoint
from hadr.training.evaluation import CLASSICAL
from hadr.training.frames.batches import FrameTensors
from hadr.training.loop import evenly
from hadr.training.training_folder import LAST


def row_of(bench: Bench, run: Run) -> dict[str, Any]:
    """Take apart the errors of one run's network, or of the hand's median depth."""
    truth = bench.frames(run, "test", EVALUATION_SIZE)
    recipe = recipe_of(run.method, bench.size)
    more: dict[str, Any] = {}
    if recipe is None:
        restorer = CLASSICAL[run.method]
        depths = [restorer(truth, number) for number in range(len(truth))]
    else:
        model, _ = load_checkpoint(bench.out / run.name / LAST)
        given = bench.frames(run, "test", recipe.size)
        if isinstance(model, LIDF):
            more = {"refinement": what_refinement_does(model, given, truth, bench, run)}
        depths = list(restored_depth(model, given, truth)[0])
        seen = [bench.frames(run, "train", size) for size in (recipe.size, EVALUATION_SIZE)]
        on_training = score_network(model, *(evenly(frames, len(truth)) for frames in seen))
        more["training_frames_rmse_m"] = on_training.columns()["rmse_m"]
    true, masks = truth.true_depth.numpy(), truth.object_mask.numpy()
    shown = [n for n in range(len(truth)) if (masks[n] & (true[n] > 0)).any()]
    errors = [
        frame_error(truth.stems[n].split("/")[0], depths[n], true[n], masks[n]) for n in shown
    ]
    learned = hand_poses(bench.frames(run, "train", EVALUATION_SIZE))
    distance = pose_distance(hand_poses(truth)[shown], learned)
    print(run.name, f"{sum(e.rmse_m for e in errors) / len(errors):.4f} m", flush=True)
    return {"method": run.method, "split": run.experiment, **summary(errors, distance), **more}


def what_refinement_does(
    model: LIDF, given: FrameTensors, truth: FrameTensors, bench: Bench, run: Run
) -> dict[str, Any]:
    """Compare LIDF with its first stage alone, frame by frame, and leave it in stage 2."""
    both = {}
    for stage in (1, 2):
        model.set_stage(stage)
        both[stage] = score_network(model, given, truth)
    holds = bench.holds(run.experiment, both[1].stems)
    return {
        "first_stage_rmse_m": both[1].columns()["rmse_m"],
        "refined_minus_first": paired(both[2].per_frame(), both[1].per_frame(), holds),
    }


def main() -> None:
    """Run the analysis."""
    args = arguments(__doc__).parse_args()
    bench = open_runs(args)
    changed = dict.fromkeys((*PARTS, *SEEING)) if bench.size == "imagenet" else {}
    rows = [
        row_of(bench, run)
        for experiment in TABLES
        for method in dict.fromkeys(("hand-median", *LEARNED, *LONGER, *changed))
        if bench.finished(run := Run(experiment, method)) is not None
    ]
    write_rows(
        args.json,
        "Parts of the depth error on the test frames, means over the frames, metres: place (median "
        "error), shape (what is left without it), tilt (what is left without the best plane); by "
        "object; by thirds of the frames from the nearest to the farthest learned hand pose; what "
        "LIDF's refinement adds to its first stage; the RMSE on as many training frames",
        rows,
        bench,
    )


if __name__ == "__main__":
    main()

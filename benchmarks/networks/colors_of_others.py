"""Do the networks look at the picture? Each restores test frames with another frame's colours.

    python benchmarks/networks/colors_of_others.py --runs OUT/runs --data DIR data_samples/frames \\
        --json results/mini/colors.json

OUT and DIR are what `hadr reproduce --preset mini` and `hadr generate --preset mini` have made. A
network is given a frame's mask, depth and hand, but the colours of the frame half the list away,
which shows another object in another hand. What its error gains is what it had from the colours.
"""

from finished_runs import arguments, open_runs, trained, write_rows

from hadr.experiments.averages import paired
from hadr.experiments.scoring import EVALUATION_SIZE, score_network
from hadr.experiments.systems import ALL_METHODS
from hadr.training.tasks.diagnosis import with_other_colors


def main() -> None:
    """Run the benchmark."""
    args = arguments(__doc__).parse_args()
    bench = open_runs(args)
    rows = []
    for run, recipe, model in trained(bench, "known", ALL_METHODS):
        frames = bench.frames(run, "test", recipe.size)
        truth = bench.frames(run, "test", EVALUATION_SIZE)
        own = score_network(model, frames, truth)
        other = score_network(model, with_other_colors(frames), truth)
        holds = bench.holds("known", own.per_frame()["stems"])
        row = {
            "method": run.method,
            "split": "known",
            "frames": len(truth),
            "rmse_m": own.columns()["rmse_m"],
            "rmse_others_colors_m": other.columns()["rmse_m"],
            "others_minus_own": paired(other.per_frame(), own.per_frame(), holds),
        }
        gap = row["others_minus_own"]
        print(
            f"{run.method}: {row['rmse_m']:.4f} m, with another frame's colours "
            f"{gap['mean_difference_m']:+.4f} +- {gap['standard_error_m']:.4f} m",
            flush=True,
        )
        rows.append(row)
    what = (
        f"RMSE on the test frames of known objects, preset {bench.size}, with each frame's own "
        "colours and with those of another frame (mask, depth and hand stay); differences frame by "
        "frame, standard errors over holds"
    )
    write_rows(args.json, what, rows, bench)


if __name__ == "__main__":
    main()

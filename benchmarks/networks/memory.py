"""What is a memory of the training frames worth, when holds are dealt out whole, and when not?

    python benchmarks/networks/memory.py --preset imagenet --runs OUT/runs --data NEAR \\
        --json results/imagenet/memory.json

OUT and NEAR are what `hadr reproduce --preset imagenet` and `hadr generate` have made. The *nearest
hand* learns nothing and remembers everything: it looks for the training frame whose hand, turned
and shifted rigidly, is most like the one it sees, and puts the glass where it was in that hand.
Beside it stands the same with all frames of the test frame's own hold left out. (It is given true
keypoints, as all methods of the tables are, so it always recognises a sister.) HADR and
HADR-plus were trained on either deal. Test frames are looked at once, after all is trained.
"""

from typing import Any

import numpy as np
import numpy.typing as npt
from finished_runs import arguments, finished, open_runs, write_rows

from hadr.camera import Intrinsics, back_project
from hadr.experiments.averages import paired, standard_error
from hadr.experiments.protocol import Experiment
from hadr.experiments.runner import Run
from hadr.experiments.scoring import EVALUATION_SIZE, Scores, score_depth
from hadr.rivals.classical import nearest_valid
from hadr.training.frames.batches import FrameTensors

SPLITS: tuple[Experiment, ...] = ("known", "by-frame")
NETWORKS = ("hadr", "hadr-plus")
NEAREST = "nearest-hand"
NO_SISTER = "nearest-hand-no-sister"

Array = npt.NDArray[np.float64]


def rigid_fits(hand: Array, others: Array) -> tuple[Array, Array, Array]:
    """Fit the keypoints of M other hands (M, 21, 3) to those of one (21, 3), rigidly; metres.

    Gives rotations (M, 3, 3) and translations (M, 3) that bring the others upon the hand, and the
    root mean square distance that is left, (M,).
    """
    middle, middles = hand.mean(axis=0), others.mean(axis=1)
    near, far = hand - middle, others - middles[:, None]
    u, _, vt = np.linalg.svd(np.einsum("mki,kj->mij", far, near))
    flip = np.ones((len(others), 3))
    flip[:, 2] = np.sign(np.linalg.det(u @ vt))
    rotations = np.einsum("mji,mj,mkj->mik", vt, flip, u)
    left = near - np.einsum("mij,mkj->mki", rotations, far)
    translations = middle - np.einsum("mij,mj->mi", rotations, middles)
    return rotations, translations, np.sqrt((left**2).sum(axis=2).mean(axis=1))


def glass_points(frames: FrameTensors, number: int) -> Array:
    """True points of a frame's glass in the camera frame, shape (n, 3), metres."""
    depth = frames.true_depth[number].numpy()
    fx, fy, cx, cy = (float(value) for value in frames.inputs.intrinsics[number])
    camera = Intrinsics(fx, fy, cx, cy, depth.shape[1], depth.shape[0])
    mask = frames.object_mask[number].numpy() & (depth > 0)
    points: Array = back_project(np.where(mask, depth, 0), camera)[mask].astype(np.float64)
    return points


def nearest_hand(
    train: FrameTensors, test: FrameTensors, left_out: npt.NDArray[np.bool_] | None = None
) -> tuple[Scores, list[int]]:
    """Score the glass put where it was in the most similar hand of the training frames.

    The remembered points, seen from the test camera, the nearest in each pixel; pixels of the mask
    that none of them meets take the depth of the nearest one that is met, and the median of all
    points where none is met. Of training frames that are `left_out`, (test, train) bool, a test
    frame is not reminded. Gives the training frame of each test frame too.
    """
    learned = train.true_keypoints.numpy().astype(np.float64)
    depths = np.zeros(tuple(test.true_depth.shape), np.float32)
    chosen = []
    for number, hand in enumerate(test.true_keypoints.numpy().astype(np.float64)):
        rotations, translations, left = rigid_fits(hand, learned)
        best = int(
            (left if left_out is None else np.where(left_out[number], np.inf, left)).argmin()
        )
        chosen.append(best)
        remembered = glass_points(train, best) @ rotations[best].T + translations[best]
        mask = test.inputs.mask[number].numpy()
        seen = seen_depth(remembered, test.inputs.intrinsics[number].tolist(), mask)
        if seen.any():
            depths[number] = np.where(mask, nearest_valid(seen, mask & (seen == 0)), 0)
        else:
            depths[number][mask] = np.median(remembered[:, 2])
    return score_depth(depths, test), chosen


def seen_depth(
    points: Array, intrinsics: list[float], mask: npt.NDArray[np.bool_]
) -> npt.NDArray[np.float32]:
    """Depth of the nearest point in each pixel of a mask, metres, shape (H, W); 0 where none is."""
    fx, fy, cx, cy = intrinsics
    x, y, z = points[points[:, 2] > 0].T
    column, row = np.rint(fx * x / z + cx).astype(int), np.rint(fy * y / z + cy).astype(int)
    height, width = mask.shape
    inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
    depth = np.full(mask.shape, np.inf)
    np.minimum.at(depth, (row[inside], column[inside]), z[inside])
    found: npt.NDArray[np.float32] = np.where(mask & np.isfinite(depth), depth, 0)
    return found.astype(np.float32)


def columns(scores: dict[str, Any], holds: list[str], median: dict[str, Any]) -> dict[str, Any]:
    """RMSE, its standard error over holds, and the difference from the hand's median depth."""
    errors = scores["rmse_m"]
    return {
        "frames": len(errors),
        "rmse_m": float(np.mean(errors)),
        "rmse_standard_error_m": standard_error(errors, holds),
        "against_hand_median": paired(scores, median, holds),
    }


def main() -> None:
    """Run the benchmark."""
    args = arguments(__doc__).parse_args()
    bench = open_runs(args)
    rows = []
    for split in SPLITS:
        run = Run(split, NEAREST)
        test, train = (bench.frames(run, part, EVALUATION_SIZE) for part in ("test", "train"))
        median = bench.measure(Run(split, "hand-median"))["per_frame"]
        networks = {name: finished(bench, Run(split, name)) for name in NETWORKS}
        shown, learned = (bench.source(run, part) for part in ("test", "train"))
        holds, others = shown.holds(test.stems), learned.holds(train.stems)
        scores, chosen = nearest_hand(train, test)
        sister = np.array(holds)[:, None] == np.array(others)
        strangers, _ = nearest_hand(train, test, sister)
        measured = {
            "hand-median": median,
            NEAREST: scores.per_frame(),
            NO_SISTER: strangers.per_frame(),
            **{name: own["per_frame"] for name, own in networks.items()},
        }
        sisters = set(others)
        for method, listed in measured.items():
            row = {"method": method, "split": split, **columns(listed, holds, median)}
            row["share_with_sister"] = float(np.mean([hold in sisters for hold in holds]))
            if (own := networks.get(method)) is not None:
                row |= {name: own[name] for name in ("seed", "configuration", "config_sha256")}
            if method == NO_SISTER:
                row["against_with_sisters"] = paired(listed, measured[NEAREST], holds)
            if method == NEAREST:
                same = [hold == others[number] for hold, number in zip(holds, chosen, strict=True)]
                row["share_reminded_of_sister"] = float(np.mean(same))
            rows.append(row)
            gap = row["against_hand_median"]["mean_difference_m"]
            print(f"{split}, {method}: {row['rmse_m']:.4f} m, against the median {gap:+.4f} m")
    what = (
        "RMSE on test frames with whole holds held out (known) and with frames dealt out one by "
        f"one (by-frame), preset {bench.size}: metres, means over frames, standard errors over "
        "holds; nearest-hand puts the glass where it was in the most similar training hand"
    )
    write_rows(args.json, what, rows, bench)


if __name__ == "__main__":
    main()

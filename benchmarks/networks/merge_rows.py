"""Put rows of later trainings into the place of older ones in a result file of the tables.

    python benchmarks/networks/merge_rows.py OUT/tables/known.json results/imagenet/known.json \\
        --methods lidf dfnet hand-offset

Both must be of the same frames: where their checksums differ, the hand's median depth, which learns
nothing, has to err alike to a hundredth of a millimetre. A row of other seeds than the one in its
place joins it: the numbers become means over all of them. The errors of single frames are not in
the file; so the standard error of such a mean is the mean of the two, as if all seeds erred alike
on each frame, which is at least what it is; and where one of two methods is new and the other is
not, the difference from the next better one has the standard errors of the two apart. A part of
the ablation keeps the standard error of its difference from the full model.
"""

import argparse
import math
import statistics
from itertools import pairwise
from pathlib import Path
from typing import Any

from hadr.models.networks import RIVALS
from hadr.records.result_file import ResultFile, read_result_file, write_sealed

ALIKE_M = 1e-5
Row = dict[str, Any]


def place(row: Row) -> tuple[Any, ...]:
    """What a row is of."""
    return tuple(row.get(name) for name in ("method", "split", "given", "frame"))


def check_frames(new: ResultFile, old: ResultFile) -> None:
    """ValueError where two files are of other frames."""
    before = [old.provenance, *old.provenance.get("later_rows", ())]
    if new.provenance["data"]["sha256"] in [one["data"]["sha256"] for one in before]:
        return
    compared = 0
    found = [{place(row): row["rmse_m"] for row in file.rows} for file in (new, old)]
    for key in found[0].keys() & found[1].keys():
        cheap = key[0] == "hand-median" and key[2] in (None, "all true")
        compared += cheap
        if cheap and abs(found[0][key] - found[1][key]) > ALIKE_M:
            raise ValueError(f"other frames: {key} errs by {found[0][key]} and {found[1][key]} m")
    if not compared:
        raise ValueError("other checksums of the frames, and no hand's median in both to compare")


def of_all_seeds(old: Row, new: Row) -> Row:
    """One row of two that have no seed in common; texts and configuration are the old one's."""
    counts = [len(row["seeds"]) for row in (old, new)]

    def mean(first: Any, second: Any) -> Any:
        if isinstance(first, dict) and isinstance(second, dict):
            return {name: mean(first[name], second[name]) for name in first.keys() & second.keys()}
        if not isinstance(first, float) or not isinstance(second, float):
            return first
        return (counts[0] * first + counts[1] * second) / sum(counts)

    apart = ("configuration", "curve", "provenance", "seed_sd", "against_next")
    row: Row = old | mean(
        *({name: value for name, value in row.items() if name not in apart} for row in (old, new))
    )
    row |= {name: old[name] + new[name] for name in ("seeds", "config_sha256")}
    row["by_seed"] = {name: each + new["by_seed"][name] for name, each in old["by_seed"].items()}
    row["seed_sd"] = {name: statistics.stdev(each) for name, each in row["by_seed"].items()}
    commits = {
        name: sorted({*old["provenance"][name], *new["provenance"][name]})
        for name in ("commit", "trained_at")
    }
    row["provenance"] = old["provenance"] | commits
    # both ask for the mean error on single frames, which is not known
    row.pop("against_next", None)
    del row["against_hand_median"]["better_on_frames"]
    return row


def merged(new: ResultFile, old: ResultFile, methods: list[str]) -> list[Row]:
    """The rows of the old file, those of some methods from the new one."""
    fresh = {place(row): dict(row) for row in new.rows if row["method"] in methods}
    rows = []
    for row in old.rows:
        other = fresh.pop(place(row), row)
        before, now = ({*each.get("seeds", [0])} for each in (row, other))
        if before & now and before - now:
            raise ValueError(f"{place(row)} has seeds {before} there, and {now} come")
        rows.append(dict(other) if before <= now else of_all_seeds(row, other))
    # methods that the old file lacks stand behind the hand's median
    for row in reversed(fresh.values()):
        cheap = [n for n, other in enumerate(rows) if other["method"] == "hand-median"
                 and other.get("split") == row.get("split")]  # fmt: skip
        rows.insert(max(cheap, default=len(rows) - 1) + 1, row)
    full = [row["rmse_m"] for row in rows if row["method"] == "full"]
    for row in rows:
        if full and row["method"] in methods and row.get("against_full"):
            row["against_full"]["mean_difference_m"] = row["rmse_m"] - full[0]
            row["against_full"].pop("better_on_frames", None)
    return rows


def compare_with_next(rows: list[Row], methods: list[str]) -> None:
    """Give the paper's methods the difference from the next better one where that has changed."""
    for split in ("known", "unknown"):
        there = [row for row in rows if row["split"] == split
                 and row["method"] in ("hadr", *RIVALS)]  # fmt: skip
        there.sort(key=lambda row: float(row["rmse_m"]))
        for better, row in pairwise(there):
            told = row.get("against_next", {}).get("method")
            new = {better["method"] in methods, row["method"] in methods}
            if told != better["method"] or len(new) == 2:
                row["against_next"] = {
                    "method": better["method"],
                    "mean_difference_m": row["rmse_m"] - better["rmse_m"],
                    "standard_error_m": math.hypot(
                        *(each["rmse_standard_error_m"] for each in (row, better))
                    ),
                }
        if there:
            there[0].pop("against_next", None)


def main() -> None:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("new", type=Path)
    parser.add_argument("old", type=Path, help="is written over")
    parser.add_argument("--methods", nargs="+", required=True)
    parser.add_argument(
        "--median",
        nargs=2,
        type=Path,
        metavar=("NEW", "OLD"),
        help="files of the same frames with the hand's median, where these lack it",
    )
    args = parser.parse_args()
    new, old = read_result_file(args.new), read_result_file(args.old)
    check_frames(*map(read_result_file, args.median or (args.new, args.old)))
    rows = merged(new, old, args.methods)
    if args.old.stem in ("known", "unknown"):
        compare_with_next(rows, args.methods)
    later = [*old.provenance.get("later_rows", ()), {"methods": args.methods, **new.provenance}]
    content = {"what": old.what, "rows": rows}
    write_sealed(args.old, content | {"provenance": {**old.provenance, "later_rows": later}})


if __name__ == "__main__":
    main()

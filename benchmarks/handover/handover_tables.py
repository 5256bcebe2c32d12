"""Make all attempts of the handover's tables, and the result files that sum them up.

    python benchmarks/handover/handover_tables.py --out RUNS --jobs 2
    python benchmarks/handover/handover_tables.py --out RUNS --jobs 2 --only seeds --seeds 5
    python benchmarks/handover/handover_tables.py --out RUNS --write --results FOLDER

What is finished in RUNS is not made again, so it can be stopped at any time; nor what `--kept` has,
a small file of the rows of attempts, to which those of RUNS are added at the end: another machine
goes on from it. A result file is written when all of its attempts are there; `--write` makes none,
and sums up what is there of this code.

    handover.json           48 attempts of each condition, seed 0
    handover_seeds.json     more seeds of some conditions, pooled
    handover_patience.json  the attempts of two seeds with twice the time
    handover_worse.json     the same attempts, or half of them, with something made worse
"""

import argparse
import gzip
import json
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from hadr.experiments.plan import REPRODUCED
from hadr.figures.tables.handover import WORSE
from hadr.records.output_folder import make_output_folder
from hadr.records.provenance import provenance
from hadr.records.result_file import digest, unchanged, write_result_file
from hadr.records.writing import sole_owner, write_whole
from hadr.simulation.trials import TRIAL_HOLDS
from hadr.simulation.trials.experiment import attempts, is_finished, read_row, run_attempts
from hadr.simulation.trials.summary import condition_row
from hadr.simulation.trials.trial import Trial

TITLES = {
    "handover": "handover attempts in simulation: 48 of each condition, seed 0",
    "seeds": "handover attempts in simulation, of several seeds",
    "patience": "handover attempts in simulation, of two seeds, with twice the time",
    "worse": "handover attempts in simulation, made worse one by one",
}
RULES = "masks and keypoints from the simulator with noise, from networks where a condition says so"
CHANGED: list[tuple[dict[str, Any], list[str], int]] = [
    *(
        (change, ["perfect"], 3)
        for change in (
            {}, {"extrinsics_error_deg": 1.5}, {"extrinsics_error_deg": 3.0},
            {"extrinsics_error_deg": 6.0}, {"hand_speed": 2.0}, {"hand_speed": 3.0},
            {"picture_rate": 5.0}, {"picture_rate": 25.0}, {"picture_rate": 30.0},
            {"latency": 0.2}, {"latency": 0.3},
        )
    ),
    ({"restless": True},
     ["perfect", "hadr-plus", "hadr-plus-no-tracking", "hadr", "hadr-no-tracking",
      "unet-hand", "raw", "hadr-plus-no-rescoring"], 6),
    *(
        ({"turn_degrees": angle}, ["perfect", "hadr-plus", "hadr-plus-no-tracking"], 6)
        for angle in (20.0, 40.0, 60.0)
    ),
]  # fmt: skip
"""What is made worse, of which conditions, in how many holds of each object."""
SEEDS: dict[str, int] = {
    **dict.fromkeys(("perfect", "hadr-plus", "unet-hand", "hadr"), 10),
    "raw": 5,
    **dict.fromkeys(("hadr-plus-no-tracking", "hadr-plus-no-rescoring"), 2),
    **dict.fromkeys((f"{c}-networks" for c in ("unet-hand", "hadr", "raw", "inpainted")), 1),
}
"""How many seeds of which conditions."""
PATIENT = ("perfect", "hadr-plus", "unet-hand", "hadr", "raw")
"""Conditions whose attempts go on, where the clock ended them, until `PATIENCE` seconds."""
PATIENCE = 26.0


class Part(NamedTuple):
    """Attempts that are summed up in one row: the folder of each seed, and what was changed."""

    condition: str
    made: list[tuple[Path, list[Trial]]]
    changed: dict[str, Any]

    @property
    def attempts(self) -> list[tuple[Path, Trial]]:
        """Folder and description of each attempt."""
        return [(out, trial) for out, trials in self.made for trial in trials]


class Rows:
    """The rows of finished attempts of this code: those of a folder, and those of a kept file."""

    def __init__(self, out: Path, kept: Path | None) -> None:
        """Read the kept file, which may still be to be written."""
        self.out, self.kept = out, kept
        self._kept: dict[str, dict[str, Any]] = {}
        if kept is not None and kept.is_file():
            found = map(json.loads, gzip.decompress(kept.read_bytes()).splitlines())
            self._kept = {row["config_sha256"]: row for row in found if unchanged(row)}

    def of(self, folder: Path, trial: Trial) -> dict[str, Any] | None:
        """An attempt's row, wherever it is; None where it is still to be made."""
        sha = digest(trial.record)
        if sha not in self._kept and is_finished(folder, trial):
            self._kept[sha] = read_row(folder / trial.condition / f"{trial.name}.json")
        return self._kept.get(sha)

    def keep(self) -> None:
        """Write all rows that were asked for, and those that the file had, in one order."""
        if self.kept is not None:
            lines = sorted(json.dumps(row) for row in self._kept.values())
            write_whole(self.kept, gzip.compress("\n".join(lines).encode(), mtime=0))


def parts(rows: Rows, file: str, seeds: int) -> Iterator[Part]:
    """The rows of a file, in the order in which they are made; of at most so many seeds."""
    out = rows.out
    if file == "handover":
        for condition in REPRODUCED:
            yield Part(condition, [(out / "seed-0", attempts(condition))], {})
    elif file == "worse":
        for changed, conditions, holds in CHANGED:
            name = "-".join(f"{key}-{value:g}" for key, value in changed.items()) or "seed-0"
            for condition in conditions:
                like = Trial("0000", 0, **changed)
                trials = attempts(condition, holds=TRIAL_HOLDS[:holds], template=like)
                told = {key: getattr(like, key) for key in (*WORSE, "restless", "time_limit")}
                yield Part(condition, [(out / name, trials)], told)
    elif file == "patience":
        for condition in PATIENT:
            made = [
                attempt for s in range(min(2, seeds)) for attempt in patient(rows, condition, s)
            ]
            yield Part(condition, made, {"time_limit": PATIENCE})
    else:
        for condition, most in SEEDS.items():
            chosen = range(min(most, seeds))
            yield Part(
                condition, [(out / f"seed-{s}", attempts(condition, seed=s)) for s in chosen], {}
            )


def patient(rows: Rows, condition: str, seed: int) -> Iterator[tuple[Path, list[Trial]]]:
    """The attempts of a seed with more time: what ended before the clock ended it is taken over."""
    for trial in attempts(condition, seed=seed):
        folder = rows.out / f"seed-{seed}"
        row = rows.of(folder, trial)
        if row is not None and row["verdict"] != "time-out":
            yield folder, [trial]
        else:
            more = replace(trial, time_limit=PATIENCE)
            yield rows.out / f"time_limit-{PATIENCE:g}-seed-{seed}", [more]


def say(trial: Trial, row: dict[str, Any]) -> None:
    """One line for one attempt."""
    print(f"{trial.condition:22} {trial.name} {trial.seed}  {row['verdict']}", flush=True)


def main() -> None:
    """Run the script."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder of the attempts")
    parser.add_argument("--only", choices=tuple(TITLES))
    parser.add_argument("--seeds", type=int, default=10, help="at most so many")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--write", action="store_true", help="sum up what is there; make none")
    parser.add_argument("--kept", type=Path, help="rows of attempts, such as of another machine")
    parser.add_argument("--results", type=Path, default=Path("results/mini"))
    args = parser.parse_args()
    make_output_folder(args.out)
    rows = Rows(args.out, args.kept)
    with nullcontext() if args.write else sole_owner(args.out, "the handover's tables"):
        for file in [args.only] if args.only else TITLES:
            wanted = list(parts(rows, file, args.seeds))
            asked = [a for part in wanted for a in part.attempts if rows.of(*a) is None]
            if not args.write:  # in one go: what a process has prepared serves all conditions
                trials, outs = [trial for _, trial in asked], [out for out, _ in asked]
                run_attempts(trials, outs, jobs=args.jobs, report=say)
            summed, missing = [], 0
            for part in wanted:
                found = [row for a in part.attempts if (row := rows.of(*a)) is not None]
                missing += len(part.attempts) - len(found)
                if found:
                    summed.append(condition_row(part.condition, found) | part.changed)
            rows.keep()
            what = f"{TITLES[file]}; {RULES}; success by HandoverSim's rules"
            if missing:
                what += f"; {missing} attempts are still to be made"
            name = "handover.json" if file == "handover" else f"handover_{file}.json"
            write_result_file(args.results / name, what, summed, provenance())
            print(args.results / name, f"{missing} missing" if missing else "")


if __name__ == "__main__":
    main()

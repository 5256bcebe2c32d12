"""Make all attempts of the handover's tables, and the result files that sum them up.

    python benchmarks/handover/handover_tables.py --out RUNS --jobs 2
    python benchmarks/handover/handover_tables.py --out RUNS --jobs 2 --only seeds --seeds 5
    python benchmarks/handover/handover_tables.py --out RUNS --write --results FOLDER

What is finished in RUNS is not made again, so it can be stopped at any time. A file is written when
all of its attempts are there; `--write` makes none, and sums up what is there of this code.

    handover.json           48 attempts of each condition, seed 0
    handover_seeds.json     more seeds of some conditions, pooled
    handover_patience.json  the attempts of two seeds with twice the time
    handover_worse.json     the same attempts, or half of them, with something made worse
"""

import argparse
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

from hadr.experiments.plan import REPRODUCED
from hadr.figures.tables.handover import WORSE
from hadr.records.output_folder import make_output_folder
from hadr.records.provenance import provenance
from hadr.records.result_file import write_result_file
from hadr.records.writing import sole_owner
from hadr.simulation.trials import TRIAL_HOLDS
from hadr.simulation.trials.experiment import attempts, finished_attempt, is_finished, run_attempts
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
     ["perfect", "hadr-plus", "hadr-plus-no-tracking", "hadr", "hadr-no-tracking"], 6),
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


def parts(out: Path, file: str, seeds: int) -> Iterator[Part]:
    """The rows of a file, in the order in which they are made; of at most so many seeds."""
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
            made = [attempt for s in range(min(2, seeds)) for attempt in patient(out, condition, s)]
            yield Part(condition, made, {"time_limit": PATIENCE})
    else:
        for condition, most in SEEDS.items():
            chosen = range(min(most, seeds))
            yield Part(
                condition, [(out / f"seed-{s}", attempts(condition, seed=s)) for s in chosen], {}
            )


def patient(out: Path, condition: str, seed: int) -> Iterator[tuple[Path, list[Trial]]]:
    """The attempts of a seed with more time: what ended before the clock ended it is taken over."""
    for trial in attempts(condition, seed=seed):
        made = out / f"seed-{seed}", trial
        if is_finished(*made) and finished_attempt(*made)[0]["verdict"] != "time-out":
            yield made[0], [trial]
        else:
            more = replace(trial, time_limit=PATIENCE)
            yield out / f"time_limit-{PATIENCE:g}-seed-{seed}", [more]


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
    parser.add_argument("--results", type=Path, default=Path("results/mini"))
    args = parser.parse_args()
    make_output_folder(args.out)
    with nullcontext() if args.write else sole_owner(args.out, "the handover's tables"):
        for file in [args.only] if args.only else TITLES:
            rows, missing, wanted = [], 0, list(parts(args.out, file, args.seeds))
            if not args.write:  # in one go: what a process has prepared serves all conditions
                asked = [attempt for part in wanted for attempt in part.attempts]
                trials, outs = [trial for _, trial in asked], [out for out, _ in asked]
                made = iter(run_attempts(trials, outs, jobs=args.jobs, report=say))
            for part in wanted:
                if args.write:
                    found = [finished_attempt(*a)[0] for a in part.attempts if is_finished(*a)]
                else:
                    found = list(islice(made, len(part.attempts)))
                missing += len(part.attempts) - len(found)
                if found:
                    rows.append(condition_row(part.condition, found) | part.changed)
            what = f"{TITLES[file]}; {RULES}; success by HandoverSim's rules"
            if missing:
                what += f"; {missing} attempts are still to be made"
            name = "handover.json" if file == "handover" else f"handover_{file}.json"
            write_result_file(args.results / name, what, rows, provenance())
            print(args.results / name, f"{missing} missing" if missing else "")


if __name__ == "__main__":
    main()

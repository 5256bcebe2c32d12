"""The handover experiment as a part of `hadr reproduce`: which attempts, what is left, the run.

OUT/handover/hadr/0004-902.json   an attempt, as `hadr handover` leaves it
OUT/tables/handover.json          the table's rows
"""

from __future__ import annotations

import argparse
from pathlib import Path

from hadr.experiments.reproduction_plan import Step
from hadr.experiments.run_times import RunTimes
from hadr.simulation.trials import command as handover_command
from hadr.simulation.trials.command import check_arguments, check_packages

REPRODUCED = (
    "raw", "inpainted", "hadr", "hadr-plus", "perfect", "hadr-no-rescoring", "hadr-no-tracking",
)  # fmt: skip
"""The arms of results/mini/handover.json; `hadr handover` alone leaves out hadr-plus."""
TINY = ("--objects", "0004", "--holds", "902")
"""At preset tiny each arm makes one attempt, which shows that everything runs and no more."""


def handover_words(out: Path, size: str, seed: int, jobs: int) -> list[str]:
    """The words that `hadr handover` is called with.

    Args:
        out: The output folder of the whole reproduction.
        size: The preset: "tiny" makes one attempt an arm, the others the experiment's 48.
        seed: Seed of places, motions and noise.
        jobs: Attempts at a time.
    """
    words = ["--out", str(out / "handover"), "--json", str(out / "tables" / "handover.json")]
    words += ["--seed", str(seed), "--jobs", str(jobs), "--arms", *REPRODUCED]
    return [*words, *TINY] if size == "tiny" else words


def open_handover(out: Path, size: str, seed: int, jobs: int) -> argparse.Namespace:
    """Read the command's words and check them, and what it needs, before anything is computed.

    Raises:
        ValueError: A package of the physical world is missing, or a word is wrong.
    """
    parser = argparse.ArgumentParser(prog="hadr handover")
    handover_command.add_arguments(parser)
    args = parser.parse_args(handover_words(out, size, seed, jobs))
    check_arguments(args)
    try:
        check_packages()
    except ValueError as error:
        raise ValueError(f"{error}; or leave them out: --only tables chapters") from error
    return args


def handover_steps(args: argparse.Namespace, times: RunTimes) -> list[Step]:
    """Describe the arms as steps of a plan.

    Args:
        args: What `open_handover` gave.
        times: What an attempt took when it was last measured.
    """
    from hadr.simulation.trials.experiment import attempts, is_finished

    steps = []
    for arm in args.arms:
        trials = attempts(arm, objects=args.objects, holds=args.holds, seed=args.seed)
        left = sum(not is_finished(args.out, trial) for trial in trials)
        rate = times.attempts.get(arm)
        seconds = None if rate is None else left * rate
        words = f"{left} of {len(trials)} attempts" if left else "done"
        steps.append(Step("handover", f"handover/{arm}", words, seconds, "tables/handover.json"))
    return steps


def run_handover(args: argparse.Namespace) -> None:
    """Make the attempts that are missing, and write the table.

    Args:
        args: What `open_handover` gave.
    """
    handover_command.run(args)

"""`hadr handover`: attempts in the simulated world, summed up as the paper's table is."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from hadr.handover.scenes import TRIAL_HOLDS, TRIAL_OBJECTS
from hadr.provenance import check_folder, machine_text, provenance, usable_cores
from hadr.result_file import write_result_file

EPILOG = """\
examples
  hadr handover --arms hadr --objects 0004 --holds 902 --out build/handover --film
  hadr handover --arms raw hadr perfect --jobs 2 --out build/handover

output, in --out
  ARM/OBJECT-HOLD.json   an attempt's outcome      ARM/OBJECT-HOLD.npz   its states
  ARM/OBJECT-HOLD.mp4    with --film               handover.json         one row per arm

An attempt that is finished is not run again, so the command goes on where it was stopped.
Lengths in metres, times in seconds, forces in newtons."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = EPILOG
    parser.add_argument("--out", type=Path, required=True, help="folder of the attempts' files")
    parser.add_argument(
        "--arms",
        nargs="+",
        default=["raw", "inpainted", "hadr", "perfect", "hadr-no-rescoring", "hadr-no-tracking"],
        metavar="ARM",
        help="raw, inpainted, hadr, hadr-plus, perfect, hadr-no-rescoring, hadr-no-tracking",
    )
    parser.add_argument(
        "--objects", nargs="+", default=list(TRIAL_OBJECTS), metavar="ID", help="objects' ids"
    )
    parser.add_argument(
        "--holds", nargs="+", type=int, default=list(TRIAL_HOLDS), metavar="N", help="holding poses"
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of places, motions, noise (0)")
    parser.add_argument("--jobs", type=int, default=usable_cores(), help="attempts at a time")
    parser.add_argument(
        "--hand-speed", type=float, default=1.0, metavar="X", help="factor on the hand's speed (1)"
    )
    parser.add_argument(
        "--extrinsics-error",
        type=float,
        default=0.0,
        metavar="DEG",
        help="turn the camera by so many degrees from its calibration (0)",
    )
    parser.add_argument("--film", action="store_true", help="write an MP4 of each attempt")
    parser.add_argument(
        "--watch", action="store_true", help="show the attempts live in MuJoCo's viewer"
    )
    parser.add_argument("--json", type=Path, help="result file (OUT/handover.json)")
    parser.add_argument("--dry-run", action="store_true", help="say what would be run, and stop")


def run(args: argparse.Namespace) -> int:
    """Run the command.

    Returns:
        0.

    Raises:
        ValueError: An argument is out of range or unknown; the message names it.
    """
    from hadr.handover.experiment import arm_row, attempts, film_of_attempt, run_attempts
    from hadr.handover.trial import Trial

    if args.jobs < 1:
        raise ValueError(f"--jobs must be at least 1, got {args.jobs}")
    if args.seed < 0:
        raise ValueError(f"--seed must be at least 0, got {args.seed}")
    unknown = [name for name in args.objects if name not in TRIAL_OBJECTS]
    if unknown:
        raise ValueError(f"no object {unknown[0]!r} here; there are {', '.join(TRIAL_OBJECTS)}")
    if min(args.holds) < 0:
        raise ValueError(f"--holds must be 0 or more, got {min(args.holds)}")
    check_folder(args.out)
    template = Trial(
        args.objects[0],
        args.holds[0],
        hand_speed=args.hand_speed,
        extrinsics_error_deg=args.extrinsics_error,
    )
    plan = {
        arm: attempts(
            arm, objects=args.objects, holds=args.holds, seed=args.seed, template=template
        )
        for arm in dict.fromkeys(args.arms)
    }
    total = sum(map(len, plan.values()))
    print(f"{total} attempts: {len(args.objects)} objects, {len(args.holds)} holds, "
          f"{len(plan)} arms, {args.jobs} at a time")  # fmt: skip
    if args.dry_run:
        return 0
    rows = []
    for arm, trials in plan.items():
        if args.watch:
            from hadr.handover.watch import watch_trial

            for trial in trials:
                watch_trial(trial)
            continue
        outcomes = run_attempts(trials, args.out, jobs=args.jobs, report=_say)
        rows.append(arm_row(arm, outcomes))
        print(_sum_up(rows[-1]))
        if args.film:
            for trial in trials:
                print(f"film: {film_of_attempt(args.out, trial)}")
    if rows:
        path = args.json or args.out / "handover.json"
        write_result_file(path, _what(args), rows, {**provenance(), "machine": machine_text()})
        print(f"the rows: {path}")
    return 0


def _what(args: argparse.Namespace) -> str:
    return (
        f"handover attempts in simulation: objects {' '.join(args.objects)}, holds "
        f"{' '.join(map(str, args.holds))}, seed {args.seed}, hand's speed x{args.hand_speed:g}, "
        f"camera turned by {args.extrinsics_error:g} degrees; masks and keypoints from the "
        "simulator with noise; success by HandoverSim's rules"
    )


def _say(trial: Any, row: dict[str, Any]) -> None:
    print(
        f"{trial.arm:18} {trial.name}  {row['verdict']:14} {row['decided_at']:5.1f} s  "
        f"{row['motion']:8} {row['kind']:8} {row['reason']}",
        flush=True,
    )


def _sum_up(row: dict[str, Any]) -> str:
    low, high = row["interval"]
    failures = ", ".join(f"{count} {kind}" for kind, count in row["failures"].items()) or "none"
    return (
        f"{row['arm']}: {row['successes']} of {row['attempts']} "
        f"({100 * row['rate']:.1f} %, 95 % interval {100 * low:.0f} to {100 * high:.0f}); "
        f"failures: {failures}; largest force {row['largest_force_n']:.1f} N"
    )

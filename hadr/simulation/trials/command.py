"""`hadr handover`: attempts in the simulated world, summed up as the paper's table is."""

from __future__ import annotations

import argparse
import importlib.util
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hadr.records.output_folder import check_folder, check_writable
from hadr.records.provenance import machine_text, provenance, record_of, usable_cores
from hadr.records.result_file import write_result_file
from hadr.simulation.trials.trial_set import TRIAL_HOLDS, TRIAL_OBJECTS

DESCRIPTION = """\
Let a simulated UR5 take glasses out of a human's hand, and count how often it
succeeds.

Each attempt is one object in one holding pose. The world is physical (MuJoCo);
the robot sees it through one simulated depth camera, ten times a second. An arm
of the experiment says whose depth of the glass the robot believes, or which
part of the method is switched off. All arms meet the same hands, motions and
noise."""

EPILOG = """\
arms
  raw                 the depth that the camera measured
  inpainted           the glass filled in from around it
  hadr, hadr-plus     restored by a bundled network trained for this camera
  perfect             the true depth
  hadr-no-rescoring   hadr, grasps by their own score alone
  hadr-no-tracking    hadr, the robot does not follow the hand
  hadr-plus-networks  hadr-plus, and networks find the mask and the keypoints,
                      which the simulator gives in all other arms, with noise

examples
  hadr handover --arms hadr --objects 0004 --holds 902 --film \\
      --out build/handover
  hadr handover --arms raw hadr perfect --jobs 2 --out build/handover
  hadr handover --replay build/handover/hadr/0004-902-log.npz

output, in --out
  ARM/OBJECT-HOLD.json      an attempt's outcome and its changes of stage
  ARM/OBJECT-HOLD.npz       the states of the world, 25 a second
  ARM/OBJECT-HOLD-log.npz   what the workflow saw and commanded, for a replay
  ARM/OBJECT-HOLD.mp4       with --film, drawn after the rows are written;
                            about a minute each, on one core
  handover.json             one row per arm: successes, rate and its 95 %
                            interval, failures by kind, times, distance, force,
                            and each attempt's verdict

units
  metres, seconds of the simulated world (wall times are named so), newtons

An attempt that is finished is not run again, so the command goes on where it
was stopped; Ctrl-C loses only what was under way. Attempts of other settings,
networks or code are run again, and so is one whose states or log are missing
or damaged. --dry-run counts what is done. The same seed gives the same
outcomes.

exit status
  0 done, however many attempts failed   2 a wrong call   130 interrupted"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description, parser.epilog = DESCRIPTION, EPILOG
    made_or_read = parser.add_mutually_exclusive_group(required=True)
    made_or_read.add_argument(
        "--out", type=_named_path, metavar="DIR", help="folder of the attempts' files"
    )
    made_or_read.add_argument(
        "--replay",
        type=_named_path,
        metavar="FILE",
        help="replay an attempt's log and print its changes of stage and its cautions; runs none",
    )
    parser.add_argument(
        "--arms",
        nargs="+",
        default=[
            *("raw", "inpainted", "hadr", "perfect"),
            *("hadr-no-rescoring", "hadr-no-tracking"),
        ],
        metavar="ARM",
        help="which to run, see below (all but those with hadr-plus)",
    )
    parser.add_argument(
        "--objects",
        nargs="+",
        default=list(TRIAL_OBJECTS),
        metavar="ID",
        help=f"objects, of {' '.join(TRIAL_OBJECTS)} (all)",
    )
    parser.add_argument(
        "--holds",
        nargs="+",
        type=int,
        default=list(TRIAL_HOLDS),
        metavar="N",
        help=f"numbers of holding poses ({' '.join(map(str, TRIAL_HOLDS))})",
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of places, motions, noise (0)")
    parser.add_argument(
        "--jobs",
        type=int,
        default=usable_cores(),
        metavar="K",
        help="attempts at a time, each a process with one thread (one per core)",
    )
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
    parser.add_argument(
        "--film",
        action="store_true",
        help="write an MP4 of each attempt, one by one: about a minute each",
    )
    parser.add_argument(
        "--watch",
        action="store_true",
        help="show the attempts live in MuJoCo's viewer, keep no files",
    )
    parser.add_argument(
        "--json", type=_named_path, metavar="FILE", help="the rows' file (handover.json in --out)"
    )
    parser.add_argument(
        "--dry-run", action="store_true", help="say what would be run and what is done, and stop"
    )


def _named_path(text: str) -> Path:
    if not text.strip():
        raise argparse.ArgumentTypeError("expected a path, got an empty one")
    return Path(text)


def run(args: argparse.Namespace) -> int:
    """Run the command.

    Returns:
        0.

    Raises:
        ValueError: An argument is out of range or unknown, or a package is missing; the message
            names it.
    """
    if args.replay is not None:
        return _replay(args.replay)
    check_arguments(args)
    check_packages()
    from hadr.simulation.trials.experiment import (
        arm_row,
        attempts,
        film_of_attempt,
        film_path,
        is_finished,
        run_attempts,
    )
    from hadr.simulation.trials.trial import Trial
    from hadr.simulation.trials.watch import check_display, watch_trial

    if args.watch:
        check_display()
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
        for arm in args.arms
    }
    total = sum(map(len, plan.values()))
    print(
        f"{_count(total, 'attempt')}: {_count(len(args.objects), 'object')}, "
        f"{_count(len(args.holds), 'hold')}, {_count(len(plan), 'arm')}, "
        f"{1 if args.watch else args.jobs} at a time"
    )
    if not args.watch:
        done = sum(is_finished(args.out, trial) for trials in plan.values() for trial in trials)
        print(f"finished already: {done} of {total} in {args.out}")
    if args.dry_run:
        return 0
    path = args.json or args.out / "handover.json"
    if not args.watch:
        for folder in (args.out, path.parent):
            _make_folder(folder)
    rows = []
    for arm, trials in plan.items():
        if args.watch:
            for trial in trials:
                _say(trial, record_of(watch_trial(trial).outcome))
            continue
        outcomes = run_attempts(trials, args.out, jobs=args.jobs, report=_say)
        rows.append(arm_row(arm, outcomes))
        print(_sum_up(rows[-1]))
    if rows:
        write_result_file(path, _what(args), rows, {**provenance(), "machine": machine_text()})
        print(f"the rows: {path}")
    if args.film:
        for trial in (trial for trials in plan.values() for trial in trials):
            print(f"drawing {film_path(args.out, trial)}", flush=True)
            film_of_attempt(args.out, trial)
    return 0


def _replay(path: Path) -> int:
    """Replay an attempt's log, and print what happened in the order of time."""
    from hadr.handover.replay import replay
    from hadr.handover.run_log import read_run_log

    if path.is_dir():
        raise ValueError(f"--replay {path} is a folder, expected a log, such as 0004-902-log.npz")
    log = read_run_log(path)
    try:
        again = replay(log)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    changes = [
        (t.time, 1, f"{t.before.value} -> {t.after.value}: {t.reason}") for t in again.transitions
    ]
    cautions = [(time, 0, f"  caution: {words}") for time, words in log.cautions if words]
    for time, _, words in sorted([*changes, *cautions], key=lambda line: line[:2]):
        print(f"{time:6.2f} s  {words}")
    print(f"replayed {path}: the same {_count(len(changes), 'change')} of stage, the same commands")
    return 0


def check_arguments(args: argparse.Namespace) -> None:
    """Check the command's arguments before anything is computed.

    Raises:
        ValueError: One is out of range, unknown or there twice; the message names it.
    """
    for name, least in (("jobs", 1), ("seed", 0)):
        if getattr(args, name) < least:
            raise ValueError(f"--{name} must be at least {least}, got {getattr(args, name)}")
    for name in ("arms", "objects", "holds"):
        given = getattr(args, name)
        twice = [value for i, value in enumerate(given) if value in given[:i]]
        if twice:
            raise ValueError(f"--{name} names {twice[0]} twice")
    unknown = [name for name in args.objects if name not in TRIAL_OBJECTS]
    if unknown:
        raise ValueError(f"no object {unknown[0]!r} here; there are {', '.join(TRIAL_OBJECTS)}")
    if min(args.holds) < 0:
        raise ValueError(f"--holds must be 0 or more, got {min(args.holds)}")
    if not (math.isfinite(args.hand_speed) and args.hand_speed > 0):
        raise ValueError(f"--hand-speed must be a factor above 0, got {args.hand_speed:g}")
    if not 0 <= args.extrinsics_error <= 90:
        raise ValueError(
            f"--extrinsics-error must lie in 0..90 degrees, got {args.extrinsics_error:g}"
        )
    if args.watch and args.film:
        raise ValueError("--watch keeps no files to film: give one of --watch and --film")
    for name, path in (("--out", args.out), ("--json", args.json)):
        try:
            (check_folder if name == "--out" else check_writable)(path)
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from error
    if args.json is None and (args.out / "handover.json").is_dir():
        raise ValueError(f"{args.out / 'handover.json'} is a folder, expected the rows' file")


def _make_folder(path: Path) -> None:
    """Make a folder for results before hours are spent on what it is to hold."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(f"can't make the folder {path}: {error.strerror}") from error
    if not os.access(path, os.W_OK | os.X_OK):
        raise ValueError(f"can't write to the folder {path}: permission denied")


def check_packages() -> None:
    """Check that the physical world's packages are installed.

    Raises:
        ValueError: One is not; the message says how to get it.
    """
    missing = [n for n in ("mujoco", "mink", "daqp") if importlib.util.find_spec(n) is None]
    if missing:
        raise ValueError(
            f"attempts need {', '.join(missing)}, not installed here: pip install 'hadr[handover]'"
        )


def _count(number: int, what: str) -> str:
    return f"{number} {what}" + ("" if number == 1 else "s")


def _what(args: argparse.Namespace) -> str:
    return (
        f"handover attempts in simulation: objects {' '.join(args.objects)}, holds "
        f"{' '.join(map(str, args.holds))}, seed {args.seed}, hand's speed x{args.hand_speed:g}, "
        f"camera turned by {args.extrinsics_error:g} degrees; {_origin_of_masks(args.arms)}; "
        "success by HandoverSim's rules"
    )


def _origin_of_masks(arms: Sequence[str]) -> str:
    """Say of which arms masks and keypoints are the simulator's, and of which networks'."""
    from hadr.simulation.trials.trial import finds_by_networks

    told = [arm for arm in arms if not finds_by_networks(arm)]
    found = [arm for arm in arms if finds_by_networks(arm)]
    words = []
    if told:
        of = f" for {', '.join(told)}" if found else ""
        words.append(f"from the simulator with noise{of}")
    if found:
        words.append(f"from networks for {', '.join(found)}")
    return f"masks and keypoints {' and '.join(words)}"


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

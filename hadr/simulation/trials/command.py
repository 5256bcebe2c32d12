"""`hadr handover`: attempts in the simulated world, summed up as the paper's table is."""

from __future__ import annotations

import importlib.util
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from hadr.records.option_words import FILE, FOLDER, ID, LARGEST_SEED, MOST_JOBS, check_range
from hadr.records.output_folder import check_file, check_own, make_output_folder
from hadr.records.provenance import provenance, record_of, usable_cores
from hadr.records.result_file import write_result_file
from hadr.records.writing import LOCK, sole_owner
from hadr.simulation.trials import TRIAL_HOLDS, TRIAL_OBJECTS

if TYPE_CHECKING:
    from hadr.handover.stages import Stage
    from hadr.simulation.trials.trial import Run, Trial
    from hadr.simulation.world.physics import World
    from hadr.simulation.world.state import WorldState

_WHAT = "handover attempts in simulation"
"""How the file of the rows begins."""
HAND_SPEEDS, LARGEST_HOLD = (0.01, 10.0), 999_999
"""Factors on a hand's speed at which a run shows something, and the last holding pose."""
EPILOG = """\
conditions (--conditions)
  raw                 the depth that the camera measured
  inpainted           the glass filled in from around it
  unet-hand, hadr, hadr-plus
                      restored by a bundled network trained for this camera
  perfect             the true depth
and after any of them, in this order
  -no-rescoring       grasps by their own score alone
  -no-tracking        the robot does not follow the hand
  -networks           networks find the mask and the keypoints, which else are
                      the simulator's, with noise

examples
  hadr handover --conditions hadr --objects 0004 --holds 902 --film \\
      --out build/handover
  hadr handover --conditions raw hadr perfect --jobs 2 --out build/handover
  hadr handover --replay build/handover/hadr/0004-902-log.npz

output, in --out
  CONDITION/OBJECT-HOLD.json  an attempt's outcome and its changes of stage
  CONDITION/OBJECT-HOLD.npz   the states of the world, 25 a second
  CONDITION/OBJECT-HOLD-log.npz
                            what the workflow saw and commanded, for a replay
  CONDITION/OBJECT-HOLD.mp4   with --film, drawn after the rows are written;
                            about a minute each, on one core
  handover.json             one row per condition: successes, rate and its 95 %
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
  0 done, however many attempts failed   1 the disk is full
  2 a wrong call   130 interrupted"""


@dataclass(frozen=True)
class Options:
    """Let a simulated UR5 take glasses out of a human's hand; count its successes.

    Each attempt is one object in one holding pose. The world is physical (MuJoCo);
    the robot sees it through one simulated depth camera, ten times a second. A
    condition of the experiment says whose depth of the glass the robot believes, or
    which part of the method is switched off. All meet the same hands, motions and
    noise.
    """

    out: Annotated[str | None, FOLDER] = None
    """Folder of the attempts' files."""
    replay: Annotated[str | None, FILE] = None
    """Replay an attempt's log and print its changes of stage and its cautions; runs none."""
    conditions: Annotated[tuple[str, ...], tyro.conf.arg(metavar="CONDITION")] = (
        *("raw", "inpainted", "unet-hand"),
        *("hadr", "hadr-plus", "perfect"),
    )
    """Which to run, see below."""
    objects: Annotated[tuple[str, ...], ID] = TRIAL_OBJECTS
    """Glasses that the hand offers; unset: all there are."""
    holds: tuple[int, ...] = TRIAL_HOLDS
    """Numbers of holding poses."""
    seed: int = 0
    """Seed of places, motions, noise."""
    jobs: int | None = None
    """Attempts at a time, each a process with one thread; unset: one per core."""
    hand_speed: float = 1.0
    """Factor on the hand's speed."""
    extrinsics_error: float = 0.0
    """Turn the camera by so many degrees from its calibration."""
    restless: bool = False
    """Hands that drift, swing or turn never come to rest."""
    turn: float | None = None
    """Let every hand turn, by at most so many degrees to each side; unset: six motions in turn."""
    picture_rate: float = 10.0
    """Pictures a second, 0.1 to 50."""
    latency: float = 0.1
    """Seconds from a picture to what is seen in it."""
    time_limit: float = 13.0
    """Seconds until an attempt has failed; HandoverSim's 13."""
    film: bool = False
    """Write an MP4 of each attempt, one by one: about a minute each."""
    watch: bool = False
    """Show the attempts live in MuJoCo's viewer, keep no files."""
    json: Annotated[str | None, FILE] = None
    """The rows' file; handover.json in --out."""
    dry_run: bool = False
    """Say what would be run and what is done, and stop."""


def run(options: Options) -> int:
    """Run the command; ValueError names an option out of range or unknown, or a missing package."""
    if (options.out is None) == (options.replay is None):
        raise ValueError("give one of --out and --replay")
    if options.replay is not None:
        return _replay(Path(options.replay))
    out = Path(options.out or "")
    path = out / "handover.json" if options.json is None else Path(options.json)
    _check(options, out, path)
    jobs = usable_cores() if options.jobs is None else options.jobs
    check_packages()
    from hadr.simulation.trials import experiment
    from hadr.simulation.trials.summary import condition_row
    from hadr.simulation.trials.trial import CONDITIONS, Trial

    places = (path.resolve(), *path.resolve().parents)
    if path.resolve() in (out.resolve(), (out / LOCK).resolve()) or any(
        (out / name).resolve() in places for name in CONDITIONS
    ):
        raise ValueError(f"--json {path} lies among the attempts' own files: name a file elsewhere")
    if options.watch:
        check_display()
    shared = Trial(
        options.objects[0],
        options.holds[0],
        hand_speed=options.hand_speed,
        extrinsics_error_deg=options.extrinsics_error,
        restless=options.restless,
        turn_degrees=options.turn,
        picture_rate=options.picture_rate,
        latency=options.latency,
        time_limit=options.time_limit,
    )
    plan = {
        name: experiment.attempts(
            name,
            objects=options.objects,
            holds=options.holds,
            seed=options.seed,
            template=shared,
        )
        for name in options.conditions
    }
    every = [trial for trials in plan.values() for trial in trials]
    print(
        f"{_count(len(every), 'attempt')}: {_count(len(options.objects), 'object')}, "
        f"{_count(len(options.holds), 'hold')}, {_count(len(plan), 'condition')}, "
        f"{1 if options.watch else jobs} at a time"
    )
    if not options.watch:
        done = sum(experiment.is_finished(out, trial) for trial in every)
        print(f"finished already: {done} of {len(every)} in {out}")
    if options.dry_run:
        return 0
    if options.watch:
        for trial in every:
            _say(trial, record_of(watch_trial(trial).outcome))
        return 0
    make_output_folder(out)
    with sole_owner(out, "hadr handover"):
        rows = []
        for condition, trials in plan.items():
            outcomes = experiment.run_attempts(trials, out, jobs=jobs, report=_say)
            rows.append(condition_row(condition, outcomes))
            print(_sum_up(rows[-1]))
        write_result_file(path, _what(options), rows, provenance())
        print(f"the rows: {path}")
        if options.film:
            for trial in every:
                print(f"drawing {experiment.film_path(out, trial)}", flush=True)
                experiment.film_of_attempt(out, trial)
    return 0


def _replay(path: Path) -> int:
    """Replay an attempt's log, and print what happened in the order of time."""
    from hadr.handover.logs.replay import replay
    from hadr.handover.logs.run_log import read_run_log

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
    cautions = [(at, 0, f"  caution: {words}") for at, words in log.cautions if words]
    for at, _, words in sorted([*changes, *cautions], key=lambda line: line[:2]):
        print(f"{at:6.2f} s  {words}")
    print(f"replayed {path}: the same {_count(len(changes), 'change')} of stage, the same commands")
    return 0


def _check(options: Options, out: Path, path: Path) -> None:
    """ValueError what `Trial` does not refuse by itself, before anything is computed."""
    check_range("jobs", 1 if options.jobs is None else options.jobs, 1, MOST_JOBS)
    check_range("seed", options.seed, 0, LARGEST_SEED)
    check_range("hand-speed", options.hand_speed, *HAND_SPEEDS)
    check_range("extrinsics-error", options.extrinsics_error, 0, 90)
    for name in ("conditions", "objects", "holds"):
        given = getattr(options, name)
        if not given or "" in given:
            raise ValueError(f"--{name} names nothing, or has an empty word")
        twice = [value for i, value in enumerate(given) if value in given[:i]]
        if twice:
            raise ValueError(f"--{name} names {twice[0]} twice")
    for number in options.holds:
        check_range("holds", number, 0, LARGEST_HOLD)
    unknown = [name for name in options.objects if name not in TRIAL_OBJECTS]
    if unknown:
        raise ValueError(f"no object {unknown[0]!r} here; there are {', '.join(TRIAL_OBJECTS)}")
    if options.watch and options.film:
        raise ValueError("--watch keeps no files to film: give one of --watch and --film")
    check_own(out)
    check_file(path, what=_WHAT)


def check_packages() -> None:
    """ValueError, with how to get it, where a package of the physical world is not installed."""
    missing = [n for n in ("mujoco", "mink", "daqp") if importlib.util.find_spec(n) is None]
    if missing:
        raise ValueError(
            f"attempts need {', '.join(missing)}, not installed here: pip install 'hadr[handover]'"
        )


def check_display() -> None:
    """ValueError, with what to do instead, where no window can be opened."""
    seen = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if sys.platform.startswith("linux") and not seen:
        raise ValueError(
            "--watch opens a window, but there is no display (DISPLAY is not set); "
            "--film writes an MP4 of each attempt instead"
        )


def watch_trial(trial: Trial) -> Run:
    """Make one attempt and show it at the speed of life, or slower where the machine is."""
    import mujoco.viewer

    from hadr.simulation.trials.trial import run_trial

    viewer = None
    started = time.perf_counter()

    def show(world: World, state: WorldState, stage: Stage) -> None:
        nonlocal viewer
        if viewer is None:
            viewer = mujoco.viewer.launch_passive(*world.physics)
        viewer.sync()
        time.sleep(max(0.0, started + state.time - time.perf_counter()))

    try:
        return run_trial(trial, on_step=show)
    finally:
        if viewer is not None:
            viewer.close()


def _count(number: int, what: str) -> str:
    return f"{number} {what}" + ("" if number == 1 else "s")


def _what(options: Options) -> str:
    return (
        f"{_WHAT}: objects {' '.join(options.objects)}, holds "
        f"{' '.join(map(str, options.holds))}, seed {options.seed}, hand's speed "
        f"x{options.hand_speed:g}{', restless' * options.restless}"
        f"{'' if options.turn is None else f', all turn by {options.turn:g} degrees'}, "
        f"camera turned by {options.extrinsics_error:g} degrees, "
        f"{options.picture_rate:g} pictures a second, latency {options.latency:g} s, "
        f"time limit {options.time_limit:g} s; "
        f"{_origin_of_masks(options.conditions)}; success by HandoverSim's rules"
    )


def _origin_of_masks(conditions: Sequence[str]) -> str:
    """Say of which conditions masks and keypoints are the simulator's, and of which networks'."""
    from hadr.simulation.trials.trial import finds_by_networks

    told = ", ".join(name for name in conditions if not finds_by_networks(name))
    found = ", ".join(name for name in conditions if finds_by_networks(name))
    by_simulator = f"from the simulator with noise{f' for {told}' if found else ''}" if told else ""
    by_networks = f"from networks for {found}" if found else ""
    return f"masks and keypoints {' and '.join(filter(None, (by_simulator, by_networks)))}"


def _say(trial: Any, row: dict[str, Any]) -> None:
    print(
        f"{trial.condition:18} {trial.name}  {row['verdict']:14} {row['decided_at']:5.1f} s  "
        f"{row['motion']:8} {row['kind']:8} {row['reason']}",
        flush=True,
    )


def _sum_up(row: dict[str, Any]) -> str:
    low, high = row["interval"]
    failures = ", ".join(f"{count} {kind}" for kind, count in row["failures"].items()) or "none"
    return (
        f"{row['condition']}: {row['successes']} of {row['attempts']} "
        f"({100 * row['rate']:.1f} %, 95 % interval {100 * low:.0f} to {100 * high:.0f}); "
        f"failures: {failures}; largest force {row['largest_force_n']:.1f} N"
    )

"""Put the handover experiment's results, and the recordings of chapter 13, where they belong.

    hadr handover --out build/handover                                          (the table)
    python benchmarks/handover_bundle.py --out build/handover \\
        --films success=hadr/0004-904 failure=raw/0006-900

    hadr handover --conditions perfect --out build/perfect                    (made worse)
    hadr handover --conditions perfect --extrinsics-error 3 --out build/turned
    python benchmarks/handover_bundle.py --worse build/perfect build/turned

    for seed in 0 1 2 3; do                                                   (several seeds)
        hadr handover --conditions hadr-plus perfect --seed $seed --out build/seed-$seed
    done
    python benchmarks/handover_bundle.py --seeds build/seed-*

Rows are summed up from the attempts' own sealed files; films, each with the picture of the moment
that decided it, are drawn from their states. With the films go the recordings of the attempt that
the chapter shows with four kinds of depth.
"""

import argparse
import json
import shutil
from pathlib import Path
from typing import Any

from PIL import Image

from hadr.data.samples import samples_dir, write_manifest
from hadr.figures.handover.film import decisive_state
from hadr.figures.tables.handover import SEEN, WORSE, commonest_parting
from hadr.records.provenance import machine_text
from hadr.records.result_file import read_result_file, write_result_file
from hadr.simulation.film.film import captioned, film_frames, write_film
from hadr.simulation.film.world_view import FilmSet, side_view
from hadr.simulation.trials.experiment import (
    condition_row,
    ending_of,
    finished_attempt,
    read_row,
)
from hadr.simulation.trials.trial import Trial


def outcomes_below(folder: Path, condition: str) -> list[dict[str, Any]]:
    """All finished attempts of a condition, in the order of their names."""
    found = []
    for path in sorted((folder / condition).glob("*-*.json")):
        try:
            trial = Trial(**read_row(path)["trial"])
        except (KeyError, TypeError) as error:
            raise ValueError(f"{path} describes no attempt: {error}") from error
        found.append(finished_attempt(folder, trial)[0])
    return found


def worse_row(condition: str, outcomes: list[dict[str, Any]]) -> dict[str, Any]:
    """A condition's row with what was made worse."""
    trial = Trial(**outcomes[0]["trial"])
    made = {name: getattr(trial, name) for name in (*WORSE, "restless", "time_limit")}
    return {**condition_row(condition, outcomes), **made}


def keep(out: Path, kept: Path, trial: Trial) -> None:
    """Copy an attempt's row and states."""
    (kept / trial.condition).mkdir(parents=True, exist_ok=True)
    for ending in (".json", ".npz"):
        name = f"{trial.condition}/{trial.name}{ending}"
        shutil.copy(out / name, kept / name)


def bundle_worse(path: Path, folders: list[Path]) -> None:
    """Sum up attempts that were made worse, and those of the folder in which nothing was."""
    files = [read_result_file(folder / "handover.json") for folder in folders]
    rows = [
        worse_row(row["condition"], outcomes_below(folder, row["condition"]))
        for folder, file in zip(folders, files, strict=True)
        for row in file.rows
    ]
    commits = {file.provenance["commit"] for file in files}
    if len(commits) > 1:
        raise ValueError(f"the folders are of different commits: {', '.join(sorted(commits))}")
    what = "handover attempts in simulation, made worse one by one; success by HandoverSim's rules"
    write_result_file(path, what, rows, {**files[0].provenance, "machine": machine_text()})


def bundle_seeds(path: Path, folders: list[Path]) -> None:
    """Sum up the attempts of several seeds, a folder each, by condition."""
    files = [read_result_file(folder / "handover.json") for folder in folders]
    commits = {file.provenance["commit"] for file in files}
    if len(commits) > 1:
        raise ValueError(f"the folders are of different commits: {', '.join(sorted(commits))}")
    conditions = [row["condition"] for row in files[0].rows]
    rows = [
        condition_row(name, [one for of in folders for one in outcomes_below(of, name)])
        for name in conditions
    ]
    what = f"handover attempts in simulation, of {len(folders)} seeds; by HandoverSim's rules"
    write_result_file(path, what, rows, {**files[0].provenance, "machine": machine_text()})


def main() -> None:
    """Run the script."""
    parser = argparse.ArgumentParser(description=__doc__)
    which = parser.add_mutually_exclusive_group(required=True)
    which.add_argument("--out", type=Path, help="folder of the table's attempts")
    which.add_argument("--worse", type=Path, nargs="+", help="folders made worse, and one not")
    which.add_argument("--seeds", type=Path, nargs="+", help="folders of one seed each")
    parser.add_argument("--films", nargs="*", default=[], metavar="NAME=CONDITION/OBJECT-HOLD")
    parser.add_argument("--results", type=Path, default=Path("results/mini"))
    args = parser.parse_args()
    if args.worse is not None:
        bundle_worse(args.results / "handover_worse.json", args.worse)
        return
    if args.seeds is not None:
        bundle_seeds(args.results / "handover_seeds.json", args.seeds)
        return
    table = read_result_file(args.out / "handover.json")
    write_result_file(args.results / "handover.json", table.what, table.rows, table.provenance)
    kept = samples_dir() / "handover"
    films = {}
    if args.films:
        shutil.rmtree(kept, ignore_errors=True)
    for wish in args.films:
        name, _, where = wish.partition("=")
        condition, _, attempt = where.partition("/")
        object_id, _, hold = attempt.partition("-")
        trial = Trial(object_id, int(hold), condition=condition)
        row, states, changes, scene = finished_attempt(args.out, trial)
        keep(args.out, kept, trial)
        view = side_view(480, 270)
        frames = film_frames(states, scene, changes, view=view, rate=10, ending=ending_of(row))
        write_film(kept / f"{name}.mp4", frames, rate=10)
        state = decisive_state(states, row)
        drawn, span = FilmSet(scene, view).draw(state), (states[0].time, states[-1].time)
        still = captioned(drawn, state.time, changes, span, ending_of(row))
        Image.fromarray(still).save(kept / f"{name}.jpg", quality=80)
        films[name] = [condition, object_id, int(hold)]
    if films:
        object_id, _, hold = commonest_parting(table.rows, SEEN).partition("-")
        for seen in SEEN:
            keep(args.out, kept, Trial(object_id, int(hold), condition=seen))
        (kept / "films.json").write_text(json.dumps(films, indent=1) + "\n", encoding="utf-8")
        write_manifest(samples_dir())


if __name__ == "__main__":
    main()

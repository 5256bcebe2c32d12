"""Put the handover experiment's results, and the recordings of chapter 13, where they belong.

    hadr handover --out build/handover                                          (the table)
    python benchmarks/handover_bundle.py --table build/handover
    python benchmarks/handover_bundle.py --films build/handover success=hadr/0004-904

    hadr handover --conditions perfect --out build/perfect                    (made worse)
    hadr handover --conditions perfect --extrinsics-error 3 --out build/turned
    python benchmarks/handover_bundle.py --worse build/perfect build/turned
    python benchmarks/handover_bundle.py --worse results/mini/handover_worse.json build/restless

    for seed in 0 1 2 3; do                                                   (several seeds)
        hadr handover --conditions hadr-plus perfect --seed $seed --out build/seed-$seed
    done
    python benchmarks/handover_bundle.py --seeds build/seed-*
    python benchmarks/handover_bundle.py --seeds results/mini/handover_seeds.json build/seed-4

Rows are summed up from the attempts' own sealed files; films, each with the picture of the moment
that decided it, are drawn from their states. Besides the named ones they are of the two attempts
that tell kinds of depth apart most often, with each kind, and with HADR-plus also without a part of
the method; the recordings go with them.
"""

import argparse
import json
import shutil
from pathlib import Path
from typing import Any

from PIL import Image

from hadr.data.samples import samples_dir, write_manifest
from hadr.figures.handover.film import decisive_state
from hadr.figures.tables.handover import FILMED, FILMED_PARTS, SEEN, WORSE, partings
from hadr.records.provenance import machine_text
from hadr.records.result_file import read_result_file, write_result_file
from hadr.simulation.film.film import captioned, film_frames, write_film
from hadr.simulation.film.world_view import FilmSet, side_view
from hadr.simulation.trials.experiment import (
    ending_of,
    finished_attempt,
    read_row,
)
from hadr.simulation.trials.summary import condition_row, pooled
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


def bundle_worse(path: Path, made: list[Path]) -> None:
    """Sum up attempts that were made worse, and those of the folder in which nothing was.

    The rows of a file that is named beside the folders stay as they are.
    """
    rows = []
    for one in made:
        if one.is_dir():
            names = [row["condition"] for row in read_result_file(one / "handover.json").rows]
            rows += [worse_row(name, outcomes_below(one, name)) for name in names]
        else:
            rows += read_result_file(one).rows
    what = "handover attempts in simulation, made worse one by one; success by HandoverSim's rules"
    write_result_file(path, what, rows, provenance_of(made))


def bundle_seeds(path: Path, made: list[Path]) -> None:
    """Pool the rows of several seeds, each a folder or a file of some of them, by condition."""
    rows: dict[str, dict[str, Any]] = {}
    for one in made:
        for row in read_result_file(one / "handover.json" if one.is_dir() else one).rows:
            name = row["condition"]
            rows[name] = pooled(rows[name], row) if name in rows else row
    what = "handover attempts in simulation, of several seeds; by HandoverSim's rules"
    write_result_file(path, what, list(rows.values()), provenance_of(made))


def provenance_of(made: list[Path]) -> dict[str, Any]:
    """The provenance of what was summed up last, with the commits of all."""
    files = [read_result_file(one / "handover.json" if one.is_dir() else one) for one in made]
    earlier = {commit for file in files for commit in file.provenance.get("commits", [])}
    commits = earlier | {str(file.provenance["commit"]) for file in files}
    return {**files[-1].provenance, "commits": sorted(commits), "machine": machine_text()}


def bundle_films(table: Path, out: Path, wishes: list[str]) -> None:
    """Draw the films and keep the recordings of the chapter, in place of those that are there."""
    attempts = dict(wish.partition("=")[::2] for wish in wishes)
    for number, name in enumerate(partings(read_result_file(table).rows, SEEN)[:2], start=1):
        attempts |= {
            f"{condition}-{number}": f"{condition}/{name}" for condition in (*FILMED, *FILMED_PARTS)
        }
    kept, films = samples_dir() / "handover", {}
    shutil.rmtree(kept, ignore_errors=True)
    for name, where in attempts.items():
        condition, _, attempt = where.partition("/")
        object_id, _, hold = attempt.partition("-")
        trial = Trial(object_id, int(hold), condition=condition)
        row, states, changes, scene = finished_attempt(out, trial)
        keep(out, kept, trial)
        view = side_view(480, 270)
        frames = film_frames(states, scene, changes, view=view, rate=10, ending=ending_of(row))
        write_film(kept / f"{name}.mp4", frames, rate=10)
        state = decisive_state(states, row)
        drawn, span = FilmSet(scene, view).draw(state), (states[0].time, states[-1].time)
        still = captioned(drawn, state.time, changes, span, ending_of(row))
        Image.fromarray(still).save(kept / f"{name}.jpg", quality=80)
        films[name] = [condition, object_id, int(hold)]
    (kept / "films.json").write_text(json.dumps(films, indent=1) + "\n", encoding="utf-8")
    write_manifest(samples_dir())


def main() -> None:
    """Run the script."""
    parser = argparse.ArgumentParser(description=__doc__)
    which = parser.add_mutually_exclusive_group(required=True)
    which.add_argument("--table", type=Path, help="folder of the table's attempts")
    which.add_argument("--worse", type=Path, nargs="+", help="folders made worse, and one not")
    which.add_argument("--seeds", type=Path, nargs="+", help="folders or files of seeds")
    which.add_argument("--films", nargs="+", metavar=("FOLDER", "NAME=WHICH"))
    parser.add_argument("--results", type=Path, default=Path("results/mini"))
    args = parser.parse_args()
    if args.worse is not None:
        bundle_worse(args.results / "handover_worse.json", args.worse)
    elif args.seeds is not None:
        bundle_seeds(args.results / "handover_seeds.json", args.seeds)
    elif args.films is not None:
        bundle_films(args.results / "handover.json", Path(args.films[0]), args.films[1:])
    else:
        table = read_result_file(args.table / "handover.json")
        write_result_file(args.results / "handover.json", table.what, table.rows, table.provenance)


if __name__ == "__main__":
    main()

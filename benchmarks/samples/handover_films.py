"""Draw the films of chapter 13 and keep the recordings that it reads, in data_samples.

    python benchmarks/handover/handover_tables.py --out RUNS --only handover
    python benchmarks/samples/handover_films.py RUNS/seed-0 \\
        success=hadr-plus/0004-905 failure-depth=hadr-plus/0008-904

Films, each with the picture of the moment that decided it, are drawn from the states of finished
attempts. Besides the named ones they are of the two attempts that tell kinds of depth apart most
often, with each kind, and with HADR-plus also without a part of the method; the recordings go with
them.
"""

import argparse
import json
import shutil
from pathlib import Path

from PIL import Image

from hadr.data.samples import samples_dir, write_manifest
from hadr.figures.handover.film import decisive_state
from hadr.figures.tables.handover import FILMED, FILMED_PARTS, SEEN, partings
from hadr.records.result_file import read_result_file
from hadr.simulation.film.film import captioned, film_frames, write_film
from hadr.simulation.film.world_view import FilmSet, side_view
from hadr.simulation.trials.experiment import ending_of, finished_attempt
from hadr.simulation.trials.trial import Trial


def keep(out: Path, kept: Path, trial: Trial) -> None:
    """Copy an attempt's row and states."""
    (kept / trial.condition).mkdir(parents=True, exist_ok=True)
    for ending in (".json", ".npz"):
        name = f"{trial.condition}/{trial.name}{ending}"
        shutil.copy(out / name, kept / name)


def draw_films(table: Path, out: Path, wishes: list[str]) -> None:
    """Draw the films and keep the recordings of the chapter, in place of those that are there."""
    attempts = dict(wish.partition("=")[::2] for wish in wishes)
    for number, name in enumerate(partings(read_result_file(table).rows, SEEN)[:2], start=1):
        attempts |= {
            f"{condition}-{number}": f"{condition}/{name}" for condition in (*FILMED, *FILMED_PARTS)
        }
    films, trials = {}, {}
    for name, where in attempts.items():
        condition, _, attempt = where.partition("/")
        object_id, _, hold = attempt.partition("-")
        trials[name] = Trial(object_id, int(hold), condition=condition)
        finished_attempt(out, trials[name])  # before anything is removed
    kept = samples_dir() / "handover"
    shutil.rmtree(kept, ignore_errors=True)
    for name, trial in trials.items():
        row, states, changes, scene = finished_attempt(out, trial)
        keep(out, kept, trial)
        view = side_view(480, 270)
        frames = film_frames(states, scene, changes, view=view, rate=10, ending=ending_of(row))
        write_film(kept / f"{name}.mp4", frames, rate=10)
        state = decisive_state(states, row)
        drawn, span = FilmSet(scene, view).draw(state), (states[0].time, states[-1].time)
        still = captioned(drawn, state.time, changes, span, ending_of(row))
        Image.fromarray(still).save(kept / f"{name}.jpg", quality=80)
        films[name] = [trial.condition, trial.object_id, trial.hold_number]
    (kept / "films.json").write_text(json.dumps(films, indent=1) + "\n", encoding="utf-8")
    write_manifest(samples_dir())


def main() -> None:
    """Run the script."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path, help="folder of finished attempts")
    parser.add_argument("films", nargs="*", metavar="NAME=CONDITION/ATTEMPT")
    parser.add_argument("--table", type=Path, default=Path("results/mini/handover.json"))
    args = parser.parse_args()
    draw_films(args.table, args.out, args.films)


if __name__ == "__main__":
    main()

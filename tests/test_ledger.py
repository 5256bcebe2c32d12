"""The ledger names options that exist, and has every row."""

import importlib
import inspect
import re
from dataclasses import fields, is_dataclass
from pathlib import Path

import pytest

from hadr.press.report import ledger_effects, switch_effects
from hadr.records.result_file import read_result_file

ROOT = Path(__file__).resolve().parents[1]
SHORT = ROOT / "results" / "training" / "switches.json"
TEXT = (ROOT / "book" / "ledger.md").read_text(encoding="utf-8")
NAMED = sorted(set(re.findall(r"`(hadr(?:\.\w+)+)(?:\(([\w, ]+)\))?`", TEXT)))


def resolve(path):
    parts = path.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        for name in parts[cut:]:
            found = getattr(found, name)
        return found
    raise ModuleNotFoundError(path)


@pytest.mark.parametrize(("path", "options"), NAMED, ids=[path for path, _ in NAMED])
def test_every_switch_exists(path, options):
    found = resolve(path)
    if not options:
        return
    if is_dataclass(found):
        known = {item.name for item in fields(found)}
    else:
        known = set(inspect.signature(found).parameters)
    assert set(options.split(", ")) <= known


def test_all_rows_are_there_with_their_four_parts():
    rows = re.findall(r"^## (\d+)\. \S", TEXT, re.MULTILINE)
    assert [int(row) for row in rows] == list(range(1, 35))
    for part in ("The paper", "The published code", "What we do, and why", "The switch"):
        assert len(re.findall(rf"^{part}\n: \S", TEXT, re.MULTILINE)) == 34


def overview():
    """Number, title and what was measured of each row of the first table."""
    rows = re.findall(r"^\| \[(\d+)\]\(#ledger-(\d+)\) \| (.+?) \| .+? \| (.+?) \|$", TEXT, re.M)
    assert all(shown == target for shown, target, _, _ in rows)
    return [(int(number), title, measured) for number, _, title, measured in rows]


def test_the_overview_has_the_rows_that_follow():
    headings = re.findall(r"^\(ledger-(\d+)\)=\n## (\d+)\. (.+)$", TEXT, re.MULTILINE)
    assert all(anchor == number for anchor, number, _ in headings)
    assert [row[:2] for row in overview()] == [(int(n), title) for _, n, title in headings]
    assert len(headings) == 34
    index = (ROOT / "book" / "index.md").read_text(encoding="utf-8")
    assert f"lists the {len(headings)} places" in index


def test_what_was_measured_is_counted_as_the_table_has_it():
    rows = overview()
    below = [number for number, _, measured in rows if measured == "yes, below"]
    lines = ledger_effects(ROOT / "results" / "mini").splitlines()[2:]
    assert [f"[{number}](#ledger-{number})" for number in below] == [
        line.strip("| ").split(" ")[0] for line in lines
    ]
    chapters = re.compile(
        r"(?:by example|in part), \[chapter (\d+)\]\((notebooks/(\d+)_\w+)\.ipynb\)"
    )
    shown = [chapters.fullmatch(measured) for _, _, measured in rows if "chapter" in measured]
    assert all(match and int(match[1]) == int(match[3]) for match in shown)
    assert all((ROOT / f"{match[2]}.ipynb").is_file() for match in shown)
    tried = {effect["row"] for effect in switch_effects(SHORT)} - {0}
    short = [number for number, _, measured in rows if measured == "in a trial, below"]
    assert short == sorted(tried - set(below))
    unmeasured = [number for number, _, measured in rows if measured == "no"]
    assert len(below) + len(short) + len(shown) + len(unmeasured) == len(rows)
    text = " ".join(TEXT.split())
    assert f" {len(short)} more were tried in short trainings" in text
    assert f"Of the {len(rows)} rows, {len(below)} were measured" in text
    robot = [match for match in shown if match and int(match[1]) >= 10]
    assert f" {len(robot)} more are about the robot, and chapters 10 to 12 show" in text
    assert f"The other {len(unmeasured)} were not measured at all" in text


def test_what_the_page_says_of_short_trainings_is_so():
    effects = {effect["turned"]: effect for effect in switch_effects(SHORT)}
    file = read_result_file(SHORT)
    rows = {row["turned"]: row for row in reversed(file.rows)}  # the first seed's
    effects.pop("as it is")
    seeds = sum(row["turned"] == "as it is" for row in file.rows)
    assert f"trained with {('two', 'three')[seeds - 2]} seeds" in " ".join(TEXT.split())
    assert len(file.provenance["measured"]) == 144
    clear = {name for name, effect in effects.items()
             if abs(effect["RMSE"][0]) > 2 * effect["RMSE"][1]}  # fmt: skip
    worse = {name for name in clear if effects[name]["RMSE"][0] > 0}
    assert worse == {"no hand", "other layers begin as published"}
    cells = {"6 cells", "cells begin at 0 m"}
    assert clear - worse == cells | {"encoder from random weights", "probability clamped"}
    assert (
        max(effects, key=lambda name: effects[name]["RMSE"][0]) == "other layers begin as published"
    )
    sees = {name: row["sees"] for name, row in rows.items()}
    base, random = sees["as it is"], sees["encoder from random weights"]
    assert random["color_gain_m"] < 0.001 < 0.002 < base["color_gain_m"] < 0.005
    long = read_result_file(ROOT / "results" / "imagenet" / "colors.json")
    learned = long.row(method="hadr", split="known")
    assert learned["rmse_others_colors_m"] - learned["rmse_m"] > 0.01
    one_rate = sees["one rate for all layers"]
    assert one_rate["rank_3"] / base["rank_3"] == pytest.approx(0.6, abs=0.02)  # "two fifths"
    assert {1, 2, 3, 10, 28, 29, 30, 31, 32, 33} <= {effect["row"] for effect in effects.values()}
    level = set(effects) - clear
    assert {"loss weights as coded", "depth loss over z alone", "no ReLU on voxels"} <= level
    taught = effects["predicted keypoints in training"]["RMSE with predicted keypoints"]
    assert abs(taught[0]) < 2 * taught[1]


def test_what_row_3_says_of_other_cells_is_so():
    effects = {effect["turned"]: effect["RMSE"][0] for effect in switch_effects(SHORT)}
    assert [effects["6 cells"], effects["cells begin at 0 m"]] == pytest.approx(
        [-0.007, -0.006], abs=0.0005)  # fmt: skip
    folder = ROOT / "results" / "imagenet"
    ledger = read_result_file(folder / "ledger.json")
    seeds = read_result_file(folder / "known.json").row(method="hadr")["by_seed"]["rmse_m"]
    found = [ledger.row(method=m)["rmse_m"] for m in ("six-cells", "cells-from-zero")]
    six, zero, least, most = (f"{100 * value:.2f}" for value in (*found, min(seeds), max(seeds)))
    assert f"{six} cm with six cells and {zero} with eight from 0 m on" in TEXT
    assert f"three as published have {least} to {most}" in TEXT


def test_the_library_points_to_rows_that_exist():
    for path in (ROOT / "hadr").rglob("*.py"):
        for first, last in re.findall(
            r"ledger(?:'s)?,? rows? (\d+)(?: to (\d+))?", path.read_text(encoding="utf-8")
        ):
            assert 1 <= int(first) <= 34
            assert not last or int(last) <= 34

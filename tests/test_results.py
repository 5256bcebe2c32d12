"""The result files are whole, and what is printed of them is what they say."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from hadr.experiments.conditions import IN_CONDITIONS, WITH_HAND
from hadr.experiments.plan import OFTEN
from hadr.experiments.report import TITLES, report
from hadr.experiments.systems import METHODS
from hadr.experiments.tables import ABLATION, FILES, LEDGER
from hadr.result_file import digest, read_result_file, read_result_files
from hadr.synthesis.objects import OBJECTS, UNKNOWN_OBJECTS

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "results"
DELTAS = ("delta_105", "delta_110", "delta_125")
METHOD = {
    "raw": "raw",
    "inpainting": "inpainting",
    "hand's median": "hand-median",
    "HADR": "hadr",
    "U-Net with the hand": "unet-hand",
    "HADR-plus": "hadr-plus",
}


def test_the_readmes_table_is_the_result_files() -> None:
    table = read_result_files(RESULTS / "mini", "known", "unknown")
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    begins = ("| root mean square", "| known objects", "| unknown objects")
    lines = [line for line in text.splitlines() if line.startswith(begins)]
    head, known, unknown = ([c.strip() for c in line.strip("|").split("|")] for line in lines)
    for split, cells in (("known", known), ("unknown", unknown)):
        for name, said in zip(head[1:], cells[1:], strict=True):
            row = table.row(method=METHOD[name], split=split)
            assert said == f"{100 * row['rmse_m']:.1f}", f"{name}, {split}"
            frames = int(re.sub(r"\D", "", cells[0]))
            assert frames == row["frames"]


def test_the_readmes_words_on_predicted_masks_are_the_result_files() -> None:
    chain = read_result_file(RESULTS / "mini" / "chain.json")
    text = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    said = re.search(
        r"HADR \(the bundled one\) reaches ([\d.]+) cm and HADR-plus ([\d.]+) cm", text
    )
    assert said is not None
    for method, number in zip(("hadr", "hadr-plus"), said.groups(), strict=True):
        row = chain.row(method=method, given="both predicted")
        assert number == f"{100 * row['rmse_m']:.1f}"


def test_the_readmes_frames_a_second_are_the_result_files() -> None:
    speed = json.loads((RESULTS / "speed" / "perception.json").read_text(encoding="utf-8"))
    rate = speed["frames_per_second"]["as it is"]["wall_median"]
    assert f"[{rate:.0f} frames a second]" in (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["known", "unknown", "ablation", "ledger"])
def test_rows_of_the_mini_tables_hang_together(name: str) -> None:
    table = read_result_file(RESULTS / "mini" / f"{name}.json")
    assert {"commit", "versions", "machine", "data", "sha256"} <= set(table.provenance)
    for row in table.rows:
        assert len(row["config_sha256"]) == len(row["seeds"]) == len(row["by_seed"]["rmse_m"])
        assert row["config_sha256"][0] == digest(row["configuration"])
        assert row["rmse_m"] == pytest.approx(sum(row["by_seed"]["rmse_m"]) / len(row["seeds"]))
        assert (row["seed_sd"]["rmse_m"] is None) == (len(row["seeds"]) == 1)
        assert row["mae_m"] <= row["rmse_m"]
        assert row["delta_105"] <= row["delta_110"] <= row["delta_125"]
        assert set(row["pooled"]) == {"rmse_m", "rel", "mae_m", *DELTAS}
        assert row["provenance"]["data_sha256"] == table.provenance["data"]["sha256"]
        assert row["provenance"]["commit"]
        objects = UNKNOWN_OBJECTS if row["split"] == "unknown" else OBJECTS
        assert set(row["by_object"]) == set(objects)
        if "parameters" in row:
            assert len(row["curve"]["validation_rmse_m"]) == row["epochs"]
            assert row["training_s"] > 0


def test_the_tables_have_every_method() -> None:
    mini = RESULTS / "mini"
    found = {name: {row["method"] for row in read_result_file(mini / f"{name}.json").rows}
             for name in FILES}  # fmt: skip
    assert found["known"] == set(METHODS)
    assert found["unknown"] >= set(METHODS) - {"hadr-long"}
    assert found["ablation"] == set(ABLATION)
    assert found["ledger"] == set(LEDGER)
    unknown = read_result_file(mini / "unknown.json")
    for method in OFTEN:
        assert len(unknown.row(method=method)["seeds"]) >= 3
    assert found["keypoints"] == set(WITH_HAND)
    assert found["segmentation"] == set(IN_CONDITIONS)


def test_errors_taken_apart_are_those_of_the_tables() -> None:
    table = read_result_files(RESULTS / "mini", "known", "unknown")
    parts = read_result_file(RESULTS / "mini" / "errors.json")
    for row in table.rows:
        if "parameters" in row:
            apart = parts.row(method=row["method"], split=row["split"])
            assert apart["rmse_m"] == pytest.approx(row["by_seed"]["rmse_m"][0], abs=1e-6)


def test_the_report_prints_what_the_files_say() -> None:
    text = report(RESULTS / "mini", RESULTS / "paper_tables.json")
    sections = text.split("\n## ")[1:]
    for name, section in zip(TITLES, sections, strict=True):
        table = read_result_file(RESULTS / "mini" / f"{name}.json")
        printed = [line for line in section.splitlines() if "**" in line and line.startswith("|")]
        assert len(printed) == len(table.rows)
        for line, row in zip(printed, table.rows, strict=True):
            numbers = re.findall(r"\*\*([-\d.]+)\*\*", line)
            wanted = [100 * row["rmse_m"], 100 * row["rel"], 100 * row["mae_m"]]
            wanted += [row[delta] for delta in DELTAS]
            assert numbers == [f"{value:.2f}" for value in wanted]


@pytest.mark.parametrize("path", sorted(RESULTS.rglob("*.json")), ids=lambda p: p.name)
def test_result_files_are_as_they_were_written(path: Path) -> None:
    content = json.loads(path.read_text(encoding="utf-8"))
    if "sha256" in content.get("provenance", {}):
        read_result_file(path)  # raises where a number was changed by hand

"""The result files are whole, and what is printed of them is what they say."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from hadr.experiments.systems import METHODS
from hadr.result_file import read_result_file
from hadr.synthesis.objects import OBJECTS, UNKNOWN_OBJECTS

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "results"
METHOD = {
    "raw": "raw",
    "inpainting": "inpainting",
    "hand's median": "hand-median",
    "HADR": "hadr",
    "U-Net with the hand": "unet-hand",
    "HADR-plus": "hadr-plus",
}


def test_the_readmes_table_is_the_result_files() -> None:
    table = read_result_file(RESULTS / "mini" / "hadr.json")
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


def test_rows_of_the_mini_table_hang_together() -> None:
    table = read_result_file(RESULTS / "mini" / "hadr.json")
    assert {row["method"] for row in table.rows} <= set(METHODS)
    assert {"commit", "versions", "machine", "data", "sha256"} <= set(table.provenance)
    parts = read_result_file(RESULTS / "mini" / "errors.json")
    for row in table.rows:
        assert row["config_sha256"]
        assert row["seeds"]
        assert row["mae_m"] <= row["rmse_m"]
        assert row["delta_105"] <= row["delta_110"] <= row["delta_125"]
        objects = OBJECTS if row["split"] == "known" else UNKNOWN_OBJECTS
        assert set(row["by_object"]) == set(objects)
        if "parameters" in row:
            assert len(row["curve"]["validation_rmse_m"]) == row["epochs"]
            apart = parts.row(method=row["method"], split=row["split"])
            assert apart["rmse_m"] == pytest.approx(row["rmse_m"], abs=1e-6)


@pytest.mark.parametrize("path", sorted(RESULTS.rglob("*.json")), ids=lambda p: p.name)
def test_result_files_are_as_they_were_written(path: Path) -> None:
    content = json.loads(path.read_text(encoding="utf-8"))
    if "sha256" in content.get("provenance", {}):
        read_result_file(path)  # raises where a number was changed by hand

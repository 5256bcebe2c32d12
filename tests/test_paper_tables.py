"""The published tables, typed into results/paper_tables.json, are what the paper prints."""

import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
TABLES = json.loads((ROOT / "results" / "paper_tables.json").read_text(encoding="utf-8"))
DEPTH_ROWS = [
    (table, name, row)
    for table in ("known", "unknown", "ablation")
    for name, row in TABLES[table].items()
]


@pytest.mark.parametrize(("table", "name", "row"), DEPTH_ROWS)
def test_rows_are_possible(table, name, row):
    rmse, rel, mae, *deltas = row
    assert len(row) == len(TABLES["columns"]) == 6
    assert rmse >= mae > 0
    assert rel > 0
    assert 0 <= deltas[0] <= deltas[1] <= deltas[2] <= 100


def test_tables_are_complete():
    assert list(TABLES["known"]) == list(TABLES["unknown"])
    assert len(TABLES["known"]) == len(TABLES["ablation"]) == 5
    # The full model of the ablation is the method of the comparison.
    assert TABLES["ablation"]["Full Model"] == TABLES["known"]["HADR"]


def test_handover_rates():
    handover = TABLES["handover"]
    rates = {
        name: handover[name][0] / handover["attempts"] for name in ("GraspNet", "HADR + GraspNet")
    }
    assert {name: round(100 * rate, 1) for name, rate in rates.items()} == {
        "GraspNet": 10.4,
        "HADR + GraspNet": 70.8,
    }


def test_values_stand_in_the_paper():
    source = ROOT.parent / "shared" / "paper" / "hadr_paper.tex"
    if not source.is_file():
        pytest.skip("put the paper's LaTeX text at ../shared/paper/hadr_paper.tex to compare")
    text = re.sub(r"\\textbf\{([\d.]+)\}", r"\1", source.read_text(encoding="utf-8"))
    for _, name, row in DEPTH_ROWS:
        printed = [f"{x:.3f}" for x in row[:3]] + [f"{x:.2f}" for x in row[3:]]
        assert " & ".join(printed) in text, name

"""The published tables, typed into results/paper_tables.json, are what the paper prints."""

import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
TABLES = json.loads((ROOT / "results" / "paper_tables.json").read_text(encoding="utf-8"))


def test_handover_rates():
    handover = TABLES["handover"]
    rates = {
        name: handover[name][0] / handover["attempts"] for name in ("GraspNet", "HADR + GraspNet")
    }
    assert {name: round(100 * rate, 1) for name, rate in rates.items()} == {
        "GraspNet": 10.4,
        "HADR + GraspNet": 70.8,
    }
    assert handover["success_rate_percent"] == {"GraspNet": 10.4, "HADR + GraspNet": 70.8}


def printed_tables():
    """The rows of the paper's LaTeX tables as printed: name and numbers, table by table."""
    source = ROOT.parent / "shared" / "paper" / "hadr_paper.tex"
    if not source.is_file():
        pytest.skip("put the paper's LaTeX text at ../shared/paper/hadr_paper.tex to compare")
    text = re.sub(r"\\(?:textbf|cite)\{([^}]*)\}", r"<\1>", source.read_text(encoding="utf-8"))
    tables = []
    for table in re.findall(r"\\begin\{tabular\}.*?\\end\{tabular\}", text, re.DOTALL):
        rows = {}
        for part in re.split(r"\\midrule|\\bottomrule", table):
            for line in part.splitlines():
                cells = [cell.strip() for cell in line.removesuffix(" \\\\").split("&")]
                if len(cells) > 1 and re.search(r"\d", cells[1]):
                    name = re.sub(r"<.*|\(Ours\)", "", cells[0]).strip()
                    numbers = [re.sub(r"[<>\\]", "", cell).strip() for cell in cells[1:]]
                    rows.setdefault(name, []).append(numbers)
        if rows:
            tables.append(rows)
    return tables


def test_every_number_of_the_papers_four_tables_is_here_and_no_other():
    comparison, ablation, handover = printed_tables()
    assert len(comparison) == len(ablation) == 5
    assert len(handover) == 2

    def as_printed(row):
        return [f"{x:.3f}" for x in row[:3]] + [f"{x:.2f}" for x in row[3:]]

    assert comparison == {
        name: [as_printed(TABLES["known"][name]), as_printed(TABLES["unknown"][name])]
        for name in TABLES["known"]
    }
    assert ablation == {name: [as_printed(row)] for name, row in TABLES["ablation"].items()}
    here = TABLES["handover"]
    for name, (printed,) in handover.items():
        won, *reached = here[name]
        counts = [f"{count}/{here['objects']}" for count in reached]
        rate = f"{here['success_rate_percent'][name]}%"
        assert printed == [f"{won}/{here['attempts']}", rate, *counts]

"""The report beside the paper: every number of its tables, ours, the difference, the origin."""

import json
import re
import shlex
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from hadr.cli import parse_options
from hadr.experiments.plan import plan
from hadr.figures.tables.comparison import PUBLISHED_NAMES
from hadr.metrics import METRICS
from hadr.press.paper_report import HANDOVER_NAMES, NOT_RUN, TITLES, report
from hadr.records.result_file import read_result_file, write_result_file

RESULTS = Path(__file__).resolve().parents[2] / "results"
PUBLISHED = RESULTS / "paper_tables.json"
PAPER = json.loads(PUBLISHED.read_text(encoding="utf-8"))


def blocks(text: str, title: str) -> dict[str, dict[str, Any]]:
    """A section's methods: the numbers of each line, and what its details say."""
    of = "" if title == TITLES["handover"] else ", preset mini"
    section = next(s for s in text.split("## ")[1:] if s.startswith(f"{title}{of}\n"))
    found: dict[str, dict[str, Any]] = {}
    for table in re.findall(r"<table.*?</table>", section, re.DOTALL):
        for body in ElementTree.fromstring(table).iter("tbody"):
            name, told = "", {}
            for row in body.iter("tr"):
                kind = row.get("class")
                if kind == "method":
                    name = "".join(row.itertext())
                elif kind == "origin":
                    terms = ["".join(each.itertext()) for each in row.iter("dt")]
                    words = ["".join(each.itertext()) for each in row.iter("dd")]
                    told["origin"] = dict(zip(terms, words, strict=True))
                else:
                    told[str(kind)] = ["".join(cell.itertext()) for cell in row.iter("td")]
            assert name not in found
            found[name] = told
    return found


@pytest.fixture(scope="module")
def text() -> str:
    return report(RESULTS / "mini", PUBLISHED)


@pytest.mark.parametrize("name", ["known", "unknown", "ablation"])
def test_depth_tables_have_every_number(text: str, name: str) -> None:
    found = blocks(text, TITLES[name])
    file = read_result_file(RESULTS / "mini" / f"{name}.json")
    for row in file.rows:
        title = PUBLISHED_NAMES.get(row["method"], "")
        factors = [metric.factor for metric in METRICS.values()]
        own = [factor * row[name] for name, factor in zip(METRICS, factors, strict=True)]
        theirs = PAPER[name].get(title)
        if theirs is None:
            block = next(b for b in found.values() if b["ours"] == [f"{x:.2f}" for x in own])
            assert set(block) == {"ours", "origin"}
        else:
            block = next(b for k, b in found.items() if k.split(" (ours")[0] == title)
            assert [float(x) for x in block["paper"]] == pytest.approx(
                np.multiply(theirs, factors), abs=1e-9
            )
            assert block["ours"] == [f"{x:.2f}" for x in own]
            gaps = np.subtract(own, np.multiply(theirs, factors))
            assert block["difference"] == [f"{gap:+.2f}" for gap in gaps]
        origin = block["origin"]
        assert all(commit[:7] in origin["commit"] for commit in row["provenance"]["commit"])
        assert ("not committed" in origin["commit"]) == row["provenance"]["uncommitted_changes"]
        assert origin["machine"] == row["provenance"]["machine"]
        assert row["config_sha256"][0].startswith(origin["recipe"])
        assert ("of training" in origin["run time"]) == ("training_s" in row)
        words = shlex.split(origin["command"])
        runs = plan([words[words.index("--only") + 1]], seeds=row["seeds"])
        if name == "ablation":  # its full model is HADR of the first table
            runs = [run for run in runs if run.experiment == "known"]
        assert {run.seed for run in runs} == set(row["seeds"])
        assert {f"{run.experiment}/{run.method}" for run in runs} == {
            row["configuration"]["run"].rsplit("/", 1)[0]
        }
    assert len(found) == len(file.rows)
    assert f"`mini/{name}.json`" in text


def test_the_handover_has_every_number(text: str) -> None:
    found = blocks(text, "Handover")
    rows = {
        row["condition"]: row for row in read_result_file(RESULTS / "mini" / "handover.json").rows
    }
    assert len(found) == len(rows)
    for condition, title in HANDOVER_NAMES.items():
        block = next(b for k, b in found.items() if k.split(" (ours")[0] == title)
        won, half, most, whole = PAPER["handover"][title]
        assert block["paper"] == [
            f"{won}/48", f"{PAPER['handover']['success_rate_percent'][title]} %",
            f"{half}/8", f"{most}/8", f"{whole}/8",
        ]  # fmt: skip
        row = rows[condition]
        reached = [row[f"objects_at_{n}_percent"] for n in (50, 80, 100)]
        assert block["ours"] == [
            f"{row['successes']}/48", f"{100 * row['rate']:.1f} %", *(f"{n}/8" for n in reached),
        ]  # fmt: skip
        assert block["difference"] == [
            f"{row['successes'] - won:+d}", f"{100 * (row['successes'] - won) / 48:+.1f}",
            f"{reached[0] - half:+d}", f"{reached[1] - most:+d}", f"{reached[2] - whole:+d}",
        ]  # fmt: skip
    for block in found.values():
        words = shlex.split(block["origin"]["command"])
        assert words[:2] == ["hadr", "handover"]
        parse_options("handover", words[2:])


def test_a_number_without_counterpart_says_why(tmp_path: Path) -> None:
    for name, kept in (("known", ("method", "hadr")), ("handover", ("condition", "raw"))):
        file = read_result_file(RESULTS / "mini" / f"{name}.json")
        rows = [row for row in file.rows if row[kept[0]] == kept[1]]
        write_result_file(tmp_path / f"{name}.json", file.what, rows, file.provenance)
    found = report(tmp_path, PUBLISHED)
    for title, name, there in (("Known objects", "known", "HADR"), ("Handover", "", "GraspNet")):
        section = blocks(found, title)
        numbers = PAPER[name] if name else HANDOVER_NAMES.values()
        assert len(section) == len(numbers)
        for label, block in section.items():
            if label.split(" (ours")[0] == there:
                assert "difference" in block
            else:
                assert block["ours"] == [NOT_RUN]
                assert "difference" not in block
                assert block["origin"]["command"].startswith("hadr ")


def test_few_attempts_are_not_subtracted_from_48(tmp_path: Path) -> None:
    file = read_result_file(RESULTS / "mini" / "handover.json")
    row = {**file.row(condition="hadr"), "attempts": 1, "successes": 1, "rate": 1.0,
           "rate_by_object": {"0004": 1.0}}  # fmt: skip
    write_result_file(tmp_path / "handover.json", file.what, [row], file.provenance)
    block = blocks(report(tmp_path, PUBLISHED, "tiny"), "Handover")["HADR + GraspNet"]
    assert block["ours"][0] == "1/1"
    assert block["difference"] == ["-", "+29.2", "-", "-", "-"]
    assert "--objects 0004" in block["origin"]["command"]

"""The page of findings: verdicts follow from the numbers, and every claim has its evidence."""

import shutil
from pathlib import Path
from typing import Any

import pytest

from hadr.press import found
from hadr.records.result_file import read_result_file, write_result_file

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def results(tmp_path: Path) -> Path:
    for name in ("mini", "imagenet", "speed", "paper_tables.json"):
        source = ROOT / "results" / name
        (shutil.copytree if source.is_dir() else shutil.copy)(source, tmp_path / name)
    return tmp_path


def change(path: Path, wanted: dict[str, Any], **values: Any) -> None:
    file = read_result_file(path)
    file.row(**wanted).update(values)
    write_result_file(path, file.what, file.rows, file.provenance)


def verdicts(results: Path) -> dict[str, str]:
    return {claim.name: claim.verdict for claim in found.claims(results)}


@pytest.mark.parametrize(
    ("difference", "word"), [(2.1, found.AGREES), (2.0, found.UNDECIDED), (-2.1, found.CONTRADICTS)]
)
def test_two_standard_errors_decide(difference: float, word: str) -> None:
    assert found.verdict(difference, 1.0) == word


def test_a_better_rival_and_a_hand_that_harms_turn_the_verdicts(results: Path) -> None:
    before = verdicts(results)
    hadr = read_result_file(results / "imagenet" / "known.json").row(method="hadr")
    change(results / "imagenet" / "known.json", {"method": "dfnet"}, rmse_m=hadr["rmse_m"] / 2)
    gap = {"mean_difference_m": -0.01, "standard_error_m": 0.001}
    change(results / "imagenet" / "ablation.json", {"method": "no-hand"}, against_full=gap)
    after = verdicts(results)
    assert {name for name in after if after[name] != before[name]} >= {
        "HADR before the four rivals on known objects", "the hand feature helps",
    }  # fmt: skip
    assert after["HADR before the four rivals on known objects"] == found.CONTRADICTS
    assert after["the hand feature helps"] == found.CONTRADICTS


def test_more_attempts_won_decide_the_handover(results: Path) -> None:
    path = results / "mini" / "handover_seeds.json"
    names = list(read_result_file(path).row(condition="raw")["verdicts"])
    ends = {few: {name: "success" if n < few else "drop" for n, name in enumerate(names)}
            for few in (5, 24, 43)}  # fmt: skip
    for won, word in ((43, found.AGREES), (5, found.CONTRADICTS), (24, found.UNDECIDED)):
        change(path, {"condition": "hadr"}, verdicts=ends[won])
        change(path, {"condition": "raw"}, verdicts=ends[24])
        assert verdicts(results)["restored depth helps the handover"] == word


def test_every_claim_has_words_a_place_and_evidence_that_is_there() -> None:
    listed = found.claims(ROOT / "results")
    assert len({claim.name for claim in listed}) == len(listed)
    for claim in listed:
        assert claim.verdict in found.VERDICTS
        assert all((claim.name, claim.words, claim.place, claim.ours))
        assert not claim.file or (ROOT / "results" / claim.file).is_file()
    table = found.found_table(ROOT / "results")
    assert table.count("](notebooks/") == len(listed) == len(table.splitlines()) - 2


def test_the_paragraph_counts_all_claims() -> None:
    text = found.found_paragraph(ROOT / "results")
    listed = found.claims(ROOT / "results")
    assert text.startswith(f"The paper makes {len(listed)} claims that ")
    assert [claim.name for claim in listed if claim.name not in text] == []

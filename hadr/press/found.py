"""The paper's claims one by one: what the paper says, what is measured here, and the verdict.

Verdicts follow from the result files by `VERDICTS`, so that they change with the numbers. Errors
are compared by their difference over its standard error: paired where the file has the pairs, else
of the two rows, which on the same frames is too large and so on the safe side.
"""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from hadr.figures.tables.comparison import PUBLISHED_NAMES
from hadr.figures.tables.handover import paired
from hadr.figures.tables.results import NAMES, Row, markdown, rmse_cm
from hadr.metrics import METRICS
from hadr.models.networks import RIVALS
from hadr.records.reading import read_json
from hadr.records.result_file import ResultFile, read_result_file

AGREES, CONTRADICTS, UNDECIDED = "agrees", "contradicts", "undecided"
NOT_REACHED, UNTESTED = "not reached", "not tested"
VERDICTS = {
    AGREES: "ours goes the same way, by more than two standard errors",
    CONTRADICTS: "ours goes the other way, by more than two standard errors",
    UNDECIDED: "ours lies within two standard errors of no difference, or has none to be judged by",
    NOT_REACHED: "a number of the paper's to which ours does not come, on other pictures and with "
    "less training, or in simulation; that contradicts nothing",
    UNTESTED: "nothing here could show it either way",
}
COMPARISON, HANDOVER = "comparison", "handover_experiment"
"""The notebooks of most claims, without their numbers."""
FOLDER = "imagenet"
"""The result files of the depth claims: those of networks that look at the colours."""


@dataclass(frozen=True)
class Claim:
    """A claim of the paper by a few words for it, what it says and where, and our numbers.

    The verdict is one of `VERDICTS`, the chapter a notebook without its number, the file in
    `results/`, or none; the remark is what must be known to read the numbers.
    """

    name: str
    words: str
    place: str
    ours: str
    verdict: str
    chapter: str
    file: str = ""
    remark: str = ""


def verdict(difference: float, standard_error: float) -> str:
    """Judge a claim by what speaks for it, and by the standard error of that."""
    if abs(difference) <= 2 * standard_error:
        return UNDECIDED
    return AGREES if difference > 0 else CONTRADICTS


def claims(results: Path) -> list[Claim]:
    """All claims, in the paper's order, judged by the result files of a folder."""
    paper = read_json(results / "paper_tables.json")
    parts = (_depth_claims, _ablation_claims, _untested_claims, _handover_claims)
    return [claim for part in parts for claim in part(results, paper)]


def _better(ours: Row, others: Sequence[Row]) -> str:
    """Whether a row's RMSE is below that of all others."""
    found = []
    for row in others:
        doubt = math.hypot(row["rmse_standard_error_m"], ours["rmse_standard_error_m"])
        found.append(verdict(row["rmse_m"] - ours["rmse_m"], doubt))
    return next((word for word in (CONTRADICTS, UNDECIDED) if word in found), AGREES)


def _first(metric: str, ours: Row, others: Sequence[Row]) -> bool:
    """Whether a row is best in a metric."""
    sign = -1 if METRICS[metric].larger_is_better else 1
    return all(sign * ours[metric] < sign * row[metric] for row in others)


def _depth_claims(results: Path, paper: Mapping[str, Any]) -> Iterator[Claim]:
    words = {
        "known": "On known objects HADR has the smallest RMSE of the five systems (SwinDRNet the "
        "same)",
        "unknown": "On unknown objects HADR is significantly better than all four others",
    }
    for split, claimed in words.items():
        name = f"{FOLDER}/{split}.json"
        file = read_result_file(results / name)
        ours, others = file.row(method="hadr"), [file.row(method=rival) for rival in RIVALS]
        theirs = [100 * paper[split][PUBLISHED_NAMES[rival]][0] for rival in RIVALS]
        own = 100 * paper[split]["HADR"][0]
        measured = [metric for metric in METRICS if metric in ours]
        nearest = min(others, key=lambda row: float(row["rmse_m"]))
        yield Claim(
            f"HADR before the four rivals on {split} objects",
            f"{claimed}: {own:.1f} cm against {min(theirs):.1f} to {max(theirs):.1f}.",
            "abstract, IV-A, table I",
            f"HADR {rmse_cm(ours)} cm, the next, {NAMES[nearest['method']]}, {rmse_cm(nearest)}; "
            f"first in {sum(_first(one, ours, others) for one in measured)} of {len(measured)} "
            "metrics",
            _better(ours, others), COMPARISON, name,
        )  # fmt: skip
        if split == "known":
            yield from _second(file, paper["columns"], paper[split])
            refined = file.row(method="lidf")
            apart = read_result_file(results / FOLDER / "errors.json").row(
                method="lidf", split=split
            )
            first = 100 * apart["refinement"]["first_stage_rmse_m"]
            yield Claim(
                "HADR needs no refinement",
                f"Unlike LIDF, HADR is good without a second stage: {own:.1f} cm against "
                f"{100 * paper[split]['LIDF+Refine'][0]:.1f}.",
                "IV-A",
                f"HADR {rmse_cm(ours)} cm, LIDF refined {rmse_cm(refined)}, its first stage "
                f"{first:.2f}",
                UNTESTED, COMPARISON, name,
                "HADR was not refined here.",
            )  # fmt: skip
        yield Claim(
            f"the published error on {split} objects", f"HADR's RMSE is {own:.1f} cm.", "table I",
            f"{rmse_cm(ours)} cm", NOT_REACHED, COMPARISON, name,
            "On other pictures, by a smaller network that learned for minutes: the digits may not "
            "be compared.",
        )  # fmt: skip


def _second(
    file: ResultFile, columns: Sequence[str], printed: Mapping[str, Sequence[float]]
) -> Iterator[Claim]:
    """The two metrics in which the paper has SwinDRNet before HADR; they have no standard error."""
    ours, rival = file.row(method="hadr"), file.row(method="swindrnet")
    behind = (ours["rel"] > rival["rel"]) + (ours["delta_125"] < rival["delta_125"])
    word = AGREES if behind == 2 else UNDECIDED
    theirs = [dict(zip(columns, printed[name], strict=True)) for name in ("HADR", "SwinDRNet")]
    told = [
        "; ".join(
            f"{metric.heading}: {metric.text(one[name])} and {metric.text(other[name])}"
            for name, metric in METRICS.items()
            if name in ("rel", "delta_125")
        )
        for one, other in (theirs, (ours, rival))
    ]
    yield Claim(
        "SwinDRNet a little before HADR in two metrics",
        f"In two metrics of six HADR is a little behind SwinDRNet ({told[0]}).",
        "IV-A, table I", told[1], word, COMPARISON,
        f"{FOLDER}/known.json",
        f"Judged by the two signs alone (here HADR is behind in {behind} of the two), since these "
        "metrics have no standard error; so it can agree and cannot be contradicted.",
    )  # fmt: skip


def _of_seeds(row: Row) -> float:
    """The standard error of a row's RMSE over its seeds, metres; 0 where there is one alone."""
    spread: float | None = row["seed_sd"]["rmse_m"]
    return 0.0 if spread is None else spread / math.sqrt(len(row["seeds"]))


def _ablation_claims(results: Path, paper: Mapping[str, Any]) -> Iterator[Claim]:
    name = f"{FOLDER}/ablation.json"
    file = read_result_file(results / name)
    full = file.row(method="full")
    ledger = read_result_file(results / FOLDER / "ledger.json")
    thawed = ledger.row(method="no-aggregation-thawed")
    remarks = {
        "no-aggregation": "Without it only the encoder's first stage is left, which is frozen in "
        f"this preset; where it learns, too, the error is {rmse_cm(thawed)} cm."
    }
    theirs = {row: 100 * numbers[0] for row, numbers in paper["ablation"].items()}
    within = {row: numbers[3] for row, numbers in paper["ablation"].items()}  # delta 1.05, %
    words = {
        "no-hand": ("the hand feature helps", "Without the hand feature the error grows"),
        "no-aggregation": ("aggregating all scales helps", "Without aggregation it grows"),
        "no-point-fusion": (
            "point fusion helps", "Without point fusion overall performance drops"),
    }  # fmt: skip
    for method, (short, claimed) in words.items():
        row = file.row(method=method)
        gap = row["against_full"]
        mean = gap["mean_difference_m"]
        doubt = math.hypot(gap["standard_error_m"], _of_seeds(row), _of_seeds(full))
        yield Claim(
            short,
            f"{claimed}: RMSE {theirs['Full Model']:.1f} to {theirs[PUBLISHED_NAMES[method]]:.1f} "
            f"cm, δ1.05 {within['Full Model']:.1f} to {within[PUBLISHED_NAMES[method]]:.1f} %.",
            "IV-A, table II",
            f"{rmse_cm(row)} cm without it, {rmse_cm(full)} with it: {100 * mean:+.2f} ± "
            f"{100 * doubt:.2f}; δ1.05 {row['delta_105']:.1f} and {full['delta_105']:.1f} %",
            verdict(mean, doubt), COMPARISON, name, remarks.get(method, ""),
        )  # fmt: skip
    rows = [file.row(method=m) for m in ("hand-2d", "no-hand")]
    flat, without = (row["against_full"] for row in rows)
    half = 0.5 * without["mean_difference_m"] - flat["mean_difference_m"]
    seeds = (_of_seeds(rows[0]), 0.5 * _of_seeds(rows[1]), 0.5 * _of_seeds(full))
    doubt = math.hypot(0.5 * without["standard_error_m"], flat["standard_error_m"], *seeds)
    yield Claim(
        "2D keypoints nearly as good as 3D",
        f"With the keypoints' pixels alone HADR is only slightly worse: {theirs['Full Model']:.1f} "
        f"to {theirs['2D Hand Feature']:.1f} cm.",
        "IV-A, table II",
        f"{rmse_cm(file.row(method='hand-2d'))} cm with 2D, {rmse_cm(full)} with 3D, "
        f"{rmse_cm(file.row(method='no-hand'))} without any hand",
        verdict(half, doubt), COMPARISON, name,
        "*Slightly* is taken for less than half of what the hand brings. The published code's 2D, "
        f"x and y in metres, reaches {rmse_cm(ledger.row(method='hand-xy'))} cm.",
    )  # fmt: skip


def _untested_claims(results: Path, paper: Mapping[str, Any]) -> Iterator[Claim]:
    whole = read_json(results / "speed/perception.json")
    rate = whole["frames_per_second"]["bundled hadr"]["wall_median"]
    yield Claim(
        "HADR best on real frames",
        "On real pictures of hand-held glass HADR's point clouds are truer than the rivals'.",
        "IV-B, figure 7",
        "two real frames of glass on a table", UNTESTED, "what_training_brings",
        "real/cleargrasp_d435.json",
        "There is no public real frame of glass in a hand with true depth.",
    )  # fmt: skip
    yield Claim(
        "TransHand-14K bridges simulation and reality",
        "Recorded hand poses make the rendered data true to life.", "III-A, conclusion",
        "none", UNTESTED, "transhand_data", "",
        "TransHand-14K was not at hand; our frames are of a program of our own.",
    )  # fmt: skip
    yield Claim(
        "perception in real time",
        "The whole perception pipeline runs at 11 frames a second on an NVIDIA 3080.", "IV-B",
        f"{rate:.0f} frames a second", UNTESTED, "what_training_brings",
        "speed/perception.json",
        "Mask, hand and depth, on two cores without a GPU, with the small bundled networks.",
    )  # fmt: skip


def _handover_claims(results: Path, paper: Mapping[str, Any]) -> Iterator[Claim]:
    name, printed = "mini/handover.json", paper["handover"]
    file = read_result_file(results / name)
    worse = read_result_file(results / "mini/handover_worse.json").rows
    restless = {row["condition"]: row for row in worse if row["restless"]}
    follows, stays = (restless[one] for one in ("hadr", "hadr-no-tracking"))
    of_all = printed["attempts"]
    before, after = (printed[title][0] for title in ("GraspNet", "HADR + GraspNet"))
    pairs = {
        "restored depth helps the handover": (
            f"With HADR's depth {after} of {of_all} attempts succeed, with sensor depth {before}.",
            "IV-B, table III", "hadr", "raw"),
        "following the hand helps": (
            "The robot reacts to the moving hand in a closed loop.", "III-C", "hadr",
            "hadr-no-tracking"),
        "rescoring helps": (
            "Grasps that point at the person and downward are to be preferred.", "III-C",
            "hadr", "hadr-no-rescoring"),
    }  # fmt: skip
    seeds = read_result_file(results / "mini/handover_seeds.json")
    of = {row["condition"]: row for row in (*file.rows, *seeds.rows)}

    def counts(one: str, other: str) -> tuple[int, int, int]:
        shared = of[one]["verdicts"].keys() & of[other]["verdicts"].keys()
        won = (sum(of[c]["verdicts"][n] == "success" for n in shared) for c in (one, other))
        return *won, len(shared)

    for short, (words, place, one, other) in pairs.items():
        ahead, behind, _ = paired(of[one], of[other])
        won, lost, count = counts(one, other)  # of the same attempts
        gap = (ahead - behind) / count
        doubt = math.sqrt(((ahead + behind) / count - gap**2) / count)
        label = {"raw": "with sensor depth", "hadr-no-tracking": "without following",
                 "hadr-no-rescoring": "without rescoring"}[other]  # fmt: skip
        plus_other = other.replace("hadr-", "hadr-plus-")
        plus, less, both = counts("hadr-plus", plus_other)
        p = paired(of["hadr-plus"], of[plus_other])[2]
        chance = "p < 0.001" if p < 0.001 else f"p = {p:.2g}"
        remark = (
            "Simulated robot and hand, grasps of a sampler of our own. The verdict is of HADR; "
            f"with HADR-plus {plus} of {both}, {label} {less} ({chance})."
        )
        if other == "hadr-no-tracking":
            moving = f"{follows['successes']} of {follows['attempts']}"
            remark += f" Of hands that never rest {moving}, "
            remark += f"without following {stays['successes']}."
        yield Claim(
            short, words, place, f"{won} of {count} attempts, {label} {lost}",
            verdict(gap, doubt), HANDOVER,
            "mini/handover_seeds.json" if other == "raw" else name, remark,
        )  # fmt: skip
    yield Claim(
        "the published rate of success",
        f"{printed['success_rate_percent']['HADR + GraspNet']:.1f} % of the attempts succeed, with "
        f"{printed['HADR + GraspNet'][1]} of {printed['objects']} objects more than half.",
        "IV-B, table III",
        f"{100 * of['hadr']['rate']:.1f} %, {of['hadr']['objects_at_50_percent']} of "
        f"{len(of['hadr']['rate_by_object'])} objects",
        NOT_REACHED, HANDOVER, "mini/handover_seeds.json", "No real robot was at hand.",
    )  # fmt: skip


def found_table(results: Path) -> str:
    """The claims as Markdown, a line a claim, with links to chapter and result file."""
    notebooks = (results.parent / "notebooks").glob("[0-9][0-9]_*.ipynb")
    chapters = {path.stem.partition("_")[2]: path for path in notebooks}
    lines = []
    for number, claim in enumerate(claims(results), start=1):
        path = chapters[claim.chapter]
        shown = f"[chapter {int(path.stem[:2])}](notebooks/{path.name})"
        place = claim.place.replace("-", "\N{NON-BREAKING HYPHEN}")
        evidence = f"{shown}, `{claim.file}`" if claim.file else shown
        lines.append({
            "the paper claims": f"{number}. {claim.words} ({place})",
            "ours": f"**{claim.verdict}**<br/>{claim.ours}. {claim.remark}<br/>{evidence}",
        })  # fmt: skip
    return markdown(pd.DataFrame(lines), "l")


def found_rules(results: Path) -> str:
    """What each verdict means, and how many claims got it, as a Markdown list."""
    counts = Counter(claim.verdict for claim in claims(results))
    lines = [f"- **{word}** ({counts[word]}): {rule}" for word, rule in VERDICTS.items()]
    return ";\n".join(lines) + "."


def found_paragraph(results: Path) -> str:
    """What was reproduced, contradicted, left open, not reached and not tested, as Markdown."""
    heads = ("Also found here", "Contradicted", "Undecided", "Not reached", "Not tested")
    lines, listed = [], claims(results)
    for head, word in zip(heads, VERDICTS, strict=True):
        those = [claim for claim in listed if claim.verdict == word]
        if word in (AGREES, CONTRADICTS):
            said = "".join(f"\n  - {claim.name}: {claim.ours}" for claim in those)
        else:
            said = "; ".join(claim.name for claim in those)
        lines.append(f"- **{head}, {len(those)}:** {said or 'none'}")
    known = read_result_file(results / FOLDER / "known.json")
    hadr, plain = known.row(method="hadr"), known.row(method="unet-hand")
    nearer = "nearer to" if plain["rmse_m"] < hadr["rmse_m"] else "no nearer to"
    return "\n".join((
        f"The paper makes {len(listed)} claims that can be held against numbers. Errors are RMSE "
        "(the root of the mean squared error) with their standard error; the rivals are "
        f"{', '.join(NAMES[rival] for rival in RIVALS)} (DFNet is the paper's TransCG).\n", *lines,
        "\nAnd what the paper did not ask: a plain U-Net that is told where the hand is comes "
        f"{nearer} the truth than HADR ({rmse_cm(plain)} cm against {rmse_cm(hadr)} on known "
        "objects).",
    ))  # fmt: skip

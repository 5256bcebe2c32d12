"""The handover experiment as tables and pictures, from its result files.

Rows are dicts with ``condition``, ``attempts``, ``successes``, ``rate`` (0 to 1),
``interval`` (low, high of 95 %) and ``failures`` (kind to count).
"""

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from scipy.stats import binomtest, false_discovery_control

from hadr.figures.panels import COLORS
from hadr.figures.rows import draw_bar_rows
from hadr.figures.tables.results import Row, markdown

_SOURCES = {
    "raw": ("sensor depth", "raw", "D"),
    "inpainted": ("inpainted depth", "baseline", "s"),
    "unet-hand": ("U-Net with the hand", "rival", "p"),
    "hadr": ("HADR", "hadr", "o"),
    "hadr-plus": ("HADR-plus", "robot", "*"),
    "perfect": ("perfect depth", "truth", "P"),
}
"""Kinds of depth: how each is called, its colour and its marker."""
_ADDED = {
    "": "",
    "-networks": ", all networks",
    "-no-rescoring": ", no rescoring",
    "-no-tracking": ", no tracking",
    "-no-rescoring-no-tracking": ", without either",
}
CONDITIONS: dict[str, str] = {
    source + added: name + words
    for added, words in _ADDED.items()
    for source, (name, _, _) in _SOURCES.items()
}
"""How a condition of the experiment is called, in the order of the pictures."""
SEEN = ("raw", "hadr", "hadr-plus", "perfect")
"""The kinds of depth that chapter 13 shows side by side."""
WORSE: dict[str, tuple[str, float]] = {
    "extrinsics_error_deg": ("camera turned by (degrees)", 0.0),
    "hand_speed": ("speed of the hand (times normal)", 1.0),
    "picture_rate": ("pictures a second", 10.0),
    "latency": ("from a picture to its answer (s)", 0.1),
}
"""What can be made worse: how it is called, and what it is in the experiment."""
TIME_LIMIT = 13.0
"""HandoverSim's, seconds."""
_KIND_STYLE = (
    ("hand", ""),
    ("baseline", "//"),
    ("voxel", "\\\\"),
    ("raw", ".."),
    ("glass", "xx"),
    ("highlight", "--"),
)


def _style(condition: str) -> tuple[str, str]:
    """Colour and marker of a condition in all pictures of the experiment: its depth's."""
    for source in sorted(_SOURCES, key=len, reverse=True):  # "hadr-plus" before "hadr"
        if condition.startswith(source):
            return COLORS[_SOURCES[source][1]], _SOURCES[source][2]
    return COLORS["background"], "X"


def conditions_table(rows: Sequence[Row], published: Mapping[str, Sequence[int]]) -> str:
    """List each condition's attempts in the paper's columns, and a success's mean time."""
    lines = []
    for row in _ordered(rows):
        low, high = row["interval"]
        reached = (row[f"objects_at_{share}_percent"] for share in (50, 80, 100))
        lines.append([
            str(CONDITIONS.get(row["condition"], row["condition"])),
            f"{row['successes']}/{row['attempts']}",
            f"{100 * row['rate']:.1f}",
            f"{100 * low:.0f}\N{NO-BREAK SPACE}to\N{NO-BREAK SPACE}{100 * high:.0f}",
            *(f"{count}/{len(row['rate_by_object'])}" for count in reached),
            "-" if row["mean_seconds"] is None else f"{row['mean_seconds']:.1f}",
        ])  # fmt: skip
    for name, (won, *objects) in published.items():
        rate = f"{100 * won / 48:.1f}"
        counts = [f"{count}/8" for count in objects]
        lines.append([f"*paper: {name}*", f"{won}/48", rate, "", *counts, ""])
    shares = ("> 0.5", "> 0.8", "1.0")
    head = ["condition", "successes", "rate (%)", "95 % interval", *shares, "time (s)"]
    own = [row["condition"] for row in _ordered(rows)]
    best = [[place for place, name in enumerate(own) if not name.startswith("perfect")]]
    return markdown(pd.DataFrame(lines, columns=head), best=best)


def motions_table(rows: Sequence[Row]) -> str:
    """List each condition's successes by the motion of the hand, the best in bold."""
    kinds, rows = list(rows[0]["by_motion"]), _ordered(rows)
    lines = [
        [CONDITIONS.get(row["condition"], row["condition"])]
        + ["{}/{}".format(*row["by_motion"][kind]) for kind in kinds]
        for row in rows
    ]
    best = [n for n, row in enumerate(rows) if not row["condition"].startswith("perfect")]
    headings = ["condition", *(f"{kind} (successes)" for kind in kinds)]
    return markdown(pd.DataFrame(lines, columns=headings), best=[best])


def paired(first: Row, second: Row) -> tuple[int, int, float]:
    """Compare two rows of `results/mini/handover.json` attempt by attempt.

    Returns:
        In how many attempts the first alone succeeds, in how many the second alone, and how likely
        chance alone makes at least such a difference (two-sided sign test; 1 without any).
    """
    if first["verdicts"].keys() != second["verdicts"].keys():
        raise ValueError(
            f"{first['condition']} and {second['condition']} have not made the same attempts"
        )
    won = [
        (verdict == "success", second["verdicts"][name] == "success")
        for name, verdict in first["verdicts"].items()
    ]
    ahead, behind = won.count((True, False)), won.count((False, True))
    doubt = float(binomtest(ahead, ahead + behind).pvalue) if ahead + behind else 1.0
    return ahead, behind, doubt


def compared(rows: Sequence[Row], pairs: Sequence[tuple[str, str]]) -> str:
    """List pairs of conditions, attempt by attempt, with chances corrected for their number.

    Corrected is Benjamini and Hochberg's: of the differences below 0.05 there, at most one in
    twenty is expected to be chance.
    """
    of = {row["condition"]: row for row in rows}
    found = [paired(of[one], of[other]) for one, other in pairs]
    corrected = false_discovery_control([chance for _, _, chance in found])
    lines = [
        [CONDITIONS[one], str(won), CONDITIONS[other], str(lost), f"{chance:.3f}", f"{fair:.3f}"]
        for (one, other), (won, lost, chance), fair in zip(pairs, found, corrected, strict=True)
    ]
    head = ["one", "it alone", "the other", "that alone", "chance", "corrected"]
    return markdown(pd.DataFrame(lines, columns=head))


def commonest_parting(rows: Sequence[Row], conditions: Sequence[str]) -> str:
    """Name the attempt on which conditions differ as they do most often, such as "0001-905".

    The ways to differ are told apart by which conditions succeed; of the attempts with the
    commonest one it is the first by name.
    """
    of = {row["condition"]: row["verdicts"] for row in rows}
    ways: dict[str, tuple[bool, ...]] = {
        name: tuple(of[condition][name] == "success" for condition in conditions)
        for name in sorted(of[conditions[0]])
    }
    counts = Counter(way for way in ways.values() if len(set(way)) > 1)
    commonest = counts.most_common(1)[0][0]
    return next(name for name, way in ways.items() if way == commonest)


def _ordered(rows: Sequence[Row]) -> list[Row]:
    place = {condition: number for number, condition in enumerate(CONDITIONS)}
    return sorted(rows, key=lambda row: place.get(row["condition"], len(place)))


def _rate(row: Row) -> tuple[float, float, float]:
    """Rate and its interval in percent."""
    low, high = row["interval"]
    return 100 * float(row["rate"]), 100 * float(low), 100 * float(high)


def draw_success(ax: Axes, rows: Sequence[Row], *, published: float) -> None:
    """Draw each condition's rate of success with its 95 % interval; the paper's as a line."""
    chosen = _ordered(rows)
    rate, low, high = np.array([_rate(row) for row in chosen]).T
    colors = [_style(row["condition"])[0] for row in chosen]
    names = [CONDITIONS.get(str(row["condition"]), str(row["condition"])) for row in chosen]
    pale = [to_rgba(color, 0.45) for color in colors]
    draw_bar_rows(ax, names, {"": rate}, [pale], edges=colors)
    spread = np.maximum([rate - low, high - rate], 0)
    ax.errorbar(
        rate, range(len(chosen)), xerr=spread, color="#202020", capsize=4, lw=1.4, fmt="none"
    )
    for place, row in enumerate(chosen):
        count = f"{row['successes']}/{row['attempts']}"
        ax.text(102, place, f"{rate[place]:.0f} %  ({count})", va="center", fontsize=9)
    ax.axvline(100 * published, color=COLORS["truth"], lw=1.2, ls=":")
    ax.text(100 * published, -0.65, "paper, real arm", ha="center", va="bottom", fontsize=9)
    ax.set(xlim=(0, 100), xlabel="successful handovers (%), 95 % interval")


def draw_outcomes(ax: Axes, rows: Sequence[Row]) -> None:
    """Draw how each condition's attempts ended: successes, then failures by kind."""
    chosen = _ordered(rows)
    kinds = dict.fromkeys(kind for row in chosen for kind, n in row["failures"].items() if n)
    parts = {"success": [row["successes"] for row in chosen]}
    parts |= {kind: [row["failures"].get(kind, 0) for row in chosen] for kind in kinds}
    styles = [("robot", ""), *(_KIND_STYLE[k % len(_KIND_STYLE)] for k in range(len(kinds)))]
    colors, hatches = [COLORS[color] for color, _ in styles], [hatch for _, hatch in styles]
    names = [CONDITIONS.get(str(row["condition"]), str(row["condition"])) for row in chosen]
    draw_bar_rows(ax, names, parts, colors, text="{:.0f}", hatches=hatches, edges="white")
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=4)
    ax.set(xlim=(0, max((row["attempts"] for row in chosen), default=1)), xlabel="attempts")


def draw_degradation(ax: Axes, rows: Sequence[Row], key: str) -> None:
    """Draw the rate of success over one thing that is made worse, with 95 % intervals.

    Of the rows those in which all else is as in the experiment; `WORSE` has the keys.
    """
    xlabel, standard = WORSE[key]
    usual: dict[str, float] = {name: value for name, (_, value) in WORSE.items() if name != key}
    usual |= {"restless": False, "time_limit": TIME_LIMIT}
    rows = [r for r in rows if all(r[name] == value for name, value in usual.items())]
    conditions = list(dict.fromkeys(row["condition"] for row in _ordered(rows)))
    values = sorted({float(row[key]) for row in rows})
    gap = min(np.diff(values), default=1.0) * 0.05
    for number, condition in enumerate(conditions):
        points = sorted((float(r[key]), *_rate(r)) for r in rows if r["condition"] == condition)
        x, rate, low, high = np.array(points).T
        # beside each other, so that intervals don't cover each other
        aside = gap * (number - (len(conditions) - 1) / 2)
        color, marker = _style(condition)
        ax.errorbar(
            x + aside, rate, yerr=[np.maximum(rate - low, 0), np.maximum(high - rate, 0)],
            color=color, marker=marker, ms=6, capsize=3, lw=1.6,
            label=CONDITIONS.get(condition, condition),
        )  # fmt: skip
    ax.axvline(standard, color=COLORS["raw"], lw=0.8, ls=":")
    ax.set(xlabel=xlabel, ylabel="successful handovers (%)", ylim=(0, 103), xticks=values)
    if len(conditions) > 1:
        ax.legend(loc="best")

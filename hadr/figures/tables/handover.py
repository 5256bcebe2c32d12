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
from hadr.simulation.trials.summary import hold_of

_SOURCES = {
    "raw": ("sensor depth", "raw", "D"),
    "inpainted": ("inpainted depth", "voxel", "s"),
    "unet-hand": ("U-Net with the hand", "baseline", "p"),
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
    "-no-rescoring-networks": ", no rescoring, all networks",
    "-no-tracking-networks": ", no tracking, all networks",
    "-no-rescoring-no-tracking-networks": ", without either, all networks",
}
CONDITIONS: dict[str, str] = {
    source + added: name + words
    for added, words in _ADDED.items()
    for source, (name, _, _) in _SOURCES.items()
}
"""How a condition of the experiment is called, in the order of the pictures."""
_STYLES = {
    source + added: (COLORS[color], marker)
    for added in _ADDED
    for source, (_, color, marker) in _SOURCES.items()
}
"""A condition's colour and marker in all pictures of the experiment: its depth's."""
SEEN = ("raw", "hadr", "hadr-plus", "perfect")
"""The kinds of depth that chapter 13 shows side by side, ..."""
FILMED = tuple(_SOURCES)
"""... and those of its films, ..."""
FILMED_PARTS = (
    *("hadr-plus-no-tracking", "hadr-plus-no-rescoring", "hadr-plus-no-rescoring-no-tracking"),
    *("hadr-no-tracking", "hadr-no-rescoring", "hadr-plus-networks", "perfect-networks"),
)
"""... the same attempts without a part of the method, and with networks' masks and keypoints."""
WORSE: dict[str, tuple[str, float | None]] = {
    "extrinsics_error_deg": ("camera turned by (degrees)", 0.0),
    "hand_speed": ("speed of the hand (times normal)", 1.0),
    "picture_rate": ("pictures a second", 10.0),
    "latency": ("from a picture to its answer (s)", 0.1),
    "turn_degrees": ("largest turn of every hand, to each side (degrees)", None),
}
"""What can be made worse: how it is called, and what it is in the experiment, if it is a number."""
TIME_LIMIT = 13.0
"""HandoverSim's, seconds."""
_KIND_STYLE = (
    ("hand", ""), ("baseline", "//"), ("voxel", "\\\\"), ("raw", ".."), ("glass", "xx"),
    ("highlight", "--"),
)  # fmt: skip


def conditions_table(rows: Sequence[Row], published: Mapping[str, Sequence[int]]) -> str:
    """List each condition's attempts in the paper's columns, and a success's mean time."""
    rows = _ordered(rows)
    lines = []
    for row in rows:
        rate, low, high = _rate(row)
        reached = (row[f"objects_at_{share}_percent"] for share in (50, 80, 100))
        lines.append([
            CONDITIONS[row["condition"]],
            f"{row['successes']}/{row['attempts']}",
            f"{rate:.1f}",
            f"{low:.0f}\N{NO-BREAK SPACE}to\N{NO-BREAK SPACE}{high:.0f}",
            *(f"{count}/{len(row['rate_by_object'])}" for count in reached),
            "-" if row["mean_seconds"] is None else f"{row['mean_seconds']:.1f}",
        ])  # fmt: skip
    for name, (won, *objects) in published.items():
        counts = [f"{count}/8" for count in objects]
        rate, low, high = _paper_rate(won)
        span = f"{low:.0f}\N{NO-BREAK SPACE}to\N{NO-BREAK SPACE}{high:.0f}"
        lines.append([f"*paper: {name}*", f"{won}/48", f"{rate:.1f}", span, *counts, ""])
    shares = ("> 0.5", "> 0.8", "1.0")
    head = ["condition", "successes", "rate (%)", "95 % interval", *shares, "time (s)"]
    return markdown(pd.DataFrame(lines, columns=head), best=[_imperfect(rows)])


def motions_table(rows: Sequence[Row]) -> str:
    """List each condition's successes in percent by the motion of the hand, the best in bold."""
    kinds, rows = list(rows[0]["by_motion"]), _ordered(rows)
    lines = []
    for row in rows:
        counts = (row["by_motion"][kind] for kind in kinds)
        cells = (f"{100 * won / tried:.0f} ({won}/{tried})" for won, tried in counts)
        lines.append([CONDITIONS[row["condition"]], *cells])
    headings = ["condition", *(f"{kind} (successes)" for kind in kinds)]
    table = markdown(pd.DataFrame(lines, columns=headings), best=[_imperfect(rows)])
    return table.replace(" (successes)", "")  # what is best is known by it; a page is narrow


def incidents_table(rows: Sequence[Row]) -> str:
    """List what happened in attempts: of how many with it each condition's succeeded.

    The commonest in the first row's attempts comes first; of equals, by the alphabet.
    """
    counts = [dict(row["incidents"]) for row in rows]
    every = set[str]().union(*counts)
    names = sorted(every, key=lambda name: (-counts[0].get(name, (0, 0))[1], name))
    lines = [[name, *("{} of {}".format(*of.get(name, (0, 0))) for of in counts)] for name in names]
    head = ["what happened", *(CONDITIONS[row["condition"]] for row in rows)]
    return markdown(pd.DataFrame(lines, columns=head))


def beliefs_table(rows: Sequence[Row]) -> str:
    """List what the robot's points were worth when it chose: in successes / in failures."""

    def both(means: Mapping[str, float | None], factor: float) -> str:
        ends = (means["success"], means["failure"])
        return " / ".join("-" if mean is None else f"{factor * mean:.0f}" for mean in ends)

    parts = {
        "points right (%)": ("points_right", 100),
        "right at the grasp (%)": ("points_right_at_grasp", 100),
        "grasp off the glass (mm)": ("grasp_off", 1000),
    }
    lines = [
        [CONDITIONS[row["condition"]], *(both(row[name], by) for name, by in parts.values())]
        for row in rows
    ]
    return markdown(pd.DataFrame(lines, columns=["condition", *parts]))


def touches_table(rows: Sequence[Row]) -> str:
    """List how often the robot touched the hand, and its largest forces, newtons, by stage."""

    def largest(row: Row, way: str) -> str:
        named = row["largest_forces_n"].items()
        forces = [(n, what.removeprefix(f"{way}, ")) for what, n in named if what.startswith(way)]
        return "{:.1f}, {}".format(*max(forces)) if forces else "none"

    lines = [
        [
            CONDITIONS[row["condition"]],
            "{} of {}".format(row["failures"].get("human contact", 0), row["attempts"]),
            largest(row, "touch"),
            largest(row, "through the glass"),
        ]
        for row in _ordered(rows)
    ]
    head = ["condition", "attempts with a touch", "by touch (N)", "through the glass (N)"]
    return markdown(pd.DataFrame(lines, columns=head))


def paired(first: Row, second: Row) -> tuple[int, int, float]:
    """Compare two rows of a result file of the handover by the attempts that both have made.

    Returns:
        In how many attempts the first alone succeeds, in how many the second alone, and how likely
        chance alone makes at least such a difference: were they alike, each hold's difference, over
        all of its seeds, would as well have gone the other way (two-sided, exact; 1 without any).
        With one seed that is the sign test.

    Raises:
        ValueError: They have made no attempt alike.
    """
    shared = first["verdicts"].keys() & second["verdicts"].keys()
    if not shared:
        raise ValueError(
            f"{first['condition']} and {second['condition']} have not made the same attempts"
        )
    gains = Counter[int]()  # of one attempt: 1, 0 or -1
    of_hold = Counter[str]()
    for name in shared:
        one, other = (row["verdicts"][name] == "success" for row in (first, second))
        gains[one - other] += 1
        of_hold[hold_of(name)] += one - other
    gaps = [abs(gain) for gain in of_hold.values()]
    chances = np.ones(1)  # of each sum of the gaps' signs, from -sum(gaps) to sum(gaps)
    for gap in gaps:
        chances = (np.pad(chances, (0, 2 * gap)) + np.pad(chances, (2 * gap, 0))) / 2
    sums = np.abs(np.arange(len(chances)) - sum(gaps))
    doubt = float(chances[sums >= abs(of_hold.total())].sum())
    return gains[1], gains[-1], doubt


def compared(rows: Sequence[Row], pairs: Sequence[tuple[str, str]]) -> str:
    """List pairs of conditions, attempt by attempt, with chances corrected for their number.

    Corrected is Benjamini and Hochberg's: of the differences below 0.05 there, at most one in
    twenty is expected to be chance.
    """
    of = {row["condition"]: row for row in rows}
    found = [paired(of[one], of[other]) for one, other in pairs]
    corrected = false_discovery_control([chance for _, _, chance in found])
    lines = [
        [CONDITIONS[one], CONDITIONS[other]]
        + [str(len(of[one]["verdicts"].keys() & of[other]["verdicts"].keys())), str(won), str(lost)]
        + ["<\N{NO-BREAK SPACE}0.001" if p < 0.001 else f"{p:.3f}" for p in (chance, fair)]
        for (one, other), (won, lost, chance), fair in zip(pairs, found, corrected, strict=True)
    ]
    head = ["A", "B", "attempts", "A alone", "B alone", "p", "p, corrected"]
    return markdown(pd.DataFrame(lines, columns=head), "llr")


def partings(rows: Sequence[Row], conditions: Sequence[str]) -> list[str]:
    """Name an attempt, such as "0001-905", for each way in which conditions differ.

    The ways are told apart by which conditions succeed, the commonest comes first; an attempt
    stands for its way as the first by name.
    """
    of = {row["condition"]: row["verdicts"] for row in rows}
    ways: dict[tuple[bool, ...], list[str]] = {}
    for name in sorted(of[conditions[0]]):
        way = tuple(of[condition][name] == "success" for condition in conditions)
        if len(set(way)) > 1:
            ways.setdefault(way, []).append(name)
    return [names[0] for names in sorted(ways.values(), key=len, reverse=True)]


def _ordered(rows: Sequence[Row]) -> list[Row]:
    return sorted(rows, key=lambda row: list(CONDITIONS).index(row["condition"]))


def _imperfect(rows: Sequence[Row]) -> list[int]:
    """Places of the rows that compete for the best: perfect depth doesn't."""
    return [n for n, row in enumerate(rows) if not row["condition"].startswith("perfect")]


def _rate(row: Row) -> tuple[float, float, float]:
    """Rate and its interval in percent."""
    low, high = row["interval"]
    return 100 * float(row["rate"]), 100 * float(low), 100 * float(high)


def _paper_rate(won: int) -> tuple[float, float, float]:
    """Rate of so many of the paper's 48 attempts and its interval, in percent."""
    interval = binomtest(won, 48).proportion_ci(0.95, "wilson")
    return 100 * won / 48, 100 * float(interval.low), 100 * float(interval.high)


def draw_success(ax: Axes, rows: Sequence[Row], *, published: Mapping[str, int]) -> None:
    """Draw each condition's rate of success with its 95 % interval; the paper's, of 48, below."""
    chosen = _ordered(rows)
    rate, low, high = np.array([_rate(row) for row in chosen]).T
    colors = [_STYLES[row["condition"]][0] for row in chosen]
    names = [CONDITIONS[row["condition"]] for row in chosen]
    pale = [to_rgba(color, 0.45) for color in colors]
    draw_bar_rows(ax, names, {"": rate}, [pale], edges=colors, height=0.55)
    spread = np.maximum([rate - low, high - rate], 0)
    ax.errorbar(
        rate, range(len(chosen)), xerr=spread, color="#202020", capsize=4, lw=1.4, fmt="none"
    )
    for place, row in enumerate(chosen):
        count = f"{row['successes']}/{row['attempts']}"
        ax.text(102, place, f"{rate[place]:.0f} %  ({count})", va="center", fontsize=9)
    places = [k for k, row in enumerate(chosen) if row["condition"] in published]
    paper = np.array([_paper_rate(published[chosen[k]["condition"]]) for k in places])
    ends = np.abs(paper[:, 1:].T - paper[:, 0])
    ax.errorbar(
        paper[:, 0], np.array(places) + 0.38, xerr=ends, fmt="D", color="#202020", mfc="white",
        ms=5, capsize=3, lw=1, label="the paper's real arm, of 48",
    )  # fmt: skip
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0))
    ax.set(xlim=(0, 100), xlabel="successful handovers (%), 95 % interval")


def draw_objects(ax: Axes, rows: Sequence[Row], names: Mapping[str, str], novel: int) -> None:
    """Draw the rate of success with each object (columns) and each condition as a map.

    `names` has what each object is called, in the columns' order; the last `novel` ones stand
    apart from those that networks were trained on.
    """
    chosen = _ordered(rows)
    rates = 100 * np.array([[row["rate_by_object"][one] for one in names] for row in chosen])
    ax.imshow(rates, cmap="cividis", vmin=0, vmax=100, aspect="auto")
    for (y, x), rate in np.ndenumerate(rates):
        ax.text(x, y, f"{rate:.0f}", ha="center", va="center", fontsize=9.5,
                color="white" if rate < 55 else "black")  # fmt: skip
    ax.axvline(len(names) - novel - 0.5, color="white", lw=5)
    ax.set_xticks(range(len(names)), [name.replace(" ", "\n") for name in names.values()])
    ax.set_yticks(range(len(chosen)), [CONDITIONS[row["condition"]] for row in chosen])
    ax.tick_params(length=0)
    ax.spines[:].set_visible(False)
    ax.grid(visible=False)


def draw_outcomes(ax: Axes, rows: Sequence[Row]) -> None:
    """Draw how each condition's attempts ended, in percent: successes, then failures by kind."""
    chosen = _ordered(rows)
    attempts = np.array([row["attempts"] for row in chosen])
    kinds = dict.fromkeys(kind for row in chosen for kind, n in row["failures"].items() if n)
    parts = {"success": 100 * np.array([row["successes"] for row in chosen]) / attempts}
    for kind in kinds:
        parts[kind] = 100 * np.array([row["failures"].get(kind, 0) for row in chosen]) / attempts
    styles = [("robot", ""), *(_KIND_STYLE[k % len(_KIND_STYLE)] for k in range(len(kinds)))]
    colors, hatches = [COLORS[color] for color, _ in styles], [hatch for _, hatch in styles]
    names = [CONDITIONS[row["condition"]] for row in chosen]
    draw_bar_rows(
        ax, names, parts, colors, text="{:.0f}", least=2.5, hatches=hatches, edges="white"
    )
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=5)
    ax.set(xlim=(0, 100), xlabel="attempts (%)")


def draw_degradation(ax: Axes, rows: Sequence[Row], key: str) -> None:
    """Draw the rate of success over one thing that is made worse, with 95 % intervals.

    Of the rows those in which all else is as in the experiment; `WORSE` has the keys.
    """
    xlabel, standard = WORSE[key]
    usual = {name: value for name, (_, value) in WORSE.items() if name != key}
    usual |= {"restless": False, "time_limit": TIME_LIMIT}
    rows = [row for row in rows if row.get(key) is not None]
    rows = [row for row in rows if all(row.get(name) == usual[name] for name in usual)]
    conditions = list(dict.fromkeys(row["condition"] for row in _ordered(rows)))
    values = sorted({float(row[key]) for row in rows})
    gap = min(np.diff(values), default=1.0) * 0.05
    for number, condition in enumerate(conditions):
        points = sorted((float(r[key]), *_rate(r)) for r in rows if r["condition"] == condition)
        x, rate, low, high = np.array(points).T
        # beside each other, so that intervals don't cover each other
        aside = gap * (number - (len(conditions) - 1) / 2)
        color, marker = _STYLES[condition]
        style, face = ("-", color) if condition in _SOURCES else ("--", "white")
        ax.errorbar(
            x + aside, rate, yerr=[np.maximum(rate - low, 0), np.maximum(high - rate, 0)],
            color=color, marker=marker, mfc=face, ls=style, ms=7, capsize=3, lw=1.6,
            label=CONDITIONS[condition],
        )  # fmt: skip
    if standard is not None:
        ax.axvline(standard, color=COLORS["raw"], lw=0.8, ls=":")
    ax.set(xlabel=xlabel, ylabel="successful handovers (%)", ylim=(0, 103), xticks=values)
    if len(conditions) > 1:
        ax.legend(loc="best")

"""Pictures of a confidence: is it honest, and does it know where the errors are?"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.image import AxesImage

from hadr.camera import BoolArray, FloatArray
from hadr.figures.panels import COLORS, bare_axes


def draw_reliability(
    ax: Axes, said: Sequence[float | None], true: Sequence[float | None], count: Sequence[int]
) -> None:
    """Draw the share of right pixels over each bin's mean confidence; a dot's size is its count."""
    number = np.asarray(count, dtype=float)
    filled = number > 0
    x, y = np.array([said, true], dtype=float)[:, filled]  # None becomes NaN
    share = number[filled] / number.sum()
    ax.plot([0, 1], [0, 1], color=COLORS["truth"], lw=1, ls="--", label="honest")
    ax.vlines(x, x, y, color=COLORS["raw"], lw=1.2)
    ax.plot(x, y, color=COLORS["hadr"], lw=1.2)
    ax.scatter(x, y, s=20 + 260 * share, color=COLORS["hadr"], zorder=3, edgecolors="white")
    gap = float((np.abs(x - y) * share).sum())
    ax.text(0.97, 0.05, f"mean gap {gap:.3f}", ha="right", transform=ax.transAxes)
    ax.set(xlim=(0, 1), ylim=(0, 1), aspect="equal")
    ax.set(xlabel="confidence", ylabel="share within 2 cm")
    ax.legend(loc="upper left")


def draw_sparsification(
    ax: Axes, dropped: Sequence[float], rmse_m: Sequence[float], oracle_rmse_m: Sequence[float]
) -> None:
    """Draw the error of what is kept over the share that is dropped, beside chance and oracle."""
    share = 100 * np.asarray(dropped)
    found, best = 100 * np.asarray(rmse_m), 100 * np.asarray(oracle_rmse_m)
    ax.axhline(found[0], color=COLORS["raw"], lw=1.4, ls=":")
    ax.plot(share, found, color=COLORS["hadr"], marker="o", ms=3)
    ax.plot(share, best, color=COLORS["truth"], lw=1.2, ls="--")
    tenth = int(np.argmin(np.abs(share - 10)))
    ax.scatter(share[tenth], found[tenth], s=70, color=COLORS["hadr"], zorder=4)
    words = f"{found[tenth]:.1f} cm without\nthe least sure tenth"
    line = {"arrowstyle": "-", "color": COLORS["raw"], "lw": 0.8, "shrinkB": 5}
    ax.annotate(words, (share[tenth], found[tenth]), xytext=(0.5, 0.62), va="center", fontsize=9,
                textcoords="axes fraction", arrowprops=line)  # fmt: skip
    last = share[-1]
    ax.text(last, found[0], "by chance", ha="right", va="bottom", color=COLORS["raw"])
    ax.text(share[len(share) // 2], best[len(best) // 2], " oracle", va="bottom")
    ax.annotate(
        "by confidence", (last, found[-1]), xytext=(0, -6), textcoords="offset points",
        ha="right", va="top", color=COLORS["hadr"],
    )  # fmt: skip
    ax.set(xlabel="dropped (%)", ylabel="RMSE of the rest (cm)", xlim=(0, 100))
    ax.set_ylim(0, 1.15 * max(found.max(), found[0]))


def show_confidence(
    ax: Axes, confidence: FloatArray, restored: BoolArray, title: str, limits: tuple[float, float]
) -> AxesImage:
    """Show the confidence of the restored pixels; the others stay white."""
    shown = np.ma.masked_where(~restored, confidence)
    image = ax.imshow(shown, cmap="cividis", vmin=limits[0], vmax=limits[1])
    bare_axes(ax, title)
    ax.figure.colorbar(image, ax=ax, shrink=0.75, pad=0.02, label="confidence")
    return image

"""A sheet for diagrams: cards, words and arrows, placed in inches, shown as a vector picture."""

import base64
import io
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
from IPython.display import display
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch, PathPatch
from matplotlib.path import Path

Box = tuple[float, float, float, float]
"""Left, bottom, width, height; inches from the sheet's lower left corner."""
INK, PAPER, EDGE = "#222222", "#f6f6f4", "#d4d4d0"
FONT = 11.0


class Sheet:
    """A white sheet of so many inches to draw a diagram on."""

    def __init__(self, width: float, height: float) -> None:
        self.size = (width, height)
        self.figure: Figure = plt.figure(figsize=self.size, facecolor="white")
        self.figure.set_layout_engine("none")
        self.page = self._page(-1)

    def _page(self, zorder: float) -> Axes:
        ax = self.figure.add_axes((0, 0, 1, 1), zorder=zorder, facecolor="none")
        ax.set(xlim=(0, self.size[0]), ylim=(0, self.size[1]))
        ax.axis("off")
        return ax

    def inset(self, box: Box) -> Any:
        """Axes in a box."""
        (left, bottom, width, height), (w, h) = box, self.size
        return self.figure.add_axes((left / w, bottom / h, width / w, height / h))

    def write(self, x: float, y: float, words: str, **options: Any) -> Any:
        """Write words at a place, in the middle of their height."""
        look: dict[str, Any] = {"fontsize": FONT, "color": INK, "va": "center"} | options
        return self.page.text(x, y, words, **look)

    def card(self, box: Box, fill: str = PAPER, edge: str = EDGE, lw: float = 1.0) -> None:
        """Draw a box with round corners."""
        style = "round,pad=0,rounding_size=0.1"
        look: dict[str, Any] = {"boxstyle": style, "fc": fill, "ec": edge, "lw": lw}
        self.page.add_patch(FancyBboxPatch(box[:2], *box[2:], **look))

    def arrow(self, *places: tuple[float, float]) -> None:
        """Draw an arrow along a line of two places or more."""
        way, head = Path(list(places)), "-|>,head_width=4,head_length=7"
        self.page.add_patch(FancyArrowPatch(path=way, arrowstyle=head, lw=2.2, color=INK))

    def dim_all_but(self, boxes: Sequence[Box]) -> None:
        """Lay a veil over the sheet that leaves some boxes free."""
        w, h = self.size
        paths = [Path([(0, 0), (w, 0), (w, h), (0, h), (0, 0)], closed=True)]
        for left, bottom, width, height in boxes:
            a, b, c, d = left - 0.04, bottom - 0.04, left + width + 0.04, bottom + height + 0.04
            paths.append(Path([(a, b), (a, d), (c, d), (c, b), (a, b)], closed=True))
        veil = PathPatch(Path.make_compound_path(*paths), fc="white", ec="none", alpha=0.68)
        self._page(10).add_patch(veil)

    def show(self) -> None:
        """Display it in a notebook: as a vector picture, and as a bitmap for what needs one."""
        shown = {}
        with mpl.rc_context({"svg.hashsalt": "sheet"}):  # the same bytes each time
            for kind, more in (("svg", {"Date": None}), ("png", {})):
                file = io.BytesIO()
                self.figure.savefig(file, format=kind, dpi=110, metadata=more)
                shown[kind] = file.getvalue()
        plt.close(self.figure)
        bitmap = base64.b64encode(shown["png"]).decode()
        both = {"image/svg+xml": shown["svg"].decode(), "image/png": bitmap}
        display(both, raw=True)

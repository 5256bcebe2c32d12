"""Sliders over pictures drawn beforehand: they work on a page without a kernel and a network.

Such a page is one HTML file with all its data inside. In a notebook it stands in a frame of its
own; the built book keeps it as it is.
"""

import base64
import html
import io
import itertools
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox, BboxBase
from mpl_toolkits.mplot3d import Axes3D
from PIL import Image

_CONTROLS = 44  # CSS pixels below the picture


@dataclass(frozen=True)
class Page:
    """A whole HTML document that a notebook shows in a frame with a title and some CSS."""

    page: str = field(repr=False)
    title: str
    style: str

    def _repr_html_(self) -> str:
        source, title = (html.escape(text, quote=True) for text in (self.page, self.title))
        style = f"width:100%;border:0;display:block;{self.style}"
        frame = f'<iframe title="{title}" style="{style}" srcdoc="{source}"></iframe>'
        return f'<figure style="margin:0">{frame}<figcaption>{title}</figcaption></figure>'

    def save(self, path: str | Path) -> None:
        """Write the page as a file that any browser opens."""
        Path(path).write_text(self.page, encoding="utf-8")


def filled_page(template: str, title: str, data: Mapping[str, Any], style: str) -> Page:
    """Fill a template of this folder with a title, and with data as JSON; the frame's style."""
    text = files("hadr.figures.solids").joinpath(template).read_text(encoding="utf-8")
    told = json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
    text = text.replace("__TITLE__", html.escape(title)).replace("__DATA__", told)
    return Page(text, title, style)


@dataclass(frozen=True)
class Slider:
    """One slider of a page.

    Args:
        name: What it changes, with the unit.
        labels: The text of each of its places, at least two.
        start: Where it stands first.
    """

    name: str
    labels: tuple[str, ...]
    start: int = 0

    def __post_init__(self) -> None:
        if len(self.labels) < 2:
            raise ValueError(f"slider {self.name!r} needs at least two places, got {self.labels}")
        if not 0 <= self.start < len(self.labels):
            raise ValueError(
                f"slider {self.name!r} has places 0 to {len(self.labels) - 1}, starts at "
                f"{self.start}"
            )


def scrubber(
    draw: Callable[..., Figure],
    sliders: Sequence[Slider],
    *,
    title: str,
    alt: str,
    frames_per_second: float = 0.0,
    box: BboxBase | None = None,
) -> Page:
    """Draw a picture for each place of the sliders and put all of them into one page.

    Args:
        draw: Called with one index a slider; returns a figure, which is closed afterwards. All
            figures have one size.
        sliders: One or more; the pictures are as many as the product of their places.
        title: What the frame is called.
        alt: What the pictures show, in words.
        frames_per_second: Above 0 a button plays the first slider at this rate.
        box: The part of each figure that is kept, inches; the whole one if left out.
    """
    if not sliders:
        raise ValueError("a scrubber needs at least one slider")
    pictures: list[str] = []
    order: list[int] = []
    sizes: set[tuple[int, int]] = set()
    for places in itertools.product(*(range(len(slider.labels)) for slider in sliders)):
        text, size = _encoded(draw(*places), box)
        sizes.add(size)
        if len(sizes) > 1:
            raise ValueError(f"pictures of one scrubber must have one size, got {sorted(sizes)}")
        if text not in pictures:
            pictures.append(text)
        order.append(pictures.index(text))
    data = {
        "alt": alt,
        "sliders": [vars(slider) for slider in sliders],
        "pictures": pictures,
        "order": order,
        "milliseconds": round(1000 / frames_per_second) if frames_per_second > 0 else 0,
    }
    ((width, height),) = sizes
    style = f"max-width:{width}px;aspect-ratio:{width}/{height + _CONTROLS};min-height:230px"
    return filled_page("scrubber.html", title, data, style)


def turning(figure: Figure, *, title: str, alt: str, turns: int = 12) -> Page:
    """Let a reader turn the 3D axes of a figure about their vertical, on a page without a kernel.

    Args:
        figure: One with 3D axes; it keeps its view.
        title: What the frame is called.
        alt: What the pictures show, in words.
        turns: How many views, evenly over the whole turn.
    """
    views = [(ax, ax.elev, ax.azim) for ax in figure.axes if isinstance(ax, Axes3D)]
    if not views:
        raise ValueError("only a figure with 3D axes can be turned, got one without")

    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # the axes stay where they are while things turn in them
    for ax, _, _ in views:
        for drawn in ax.get_children():
            drawn.set_clip_on(False)  # what turns out of the axes' box is still in the figure

    def turned(place: int) -> Figure:
        for ax, elevation, azimuth in views:
            ax.view_init(elevation, azimuth + 360 * place / turns)
        return figure

    slider = Slider("turn (°)", tuple(f"{360 * place / turns:.0f}" for place in range(turns)))
    try:
        boxes = []
        for place in range(turns):
            turned(place).draw_without_rendering()
            boxes.append(figure.get_tightbbox())
        seen = Bbox.union(boxes).padded(0.05)
        return scrubber(turned, [slider], title=title, alt=alt, frames_per_second=3, box=seen)
    finally:
        for ax, elevation, azimuth in views:
            ax.view_init(elevation, azimuth)


def _encoded(figure: Figure, box: BboxBase | None) -> tuple[str, tuple[int, int]]:
    """A figure as base64 of a WebP picture, and its width and height in pixels; closes it."""
    drawn = io.BytesIO()
    figure.savefig(
        drawn, format="webp", facecolor="white", bbox_inches=box, pil_kwargs={"quality": 70}
    )
    plt.close(figure)
    with Image.open(drawn) as picture:
        size = picture.size
    return base64.b64encode(drawn.getvalue()).decode(), size

"""A page that works without a kernel and a network: one HTML file with all its data inside.

In a notebook it stands in a frame of its own; the built book keeps it as it is.
"""

import html
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Page:
    """A whole HTML document that a notebook shows in a frame with a title and some CSS."""

    page: str = field(repr=False)
    title: str
    style: str

    def _repr_html_(self) -> str:
        source, title = (html.escape(text, quote=True) for text in (self.page, self.title))
        style = f"width:100%;border:0;display:block;{self.style}"
        return f'<iframe title="{title}" style="{style}" srcdoc="{source}"></iframe>'

    def save(self, path: str | Path) -> None:
        """Write the page as a file that any browser opens."""
        Path(path).write_text(self.page, encoding="utf-8")


def filled_page(template: str, title: str, data: Mapping[str, Any], style: str) -> Page:
    """Fill a template of this folder with a title, and with data as JSON; the frame's style."""
    text = files("hadr.figures.solids").joinpath(template).read_text(encoding="utf-8")
    told = json.dumps(data, separators=(",", ":")).replace("</", "<\\/")
    text = text.replace("__TITLE__", html.escape(title)).replace("__DATA__", told)
    return Page(text, title, style)

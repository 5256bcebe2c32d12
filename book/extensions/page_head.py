"""A Sphinx extension for what browsers, searches and links tell of a page before it is opened.

Also a remedy: the search page looks for a glossary's terms by selector, where a dot would begin a
class.
"""

import re
from html import escape, unescape
from typing import Any

from docutils import nodes
from sphinx.domains import std

PICTURE = "_images/restored_frame.png"
LENGTH = 200
HOME = "Hand-aware depth restoration, an executable book"


def description(doctree: nodes.document | None) -> str:
    """The first paragraph of a page, at most `LENGTH` characters, no word cut; "" without one."""
    for paragraph in doctree.findall(nodes.paragraph) if doctree else ():
        text = " ".join(paragraph.astext().split())
        if len(text) > LENGTH:
            text = text[: LENGTH - 1].rsplit(" ", 1)[0] + "…"
        return text
    return ""


def setup(app: Any) -> dict[str, Any]:
    """Hook into Sphinx."""

    def on_page(
        app: Any, page: str, _template: str, context: dict[str, Any], doctree: nodes.document | None
    ) -> None:
        if page == app.config.root_doc:
            context["title"] = HOME  # its heading is the book's title, which follows
        title = re.sub("<[^>]+>", "", context.get("title", ""))
        told = {"og:title": unescape(title), "og:type": "article"}
        if text := description(doctree):
            told |= {"description": text, "og:description": text}
        told["og:image"] = f"{app.config.html_baseurl}{context['pathto'](PICTURE, 1)}"
        context["metatags"] = context.get("metatags", "") + "".join(
            f'<meta {"property" if ":" in name else "name"}="{name}" content="{escape(value)}" />\n'
            for name, value in told.items()
        )

    make_id = std.make_id
    std.make_id = lambda *args: make_id(*args).replace(".", "-")
    app.connect("html-page-context", on_page)
    return {"parallel_read_safe": True}

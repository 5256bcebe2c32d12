"""A Sphinx extension for what browsers, searches and links tell of a page before it is opened.

A link's picture needs the address where the book is published: `html: baseurl` of `_config.yml`,
or one of the variables in `ADDRESS`. Without one there is none.

Also a remedy: the search page looks for a glossary's terms by selector, where a dot would begin a
class.
"""

import os
import re
from html import escape, unescape
from typing import Any

from docutils import nodes
from sphinx.domains import std

PICTURE = "_images/restored_frame.png"
ADDRESS = ("HADR_BOOK_URL", "READTHEDOCS_CANONICAL_URL")
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

    def on_settings(_app: Any, config: Any) -> None:
        given = (config.html_baseurl, *map(os.environ.get, ADDRESS))
        if address := next(filter(None, given), ""):
            config.html_baseurl = f"{address.rstrip('/')}/"

    def on_page(
        app: Any, page: str, _template: str, context: dict[str, Any], doctree: nodes.document | None
    ) -> None:
        if page == app.config.root_doc:
            context["title"] = HOME  # its heading is the book's title, which follows
        title = re.sub("<[^>]+>", "", context.get("title", ""))
        told = {"og:title": unescape(title), "og:type": "article"}
        if text := description(doctree):
            told |= {"description": text, "og:description": text}
        if address := app.config.html_baseurl:
            told["og:image"] = f"{address}{PICTURE}"
        context["metatags"] = context.get("metatags", "") + "".join(
            f'<meta {"property" if ":" in name else "name"}="{name}" content="{escape(value)}" />\n'
            for name, value in told.items()
        )

    make_id = std.make_id
    std.make_id = lambda *args: make_id(*args).replace(".", "-")
    app.connect("config-inited", on_settings)
    app.connect("html-page-context", on_page)
    return {"parallel_read_safe": True}

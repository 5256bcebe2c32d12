"""A Sphinx extension: numbers of chapters, figures and tables.

A chapter has the number in its file's name, whatever stands before it in the book. On other pages,
each begins with figure 1 and table 1; Sphinx counts them in one row from page to page. And a table
that a page has as HTML, with a caption, is counted like any other.
"""

import re
from html import unescape
from typing import Any

from docutils import nodes
from sphinx_external_toc.collectors import TocTreeCollectorWithStyles

LATE = 900  # after Sphinx has numbered them
HTML_TABLE = re.compile(
    r'<table class="([^"]+)">\s*<caption>(.*?)</caption>(.*)</table>\s*', re.DOTALL
)


def restart(numbers: dict[str, dict[str, dict[str, tuple[int, ...]]]]) -> None:
    """Count the figures of each page from 1 where their numbers have no chapter before them."""
    for kinds in numbers.values():
        for figures in kinds.values():
            if figures and all(len(number) == 1 for number in figures.values()):
                in_order = sorted(figures, key=lambda name: figures[name])
                figures.update({name: (k,) for k, name in enumerate(in_order, 1)})


def number_chapters(env: Any) -> None:
    """Put the number in a chapter's file name in place of the one that Sphinx has counted."""
    for page, sections in env.toc_secnumbers.items():
        if not (found := re.match(r"notebooks/(\d+)_", page)):
            continue
        chapter = int(found[1])
        shown = [env.titles[page], *env.tocs[page].findall(nodes.reference)]
        for node in shown:
            if number := node.get("secnumber"):
                node["secnumber"] = [chapter, *number[1:]]
        for anchor, number in sections.items():
            if number:
                sections[anchor] = (chapter, *number[1:])


def count_html_tables(doctree: nodes.document) -> None:
    """Make a table with a caption of each raw one."""
    for raw in list(doctree.findall(nodes.raw)):
        if found := HTML_TABLE.fullmatch(raw.astext()):
            classes, caption, rows = found.groups()
            table = nodes.table(
                "", nodes.title("", unescape(caption)), nodes.raw("", rows, format="html")
            )
            table["classes"] = classes.split()
            doctree.set_id(table)
            raw.replace_self(table)


def setup(app: Any) -> dict[str, Any]:
    """Hook into Sphinx."""
    numbered = TocTreeCollectorWithStyles.assign_section_numbers

    def assign_section_numbers(collector: Any, env: Any) -> Any:
        changed = numbered(collector, env)
        number_chapters(env)
        return changed

    def on_updated(_app: Any, env: Any) -> list[str]:
        restart(env.toc_fignumbers)
        return []

    TocTreeCollectorWithStyles.assign_section_numbers = assign_section_numbers
    app.connect("doctree-read", lambda _app, doctree: count_html_tables(doctree))
    app.connect("env-get-updated", on_updated, priority=LATE)
    return {"parallel_read_safe": True}

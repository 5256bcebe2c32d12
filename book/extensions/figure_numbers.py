"""A Sphinx extension: on pages without a chapter's number each page's figures begin with 1.

Sphinx counts the figures and tables of all such pages in one row, from page to page.
"""

from typing import Any

LATE = 900  # after Sphinx has numbered them


def restart(numbers: dict[str, dict[str, dict[str, tuple[int, ...]]]]) -> None:
    """Count the figures of each page from 1 where their numbers have no chapter before them."""
    for kinds in numbers.values():
        for figures in kinds.values():
            if figures and all(len(number) == 1 for number in figures.values()):
                in_order = sorted(figures, key=lambda name: figures[name])
                figures.update({name: (k,) for k, name in enumerate(in_order, 1)})


def setup(app: Any) -> dict[str, Any]:
    """Hook into Sphinx."""

    def on_updated(_app: Any, env: Any) -> list[str]:
        restart(env.toc_fignumbers)
        return []

    app.connect("env-get-updated", on_updated, priority=LATE)
    return {"parallel_read_safe": True}

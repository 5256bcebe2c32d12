"""The book's Markdown, without what only the book's own builder understands."""

import re
from collections.abc import Mapping
from pathlib import Path

_CITE = re.compile(r"\{cite(?::\w+)?\}`([^`]+)`")
_DOC = re.compile(r"\{doc\}`(?:([^`<]+?)\s*<([^`>]+)>|([^`]+))`")
_NUMBER = re.compile(r"\{numref\}`[^`]+`")
_TABLE = re.compile(r"^:::\{table\} (.+)\n(?::name: .+\n)?\n(?s:(.+?))^:::$", re.MULTILINE)
_PAGE = re.compile(r"\]\(\.\./([\w/-]+\.md)(#[\w-]+)?\)")


def short_citations(bibliography: str) -> dict[str, str]:
    """How prose names the works of a BibTeX file's text: ``Yu et al., 2024`` by key."""
    names = {}
    for entry in re.split(r"^@", bibliography, flags=re.MULTILINE)[1:]:
        key = re.match(r"\w+\{([^,\s]+),", entry)
        authors = re.search(r"^\s*author\s*=\s*\{(.+)\},?\s*$", entry, flags=re.MULTILINE)
        year = re.search(r"^\s*year\s*=\s*\{?(\d{4})", entry, flags=re.MULTILINE)
        if key is None:
            continue
        people = re.split(r"\s+and\s+", authors.group(1)) if authors else [key.group(1)]
        family = [re.sub(r"[{}\\'\"^~`]", "", person.split(",")[0]) for person in people]
        who = {1: family[0], 2: " and ".join(family[:2])}.get(len(family), f"{family[0]} et al.")
        names[key.group(1)] = f"{who}, {year.group(1)}" if year else who
    return names


def plain_markdown(text: str, citations: Mapping[str, str], pages: str) -> str:
    """Turn the book's Markdown into such as Jupyter shows without extensions."""

    def cited(found: re.Match[str]) -> str:
        keys = [key.strip() for key in found.group(1).split(",")]
        return "(" + "; ".join(citations.get(key, key) for key in keys) + ")"

    def linked(found: re.Match[str]) -> str:
        target = found.group(2) or found.group(3)
        words = found.group(1) or Path(target).name
        if target.startswith("../"):
            return f"[{words}]({pages}/{Path(target).name}.md)"
        return f"[{words}]({target}.ipynb)"

    text = _TABLE.sub(r"*\1*\n\n\2", _NUMBER.sub("the table", text))
    text = _DOC.sub(linked, _CITE.sub(cited, text))
    return _PAGE.sub(lambda found: f"]({pages}/{found.group(1)}{found.group(2) or ''})", text)

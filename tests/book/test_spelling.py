"""Spelling of all pages: every word of the prose is in a dictionary, or in words.txt beside this.

The dictionary is pyspellchecker's English one, which has few British forms. A word that it lacks
and that is right goes into words.txt, in lower case, one a line.
"""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "book").glob("*.md")),
    *sorted((ROOT / "notebooks" / "text").glob("*.md")),
    *sorted((ROOT / "data_samples").glob("*.md")),
]
OWN = Path(__file__).with_name("words.txt").read_text(encoding="utf-8").split()
CODE = {"", "bash", "bibtex", "python", "text", "json", "console", "mermaid"}


def prose(text: str) -> str:
    """What a reader reads: no code, formula, address, key or checksum; but alternative texts."""
    kept, fence = [], ""
    directives: list[str] = []  # open fences whose content is prose
    for line in re.sub(r"\A---\n.*?\n---\n", "", text, flags=re.DOTALL).splitlines():
        marks = re.match(r"\s*(`{3,}|:{3,})(.*)$", line)
        if fence:
            if marks and marks[1] == fence and not marks[2].strip():
                fence = ""
            elif (found := re.match(r"\s*alt: (.*)$", line)) is not None:
                kept.append(found[1])
        elif marks and not marks[2].strip() and marks[1] in directives[-1:]:
            directives.pop()
        elif marks and marks[1][0] == "`" and _is_code(marks[2].strip()):
            fence = marks[1]
        elif marks:
            directives.append(marks[1])
            kept.append(re.sub(r"\{[\w-]+\}", "", marks[2]))
        elif not re.match(r":[\w-]+:", line):
            kept.append(line)
    words = "\n".join(kept)
    for pattern in (
        r"<!--.*?-->", r"\$\$.*?\$\$", r"\$[^$\n]+\$", r"\{[\w:-]+\}`[^`]*`", r"`[^`]*`",
        r"(?<=\])\([^)]*\)", r"https?://\S+", r"<[^>]+>", r"\{\{\w+\}\}", r"^\([\w-]+\)=$",
        r"\b(?=[a-f]*\d)[\da-f]{12,}\b",
    ):  # fmt: skip
        words = re.sub(pattern, " ", words, flags=re.DOTALL | re.MULTILINE)
    return words


def _is_code(info: str) -> bool:
    return info in CODE or info.startswith("{code-cell}") or info.startswith("{code-block}")


def words_of(text: str) -> set[str]:
    """Words of three letters and more in lower case, without a genitive's end."""
    found = re.findall(r"[^\W\d_]+(?:['’][^\W\d_]+)?", prose(text))
    plain = {re.sub(r"'(s)?$", "", word.replace("’", "'")).lower() for word in found}
    return {word for word in plain if len(word) > 2}


def unknown(text: str) -> list[str]:
    """Words of a page that neither the dictionary nor words.txt has."""
    spellchecker = pytest.importorskip(
        "spellchecker", reason="the package pyspellchecker is not installed: no dictionary here"
    )
    checker = spellchecker.SpellChecker(language="en", distance=1)
    checker.word_frequency.load_words(OWN)
    return sorted(checker.unknown(words_of(text)))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_every_word_is_known(page):
    assert unknown(page.read_text(encoding="utf-8")) == []


def test_the_word_list_is_sorted_and_every_word_of_it_is_used():
    used = {word for page in PAGES for word in words_of(page.read_text(encoding="utf-8"))}
    assert sorted(set(OWN)) == OWN
    assert [word for word in OWN if word not in used] == []

"""A chapter's slides as text: what is on which slide, before anything is drawn.

A deck has one column per section of the chapter. Its first slide holds the idea, in few words;
below it, under the same heading, stand the section's formulas and figures. Exercises have a slide
each. What the chapter says at length goes into the speaker's notes.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from hadr.press.course.chapter import Chapter, Piece, marks_text

MOST_FIGURES = 3
MOST_FORMULAS = 2
_DISPLAY = re.compile(r"\$\$.+?\$\$", flags=re.DOTALL)
_LEAD = re.compile(r"^\*\*[^*]+[.:?!]\*\* ")


@dataclass
class Section:
    """One section of a chapter, sorted by what a slide can show.

    Args:
        heading: Its heading.
        paragraphs: Its prose, without formulas on lines of their own.
        formulas: The sentence that leads to a displayed formula, and the formula.
        figures: Code cells that draw.
    """

    heading: str
    paragraphs: list[str] = field(default_factory=list)
    formulas: list[tuple[str, str]] = field(default_factory=list)
    figures: list[Piece] = field(default_factory=list)


def sections_of(chapter: Chapter) -> list[Section]:
    """The sections of a chapter in order, without the exercises' own text."""
    found: list[Section] = []
    for piece in chapter.pieces:
        if piece.label:
            continue
        if piece.is_code:
            if found and "image" in piece.metadata.get("mystnb", {}):
                found[-1].figures.append(piece)
            continue
        for block in re.split(r"\n\s*\n", piece.source):
            _sort_block(found, block.strip())
    return found


def _sort_block(found: list[Section], block: str) -> None:
    heading = re.match(r"^(#{2,}) +([^\n]+)\n?", block)
    if heading and heading[1] == "##":
        found.append(Section(heading[2].strip()))
    if heading:
        block = block[heading.end() :].strip()
    if not block or not found or block.startswith(("```", "|", ":::")):
        return
    section = found[-1]
    for formula in _DISPLAY.findall(block):
        before = section.paragraphs[-1] if section.paragraphs else ""
        ahead = block.split(formula)[0].strip() or before
        section.formulas.append((sentences(ahead)[-1] if ahead else "", formula))
    words = _DISPLAY.sub("", block).strip()
    if words:
        section.paragraphs.append(words)


def sentences(text: str) -> list[str]:
    """Cut a paragraph of Markdown into sentences; formulas, code and bold leads stay whole."""
    kept: list[str] = []

    def hide(found: re.Match[str]) -> str:
        kept.append(found.group())
        return f"\x00{len(kept) - 1}\x00"

    flat = " ".join(text.split())
    hidden = re.sub(r"\$[^$]+\$|`[^`]+`|\*\*[^*]+\*\*|\[[^\]]*\]\([^)]*\)|\([^()]*\)", hide, flat)
    cut = re.split(r"(?<=[.!?:])\s+(?=[A-Z\x00*])", hidden)
    show = lambda found: kept[int(found.group(1))]  # noqa: E731
    whole = [re.sub(r"\x00(\d+)\x00", show, part) for part in cut]
    whole = [re.sub(r"\x00(\d+)\x00", show, part) for part in whole]
    return [part.strip() for part in whole if part.strip()]


def deck_text(
    chapter: Chapter,
    pictures: Mapping[str, str],
    marks: Mapping[str, int],
    plain: Callable[[str], str],
) -> str:
    """Write a chapter's deck as MyST Markdown: ``#`` and ``##`` begin columns, ``###`` slides.

    Args:
        chapter: The chapter.
        pictures: Image file, relative to the deck, by the code of the cell that drew it.
        marks: Marks by exercise label.
        plain: Turns the book's Markdown into such as needs none of the book's extensions.
    """
    goals = "\n".join(f"- {goal}" for goal in chapter.goals)
    slides = [
        f"# {chapter.title}\n\nChapter {chapter.number}",
        f"## You will be able to\n\n{goals}",
    ]
    sections = {section.heading: section for section in sections_of(chapter)}
    for heading, section in sections.items():
        if heading not in ("Exercises", "Summary"):
            slides += _column(section, pictures)
    listed = "\n".join(
        f"{place}. {exercise.title} ({marks_text(marks[exercise.label])})"
        for place, exercise in enumerate(chapter.exercises, start=1)
    )
    slides.append(f"## Exercises\n\n{listed}")
    for exercise in chapter.exercises:
        slides.append(f"### {exercise.title}\n\n{exercise.question}\n\n{_notes(exercise.words)}")
    if "Summary" in sections:
        slides.append(_summary(sections["Summary"]))
    return plain("\n\n".join(slides)) + "\n"


def _column(section: Section, pictures: Mapping[str, str]) -> list[str]:
    """The idea of a section, then its formulas, then its figures."""
    leads = [p for p in section.paragraphs if _LEAD.match(p)]
    if len(leads) >= 2:
        idea = [" ".join(sentences(lead)[:2]) for lead in leads]
    else:
        idea = sentences(section.paragraphs[0])[:2] if section.paragraphs else []
        idea += [s for p in section.paragraphs for s in sentences(p) if "**" in s and s not in idea]
    points = "\n".join(f"- {_capital(point.rstrip(':'))}" for point in idea[:4])
    slides = [f"## {section.heading}\n\n{points}\n\n{_notes(*section.paragraphs)}"]
    shown = section.formulas[:MOST_FORMULAS]
    if shown:
        rows = [f"{_capital(shown[0][0])}\n\n{shown[0][1]}"]
        rows += [f"{lead}\n\n{formula}" for lead, formula in shown[1:]]
        slides.append(f"### {section.heading}\n\n" + "\n\n".join(rows))
    drawn = [piece for piece in section.figures if piece.source in pictures]
    for piece in drawn[:MOST_FIGURES]:
        words = str(piece.metadata["mystnb"]["image"]["alt"]).replace('"', "'")
        picture = f"```{{image}} {pictures[piece.source]}\n:alt: {words}\n```"
        slides.append(f"### {section.heading}\n\n{picture}\n\n*{words}*")
    return slides


def _capital(sentence: str) -> str:
    """Begin with a capital letter, also behind the marks of bold words."""
    return re.sub(r"^(\**)([a-z])", lambda found: found[1] + found[2].upper(), sentence)


def _summary(section: Section) -> str:
    told = [p for p in section.paragraphs if not p.startswith(("**Read", "**Next", "- "))]
    points = [sentence for paragraph in told for sentence in sentences(paragraph)][:5]
    further = [p for p in section.paragraphs if p.startswith(("**Read", "**Next"))]
    listed = "\n".join(f"- {point}" for point in points)
    return f"## Summary\n\n{listed}\n\n{_notes(*further)}"


def _notes(*paragraphs: str) -> str:
    """Speaker's notes: plain words, so formulas stay as their source."""
    if not paragraphs:
        return ""
    words = "\n\n".join(_DISPLAY.sub("", paragraph) for paragraph in paragraphs)
    return f"````{{revealjs-notes}}\n{words}\n````"

"""Decks of slides, one a chapter: reveal.js through Sphinx, with every script and font beside them.

A deck has one column per section of the chapter. Its first slide holds the section's first
paragraph and the bold words with which others begin; below it, under the same heading, stand its
formulas and figures. Exercises have a slide each. All words are in the speaker's notes, too.

The package sphinx-revealjs carries reveal.js, and sphinx-mathjax-offline carries MathJax, so a
deck opens from a folder without a network.
"""

import base64
import importlib.util
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from hadr.press.chapters import read_notebook
from hadr.press.course.chapter import Chapter, Piece

MOST_FIGURES = 3
MOST_FORMULAS = 2
_DISPLAY = re.compile(r"\$\$.+?\$\$", flags=re.DOTALL)
_LEAD = re.compile(r"\*\*[^*]+[.:?!]\*\*")
_LEFT_OVERS = (".buildinfo", "objects.inv", "search.html", "searchindex.js", "genindex.html")
_CONF = """\
project = "Depth for glass in a hand"
html_title = project
extensions = ["myst_parser", "sphinx-mathjax-offline", "sphinx_revealjs"]
myst_enable_extensions = ["amsmath", "dollarmath"]
suppress_warnings = ["myst.xref_missing", "myst.header", "image.not_readable"]
language = "en"
html_copy_source = False
html_show_sourcelink = False
html_show_sphinx = False
html_use_index = False
html_last_updated_fmt = None
revealjs_style_theme = "white"
revealjs_static_path = ["_static"]
revealjs_css_files = ["course.css"]
revealjs_script_conf = {
    "hash": True, "slideNumber": "c/t", "transition": "none", "width": 1280, "height": 720,
    "margin": 0.06, "center": False,
}
revealjs_script_plugins = [
    {"name": "RevealNotes", "src": "revealjs/plugin/notes/notes.js"},
]
"""
_STYLE = """\
.reveal { font-size: 28px; }
.reveal .slides section { text-align: left; }
.reveal h1 { font-size: 2.1em; text-transform: none; margin-top: 22vh; }
.reveal h2 { font-size: 1.5em; text-transform: none; }
.reveal h3 { font-size: 1.1em; text-transform: none; color: #555; }
.reveal .slide-number { left: 8px; right: auto; }
.reveal li { margin-bottom: 0.5em; }
.reveal img { display: block; margin: 0 auto; max-width: 100%; max-height: 450px; }
.reveal em { color: #555; font-size: 0.8em; }
.reveal code { background: #f2f2f2; padding: 0 0.2em; }
.reveal div.math { overflow-x: auto; margin: 1em 0; }
"""


def missing_packages() -> list[str]:
    """What the slides need and this environment lacks, by the names under which to install it."""
    needed = ("sphinx", "myst_parser", "sphinx-mathjax-offline", "sphinx_revealjs")
    return [one.replace("_", "-") for one in needed if importlib.util.find_spec(one) is None]


def pictures_of(executed: Path, chapter: Chapter, folder: Path) -> dict[str, str]:
    """Take the figures of an executed notebook out into files."""
    cells = read_notebook(executed).cells
    outputs = {cell.source: cell.outputs for cell in cells if cell.cell_type == "code"}
    found: dict[str, str] = {}
    for piece in chapter.pieces:
        if not piece.is_code or piece.label or "image" not in piece.metadata.get("mystnb", {}):
            continue
        if piece.source not in outputs:
            first = piece.source.splitlines()[0]
            raise ValueError(
                f"{executed} is not of this state of {chapter.name}: it has no cell that begins "
                f"with {first!r}; execute the chapters again"
            )
        images = [o["data"]["image/png"] for o in outputs[piece.source]
                  if "image/png" in o.get("data", {})]  # fmt: skip
        if images:
            name = f"{chapter.name}-{len(found)}.png"
            (folder / name).write_bytes(base64.b64decode(images[-1]))
            found[piece.source] = name
    return found


def build_slides(
    chapters: Sequence[Chapter],
    executed: Mapping[str, Path],
    plain: Callable[[str], str],
    work: Path,
    target: Path,
) -> None:
    """Build one deck per chapter and a first page that links them."""
    source = work / "source"
    (source / "_static").mkdir(parents=True)
    (source / "conf.py").write_text(_CONF, encoding="utf-8")
    (source / "_static" / "course.css").write_text(_STYLE, encoding="utf-8")
    for chapter in chapters:
        drawn = pictures_of(executed[chapter.name], chapter, source)
        deck = deck_text(chapter, drawn, plain)
        (source / f"{chapter.name}.md").write_text(deck, encoding="utf-8")
    links = "\n".join(f"- [{chapter.title}]({chapter.name}.md)" for chapter in chapters)
    names = "\n".join(chapter.name for chapter in chapters)
    index = f"# Depth for glass in a hand\n\n## Decks\n\n{links}\n\n"
    index += f"```{{toctree}}\n:hidden:\n\n{names}\n```\n"
    (source / "index.md").write_text(index, encoding="utf-8")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b",
               "revealjs", "-d", str(work / "doctrees"), str(source), str(target)]  # fmt: skip
    environment = os.environ | {"NO_COLOR": "1", "PYTHONHASHSEED": "0"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    if done.returncode != 0:
        raise RuntimeError(f"the slides did not build:\n{(done.stdout + done.stderr)[-4000:]}")
    for name in _LEFT_OVERS:
        (target / name).unlink(missing_ok=True)
    shutil.rmtree(target / ".doctrees", ignore_errors=True)


@dataclass
class Section:
    """One section of a chapter by what a slide can show; formulas and lists end a paragraph."""

    heading: str
    paragraphs: list[str] = field(default_factory=list)
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
    paragraphs = found[-1].paragraphs
    if paragraphs and (block.startswith(("$$", "- ", "1. ")) or block[0].islower()):
        paragraphs[-1] += f"\n\n{block}"
    else:
        paragraphs.append(block)


def deck_text(chapter: Chapter, pictures: Mapping[str, str], plain: Callable[[str], str]) -> str:
    """Write a chapter's deck as MyST Markdown: ``#`` and ``##`` begin columns, ``###`` slides.

    Pictures are files, relative to the deck, by the code of the cell that drew them.
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
        f"{place}. {exercise.title} ({exercise.marks_text})"
        for place, exercise in enumerate(chapter.exercises, start=1)
    )
    slides.append(f"## Exercises\n\n{listed}")
    for exercise in chapter.exercises:
        slides.append(f"### {exercise.title}\n\n{exercise.question}\n\n{_notes(exercise.words)}")
    if "Summary" in sections:
        told = sections["Summary"].paragraphs
        further = [p for p in told if p.startswith(("**Read", "**Next", "**In the"))]
        slides += ["## Summary", *(p for p in told if p not in further), _notes(*further)]
    return plain("\n\n".join(slides)) + "\n"


def _column(section: Section, pictures: Mapping[str, str]) -> list[str]:
    """The idea of a section, then its formulas, then its figures; what it lacks has no slide."""
    bodies = []
    if section.paragraphs:
        idea, *rest = section.paragraphs
        leads = "\n".join(f"- {lead[0]}" for lead in map(_LEAD.match, rest) if lead)
        idea = re.sub(":$", ".", idea)  # what it announced, a table or code, is not on the slide
        bodies.append(f"{idea}\n\n{leads}\n\n{_notes(*section.paragraphs)}")
        formulas = [paragraph for paragraph in rest if "$$" in paragraph]
        bodies += ["\n\n".join(formulas[:MOST_FORMULAS])] if formulas else []
    drawn = [piece for piece in section.figures if piece.source in pictures]
    for piece in drawn[:MOST_FIGURES]:
        words = str(piece.metadata["mystnb"]["image"]["alt"]).replace('"', "'")
        picture = f"```{{image}} {pictures[piece.source]}\n:alt: {words}\n```"
        told = piece.metadata["mystnb"].get("figure", {}).get("caption", words)
        bodies.append(f"{picture}\n\n*{told}*")
    return [f"{'###' if k else '##'} {section.heading}\n\n{body}" for k, body in enumerate(bodies)]


def _notes(*paragraphs: str) -> str:
    """Speaker's notes: plain words, so formulas stay as their source."""
    if not paragraphs:
        return ""
    words = "\n\n".join(_DISPLAY.sub("", paragraph) for paragraph in paragraphs)
    return f"````{{revealjs-notes}}\n{words}\n````"

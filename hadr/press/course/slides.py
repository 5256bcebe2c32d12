"""Decks of slides: reveal.js through Sphinx, with every script and font beside them.

The package sphinx-revealjs carries reveal.js, and sphinx-mathjax-offline carries MathJax, so a
deck opens from a folder without a network.
"""

import base64
import importlib.util
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from hadr.press.chapters import read_notebook
from hadr.press.course.chapter import Chapter
from hadr.press.course.deck import deck_text

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
.reveal { font-size: 30px; }
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
    needed = {"sphinx": "sphinx", "myst_parser": "myst-parser",
              "sphinx-mathjax-offline": "sphinx-mathjax-offline",
              "sphinx_revealjs": "sphinx-revealjs"}  # fmt: skip
    return [name for module, name in needed.items() if importlib.util.find_spec(module) is None]


def pictures_of(executed: Path, chapter: Chapter, folder: Path) -> dict[str, str]:
    """Take the figures of an executed notebook out into files."""
    outputs = {
        cell.source: cell.outputs
        for cell in read_notebook(executed).cells
        if cell.cell_type == "code"
    }
    folder.mkdir(parents=True, exist_ok=True)
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
    marks: Mapping[str, int],
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
        notebook = executed.get(chapter.name)
        drawn = {} if notebook is None else pictures_of(notebook, chapter, source)
        deck = deck_text(chapter, drawn, marks, plain)
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

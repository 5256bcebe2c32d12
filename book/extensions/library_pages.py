"""A Sphinx extension: the pages on the library from the code itself, and each page's footer.

A page names its modules once, in a fence ``{modules}``; each becomes a line in a list and a
section with its documented names. The fence ``{commands}`` becomes the description of the command
line, from the parsers that answer ``--help``. Both are expanded to text before a page is read.
"""

import argparse
import ast
import importlib.util
import re
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike
from sphinx.ext import autodoc
from sphinx.util.typing import stringify_annotation

from hadr.cli import COMMANDS, command_parser

MODULES = re.compile(r"^```\{modules\}\n(.*?)^```$", re.DOTALL | re.MULTILINE)
COMMAND_LINE = re.compile(r"^```\{commands\}\n```$", re.MULTILINE)
#: numpy's own spelling of an array's type, as Sphinx prints it, and of what becomes an array.
ARRAY = re.compile(
    r"~numpy\.ndarray\[tuple\[~typing\.Any, \.\.\.\], "
    r"~numpy\.dtype\[(~[\w.]+)(?:\[~typing\.Any\])?\]\]"
)
ARRAY_LIKE = stringify_annotation(ArrayLike, "smart")
OPTION = re.compile(r"(?<![\w`-])(--[a-z][a-z-]*\b)")
USAGE_WIDTH = 42


def module_summary(name: str) -> str:
    """The first line of a module's docstring as Markdown; the module is not imported.

    Args:
        name: Such as ``hadr.camera``.

    Raises:
        ValueError: There is no such module, or it says nothing about itself.
    """
    spec = importlib.util.find_spec(name)
    if spec is None or spec.origin is None:
        raise ValueError(f"there is no module {name!r}")
    text = ast.get_docstring(ast.parse(Path(spec.origin).read_text(encoding="utf-8")))
    if not text:
        raise ValueError(f"the module {name!r} has no docstring")
    line = re.sub(r":\w+:`~?([^`]+)`", r"`\1`", text.splitlines()[0])
    return line.replace("``", "`")


def modules_text(names: list[str]) -> str:
    """A list of the modules, where there are several, and a section for each."""
    lines = []
    if len(names) > 1:
        lines += [f"- [`{name}`](#{name}): {module_summary(name)}" for name in names] + [""]
    for name in names:
        module_summary(name)
        lines += [f"## {name}", "", "```{eval-rst}", f".. automodule:: {name}", "```", ""]
    return "\n".join(lines)


def commands_text() -> str:
    """The whole command line: a list of the commands, and a section for each."""
    lines = [f"- [`hadr {name}`](#hadr-{name}): {about}" for name, (_, about) in COMMANDS.items()]
    for name in COMMANDS:
        lines += ["", f"(hadr-{name})=", f"## hadr {name}", "", parser_text(command_parser(name))]
    return "\n".join(lines) + "\n"


def parser_text(parser: argparse.ArgumentParser) -> str:
    """One parser as Markdown: what it is for, how it is called, each argument, the closing words.

    Args:
        parser: Any parser without subparsers.

    Returns:
        Markdown with definition lists; free text of the parser stands as it is, between fences.
    """
    parser.formatter_class = lambda prog: argparse.RawDescriptionHelpFormatter(
        prog, width=USAGE_WIDTH
    )
    usage = parser.format_usage().removeprefix("usage: ").rstrip()
    parts = [_free_text(parser.description), f"```text\n{_dedented(usage)}\n```"]
    for group in parser._action_groups:
        actions = [a for a in group._group_actions if a.help is not argparse.SUPPRESS]
        actions = [a for a in actions if "--help" not in a.option_strings]
        if actions:
            parts.append(f"**{(group.title or 'options').capitalize()}**")
            parts += [_action_text(parser, action) for action in actions]
    parts.append(_free_text(parser.epilog))
    return "\n\n".join(part for part in parts if part)


def _free_text(text: str | None) -> str:
    """Paragraphs of prose as prose; what is set in columns keeps its form."""
    parts: list[tuple[bool, str]] = []
    for part in re.split(r"\n\s*\n", (text or "").strip("\n")):
        in_columns = bool(re.search(r"^ |\S {2,}\S", part, re.MULTILINE))
        if in_columns and parts and parts[-1][0]:
            parts[-1] = (True, f"{parts[-1][1]}\n\n{part}")
        elif part:
            parts.append((in_columns, part))
    return "\n\n".join(f"```text\n{t}\n```" if kept else _escaped(t) for kept, t in parts)


def _escaped(text: str) -> str:
    """Plain text as Markdown; what stands between backticks is code already."""
    parts = re.split(r"(`[^`]*`)", text)
    parts[::2] = [OPTION.sub(r"`\1`", re.sub(r"([*_<\[$|])", r"\\\1", one)) for one in parts[::2]]
    return "".join(parts)


def _dedented(usage: str) -> str:
    return re.sub(r"\n +", "\n    ", usage)


def _action_text(parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    formatter = argparse.HelpFormatter(parser.prog)
    name = formatter._format_action_invocation(action)
    told = " ".join(formatter._expand_help(action).split()) if action.help else ""
    told = _escaped(re.sub(r" \(default: (False|unset)?\)", "", told))
    has_default = action.default not in (None, False, argparse.SUPPRESS, [], "")
    if has_default and "default" not in told and f"({action.default})" not in told:
        told = f"{told} (default: `{action.default}`)".strip()
    if action.required and action.option_strings and "(required)" not in told:
        told = f"{told} (required)".strip()
    return f"`{name}`\n: {told or 'See above.'}"


def expand(text: str) -> str:
    """Put text from the code in place of a page's fences ``{modules}`` and ``{commands}``."""
    text = MODULES.sub(lambda found: modules_text(found.group(1).split()), text)
    return COMMAND_LINE.sub(lambda found: commands_text(), text)


def sphinx_text(lines: list[str]) -> list[str]:
    """A docstring of this library as Sphinx has to be told it.

    A bar is a bar, as in ``|A|``, and no markup; what stands between single backticks is code, and
    so is an option such as --help, whose dashes would be joined.

    Args:
        lines: Plain text; roles, links and literals in double backticks stay as they are.
    """
    parts = re.split(r"(``.*?``|`[^`]*`_*)", "\n".join(lines), flags=re.DOTALL)
    for number, part in enumerate(parts):
        if number % 2 == 0:
            part = OPTION.sub(r"``\1``", part.replace("|", r"\|"))
        elif part[:2] != "``" and part[-1] != "_" and not parts[number - 1].endswith(":"):
            part = f"`{part}`"
        parts[number] = part
    return "".join(parts).split("\n")


def readable_types(signature: str | None) -> str | None:
    """Array types in a signature as they are written in the code; a made default is left open.

    Sphinx cannot read the ``<factory>`` of a dataclass, and would print the signature unread.
    """
    if not signature:
        return signature
    signature = signature.replace("<factory>", "...")
    named = signature.replace(ARRAY_LIKE, "~numpy.typing.ArrayLike")
    return ARRAY.sub(r"~numpy.typing.NDArray[\1]", named)


def setup(app: Any) -> dict[str, Any]:
    """Hook into Sphinx."""

    def on_source(_app: Any, _page: str, source: list[str]) -> None:
        source[0] = expand(source[0])

    def on_page(_app: Any, _page: str, _template: str, context: dict[str, Any], _tree: Any) -> None:
        link = f'<a href="{context["pathto"]("licences")}">Licences</a>'
        context["theme_extra_footer"] = f"{link} of code, data, weights and pictures"

    def on_signature(*told: Any) -> tuple[str | None, str | None]:
        signature, returned = told[-2:]
        return readable_types(signature), readable_types(returned)

    def on_docstring(_app: Any, what: str, *told: Any) -> None:
        lines = told[-1]
        lines[:] = sphinx_text(lines)
        if what in ("attribute", "data", "property") and lines and ":" in lines[0]:
            lines[:0] = ["..", ""]  # else napoleon takes what is before the colon for a type

    app.setup_extension("sphinx.ext.autodoc")
    # the type of a property passes no event
    printed = autodoc.stringify_annotation
    autodoc.stringify_annotation = lambda *args: readable_types(printed(*args))
    app.connect("source-read", on_source)
    app.connect("html-page-context", on_page)
    app.connect("autodoc-process-signature", on_signature)
    app.connect("autodoc-process-docstring", on_docstring)
    return {"parallel_read_safe": True}

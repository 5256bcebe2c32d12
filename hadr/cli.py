"""The `hadr` command: a thin face over the library.

Each subcommand lives in a module of its own, imported only when it is called, that offers

* ``Options``, a frozen dataclass: its docstring is the command's description, the string below
  each field is the option's help with its unit;
* ``run(options) -> int``, the exit status;
* ``EPILOG``, what stands below the options: examples above all, units, files.

On top it imports nothing that takes long, so that its --help is quick; `run` does.
"""

from __future__ import annotations

import argparse
import difflib
import errno
import importlib
import inspect
import io
import os
import re
import shutil
import sys
import textwrap
import traceback
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import replace
from types import NoneType
from typing import Any, NoReturn, Union, get_args

import tyro
from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

from hadr import __version__

COMMANDS: dict[str, tuple[str, str]] = {
    "restore": (
        "hadr.press.own_frames.restore_command",
        "restore the depth of a transparent object in a frame",
    ),
    "view": ("hadr.press.own_frames.view_command", "turn a restored cloud in the browser"),
    "hand-model": (
        "hadr.models.hand.hand_model_command",
        "make the model that MediaPipe finds hands with",
    ),
    "reproduce": (
        "hadr.press.reproduce",
        "make the tables, the handover's attempts and the chapters anew",
    ),
    "book": ("hadr.press.book_command", "execute the chapters and build the HTML book"),
    "course": ("hadr.press.course.command", "write student notebooks, solutions and slides"),
    "generate": (
        "hadr.synthesis.generation.command",
        "make a data set of hand-held glass in TransHand's form",
    ),
    "train": ("hadr.training.train_command", "train a network on a data set"),
    "calibrate": (
        "hadr.training.calibrate_command",
        "teach a checkpoint what its confidence means",
    ),
    "handover": ("hadr.simulation.trials.command", "let a simulated UR5 take glasses from a hand"),
    "evaluate": ("hadr.experiments.evaluate_command", "score networks beside simple methods"),
}

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""What an error of writing says where the disk is full."""
TOLD = (ValueError, OSError, FloatingPointError, ImportError)
"""Errors that are told in one sentence: unusable input, or a library that is not installed."""
NEEDS_LESS = ("--batch-size", "--jobs", "--workers")
"""Options with whose smaller numbers a command needs less memory."""
DESCRIPTION = """\
hadr: depth restoration of hand-held transparent objects.

A depth camera sees through glass. Given the colour image, the corrupted depth,
the object's mask and the hand that holds it, hadr restores the object's depth."""

EPILOG = """\
commands
{commands}

  hadr COMMAND --help explains one command: its input with units, its output,
  examples, exit status.

a first try
  hadr restore --rgb rgb.png --depth depth.png --intrinsics camera.yaml \\
      --mask glass.png --hand hand.json --out restored

exit status
  0 done   1 failed   2 unusable input or a wrong call   130 interrupted"""


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are one sentence with the nearest known word, and where to read on."""

    def error(self, message: str) -> NoReturn:
        wrong = re.search(r"invalid choice: '(.*)' \(choose from (.*)\)", message)
        known = wrong[2].replace("'", "").split(", ") if wrong else []
        hint = _nearest(wrong[1], known) if wrong else ""
        self.exit(2, f"{self.prog}: error: {message}{hint} (see {self.prog} --help)\n")


class _Formatter(argparse.HelpFormatter):
    """Fills paragraphs of prose to the width; what is set in lines or columns stays as it is."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, width=min(shutil.get_terminal_size().columns, 100) - 2)

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        parts = text.strip("\n").split("\n\n")
        return "\n\n".join(p if "\n " in p else textwrap.fill(p, width) for p in parts)


def _nearest(word: str, known: Iterable[str]) -> str:
    similar = difflib.get_close_matches(word, known, n=1)
    return f"; did you mean {similar[0]!r}?" if similar else ""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        argv: Arguments without the program's name; None takes the process's own.

    Returns:
        Exit status: 0 done, 1 failed, 2 unusable input, 130 interrupted.

    Raises:
        SystemExit: After --help and --version (status 0) and wrong calls (status 2).
    """
    # Before a library starts its threads: see `hadr.press.chapters`.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    if argv is None:
        os.environ["PYTHONSAFEPATH"] = "1"  # no child process imports from the current folder
        argv = sys.argv[1:]
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, io.TextIOWrapper):  # a name that it can't show is no error
                stream.reconfigure(errors="backslashreplace")
    words = list(argv)
    parser = _Parser(
        prog="hadr",
        usage="hadr COMMAND [options]",
        description=DESCRIPTION,
        epilog=EPILOG.format(
            commands="\n".join(f"  {name:<11} {told}" for name, (_, told) in COMMANDS.items())
        ),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"hadr {__version__}")
    if not words:
        parser.print_help()
        return 2
    if words[0].startswith("-"):
        parser.parse_args(words)  # --help and --version leave here
        return 2
    if words[0] not in COMMANDS:
        hint = _nearest(words[0], COMMANDS)
        parser.error(f"there is no command {words[0]!r}{hint}; commands: {', '.join(COMMANDS)}")
    return _run_command(words[0], words[1:])


def command_parser(name: str) -> argparse.ArgumentParser:
    """The parser of one of `COMMANDS`: its help, its errors, and what the book's page is from.

    ModuleNotFoundError where this installation lacks what the command needs.
    """
    module = importlib.import_module(COMMANDS[name][0])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        declared: Any = tyro.extras.get_parser(module.Options, **_tyro_settings())
    parser = _Parser(
        prog=f"hadr {name}",
        description=inspect.getdoc(module.Options),
        epilog=module.EPILOG.strip("\n"),
        formatter_class=_Formatter,
        allow_abbrev=False,
    )
    needed = []
    for group in declared._action_groups:
        actions = [action for action in group._group_actions if action.dest != "help"]
        about = (group.description or "").rstrip(".")
        own = parser.add_argument_group(f"{about[0].lower()}{about[1:]}") if about else parser
        for action in actions:
            added = _add(own, action)
            if added.required:
                metavar: Any = added.metavar
                words = parser._get_formatter()._format_args(added, metavar)
                needed.append("\xa0".join((*added.option_strings[:1], words)))
    usage = textwrap.fill(
        " ".join((parser.prog, *needed, "[options]")), 70, subsequent_indent="    "
    )
    parser.usage = usage.replace("\xa0", " ")
    return parser


def _add(group: argparse._ActionsContainer, declared: Any) -> argparse.Action:
    """Add an option as tyro has declared it, in argparse's own form."""
    told = re.sub(r"\s*\((default:\s*(unset|False)?|required)\)", "", declared.help)
    help_text = " ".join(told.replace("``", "`").split())
    if declared.nargs == 0:
        return group.add_argument(*declared.option_strings, action="store_true", help=help_text)
    named, several = bool(declared.option_strings), declared.nargs in ("*", "+")
    word = re.sub(r"[\[\]]", "", declared.metavar if named else declared.dest.upper()).split()
    metavar: Any = tuple(word) if declared.nargs == 2 else word[0]
    if len(metavar) > 60:  # a choice among so many that argparse would not break the line
        metavar = declared.dest.upper()
        help_text = f"one of {', '.join(declared.choices)}: {help_text}"
    return group.add_argument(
        *(declared.option_strings if named else [declared.dest]),
        nargs="+" if several else None if declared.nargs == 1 else declared.nargs,
        metavar=metavar,
        choices=declared.choices,
        type={"INT": int, "FLOAT": float}.get(word[0], str),
        help=help_text,
        **({"required": declared.required} if named else {}),
    )


def parse_options(name: str, words: Sequence[str]) -> Any:
    """Read what follows ``hadr NAME`` into the command's ``Options``; SystemExit as `main`."""
    parser = command_parser(name)
    for word in words:
        option = word.partition("=")[0]
        if option.startswith("--") and option not in parser._option_string_actions:
            hint = _nearest(option, parser._option_string_actions)
            parser.error(f"there is no option {option!r}{hint}")
    for option, given in vars(parser.parse_args(words)).items():
        for word in given if isinstance(given, list) else [given]:
            if isinstance(word, str) and not word.strip():
                name = option.replace("_", "-")
                parser.error(f"argument --{name}: expected a name or value, got an empty one")
    module = importlib.import_module(COMMANDS[name][0])
    return tyro.cli(module.Options, args=words, **_tyro_settings())


def _tyro_settings() -> dict[str, Any]:
    registry = ConstructorRegistry()
    registry.primitive_rule(_unset_or_value)
    return {"config": (tyro.conf.FlagCreatePairsOff,), "registry": registry}


def _unset_or_value(told: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Any] | None:
    """Read ``T | None`` as a T that may be left out; the word None has no meaning."""
    kinds = get_args(told.type)
    if NoneType not in kinds:
        return None
    value: Any = Union[tuple(kind for kind in kinds if kind is not NoneType)]  # noqa: UP007
    spec = ConstructorRegistry.get_primitive_spec(PrimitiveTypeInfo.make(value, told.markers))
    if not isinstance(spec, PrimitiveConstructorSpec):
        return None
    named = spec.str_from_instance
    return replace(
        spec,
        is_instance=lambda given: given is None or spec.is_instance(given),
        str_from_instance=lambda given: ["unset"] if given is None else named(given),
    )


def _run_command(name: str, words: list[str]) -> int:
    program = f"hadr {name}"
    try:
        module = importlib.import_module(COMMANDS[name][0])
        status: int = module.run(parse_options(name, words))
        return status
    except BrokenPipeError:  # who read what was printed has left; all else was written before
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        return 0
    except KeyboardInterrupt:
        print(f"{program}: interrupted", file=sys.stderr)
        return 130
    except Exception as error:
        named = type(error).__name__ == "OutOfMemoryError"  # PyTorch's; it is not imported here
        short = named or isinstance(error, MemoryError) or "DefaultCPUAllocator" in str(error)
        own = isinstance(error, ImportError) and f"{error.name}.".startswith("hadr.")
        if own or not (isinstance(error, TOLD) or short):
            traceback.print_exc()
            print(
                f"{program}: this is a bug in hadr: please report it with the command and the text "
                "above",
                file=sys.stderr,
            )
            return 1
        full = isinstance(error, OSError) and error.errno in FULL
        told = re.sub(r"^\[Errno \d+\] ", "", str(error))
        if full:
            told = f"the disk is full ({told}); no file is half-written: make room, run it again"
        elif short:
            known = command_parser(name)._option_string_actions
            lower = " or ".join(option for option in NEEDS_LESS if option in known)
            remedy = f"a smaller {lower} needs less" if lower else "free some, run it again"
            told = f"memory ran out ({'. '.join(told.split('. ')[:2])}); {remedy}"
        elif isinstance(error, ModuleNotFoundError) and error.name:
            told = f"this installation lacks the module {error.name!r}"
        sentence = " ".join("; ".join((told, *getattr(error, "__notes__", ()))).split())
        print(f"{program}: error: {sentence}", file=sys.stderr)
        return 1 if full or short else 2


if __name__ == "__main__":
    sys.exit(main())

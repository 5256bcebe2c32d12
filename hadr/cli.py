"""The `hadr` command: a thin face over the library.

Each subcommand lives in a module of its own, imported only when it is called, that offers

* ``Options``, a frozen dataclass: its docstring is the command's description, the string below
  each field is the option's help with its unit;
* ``run(options) -> int``, the exit status;
* ``EPILOG``, if there is more to say below the options: units, files, examples.
"""

from __future__ import annotations

import argparse
import contextlib
import difflib
import importlib
import inspect
import io
import os
import re
import sys
import warnings
from collections.abc import Sequence
from dataclasses import replace
from types import ModuleType, NoneType
from typing import Any, NoReturn, Union, cast, get_args

import tyro
from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

from hadr import __version__

COMMANDS: dict[str, tuple[str, str]] = {
    "restore": (
        "hadr.press.restore_command",
        "restore the depth of a transparent object in one frame",
    ),
    "hand-model": (
        "hadr.models.hand.hand_model_command",
        "make the model that MediaPipe finds hands with",
    ),
    "reproduce": (
        "hadr.press.reproduce",
        "execute the chapters and report beside the paper's tables",
    ),
    "book": ("hadr.press.book", "execute the chapters and build the HTML book"),
    "course": ("hadr.press.course.command", "write student notebooks, solutions and slides"),
    "generate": (
        "hadr.synthesis.generation.command",
        "make a data set of hand-held glass in TransHand's form",
    ),
    "train": ("hadr.training.train_command", "train a network on a data set"),
    "calibrate": ("hadr.training.calibrate", "teach a checkpoint what its confidence means"),
    "handover": (
        "hadr.simulation.trials.command",
        "let a simulated UR5 take glasses from a hand",
    ),
    "evaluate": ("hadr.experiments.evaluate_command", "score networks beside simple methods"),
}

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
      --mask glass.png --out restored

exit status
  0 done   1 failed   2 unusable input or a wrong call   130 interrupted"""


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are one sentence and where to read on."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {message} (see {self.prog} --help)\n")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        argv: Arguments without the program's name; None takes the process's own.

    Returns:
        Exit status: 0 done, 1 failed, 2 unusable input, 130 interrupted.

    Raises:
        SystemExit: After --help and --version (status 0) and wrong calls (status 2).
    """
    # Before a library starts its threads: see `hadr.press.private_kernel`.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    words = list(sys.argv[1:] if argv is None else argv)
    parser = _Parser(
        prog="hadr",
        usage="hadr COMMAND [options]",
        description=DESCRIPTION,
        epilog=EPILOG.format(commands=_command_list()),
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
        similar = difflib.get_close_matches(words[0], COMMANDS, n=1)
        hint = f"; did you mean {similar[0]!r}?" if similar else ""
        parser.error(f"there is no command {words[0]!r}{hint} Commands: {', '.join(COMMANDS)}")
    return _run_command(words[0], words[1:])


def command_parser(name: str) -> argparse.ArgumentParser:
    """The parser of one command, for documentation.

    Args:
        name: A key of ``COMMANDS``.

    Returns:
        A parser with the options that ``hadr NAME --help`` prints.

    Raises:
        ModuleNotFoundError: This installation lacks what the command needs.
    """
    module = importlib.import_module(COMMANDS[name][0])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        documented: Any = tyro.extras.get_parser(module.Options, **_tyro_settings(name))
    documented.description, documented.epilog = _description(module), _epilog(module)
    for action in documented._actions:  # its help tells the default, its metavar the count
        action.default = argparse.SUPPRESS
        action.nargs = None if action.nargs != 0 else 0
    return cast("argparse.ArgumentParser", documented)


def parse_options(name: str, words: Sequence[str]) -> Any:
    """Read one command's words; in its help, what is unset or off by default has no default.

    Args:
        name: A key of ``COMMANDS``.
        words: What follows ``hadr NAME``.

    Returns:
        What the command's `run` takes: its ``Options``.

    Raises:
        SystemExit: After --help (status 0) and wrong calls (status 2).
        ModuleNotFoundError: This installation lacks what the command needs.
    """
    module = importlib.import_module(COMMANDS[name][0])
    shown, wrong = io.StringIO(), io.StringIO()
    try:
        with contextlib.redirect_stdout(shown), contextlib.redirect_stderr(wrong):
            return tyro.cli(module.Options, args=words, **_tyro_settings(name))
    except SystemExit as left:
        told = wrong if left.code else shown  # tyro would run the description's lines together
        text = re.sub(r"\s*\(default:\s*(unset|False)?\)", "", told.getvalue())
        for line in text.splitlines():
            line = line.replace(_DESCRIPTION, _description(module)).rstrip()
            print(line, file=sys.stderr if left.code else sys.stdout)
        if not left.code:
            print(_epilog(module))
        raise


_DESCRIPTION = "<description>"


def _tyro_settings(name: str) -> dict[str, Any]:
    registry = ConstructorRegistry()
    registry.primitive_rule(_unset_or_value)
    return {
        "prog": f"hadr {name}",
        "description": _DESCRIPTION,
        "config": (tyro.conf.FlagCreatePairsOff, tyro.conf.PositionalMetavarFromFieldName),
        "registry": registry,
    }


def _description(module: ModuleType) -> str:
    return inspect.getdoc(module.Options) or ""


def _epilog(module: ModuleType) -> str:
    return str(getattr(module, "EPILOG", "")).strip("\n")


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
    except ModuleNotFoundError as error:
        print(
            f"{program}: error: this installation lacks the module {error.name!r}", file=sys.stderr
        )
        return 2
    options = parse_options(name, words)
    try:
        status: int = module.run(options)
        return status
    except (ValueError, OSError, FloatingPointError) as error:
        sentence = " ".join(str(error).split())
        print(f"{program}: error: {sentence}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"{program}: interrupted", file=sys.stderr)
        return 130


def _command_list() -> str:
    return "\n".join(f"  {name:<11} {summary}" for name, (_, summary) in COMMANDS.items())


if __name__ == "__main__":
    sys.exit(main())

"""Call a function in a child process: what ends that process ends nothing else."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

Result = TypeVar("Result")


def call_in_child(
    function: Callable[..., Result],
    *args: Any,
    timeout: float,
    environment: Mapping[str, str] | None = None,
) -> Result:
    """Call a function in a Python process of its own, and give what it returns.

    The child imports from where this Python does, but never from the current folder.

    Args:
        function: A function of a module, not of a notebook; its arguments and its result travel
            between processes.
        *args: Its arguments.
        timeout: Seconds until the child is ended.
        environment: Variables that are other in the child.

    Raises:
        ChildProcessError: The child died; the message names the signal, or what it said last.
        TimeoutError: It took longer than ``timeout``.
        Exception: What the function raised.
    """
    # This package is found behind what the user names, and before other installations of it. An
    # empty name, such as OpenCV leaves behind, would stand for the current folder.
    home = str(Path(__file__).resolve().parents[3])
    folders = {
        name: os.pathsep.join(filter(None, [*os.environ.get(name, "").split(os.pathsep), last]))
        for name, last in (("PYTHONPATH", home), ("LD_LIBRARY_PATH", ""))
    }
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-m", __name__],
            input=pickle.dumps((function, args)),
            capture_output=True,
            timeout=timeout,
            check=False,
            env={**os.environ, **folders, **(environment or {})},
        )
    except subprocess.TimeoutExpired as error:
        raise TimeoutError(f"it took longer than {timeout:g} s") from error
    if done.returncode or not done.stdout:
        raise ChildProcessError(_cause_of_death(done.returncode, done.stderr))
    returned, result = pickle.loads(done.stdout)
    if not returned:
        raise result
    return result  # type: ignore[no-any-return]


def _cause_of_death(status: int, errors: bytes) -> str:
    """How a process ended, with the telling line of what it wrote."""
    lines = [line.strip() for line in errors.decode(errors="replace").splitlines() if line.strip()]
    if status >= 0:  # a traceback's last line
        said, ended = lines[-1:], f"ended with status {status}"
    else:  # before it died a library complained, at length
        said, ended = lines[:1], f"ended by {_signal_name(-status)}"
    return f"its process was {ended}" + "".join(f" ({line[:160]})" for line in said)


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def _answer() -> None:
    """The child's side: what to call comes in by stdin, what comes of it leaves by stdout."""
    with os.fdopen(os.dup(1), "wb") as out:
        os.dup2(2, 1)  # what a library prints is no answer
        function, args = pickle.load(sys.stdin.buffer)
        try:
            answer = True, function(*args)
        except Exception as error:
            answer = False, error
        pickle.dump(answer, out)


if __name__ == "__main__":
    _answer()

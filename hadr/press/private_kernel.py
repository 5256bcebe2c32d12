"""Notebooks on a Jupyter kernel of this very Python, out of reach of a user's settings."""

import contextlib
import json
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import patch

_RUNNING: set[Any] = set()  # nbclient's clients


@contextlib.contextmanager
def private_jupyter(folder: Path) -> Iterator[None]:
    """Keep a user's kernels, start-up files and caches out, and need no writable HOME."""
    kernel = folder / "jupyter" / "kernels" / "python3"
    kernel.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}",
               "--log-level=CRITICAL"]  # fmt: skip
    specification = {"argv": command, "display_name": "Python 3", "language": "python"}
    (kernel / "kernel.json").write_text(json.dumps(specification), encoding="utf-8")
    changes = {
        "JUPYTER_PATH": str(folder / "jupyter"),
        "JUPYTER_CONFIG_DIR": str(folder / "jupyter" / "config"),
        "JUPYTER_RUNTIME_DIR": str(folder / "jupyter" / "runtime"),
        "JUPYTER_PLATFORM_DIRS": "1",
        "IPYTHONDIR": str(folder / "ipython"),
        "MPLCONFIGDIR": str(folder / "matplotlib"),
        "PYDEVD_DISABLE_FILE_VALIDATION": "1",
        # Beside other work, threads that spin keep the processor from those they wait for: two
        # epochs of preset tiny beside four busy loops on two cores took 145 s, and 18 s so.
        "OMP_WAIT_POLICY": os.environ.get("OMP_WAIT_POLICY", "PASSIVE"),
    }
    with patch.dict(os.environ, changes):
        os.environ.pop("MPLBACKEND", None)
        yield


def register_engine() -> str:
    """Register a papermill engine that never waits in vain for a widget's cell; gives its name.

    nbclient's stand-in for an output widget writes to the socket on which the reply of the cell is
    awaited, and the reply that comes meanwhile may go unnoticed: measured on 400 cells, 0.70 s a
    cell instead of 0.02, and on a busy machine sometimes for ever. Without the stand-in, what a
    widget's function draws is output of its cell.
    """
    from papermill.clientwrap import PapermillNotebookClient
    from papermill.engines import Engine, papermill_engines

    class Client(PapermillNotebookClient):  # type: ignore[misc]
        def on_comm_open_jupyter_widget(self, msg: dict[str, Any]) -> None:
            """No stand-in for any widget."""

    class WidgetsApart(Engine):  # type: ignore[misc]
        @classmethod
        def execute_managed_notebook(
            cls, nb_man: Any, kernel_name: str, *, execution_timeout: int, **_: Any
        ) -> None:
            client = Client(nb_man, kernel_name=kernel_name, timeout=execution_timeout)
            _RUNNING.add(client)
            try:
                client.execute()
            finally:
                _RUNNING.discard(client)

    papermill_engines.register("hadr", WidgetsApart)
    return "hadr"


def end_kernels() -> None:
    """End all kernels under way; their notebooks fail with "the kernel died"."""
    for client in tuple(_RUNNING):
        with contextlib.suppress(AttributeError, TypeError, ProcessLookupError):  # not there
            os.kill(client.km.provisioner.pid, signal.SIGKILL)

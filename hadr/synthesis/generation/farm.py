"""Many tasks on one machine or on a cluster: Dask, and none of it where one process will do."""

from __future__ import annotations

import importlib.util
import logging
import re
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

#: Seconds to wait for a cluster.
PATIENCE = 20.0

_WORKER_ENVIRONMENT = "distributed.nanny.pre-spawn-environ"
#: What Dask sets besides, a fixed MALLOC_TRIM_THRESHOLD_, hands each large array back to the
#: system at once; getting it again then costs as much time as the work itself.
_ONE_THREAD = {"OMP_NUM_THREADS": 1, "MKL_NUM_THREADS": 1, "OPENBLAS_NUM_THREADS": 1}

Task = TypeVar("Task")
Result = TypeVar("Result")


def dask_installed() -> bool:
    """Whether tasks can be spread over processes."""
    return importlib.util.find_spec("distributed") is not None


MOST_WORKERS = 1024
"""Processes of one machine."""


def check_workers(workers: int, scheduler: str | None = None) -> None:
    """Check that so many processes, or a cluster, can work; a ``ValueError`` says why not."""
    if not 1 <= workers <= MOST_WORKERS:
        raise ValueError(f"workers must be from 1 to {MOST_WORKERS}, got {workers}")
    if scheduler is not None and workers > 1:
        raise ValueError(
            f"{workers} workers of this machine or the cluster at {scheduler}: give one of both"
        )
    if (workers > 1 or scheduler is not None) and not dask_installed():
        raise ValueError(
            f"{workers} workers need Dask, which is not installed: pip install 'hadr[generate]', "
            "or choose --workers 1"
            if scheduler is None
            else "a cluster needs Dask, which is not installed: pip install 'hadr[generate]'"
        )
    script = getattr(sys.modules["__main__"], "__file__", None)
    if workers > 1 and script and Path(script).suffix == ".py":
        with suppress(OSError):
            if b"__main__" not in Path(script).read_bytes():
                raise ValueError(
                    f"each of {workers} workers runs {script} from its top: put what it does under "
                    '`if __name__ == "__main__":`, or choose 1 worker'
                )


@contextmanager
def connected(scheduler: str | None) -> Iterator[Any]:
    """Stay connected to a running Dask cluster, where there is an address; yields its client."""
    if scheduler is None:
        yield None
        return
    from distributed import Client

    try:
        client = Client(scheduler, timeout=PATIENCE)
    except (OSError, ValueError) as error:
        raise OSError(f"no Dask scheduler answers at {scheduler}: {error}") from error
    with client:
        yield client


def run_tasks(
    function: Callable[[Task], Result],
    tasks: Sequence[Task],
    *,
    workers: int = 1,
    client: Any = None,
) -> Iterator[Result]:
    """Carry out a function on each task, and give the results as they become ready.

    Function and results travel between ``workers`` processes of this machine, checked before; one
    is this process, without Dask. The ``client`` of a cluster (:func:`connected`) takes the tasks
    instead; its workers need the same version of this package, and see the same files.

    Raises:
        ChildProcessError: Workers died over a task; the message names the last one and the reason.
    """
    if client is None and (workers == 1 or len(tasks) < 2):
        yield from map(function, tasks)
        return
    import dask
    from distributed import Client, KilledWorker, LocalCluster, as_completed

    with ExitStack() as stack:
        if client is None:
            stack.enter_context(dask.config.set({_WORKER_ENVIRONMENT: _ONE_THREAD}))
            cluster = LocalCluster(
                n_workers=min(workers, len(tasks)),
                threads_per_worker=1,
                processes=True,
                memory_limit=0,
                host="127.0.0.1",
                # No dashboard; what is left of its server takes any port, and no other host's word.
                dashboard_address=None,
                scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
                silence_logs=logging.CRITICAL,
            )
            client = stack.enter_context(Client(stack.enter_context(cluster)))
        futures = client.map(function, list(tasks), pure=False, retries=1)
        try:
            for future in as_completed(futures):
                yield future.result()
                future.release()
        except KilledWorker as error:
            raise ChildProcessError(_obituary(client, error)) from error


def _obituary(client: Any, error: Any) -> str:
    """Which worker died, and what the process that watched it noted of its end."""
    address, deaths = error.last_worker.address, error.allowed_failures + 1
    host, ends = address.rpartition(":")[0], list[str]()
    deadline = time.monotonic() + PATIENCE
    while not ends and time.monotonic() < deadline:
        time.sleep(0.2)  # it is asked through the dead one's successor
        with suppress(Exception):
            logs = client.get_worker_logs(nanny=True)
            lines = sorted(line for name in logs if name.startswith(host) for _, line in logs[name])
            ends = re.findall(r"Worker process \d+ (.*)", "\n".join(lines))  # the last one last
    reason = f"its process {ends[-1]}" if ends else "what watched it says nothing of the reason"
    return f"workers died over one task ({deaths} of them), the last at {address}: {reason}"

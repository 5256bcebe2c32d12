"""Many tasks on one machine or on a cluster: Dask, and none of it where one process will do."""

from __future__ import annotations

import importlib.util
import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from typing import TypeVar

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


def run_tasks(
    function: Callable[[Task], Result],
    tasks: Sequence[Task],
    *,
    workers: int = 1,
    scheduler: str | None = None,
) -> Iterator[Result]:
    """Carry out a function on each task, and give the results as they come in.

    Args:
        function: What to do; it and its results travel between processes.
        tasks: One argument each. Which worker takes which is left open.
        workers: Processes on this machine; one works in this process, without Dask.
        scheduler: Address of a running Dask cluster (``tcp://host:8786``) that takes the tasks
            instead. Its workers need the same version of this package and must see the same
            files under the same names.

    Yields:
        The results, in the order in which they are ready.

    Raises:
        ValueError: Dask is needed and not installed, or ``workers`` is not positive.
        OSError: The cluster does not answer.
    """
    if workers < 1:
        raise ValueError(f"workers must be positive, got {workers}")
    if scheduler is None and (workers == 1 or len(tasks) < 2):
        yield from map(function, tasks)
        return
    if not dask_installed():
        raise ValueError(
            f"{workers} workers need Dask, which is not installed: pip install 'hadr[generate]', "
            "or choose --workers 1"
            if scheduler is None
            else "a cluster needs Dask, which is not installed: pip install 'hadr[generate]'"
        )
    import dask
    from distributed import Client, LocalCluster, as_completed

    with ExitStack() as stack:
        if scheduler is None:
            stack.enter_context(dask.config.set({_WORKER_ENVIRONMENT: _ONE_THREAD}))
            cluster = LocalCluster(
                n_workers=min(workers, len(tasks)),
                threads_per_worker=1,
                processes=True,
                memory_limit=0,
                dashboard_address=":0",
                silence_logs=logging.CRITICAL,
            )
            client = Client(stack.enter_context(cluster))
        else:
            try:
                client = Client(scheduler, timeout=PATIENCE)
            except (OSError, ValueError) as error:
                raise OSError(f"no Dask scheduler answers at {scheduler}: {error}") from error
        stack.enter_context(client)
        futures = client.map(function, list(tasks), pure=False, retries=1)
        for future in as_completed(futures):
            yield future.result()
            future.release()

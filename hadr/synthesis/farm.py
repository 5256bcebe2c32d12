"""Many tasks on one machine or on a cluster: Dask, and none of it where one process will do."""

from __future__ import annotations

import importlib.util
import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
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


def check_workers(workers: int, scheduler: str | None = None) -> None:
    """Check that there can be so many workers, before anything is done.

    Args:
        workers: Processes on this machine.
        scheduler: Address of a Dask cluster that takes the tasks instead, or None.

    Raises:
        ValueError: ``workers`` is not positive, both are asked for, or Dask is not installed.
    """
    if workers < 1:
        raise ValueError(f"workers must be at least 1, got {workers}")
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


@contextmanager
def connected(scheduler: str | None) -> Iterator[Any]:
    """Stay connected to a running Dask cluster.

    Args:
        scheduler: Its address (``tcp://host:8786``), or None for no cluster.

    Yields:
        The client of the cluster, or None.

    Raises:
        ValueError: Dask is not installed.
        OSError: The cluster does not answer.
    """
    check_workers(1, scheduler)
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
    """Carry out a function on each task, and give the results as they come in.

    Args:
        function: What to do; it and its results travel between processes.
        tasks: One argument each. Which worker takes which is left open.
        workers: Processes on this machine; one works in this process, without Dask.
        client: Of a running Dask cluster (:func:`connected`) that takes the tasks instead. Its
            workers need the same version of this package and must see the same files under the
            same names.

    Yields:
        The results, in the order in which they are ready.

    Raises:
        ValueError: Dask is needed and not installed, or ``workers`` is not positive.
    """
    check_workers(workers)
    if client is None and (workers == 1 or len(tasks) < 2):
        yield from map(function, tasks)
        return
    import dask
    from distributed import Client, LocalCluster, as_completed

    with ExitStack() as stack:
        if client is None:
            stack.enter_context(dask.config.set({_WORKER_ENVIRONMENT: _ONE_THREAD}))
            cluster = LocalCluster(
                n_workers=min(workers, len(tasks)),
                threads_per_worker=1,
                processes=True,
                memory_limit=0,
                dashboard_address=":0",
                silence_logs=logging.CRITICAL,
            )
            client = stack.enter_context(Client(stack.enter_context(cluster)))
        futures = client.map(function, list(tasks), pure=False, retries=1)
        for future in as_completed(futures):
            yield future.result()
            future.release()

"""Tasks in several processes, one thread for a library, and the end of a process without parent."""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypeVar

Task = TypeVar("Task")
Result = TypeVar("Result")
MOST_WORKERS = 61
"""Processes at a time: Windows waits for no more."""


def check_workers(workers: int) -> None:
    """Check that so many processes can work; ValueError says why not."""
    if not 1 <= workers <= MOST_WORKERS:
        raise ValueError(f"workers must be from 1 to {MOST_WORKERS}, got {workers}")
    script = getattr(sys.modules["__main__"], "__file__", None)
    if workers > 1 and script and Path(script).suffix == ".py":
        with suppress(OSError):
            if b"__main__" not in Path(script).read_bytes():
                raise ValueError(
                    f"each of {workers} workers runs {script} from its top: put what it does under "
                    '`if __name__ == "__main__":`, or choose 1 worker'
                )


def run_tasks(
    function: Callable[[Task], Result], tasks: Sequence[Task], workers: int = 1
) -> Generator[tuple[int, Result]]:
    """Carry out a function on each task, and give each one's number and result as it is ready.

    One worker is this process. Several are spawned: forked ones would inherit PyTorch's threads.
    They end with this process, and as soon as the results are no longer waited for.

    Raises:
        ChildProcessError: A worker died; the message names the signal or exit status.
    """
    if min(workers, len(tasks)) < 2:
        yield from enumerate(map(function, tasks))
        return
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(min(workers, len(tasks)), context, _begin_worker)
    processes = []
    try:
        with _interrupts_wait():
            under_way = {pool.submit(function, task): n for n, task in enumerate(tasks)}
            processes = list(pool._processes.values())
        for future in as_completed(under_way):
            yield under_way[future], future.result()
    except BrokenProcessPool as error:
        pool.shutdown(wait=True)  # it ends the others, and knows all exit codes then
        ends = {process.exitcode or 0 for process in processes} - {0, -signal.SIGTERM}
        how = ", ".join(signal.Signals(-e).name if e < 0 else f"exit status {e}" for e in ends)
        raise ChildProcessError(
            f"a worker process died ({how or 'of an unknown reason'}); SIGKILL often means that "
            "memory ran out: fewer workers need less"
        ) from error
    except BaseException:
        for process in processes:
            process.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _interrupts_wait() -> Iterator[None]:
    """Put Ctrl-C off; a process that is started meanwhile never hears of it."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin_worker() -> None:
    """Make a process ready for tasks: Ctrl-C is its parent's business, and it ends with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()


#: How many want a library at one thread just now, and how many threads it had before.
_USERS: dict[Callable[[int], object], tuple[int, int]] = {}
_COUNTING = threading.Lock()


@contextmanager
def one_thread(count: Callable[[], int], set_count: Callable[[int], object]) -> Iterator[None]:
    """Keep a library to one thread, and give it back those that it had when the last user is done.

    ``count`` says how many threads the library has, ``set_count`` gives it so many.
    """
    with _COUNTING:
        users, before = _USERS.get(set_count) or (0, count())
        _USERS[set_count] = users + 1, before
        set_count(1)
    try:
        yield
    finally:
        with _COUNTING:
            users, before = _USERS.pop(set_count)
            if users > 1:
                _USERS[set_count] = users - 1, before
            else:
                set_count(before)


def end_with_parent() -> None:
    """End this process, which another one has started, as soon as that is gone."""
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()

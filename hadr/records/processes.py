"""One thread for a library, and the end of a process whose parent is gone."""

import multiprocessing
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

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

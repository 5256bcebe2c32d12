"""Tasks in this process and in several; threads of a library."""

import os
import re
import subprocess
import sys
from functools import partial

import pytest

from hadr.records.processes import check_workers, one_thread, run_tasks


def test_one_worker_is_this_process_and_results_come_one_by_one():
    found = list(run_tasks(lambda n: (n * n, os.getpid()), [1, 2, 3]))
    assert found == [(0, (1, os.getpid())), (1, (4, os.getpid())), (2, (9, os.getpid()))]
    assert list(run_tasks(abs, [], workers=2)) == []
    started = []
    next(run_tasks(started.append, [1, 2, 3]))
    assert started == [1]


def test_several_workers_are_others_and_their_results_keep_their_numbers():
    assert sorted(run_tasks(abs, [-3, 2, -1], workers=2)) == [(0, 3), (1, 2), (2, 1)]
    pids = {pid for _, pid in run_tasks(partial(_pid_of, os.getpid()), [0, 1], workers=2)}
    assert os.getpid() not in pids
    with pytest.raises(ValueError, match=r"expected a nonnegative input, got -4\.0"):
        list(run_tasks(_root, [4.0, -4.0], workers=2))


def _pid_of(parent, _):
    assert os.getppid() == parent
    return os.getpid()


def _root(value):
    if value < 0:
        raise ValueError(f"expected a nonnegative input, got {value}")
    return value**0.5


def test_a_worker_that_dies_is_an_error_that_says_how():
    with pytest.raises(ChildProcessError, match=r"a worker process died \(SIGABRT\)"):
        list(run_tasks(_abort, [0, 1], workers=2))
    with pytest.raises(ChildProcessError, match=r"a worker process died \(exit status 3\)"):
        list(run_tasks(os._exit, [3, 3], workers=2))


def _abort(_):
    os.abort()


def test_the_number_of_workers_is_checked():
    for number in (0, 62):
        with pytest.raises(ValueError, match=f"workers must be from 1 to 61, got {number}"):
            check_workers(number)
    check_workers(61)


def test_a_script_without_a_guard_is_refused_in_one_sentence(tmp_path):
    script = tmp_path / "mine.py"
    for guard, status in (("if True", 1), ('if __name__ == "__main__"', 0)):
        script.write_text(f"from hadr.records.processes import check_workers as f\n{guard}: f(2)\n")
        done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False)
        assert done.returncode == status, done.stderr
        assert bool(re.search(rf"runs {script} from its top", done.stderr)) == bool(status)


def test_a_library_gets_back_the_threads_that_it_had():
    threads = [4]
    count, set_count = (lambda: threads[-1]), threads.append

    def work():
        with one_thread(count, set_count):
            assert threads[-1] == 1
            raise ValueError("it ends badly")

    with pytest.raises(ValueError, match="badly"):
        work()
    assert threads == [4, 1, 4]
    # As in two threads of a worker: who ends first is not alone.
    first, second = one_thread(count, set_count), one_thread(count, set_count)
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    assert threads[-1] == 1
    second.__exit__(None, None, None)
    assert threads[-1] == 4

"""Tasks in this process, in several, on a cluster by its address."""

import importlib.util
import os
import subprocess
import sys
import time

import psutil
import pytest

from hadr.records.processes import one_thread
from hadr.synthesis.generation.farm import check_workers, connected, run_tasks

needs_dask = pytest.mark.skipif(
    importlib.util.find_spec("distributed") is None,
    reason="Dask is not installed: pip install 'hadr[generate]'",
)


def test_one_worker_needs_no_dask(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert list(run_tasks(lambda n: (n * n, os.getpid()), [1, 2, 3])) == [
        (n, os.getpid()) for n in (1, 4, 9)
    ]
    assert list(run_tasks(abs, [])) == []


def test_results_come_one_by_one():
    started = []
    results = run_tasks(started.append, [1, 2, 3])
    next(results)
    assert started == [1]


def test_what_is_missing_is_named(monkeypatch):
    monkeypatch.setattr("hadr.synthesis.generation.farm.dask_installed", lambda: False)
    with pytest.raises(ValueError, match=r"2 workers need Dask.*hadr\[generate\].*--workers 1"):
        check_workers(2)
    with pytest.raises(ValueError, match=r"a cluster needs Dask.*pip install"):
        check_workers(1, "tcp://host:1")
    with pytest.raises(ValueError, match="workers must be from 1 to 1024, got 0"):
        check_workers(0)


@needs_dask
def test_a_cluster_by_its_address_and_the_error_of_a_task():
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None
    ) as cluster:
        address = cluster.scheduler_address
        with connected(address) as client:
            assert sorted(run_tasks(abs, [-3, 2, -1], client=client)) == [1, 2, 3]
            with pytest.raises(ValueError, match="expected a nonnegative input"):
                list(run_tasks(_root, [4.0, -4.0], client=client))


def _root(value):
    if value < 0:
        raise ValueError(f"expected a nonnegative input, got {value}")
    return value**0.5


@needs_dask
def test_a_worker_that_dies_is_named_and_nobody_else_can_reach_the_cluster(tmp_path):
    import dask

    go_on = tmp_path / "go on"

    def die_later(number):
        while number and not go_on.exists():
            time.sleep(0.05)
        return os.abort() if number else number

    with dask.config.set({"distributed.scheduler.allowed-failures": 0}):
        results = run_tasks(die_later, [0, 1], workers=2)
        assert next(results) == 0
        ours = [psutil.Process(), *psutil.Process().children(recursive=True)]
        sockets = [s for process in ours for s in process.net_connections("tcp")]
        assert {s.laddr.ip for s in sockets if s.status == psutil.CONN_LISTEN} == {"127.0.0.1"}
        go_on.touch()
        message = r"workers died over one task.* at tcp://127\.0\.0\.1:\d+: .*killed by signal 6"
        with pytest.raises(ChildProcessError, match=message):
            next(results)


@needs_dask
def test_a_script_without_a_guard_is_refused_in_one_sentence(tmp_path):
    script = tmp_path / "mine.py"
    for guard, status in (("if True", 1), ('if __name__ == "__main__"', 0)):
        script.write_text(
            f"from hadr.synthesis.generation.farm import check_workers as f\n{guard}: f(2)\n"
        )
        done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False)
        assert done.returncode == status, done.stderr
        assert ("runs " + str(script) + " from its top" in done.stderr) == bool(status)


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

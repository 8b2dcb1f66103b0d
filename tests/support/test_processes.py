"""Pools of processes: shared arguments, and the end of workers with their command."""

import subprocess
import sys
import time

import psutil
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from bgmodel.support.processes import processes, shared_map

LONG = """
import os, sys, time
from bgmodel.support.processes import processes

def work(path):
    open(path, "w").write(str(os.getpid()))
    time.sleep(3600)

if __name__ == "__main__":
    with processes(1) as pool:
        pool.submit(work, sys.argv[1]).result()
"""
held: list[object] = []


def hold(*values):
    held.extend(values)


def what_is_held(_):
    return list(held)


def test_each_process_receives_what_is_held_once():
    with processes(1, hold, (1, "two")) as pool:
        assert list(pool.map(what_is_held, range(3))) == [[1, "two"]] * 3


def plus(held, first, second):
    return held, first + second


@pytest.mark.parametrize("workers", [1, 2])
def test_a_map_gives_results_in_order_whatever_the_number_of_processes(workers):
    with shared_map(workers, "held") as each:
        assert each(plus, [(k, 1) for k in range(5)]) == [("held", k + 1) for k in range(5)]


def blas_threads(_):
    return [each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"]


@pytest.mark.parametrize("workers", [1, 2])
def test_linear_algebra_uses_one_thread_whatever_the_number_of_processes(workers):
    with threadpool_limits(2, user_api="blas"):
        assert max(blas_threads(None)) == 2
        with shared_map(workers, None) as over:
            assert set(over(blas_threads, [()])[0]) == {1}


def test_no_process_outlives_a_command_that_was_killed(tmp_path):
    (tmp_path / "long.py").write_text(LONG)
    written = tmp_path / "pid"
    with subprocess.Popen([sys.executable, tmp_path / "long.py", written]) as command:
        while not (written.exists() and written.read_text()):
            assert command.poll() is None
            time.sleep(0.05)
        worker = psutil.Process(int(written.read_text()))
        command.kill()
    try:
        worker.wait(300)
    except psutil.TimeoutExpired:
        worker.kill()
        pytest.fail("the worker outlived its command")

"""Pools of processes: shared arguments, and the end of workers with their command."""

import os
import subprocess
import sys
import time

import psutil
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from bgmodel.support.processes import processes, shared_map
from tests.helpers import ROOT

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
UNGUARDED = """
from bgmodel.task import Gaussian
from bgmodel.support.processes import processes
from bgmodel.sweeps.plan import Plan
from bgmodel.sweeps.sweep import Sweep

task = Gaussian(trials=20, t_max=5)
plan = Plan(task=task, engine="algebra", gain=0.7, grid={"task.d_prime": (0.4, 0.8)})
RUN
"""
RUNS = {
    "pool": "with processes(2) as pool: pool.submit(print).result()",
    "sweep": "Sweep(plan).run('out', workers=2)",
}
held: list[object] = []


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


def test_linear_algebra_uses_one_thread_until_the_last_of_overlapping_maps_ends():
    with threadpool_limits(2, user_api="blas"):
        first, second = shared_map(1, None), shared_map(1, None)
        first.__enter__()
        over = second.__enter__()
        first.__exit__(None, None, None)  # as in another thread
        assert set(over(blas_threads, [()])[0]) == {1}
        second.__exit__(None, None, None)
        assert max(blas_threads(None)) == 2


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


@pytest.mark.parametrize("call", RUNS)
def test_a_script_without_a_guard_gets_one_sentence(tmp_path, call):
    script = tmp_path / "run.py"
    script.write_text(UNGUARDED.replace("RUN", RUNS[call]))
    done = subprocess.run(
        [sys.executable, script],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1
    assert done.stderr.count("Traceback") == 1
    assert "InputError: workers must be 1 in a script without" in done.stderr.splitlines()[-1]
    assert not list(tmp_path.rglob("*.parquet"))


def killed(_):
    os._exit(1)


def test_a_worker_that_is_killed_is_said_in_one_sentence():
    with pytest.raises(ValueError, match="killed") as error, processes(1) as pool:
        pool.submit(killed, None).result()
    assert error.value.__suppress_context__

"""Pools of processes: shared arguments, memory, who listens, and the end of workers."""

import os
import subprocess
import sys
import time
from types import SimpleNamespace

import numpy as np
import psutil
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from bgmodel.integrators.at_thresholds import decide_at_thresholds
from bgmodel.integrators.basal_ganglia import BATCH, BasalGanglia
from bgmodel.support.files import read_table
from bgmodel.support.processes import (
    CELL_BYTES,
    NoMemoryError,
    advance,
    check_evidence_memory,
    check_learning_memory,
    check_memory,
    processes,
    shared_map,
    shown_by,
)
from bgmodel.trials.evidence_table import read_evidence_table
from bgmodel.trials.reader import read_trials
from circuits.anatomy import load_circuit
from tests.helpers import some_evidence

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


def killed(_):
    os._exit(1)


def test_a_worker_that_is_killed_is_said_in_one_sentence():
    with pytest.raises(ValueError, match="killed") as error, processes(1) as pool:
        pool.submit(killed, None).result()
    assert error.value.__suppress_context__


@pytest.fixture
def free(monkeypatch):
    """Return a function that sets how many bytes are free."""

    def set_free(count):
        monkeypatch.setattr("psutil.virtual_memory", lambda: SimpleNamespace(available=count))

    return set_free


def test_less_than_100_mb_is_never_refused(free):
    free(0)
    check_memory(0.99e8, "trials")
    with pytest.raises(NoMemoryError, match=r"^trials need 100 MB of memory, 0 bytes are free$"):
        check_memory(1e8, "trials")


@pytest.mark.parametrize(
    ("check", "shape", "needed"),
    [
        # Numbers of eight bytes: four of each reading, ten of each episode.
        (check_evidence_memory, (1000, 1000, 4), 4 * 8 * 4_000_000),
        (check_learning_memory, (30, 50_000), 10 * 8 * 1_500_000),
    ],
)
def test_memory_that_is_just_enough_is_allowed(free, check, shape, needed):
    free(needed)
    check(*shape)
    free(needed - 1)
    with pytest.raises(NoMemoryError, match=f"need {needed / 1e6:.0f} MB of memory"):
        check(*shape)


@pytest.mark.parametrize("read", [read_table, read_evidence_table, read_trials])
@pytest.mark.parametrize("ending", [".parquet", ".csv"])
def test_a_table_that_does_not_fit_is_refused_before_it_is_read(
    free, tmp_path, monkeypatch, read, ending
):
    rows, columns = 2_000_000, ("trial", "step", "ll_a", "ll_b")
    path = tmp_path / f"big{ending}"
    if ending == ".csv":
        needed = 200_000_000
        with path.open("wb") as stream:
            stream.truncate(needed // 2)
    else:
        needed = CELL_BYTES * rows * len(columns)
        pq.write_table(pa.table({name: pa.nulls(rows) for name in columns}), path)

    def taken(*arguments, **more):
        raise KeyboardInterrupt

    for reader in ("pandas.read_parquet", "pandas.read_csv"):
        monkeypatch.setattr(reader, taken)
    free(needed - 1)
    with pytest.raises(NoMemoryError, match=r"'big\..* need .* of memory"):
        read(path)
    if read is read_table:
        free(needed)
        with pytest.raises(KeyboardInterrupt):
            read(path)


def test_every_part_of_the_trials_is_heard_of_once():
    evidence = some_evidence(trials=BATCH + 30, steps=4, hypotheses=2)
    heard = []
    with shown_by(heard.append):
        decide_at_thresholds(
            BasalGanglia(load_circuit("bogacz_gurney"), "algebra"), evidence, np.array([0.3])
        )
    assert heard == [BATCH, 30]
    advance(5)
    assert heard == [BATCH, 30]


def test_the_innermost_listener_hears_alone():
    outer, inner = [], []
    with shown_by(outer.append):
        with shown_by(inner.append):
            advance(2)
        advance(3)
    assert (outer, inner) == ([3], [2])

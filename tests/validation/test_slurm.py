"""Jobs of SLURM killed half-way, on a node that is drained: the bytes are those of this machine."""

import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager

import pytest

from tests.helpers import ROOT, run
from tests.validation import slurm

pytestmark = pytest.mark.validate
SWEEP = """
name = "a small sweep"
circuit = "macaque"
engine = "population"
[task]
trials = 1500
t_max = 30
[grid]
"lesion STN" = [0.0, 0.1]
posterior = [0.7, 0.8, 0.9]
"""
WAIT_S = 400


@pytest.fixture(scope="module")
def cluster():
    """Start a SLURM of one node; yield its environment."""
    if sentence := slurm.missing():
        pytest.skip(sentence)
    with slurm.one_node() as environment:
        yield environment


@pytest.fixture(scope="module")
def ask(cluster):
    """Return a function that runs one of SLURM's commands and returns what it printed."""

    def asked(*command):
        options = {"env": cluster, "capture_output": True, "text": True, "check": True}
        return subprocess.run(command, **options).stdout.strip()

    return asked


def until(condition, what):
    """Wait until a condition holds; return its value."""
    end = time.monotonic() + WAIT_S
    while not (value := condition()):
        assert time.monotonic() < end, f"waited in vain for {what}"
        time.sleep(0.1)
    return value


def times(folder):
    """Return the time of writing of every whole shard, ns, by name."""
    return {p.name: p.stat().st_mtime_ns for p in (folder / "shards").glob("[!.]*.parquet")}


def outcome(folder):
    return {path.name: path.read_bytes() for path in folder.glob("outcome*")}


@pytest.fixture
def file(tmp_path):
    """Write a sweep; its name would be more than a name to a shell."""
    path = tmp_path / "a 'small' $(sweep).toml"
    path.write_text(SWEEP)
    return path


def hear_interrupts():
    """Undo that a shell has SIGINT ignored in what it runs in the background."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@contextmanager
def submitted(cluster, file, folder, log):
    """Submit a sweep in three parts from a login node that names no user; yield the process."""
    options = ["--on", "slurm", "--parts", "3"]
    command = [sys.executable, "-m", "bgmodel", "sweep", str(file), str(folder), *options]
    environment = {name: value for name, value in cluster.items() if name != "USER"}
    with log.open("w") as output:
        process = subprocess.Popen(
            command, cwd=ROOT, env=environment, stdout=output, stderr=output,
            start_new_session=True, preexec_fn=hear_interrupts,
        )  # fmt: skip
    try:
        yield process
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGINT)
            process.wait()


@contextmanager
def drained(ask):
    """Drain the node: running jobs continue, and no job starts until the block ends."""
    ask("scontrol", "update", f"nodename={slurm.NODE}", "state=drain", "reason=test")
    try:
        yield
    finally:
        ask("scontrol", "update", f"nodename={slurm.NODE}", "state=resume")


def jobs(ask, states):
    """Return the numbers of jobs in some states, the tasks of an array one by one."""
    return ask("squeue", "--array", "-h", "-t", states, "-o", "%i").split()


def wait_until_drained(ask):
    until(lambda: not jobs(ask, "running,completing"), "the end of jobs")
    until(lambda: ask("sinfo", "-h", "-o", "%T") == "drained", "the node")


def test_an_interrupted_sweep_leaves_no_job(cluster, ask, file, tmp_path):
    folder = tmp_path / "found here"
    with drained(ask), submitted(cluster, file, folder, tmp_path / "log") as process:
        until(lambda: len(jobs(ask, "pending")) == 3 or process.poll() is not None, "jobs")
        os.killpg(process.pid, signal.SIGINT)
        assert process.wait(WAIT_S) == 130, (tmp_path / "log").read_text()
        assert jobs(ask, "pending,running") == []
    assert not (folder / ".snakemake" / "locks").is_dir()


def test_a_sweep_goes_on_after_a_killed_job_and_a_drained_node(cluster, ask, file, tmp_path):
    folder, log = tmp_path / "found here", tmp_path / "log"
    assert run("sweep", file, tmp_path / "alone", "--workers", 1) == 0

    # Three jobs for the two cores of the node: one waits.
    with submitted(cluster, file, folder, log) as process:
        until(lambda: times(folder) or process.poll() is not None, "the first shard")
        with drained(ask):
            running = jobs(ask, "running")
            assert running, log.read_text()
            ask("scancel", running[0])
            wait_until_drained(ask)
            assert len(jobs(ask, "pending")) == 1
            before = times(folder)
        assert process.wait(WAIT_S) == 1
    text = log.read_text()
    assert "CANCELLED" in text
    assert "the sweep is not finished" in text
    assert not outcome(folder)
    assert len(before) < len(times(folder)) < 6  # the job that waited ran, and one is not whole

    before = times(folder)
    with submitted(cluster, file, folder, log) as process:
        assert process.wait(WAIT_S) == 0, log.read_text()
    assert before.items() <= times(folder).items()  # what was finished is not computed again
    assert outcome(folder) == outcome(tmp_path / "alone")

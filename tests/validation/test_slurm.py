"""A sweep through SLURM: a job killed and the node drained half-way, and the same bytes."""

import subprocess
import sys
import time

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
        given = {"env": cluster, "capture_output": True, "text": True, "check": True}
        return subprocess.run(command, **given).stdout.strip()

    return asked


def until(condition, what):
    """Wait until a condition holds; return its value."""
    end = time.monotonic() + WAIT_S
    while not (value := condition()):
        assert time.monotonic() < end, f"waited in vain for {what}"
        time.sleep(0.1)
    return value


def whole(folder):
    """Return the time of writing of every whole shard, ns, by name."""
    return {p.name: p.stat().st_mtime_ns for p in (folder / "shards").glob("[!.]*.parquet")}


def outcome(folder):
    return {path.name: path.read_bytes() for path in folder.glob("outcome*")}


def started(cluster, file, folder, log):
    command = [sys.executable, "-m", "bgmodel", "sweep", file, folder, "--on", "slurm", "--parts", 3]
    with log.open("w") as output:
        return subprocess.Popen(
            [*map(str, command)], cwd=ROOT, env=cluster, stdout=output, stderr=output
        )


def test_a_sweep_goes_on_after_a_killed_job_and_a_drained_node(cluster, ask, tmp_path):
    file, folder, log = tmp_path / "small.toml", tmp_path / "found", tmp_path / "log"
    file.write_text(SWEEP)
    assert run("sweep", file, tmp_path / "alone", "--workers", 1) == 0

    # Three jobs for the two cores of the node: one waits.
    first = started(cluster, file, folder, log)
    try:
        until(lambda: whole(folder) or first.poll() is not None, "the first shard")
        ask("scontrol", "update", f"nodename={slurm.NODE}", "state=drain", "reason=test")
        running = ask("squeue", "-h", "-t", "running", "-o", "%i").split()
        assert running, log.read_text()
        ask("scancel", running[0])
        # A drained node finishes what runs, and starts nothing.
        until(lambda: not ask("squeue", "-h", "-t", "running,completing"), "the end of jobs")
        assert ask("sinfo", "-h", "-o", "%T") == "drained"
        assert len(ask("squeue", "-h", "-t", "pending", "-o", "%i").split()) == 1
        before = whole(folder)
        ask("scontrol", "update", f"nodename={slurm.NODE}", "state=resume")
        assert first.wait(WAIT_S) == 1
    finally:
        first.terminate()
        first.wait()
    said = log.read_text()
    assert "CANCELLED" in said
    assert "the sweep is not finished" in said
    assert not outcome(folder)
    assert len(before) < len(whole(folder)) < 6  # the job that waited ran, and one is not whole

    before = whole(folder)
    again = started(cluster, file, folder, log)
    try:
        assert again.wait(WAIT_S) == 0, log.read_text()
    finally:
        again.terminate()
        again.wait()
    assert before.items() <= whole(folder).items()  # what was finished is not computed again
    assert outcome(folder) == outcome(tmp_path / "alone")

"""Jobs of SLURM killed half-way, on a node that is drained: the bytes are those of this machine."""

import os
import re
import shlex
import signal
import subprocess
import sys
import time
from contextlib import chdir, contextmanager
from pathlib import Path

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


LESS = ["--share", "0.05", "--domains", "resting rates"]
"""Options that make the exams of the page short."""
SEARCH = """import bgmodel as bg
from bgmodel.commands.output import say

found = bg.discriminate("msprt", "max vs average", trials=200, check_trials=2000, evaluations=8,
                        workers=1, tell=say)
found.to_json("average.json")
"""
"""A script that searches for an experiment, as that of a reader."""


def of_page():
    """Return the commands of the guide, exams made short, and the script that runs one of them."""
    page = (ROOT / "docs/guides/sweeps.md").read_text()
    lines, script = re.findall(r"```sh\n(.*?)```", page, re.DOTALL)
    commands = [shlex.split(line) for line in lines.splitlines()]
    return [[*each, *(LESS if each[0] == "bgmodel" else ())] for each in commands], script


def test_searches_and_exams_go_on_as_an_array_of_jobs(cluster, ask, tmp_path):
    """As the guide has it; the first command, a search, is killed once it has tried a task."""
    commands, script = of_page()
    (tmp_path / "commands.txt").write_text("".join(f"{shlex.join(each)}\n" for each in commands))
    (tmp_path / "array.sh").write_text(script)
    (tmp_path / "search.py").write_text(SEARCH)
    with chdir(tmp_path):
        place = os.pathsep.join((str(Path(sys.executable).parent), cluster["PATH"]))
        submit = ["env", f"PATH={place}", "sbatch", "--parsable", "array.sh"]
        first = ask(*submit)
        log = tmp_path / f"slurm-{first}_1.out"
        until(lambda: log.is_file() and "bgmodel: N = " in log.read_text(), "the search")
        with drained(ask):
            ask("scancel", f"{first}_1")
            wait_until_drained(ask)
            assert jobs(ask, "pending") == [f"{first}_3"]
        until(lambda: not jobs(ask, "pending,running,completing"), "the end of jobs")
        assert sorted(path.name for path in tmp_path.glob("done.*")) == ["done.2", "done.3"]
        before = results(tmp_path)
        assert len(before) == 2

        ask(*submit)
        until(lambda: not jobs(ask, "pending,running,completing"), "the end of jobs")
        after = results(tmp_path)
        assert before.items() <= after.items()
        for path in tmp_path.glob("*.json"):
            path.unlink()
        exec(SEARCH, {})
        for each in commands[1:]:
            assert run(*each[1:]) == 0
        assert {name: text for name, (text, _) in after.items()} == {
            name: text for name, (text, _) in results(tmp_path).items()
        }


def results(folder):
    """Return the bytes of every result, and when it was written, by name."""
    return {p.name: (p.read_bytes(), p.stat().st_mtime_ns) for p in folder.glob("*.json")}

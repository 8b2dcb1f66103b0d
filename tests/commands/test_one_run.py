"""`bgmodel figures` that was stopped goes on, and two never work in one checkout at a time."""

import os
import shutil
import signal
import subprocess
import sys
import time
from fcntl import LOCK_EX, flock

import psutil
import pytest

from tests.helpers import ROOT

# SIGINT is heard also where the tests run in the background of a shell, which has it ignored.
COMMAND = [
    sys.executable,
    "-c",
    "from signal import SIGINT, default_int_handler, signal; signal(SIGINT, default_int_handler)\n"
    "from bgmodel.cli import main; raise SystemExit(main())",
]
# A figure that is drawn by half, one of its two files whole, for as long as a file "hold" is there.
SLOW = """
import time
from pathlib import Path
from bgmodel.support.files import replacing
from figures.common import run

def draw(settings, *, output):
    for ending in (".pdf", ".png"):
        with replacing(output.with_suffix(ending)) as partial:
            partial.write_text("a half")
            while ending == ".png" and Path("hold").exists():
                Path("half").touch()
                time.sleep(0.02)
            partial.write_text("a half and a half")

if __name__ == "__main__":
    run(draw=draw)
"""
WHOLE = {"fig3.pdf": b"a half and a half", "fig3.png": b"a half and a half"}
# Recordings may be named by a path that is another one in another place.
ENVIRONMENT = {name: value for name, value in os.environ.items() if name != "BGMODEL_RECORDINGS"}
ENVIRONMENT["PYTHONPATH"] = str(ROOT)
HANG_S = 600
"""No process takes as long, however busy the machine is: one that does hangs."""


class Checkout:
    """The `figures` folder alone, in another place, with a figure 3 that can be held by half."""

    def __init__(self, folder):
        self.folder = folder
        self.made = folder / "figures" / "fast"
        left_out = shutil.ignore_patterns("out", "fast", "__pycache__")
        shutil.copytree(ROOT / "figures", folder / "figures", ignore=left_out)
        (folder / "figures" / "fig3.py").write_text(SLOW)
        self.started = []

    def start(self):
        process = psutil.Popen(
            [*COMMAND, "figures", "fig3", "--fast"],
            cwd=self.folder,
            env=ENVIRONMENT,
            stdout=subprocess.DEVNULL,
            stderr=(self.folder / f"said{len(self.started)}").open("w"),
            start_new_session=True,
        )
        self.started.append(process)
        return process

    def said(self):
        """Return the text of the last call on stderr."""
        return (self.folder / f"said{len(self.started) - 1}").read_text()

    def held(self):
        """Start, and wait until the figure is drawn by half: the command, Snakemake, the job."""
        (self.folder / "hold").touch()
        command = self.start()
        until((self.folder / "half").exists)
        return command, *command.children(recursive=True)

    def release(self):
        for name in ("hold", "half"):
            (self.folder / name).unlink(missing_ok=True)

    def files(self):
        return {path.name: path.read_bytes() for path in self.made.iterdir()}

    def assert_goes_on(self):
        self.release()
        assert self.start().wait(HANG_S) == 0, self.said()
        assert self.files() == WHOLE


@pytest.fixture
def checkout(tmp_path):
    checkout = Checkout(tmp_path)
    yield checkout
    checkout.release()  # a job that a failed test left behind ends by itself
    for process in checkout.started:
        if process.is_running():
            process.kill()


def until(holds):
    end = time.monotonic() + HANG_S
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.02)


def kill(*processes):
    """Kill all of them before one can see that another ended."""
    for process in processes:
        process.suspend()
    for process in processes:
        process.kill()


def test_a_live_run_refuses_a_second_pauses_its_jobs_and_goes_on_after_an_interrupt(checkout):
    family = command, *others = checkout.held()
    assert checkout.start().wait(HANG_S) == 2
    assert checkout.said() == (
        f"bgmodel: another `bgmodel figures` is at work in this checkout, process {command.pid}: "
        "wait for its end, or stop it\n"
    )
    command.send_signal(signal.SIGTSTP)
    until(lambda: all(process.status() == psutil.STATUS_STOPPED for process in family))
    command.send_signal(signal.SIGCONT)
    until(lambda: all(process.status() != psutil.STATUS_STOPPED for process in family))
    command.send_signal(signal.SIGINT)
    assert command.wait(HANG_S) == 130
    said = (checkout.folder / "said0").read_text()
    assert said.endswith("bgmodel: stopped. The same command goes on where it was.\n")
    assert "Traceback" not in said
    assert not psutil.wait_procs(others, timeout=HANG_S)[1]
    checkout.assert_goes_on()


@pytest.mark.parametrize(
    ("killed", "by"),
    [
        ("command", signal.SIGKILL),
        pytest.param("command", signal.SIGTERM, marks=pytest.mark.validate),
        pytest.param("Snakemake", signal.SIGKILL, marks=pytest.mark.validate),
        pytest.param("all", signal.SIGKILL, marks=pytest.mark.validate),
    ],
)
def test_nothing_of_a_killed_run_lives_on_or_is_taken_for_finished(checkout, killed, by):
    family = checkout.held()
    if killed == "all":
        kill(*family)
    else:
        family[["command", "Snakemake"].index(killed)].send_signal(by)
    assert not psutil.wait_procs(family, timeout=HANG_S)[1]
    left = set(checkout.files()) - {"fig3.pdf"}
    assert len(left) == 1, left
    assert left.pop().endswith(".partial.fig3.png")
    checkout.assert_goes_on()


def test_a_run_waits_for_what_is_left_of_one_that_was_killed(checkout):
    family = checkout.held()
    lock = checkout.folder / ".snakemake" / "jobs.lock"
    for process in family:
        assert str(lock) in {file.path for file in process.open_files()}
    kill(*family)
    psutil.wait_procs(family, timeout=HANG_S)
    checkout.release()
    with lock.open("a+") as left:
        flock(left, LOCK_EX)
        again = checkout.start()
        until(lambda: "waiting for the last jobs" in checkout.said())
        assert again.poll() is None
    assert again.wait(HANG_S) == 0, checkout.said()
    assert checkout.files() == WHOLE


def test_no_job_outlives_snakemake_and_the_command(checkout):
    command, snakemake, *jobs = checkout.held()
    kill(snakemake, command)
    assert not psutil.wait_procs(jobs, timeout=HANG_S)[1]
    checkout.assert_goes_on()


def test_a_figure_that_fails_says_so_in_the_last_line(checkout):
    (checkout.folder / "figures" / "fig3.py").write_text("raise SystemExit('no such luck')")
    assert checkout.start().wait(HANG_S) == 1
    assert checkout.said().splitlines()[-1] == (
        "bgmodel: not every figure is drawn, Snakemake ended with status 1"
    )


def test_a_file_of_a_figure_can_be_asked_for_and_a_stale_lock_of_snakemake_stops_no_run(checkout):
    locks = checkout.folder / ".snakemake" / "locks"
    locks.mkdir(parents=True)
    (locks / "0.output.lock").write_text("figures/fast/fig3.png\nfigures/fast/fig3.pdf\n")
    command = [*COMMAND, "figures", "figures/fast/fig3.png", "--fast"]
    done = subprocess.run(command, cwd=checkout.folder, env=ENVIRONMENT, check=False)
    assert done.returncode == 0
    assert checkout.files() == WHOLE

"""The command `figures`: what it asks Snakemake for, and runs that are stopped."""

import os
import shutil
import signal
import subprocess
import sys
import time

import psutil
import pytest

from bgmodel.cli import main
from bgmodel.commands import pictures
from tests.helpers import ROOT


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["fig99"], "S1, T1 or files in figures/out, got 'fig99'"),
        (["fig3", "all_of_them", "--fast"], "files in figures/fast, got 'all_of_them'"),
        (["figures/out/fig3.png", "--fast"], "files in figures/fast, got 'figures/out/fig3.png'"),
    ],
)
def test_what_is_no_figure_is_refused_before_snakemake_starts(monkeypatch, capsys, arguments, says):
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(pictures, "run_snakemake", None)
    assert main(["figures", *arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith("bgmodel: targets must be among fig1, 2b, 3, ")
    assert error.endswith(f"{says}\n")
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "asked", "count"),
    [
        ([], ["all"], 3),
        (["fig2"], ["fig2"], 1),
        (["fig3", "figures/fast/fig2.png", "--fast"], ["fig3", "figures/fast/fig2.png"], 2),
    ],
)
def test_what_is_asked_for_is_drawn_and_nothing_else_and_all_without_a_word(
    tmp_path, monkeypatch, capsys, arguments, asked, count
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("BGMODEL_RECORDINGS", "")
    (tmp_path / "figures" / "room").mkdir(parents=True)
    for name in ("Snakefile", "room/draw_2.py", "room/draw_3.py", "room/draw_4.py"):
        (tmp_path / "figures" / name).touch()
    ran = []
    monkeypatch.setattr(pictures, "run_snakemake", lambda targets: ran.append(targets) or 0)
    assert main(["figures", *arguments]) == 0
    (command,) = ran
    assert command[command.index("--") + 1 :] == asked
    assert command[command.index("--config") + 1] == f"fast={int('--fast' in arguments)}"
    printed = capsys.readouterr().out
    assert f": {count}, already there: 0" in printed
    folder = tmp_path / "figures" / ("fast" if "--fast" in arguments else "out")
    folder.mkdir()
    (folder / "fig2.png").touch()
    assert main(["figures", *arguments]) == 0
    printed = capsys.readouterr().out
    assert f": {count}, already there: 1" in printed


@pytest.mark.parametrize("folder", ["010", "1e3", "true", "a' b"])
def test_a_folder_of_recordings_reaches_snakemake_as_it_is_named(tmp_path, monkeypatch, folder):
    """Its own reading of a configuration makes 10 of 010."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("BGMODEL_RECORDINGS", "")
    (tmp_path / folder).mkdir()
    (tmp_path / "figures").mkdir()
    read = tmp_path / "read.txt"
    (tmp_path / "figures" / "Snakefile").write_text(
        "import os\nwith open('read.txt', 'w') as file:\n"
        "    file.write(os.environ['BGMODEL_RECORDINGS'])\nrule all:\n"
    )
    assert main(["figures", "--recordings", folder]) == 0
    assert read.read_text() == folder


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

def draw(settings, *, output):
    for ending in (".pdf", ".png"):
        with replacing(output.with_suffix(ending)) as partial:
            partial.write_text("a half")
            while ending == ".png" and Path("hold").exists():
                Path("half").touch()
                time.sleep(0.02)
            partial.write_text("a half and a half")
"""
WHOLE = {"fig3.pdf": b"a half and a half", "fig3.png": b"a half and a half"}
HANG_S = 600
"""No process takes as long, however busy the machine is: one that does hangs."""


class Checkout:
    """The `figures` folder alone, in another place, with a figure 3 that can be held by half."""

    def __init__(self, folder):
        self.folder = folder
        self.made = folder / "figures" / "fast"
        left_out = shutil.ignore_patterns("out", "fast", "__pycache__")
        shutil.copytree(ROOT / "figures", folder / "figures", ignore=left_out)
        (folder / "figures" / "touch" / "draw_3.py").write_text(SLOW)
        self.started = []

    def start(self, *more, figure="fig3"):
        environment = os.environ | {"PYTHONPATH": str(ROOT)}
        environment.pop("BGMODEL_RECORDINGS", None)  # may be seen from another folder
        said = (self.folder / f"said{len(self.started)}").open("w")
        streams = {"stdout": subprocess.DEVNULL, "stderr": said, "start_new_session": True}
        words = [*COMMAND, "figures", figure, "--fast", *more]
        process = psutil.Popen(words, cwd=self.folder, env=environment, **streams)
        self.started.append(process)
        return process

    def printed(self):
        """Return the text of the last call on stderr."""
        return (self.folder / f"said{len(self.started) - 1}").read_text()

    def held(self):
        """Start, and wait until the figure is drawn by half: the command, and its processes."""
        (self.folder / "hold").touch()
        command = self.start()
        half = self.folder / "half"
        until(lambda: half.exists() or command.poll() is not None)
        assert half.exists(), self.printed()
        return command, *command.children(recursive=True)

    def release(self):
        for name in ("hold", "half"):
            (self.folder / name).unlink(missing_ok=True)

    def files(self):
        return {path.name: path.read_bytes() for path in self.made.iterdir()}

    def assert_goes_on(self):
        self.release()
        assert self.start().wait(HANG_S) == 0, self.printed()
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


def test_a_live_run_refuses_a_second_and_one_that_is_stopped_goes_on(checkout):
    command, *others = checkout.held()
    assert checkout.start().wait(HANG_S) == 2
    assert checkout.printed().startswith("bgmodel: another run is drawing figures in this checkout")
    assert checkout.printed().endswith("`bgmodel figures --unlock`\n")
    os.killpg(command.pid, signal.SIGINT)
    assert command.wait(HANG_S) == 130
    message = (checkout.folder / "said0").read_text()
    assert message.endswith("bgmodel: stopped. The same command resumes where it stopped.\n")
    assert "Traceback" not in message
    assert not psutil.wait_procs(others, timeout=HANG_S)[1]
    checkout.assert_goes_on()


def test_nothing_of_a_killed_run_lives_on_or_is_taken_for_finished(checkout):
    command, *others = checkout.held()
    command.kill()
    assert not psutil.wait_procs([command, *others], timeout=HANG_S)[1]
    left = set(checkout.files()) - {"fig3.pdf"}
    assert len(left) == 1, left
    assert left.pop().endswith(".partial.fig3.png")
    assert checkout.start().wait(HANG_S) == 2
    assert checkout.start("--unlock").wait(HANG_S) == 0, checkout.printed()
    checkout.assert_goes_on()


def test_a_figure_that_fails_says_so_in_the_last_line_and_leaves_no_lock(checkout):
    """Then a file of a figure is asked for, and drawn."""
    script = checkout.folder / "figures" / "touch" / "draw_3.py"
    script.write_text("raise SystemExit('no such luck')")
    assert checkout.start().wait(HANG_S) == 1
    assert checkout.printed().splitlines()[-1] == (
        "bgmodel: not all figures were drawn: Snakemake ended with status 1"
    )
    script.write_text(SLOW)
    assert checkout.start(figure="figures/fast/fig3.png").wait(HANG_S) == 0
    assert checkout.files() == WHOLE

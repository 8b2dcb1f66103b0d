"""One run at a time in a checkout, and no process of it outlives the command that started it.

Two kernel locks say who is at work; both vanish with their owners, however these end. The command
alone holds the first one: while it is held, the run is alive. Every process of the run holds the
second one, as its standard input: while it is held, something may still write.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from fcntl import LOCK_EX, LOCK_NB, flock
from pathlib import Path
from typing import IO


@contextmanager
def only_run(folder: Path, name: str) -> Iterator[IO[str]]:
    """Hold the locks of a run; wait for what is left of one that was killed.

    Parameters
    ----------
    folder : Path
        Folder of the two lock files.
    name : str
        Name of the run in messages.

    Yields
    ------
    file
        Standard input of all processes of the run.

    Raises
    ------
    ValueError
        Another run is alive.
    """
    folder.mkdir(exist_ok=True)
    with (folder / "command.lock").open("a+") as command, (folder / "jobs.lock").open("a+") as jobs:
        try:
            flock(command, LOCK_EX | LOCK_NB)
        except BlockingIOError:
            command.seek(0)
            raise ValueError(
                f"another {name} is at work in this checkout, process {command.read() or 'unknown'}"
                ": wait for its end, or stop it"
            ) from None
        # For the message above only: the lock decides, not the number.
        command.truncate(0)
        command.write(str(os.getpid()))
        command.flush()
        try:
            flock(jobs, LOCK_EX | LOCK_NB)
        except BlockingIOError:
            print(f"waiting for the last jobs of a {name} that was killed", file=sys.stderr)
            flock(jobs, LOCK_EX)
        yield jobs


def run_to_end(command: Callable[[int], Sequence[str]], jobs: IO[str]) -> int:
    """Run a command line in a process group of its own, and leave nothing of the group behind.

    Parameters
    ----------
    command : function
        Command line from the number of the file that its process must give to ``end_with``.
    jobs : file
        What ``only_run`` gave.

    Returns
    -------
    int
        Exit status of the command.
    """
    owner, ours = os.pipe()
    try:
        child = subprocess.Popen(command(owner), stdin=jobs, pass_fds=[owner], process_group=0)
        try:
            with _pausing(child.pid):
                # A thread of a numerical library may take a signal: that ends no wait in this one.
                while child.poll() is None:
                    time.sleep(0.1)
                return child.returncode
        finally:
            with suppress(ProcessLookupError, PermissionError):  # nothing of it is left
                os.killpg(child.pid, signal.SIGKILL)
            child.wait()
    finally:
        os.close(owner)
        os.close(ours)


def end_with(owner: int) -> None:
    """Wait until the command that holds the other end of a pipe is gone, then end this group."""
    os.read(owner, 1)
    os.killpg(0, signal.SIGKILL)


@contextmanager
def _pausing(group: int) -> Iterator[None]:
    """Let Ctrl-Z, which reaches only this process, stop the group as well."""

    def pause(*_: object) -> None:
        os.killpg(group, signal.SIGSTOP)
        os.kill(os.getpid(), signal.SIGSTOP)
        os.killpg(group, signal.SIGCONT)

    before = signal.signal(signal.SIGTSTP, pause)
    try:
        yield
    finally:
        signal.signal(signal.SIGTSTP, before)

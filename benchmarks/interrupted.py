"""Interrupt `make figures FAST=1` repeatedly and check that it resumes with identical results.

Two clones of what is committed here, both run with this interpreter's environment. One run is left
alone; the other is stopped at random moments (fixed seed), fifteen times, and then left alone:
five times each by SIGINT to make's process group (Ctrl-C), SIGINT to `bgmodel figures` alone, and
SIGKILL of the command, of a job, of make's group and of everything, after which the lock that a
killed run leaves is removed. Early steps are long, few end between stops: so all pictures are then
removed, and the run that draws them again, in short steps, is stopped fifteen times more. Then the
SHA-256 of every file under figures/fast is compared, the cache of the contact library included.
Linux; about half an hour on two cores:

    python -m benchmarks.interrupted --folder /tmp/interrupted
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import psutil

from benchmarks import OUT
from bgmodel.support.files import checksum, write_table

ROOT = Path(__file__).parents[1]
SEED = 2023
WAYS = ["SIGINT group", "SIGINT command"] * 5
WAYS += [f"SIGKILL {who}" for who in ("command", "job", "group", "everything", "command")]


def clone(folder: Path) -> Path:
    """Clone what is committed here."""
    subprocess.run(["git", "clone", "-q", str(ROOT), str(folder)], check=True)
    return folder


def environment(folder: Path) -> dict[str, str]:
    """Return our environment, with the package of a clone."""
    return os.environ | {"PYTHONPATH": str(folder)}


def start(folder: Path, cores: int) -> psutil.Popen:
    """Call ``make figures`` in a clone, in a new process group, with our environment."""
    command = ["make", "figures", "FAST=1", f"CORES={cores}", f"VENV={sys.prefix}"]
    for file in ("pyvenv.cfg", "figures.installed"):
        command += ["-o", f"{sys.prefix}/{file}"]  # installed packages stay unchanged
    with (folder / "said.txt").open("a") as said:
        return psutil.Popen(
            command,
            cwd=folder,
            env=environment(folder),
            stdout=said,
            stderr=said,
            start_new_session=True,
        )


def family(make: psutil.Popen) -> list[psutil.Process]:
    """Return the command and its jobs, as far as they have begun."""
    command = make.children()
    return command + [child for parent in command for child in parent.children(recursive=True)]


def stop(make: psutil.Popen, way: str) -> list[psutil.Process]:
    """Stop a run in one of the ways; return the processes that it had."""
    every = family(make)
    sent, who = way.split()
    number = signal.Signals[sent]
    if who == "group":
        os.killpg(make.pid, number)
        return every
    chosen = {
        "command": every[:1],
        "job": every[1:2],
        "everything": [make, *every],
    }[who]
    for process in chosen[1:]:
        process.suspend()  # none may see the first one end
    for process in chosen:
        process.send_signal(number)
    return every


def hashes(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of every file under figures/fast."""
    made = folder / "figures" / "fast"
    return {
        str(path.relative_to(made)): checksum(path)
        for path in sorted(made.rglob("*"))
        if path.is_file()
    }


def stopped_run(folder: Path, cores: int, longest_s: float) -> pd.DataFrame:
    """Stop a run in every way, in random order, then let it end; one row per stop."""
    rng = random.Random(SEED)
    rows = []
    for way in rng.sample(WAYS, len(WAYS)):
        moment = rng.uniform(0.5, longest_s)
        make = start(folder, cores)
        time.sleep(moment)
        row = {"way": way, "after_s": round(moment, 1), "ran": make.poll() is None}
        if row["ran"]:
            every = stop(make, way)
            begun = time.monotonic()
            row["jobs"] = len(every[1:])
            row["status"] = make.wait(60)
            row["left"] = len(psutil.wait_procs(every, timeout=3)[1])
            row["ended_in_s"] = round(time.monotonic() - begun, 2)
        row["partial"] = len(list((folder / "figures" / "fast").rglob(".*.partial.*")))
        row["figures"] = len(list((folder / "figures" / "fast").glob("*.png")))
        rows.append(row)
        print(row, flush=True)
        unlock = [sys.executable, "-m", "bgmodel", "figures", "--fast", "--unlock"]
        subprocess.run(unlock, cwd=folder, env=environment(folder), check=True)
    return pd.DataFrame(rows)


def pictures_again(folder: Path, cores: int, longest_s: float = 15.0) -> tuple[pd.DataFrame, int]:
    """Remove all pictures of a finished run, and stop the one that draws them again."""
    for ending in ("png", "pdf"):
        for path in (folder / "figures" / "fast").glob(f"*.{ending}"):
            path.unlink()
    return stopped_run(folder, cores, longest_s), start(folder, cores).wait()


def main() -> None:
    """Run both, compare, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, required=True, help="for the clones; removed first")
    parser.add_argument("--cores", type=int, default=2)
    parser.add_argument("--longest-s", type=float, default=60.0, help="of a run before its stop")
    given = parser.parse_args()
    # In the background of a script SIGINT is ignored, by all that is started here too.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    shutil.rmtree(given.folder, ignore_errors=True)
    left_alone, stopped = (clone(given.folder / name) for name in ("left_alone", "stopped"))
    table = stopped_run(stopped, given.cores, given.longest_s)
    statuses = [start(folder, given.cores).wait() for folder in (stopped, left_alone)]
    more, status = pictures_again(stopped, given.cores)
    table, statuses = pd.concat([table, more], ignore_index=True), [*statuses, status]
    ours, theirs = hashes(stopped), hashes(left_alone)
    differ = sorted(
        name for name in ours.keys() | theirs.keys() if ours.get(name) != theirs.get(name)
    )
    OUT.mkdir(exist_ok=True)
    write_table(table, OUT / "stopping.csv", seed=SEED, cores=given.cores, differ=differ)
    print(table.to_string())
    print(f"statuses at the end {statuses}; {len(theirs)} files, {len(differ)} differ: {differ}")


if __name__ == "__main__":
    main()

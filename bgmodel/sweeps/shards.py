"""Shards of a sweep: computed anywhere, stored as a unit, named by a hash of their settings.

Jobs of Snakemake compute them on this machine or, through its SLURM executor, on a cluster: if
SLURM takes jobs from this machine and says how they ended.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor, as_completed
from contextlib import contextmanager
from dataclasses import replace
from fcntl import LOCK_EX, LOCK_NB, LOCK_SH, flock
from functools import partial
from getpass import getuser
from importlib.resources import files as resources
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from bgmodel.deciding.decision import Decision
from bgmodel.deciding.measures import Behaviour
from bgmodel.support import __version__
from bgmodel.support.processes import NoMemoryError, advance
from bgmodel.sweeps.plan import BLOCK, Point, Shard
from circuits.arrays import Arrays
from circuits.errors import InputError, collected, require
from circuits.store import Entry, remove_partial_files

TRIAL_BYTES, SHARD_BYTES = 48, 20_000
"""Largest size of a stored trial, and of a shard without trials, bytes."""
OF_DECISION = ("choice", "time_ms", "forced", "premature")
"""Columns of a shard from which decisions are restored."""
REMARK = "remark"
"""The entry with the warnings of a run, or why it ended; usually empty."""
QUERIES = (
    (["sinfo", "--noheader"], "SLURM does not answer on this machine: run this on a login node"),
    (
        ["sacct", "--allocations", "--noheader", "--clusters", "all", "--starttime", "now"],
        "SLURM keeps no accounts here, from which the executor learns that a job has ended",
    ),
)
"""Commands that must succeed before a sweep submits jobs, and the reason if one fails."""
TIMEOUT_S = 60
SPECIAL = set("\"'$`\\")
"""Characters that the executor hands to a shell unquoted."""


def entry(shard: Shard, folder: Path) -> Entry[Arrays]:
    """Return the place of a shard in the folder of a sweep."""
    return Entry(folder / "shards", __version__, shard.key, dict, dict)


def state(shard: Shard, folder: Path) -> str:
    """Return "done", "missing", or "damaged": cut short, or made from other parameters."""
    there = entry(shard, folder)
    if not there.path.is_file():
        return "missing"
    return "damaged" if there.get() is None else "done"


def compute(shard: Shard, folder: Path) -> None:
    """Compute and store the decisions of a shard, unless they are stored."""
    _stored(shard, folder)


def _stored(shard: Shard, folder: Path) -> Arrays:
    """Return the decisions of a shard by column, and its remark, stored or computed."""
    return entry(shard, folder).once(partial(_computed, shard))


def _computed(shard: Shard) -> Arrays:
    """Run the circuit on the trials of a shard.

    A circuit that cannot be run, such as one whose rates diverge, is an outcome: its shard has no
    trials and states the reason.
    """
    with collected() as caught:
        try:
            columns = _decided(shard)
            remark = ""
        except NoMemoryError:
            raise  # a temporary failure, not an outcome
        except (ValueError, FloatingPointError) as error:
            columns, remark = {}, str(error)
    if replace(shard).key != shard.key:
        raise ValueError("the table of evidence was changed while the sweep ran: start it again")
    remark = remark or "; ".join(dict.fromkeys(caught))
    return {**columns, REMARK: np.array(remark)}


def _decided(shard: Shard) -> Arrays:
    of = shard.point
    model = of.model(of.hypotheses, seed=of.block_seed(shard.first), rates=False)
    model = replace(model, gain=of.used_gain)
    evidence = of.block(shard.first, shard.trials).evidence
    model.warn_beyond_range(evidence)
    behaviour = of.behaviour(model, evidence, of.block_seed(shard.first))
    columns = {name: getattr(behaviour.decision, name) for name in OF_DECISION}
    measured = {"posterior": behaviour.posterior, **behaviour.columns()}
    return {**columns, **measured, "truth": evidence.truth}


def read(point: Point, folder: Path) -> tuple[Behaviour | None, str]:
    """Return the decisions at a point, from its shards, and the remarks on them.

    None if the circuit could not be run.
    """
    parts = [_stored(shard, folder) for shard in point.shards()]
    remarks = dict.fromkeys(str(part.pop(REMARK)) for part in parts)
    remark = "; ".join(filter(None, remarks))
    if not all(parts):
        return None, remark
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    decision = Decision(
        **{name: columns[name] for name in OF_DECISION},
        step_ms=point.task.step_ms,
        deadline_ms=columns["time_ms"],
        truth=columns["truth"],
        gain=point.used_gain,
    )
    return Behaviour(
        decision,
        columns["posterior"],
        columns["anticipatory"],
        point.hypotheses,
        columns.get("ssd_ms"),
    ), remark


def check_room(points: Sequence[Point], folder: Path) -> None:
    """Raise ValueError if the disk has no room for the shards still missing."""
    trials = sum(point.trials for point in points)
    need = TRIAL_BYTES * trials + SHARD_BYTES * (len(points) + trials // BLOCK)
    there = sum(path.stat().st_size for path in (folder / "shards").glob("*.npz"))
    place = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    free = shutil.disk_usage(place).free
    if need - there > free:
        raise ValueError(
            f"{trials} trials at all points take up to {need / 1e9:.3g} GB in "
            f"{str(folder)!r}, where {free / 1e9:.3g} GB are free"
        )


@contextmanager
def at_work(folder: Path, *, alone: bool) -> Iterator[None]:
    """Lock a folder: exclusively, or shared by several parts of a sweep.

    A lock of filelock is never shared.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "sweep.lock").open("a+") as lock:
        try:
            flock(lock, (LOCK_EX if alone else LOCK_SH) | LOCK_NB)
        except BlockingIOError:
            raise ValueError(
                f"another sweep is running in {str(folder)!r}: wait for its end, or give another "
                "folder"
            ) from None
        except OSError:
            pass  # file system without locks: shards stay intact, but work may be done twice
        if alone:
            remove_partial_files(folder)
        yield


def compute_all(shards: Iterable[Shard], folder: Path, pool: Executor) -> None:
    """Compute shards, and report the trials of each that is stored."""
    jobs = {pool.submit(compute, shard, folder): shard for shard in shards}
    for done in as_completed(jobs):
        done.result()
        advance(jobs[done].trials)


def check_slurm(folder: Path) -> None:
    """Refuse a folder or a machine from which jobs can't be submitted and followed.

    Without accounts (slurmdbd) the executor of Snakemake would submit jobs and wait forever.
    """
    for path in (folder.absolute(), Path.cwd()):
        allowed = "must have a path without quotes, $, ` and backslashes, as SLURM's shell reads it"
        require(not SPECIAL & set(str(path)), "folder", allowed, str(path))
    for command, reason in QUERIES:
        try:
            subprocess.run(command, capture_output=True, text=True, check=True, timeout=TIMEOUT_S)
        except (OSError, subprocess.SubprocessError) as error:
            answer = " ".join((getattr(error, "stderr", None) or str(error)).split())
            raise InputError(
                f"{reason} ({command[0]}: {answer}); --part K/N needs no answers from SLURM", "on"
            ) from None


PACKAGE = resources("bgmodel.sweeps")


def run_jobs(
    shards: Iterable[Shard],
    file: Path,
    folder: Path,
    *,
    parts: int,
    workers: int,
    profile: Path | None = None,
    slurm: bool = False,
    dry_run: bool = False,
) -> None:
    """Let jobs of Snakemake compute the shards of a sweep in parts and gather the results.

    ``file`` is that of the sweep, ``profile`` the folder of another profile for SLURM than the
    shipped one. SystemExit if Snakemake fails.
    """
    if profile is not None and not (profile / "config.yaml").is_file():
        raise InputError.of("profile", "must be a folder with config.yaml", str(profile))
    try:
        import snakemake  # noqa: F401
    except ImportError as error:
        raise ImportError('jobs need Snakemake: pip install ".[cluster]"') from error
    if slurm and not dry_run:
        check_slurm(folder)
    names = "".join([__version__, *sorted(shard.name for shard in shards)])
    settings: dict[str, str | int] = {
        "file": str(file.absolute()),
        "folder": str(folder.absolute()),
        "parts": parts,
        "plan": hashlib.sha256(names.encode()).hexdigest()[:12],
    }
    how = ["--cores", str(workers)]
    if slurm:
        how = ["--profile", str(profile.absolute() if profile else PACKAGE / "slurm")]
    command = [sys.executable, "-m", "snakemake", "-s", str(PACKAGE / "Snakefile"), *how]
    command += ["--dry-run"] * dry_run + ["--rerun-incomplete"]
    with TemporaryDirectory() as empty:
        if not dry_run:
            folder.mkdir(parents=True, exist_ok=True)
        # Jobs on other machines read the settings too; a dry run leaves no files.
        path = Path(empty if dry_run else folder).absolute() / "jobs.json"
        path.write_text(json.dumps(settings))
        place = folder.absolute() if folder.is_dir() else Path(empty)
        command += ["--directory", str(place), "--configfile", str(path)]
        # The executor for SLURM reads USER, which services and containers leave unset.
        process = subprocess.Popen(command, env={"USER": getuser(), **os.environ})
        try:
            status = process.wait()
        except KeyboardInterrupt:
            process.wait()  # Ctrl-C reached it too: it ends its jobs and removes its lock
            raise
    if status:
        locks = place / ".snakemake" / "locks"
        more = f"; `rm -r {locks}` removes the lock of a killed run"
        raise SystemExit(
            f"bgmodel: the sweep is not finished, Snakemake ended with status {status}"
            + (more if locks.is_dir() else "")
        )

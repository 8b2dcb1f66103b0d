"""Shards of a sweep: computed anywhere, stored as a unit, named by a hash of their settings."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor, as_completed
from contextlib import contextmanager
from dataclasses import replace
from fcntl import LOCK_EX, LOCK_NB, LOCK_SH, flock
from functools import partial
from pathlib import Path

import numpy as np

from bgmodel.deciding.decision import Decision
from bgmodel.deciding.measures import Behaviour
from bgmodel.support import __version__
from bgmodel.support.processes import NoMemoryError, advance
from bgmodel.sweeps.plan import BLOCK, Point, Shard
from circuits.arrays import Arrays
from circuits.errors import collected
from circuits.store import Entry, remove_partial_files

TRIAL_BYTES, SHARD_BYTES = 48, 20_000
"""Largest size of a stored trial, and of a shard without trials, bytes."""
OF_DECISION = ("choice", "time_ms", "forced", "premature")
"""Columns of a shard from which decisions are restored."""
REMARK = "remark"
"""The entry with the warnings of a run, or why it ended; usually empty."""


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

"""Shards of a sweep: computed anywhere, stored as a unit, named by a hash of their settings."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor, as_completed
from contextlib import contextmanager
from dataclasses import replace
from fcntl import LOCK_EX, LOCK_NB, LOCK_SH, flock
from pathlib import Path
from typing import Any

import pandas as pd

from bgmodel.deciding.decision import Decision
from bgmodel.deciding.measures import Behaviour
from bgmodel.support import files
from bgmodel.support.memory import NoMemoryError
from bgmodel.sweeps.plan import BLOCK, Point, Shard
from circuits.errors import collected

TRIAL_BYTES, SHARD_BYTES = 40, 20_000
"""Largest size of a stored trial, and of a shard without trials, bytes."""
OF_DECISION = ("choice", "time_ms", "forced", "premature")
"""Columns of a shard from which decisions are restored."""
REMARK = "remark"
"""The column with the warnings of a run, or why it ended; in the first row, usually empty."""


def path_of(shard: Shard, folder: Path) -> Path:
    """Return the path of a shard in the folder of a sweep."""
    return folder / "shards" / f"{shard.name}.parquet"


def state(shard: Shard, folder: Path) -> str:
    """Return "done", "missing", or "damaged": cut short, or made from other parameters."""
    path = path_of(shard, folder)
    if not path.is_file():
        return "missing"
    try:
        parameters = files.read_provenance(path)["parameters"]
        made_from, _ = parameters["shard"], parameters[REMARK]
        read = files.read_table(path)
    except (OSError, ValueError, KeyError):
        return "damaged"
    complete = made_from == _plain(shard) and len(read) in (0, shard.trials)
    return "done" if complete else "damaged"


def compute(shard: Shard, folder: Path) -> None:
    """Run the circuit on the trials of a shard and store its decisions.

    A circuit that cannot be run, such as one whose rates diverge, is an outcome: its shard has no
    trials and states the reason.
    """
    with collected() as caught:
        try:
            table = _decided(shard)
            remark = ""
        except NoMemoryError:
            raise  # a temporary failure, not an outcome
        except (ValueError, FloatingPointError) as error:
            table, remark = pd.DataFrame(), str(error)
    if replace(shard).key != shard.key:
        raise ValueError("the table of evidence was changed while the sweep ran: start it again")
    remark = remark or "; ".join(dict.fromkeys(caught))
    path = path_of(shard, folder)
    try:
        files.write_table(table, path, seed=shard.point.seed, shard=shard.key, remark=remark)
    except OSError as error:
        raise ValueError(
            f"{str(folder)!r} can't be written: {error.strerror}; finished shards are kept"
        ) from error


def _decided(shard: Shard) -> pd.DataFrame:
    of = shard.point
    model = of.model(of.hypotheses, seed=of.block_seed(shard.first), rates=False)
    model = replace(model, gain=of.used_gain)
    evidence = of.block(shard.first, shard.trials).evidence
    model.warn_beyond_range(evidence)
    behaviour = of.behaviour(model, evidence, of.block_seed(shard.first))
    columns = {name: getattr(behaviour.decision, name) for name in OF_DECISION}
    measured = {"posterior": behaviour.posterior, **behaviour.columns()}
    return pd.DataFrame({**columns, **measured, "truth": evidence.truth})


def read(point: Point, folder: Path) -> tuple[Behaviour | None, str]:
    """Return the decisions at a point, from its shards, and the remarks on them.

    None if the circuit could not be run.
    """
    parts, remarks = [], []
    for shard in point.shards():
        path = path_of(shard, folder)
        parts.append(files.read_table(path))
        remarks.append(files.read_provenance(path)["parameters"][REMARK])
    remark = "; ".join(dict.fromkeys(text for text in remarks if text))
    if any(part.empty for part in parts):
        return None, remark
    trials = pd.concat(parts, ignore_index=True)
    columns = {name: trials[name].to_numpy() for name in trials}
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


def _plain(shard: Shard) -> Any:
    return files.provenance(shard=shard.key)["parameters"]["shard"]


def check_room(points: Sequence[Point], folder: Path) -> None:
    """Raise ValueError if the disk has no room for the shards still missing."""
    trials = sum(point.trials for point in points)
    need = TRIAL_BYTES * trials + SHARD_BYTES * (len(points) + trials // BLOCK)
    there = sum(path.stat().st_size for path in (folder / "shards").glob("*.parquet"))
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
            files.remove_partial_files(folder)
        yield


def compute_all(shards: Iterable[Shard], folder: Path, pool: Executor) -> Iterator[None]:
    """Compute shards, and yield once for each that is stored."""
    for done in as_completed([pool.submit(compute, shard, folder) for shard in shards]):
        yield done.result()

"""The spikes of recorded cells in each trial, from tables and from NWB files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from bgmodel.support.checks import path_of
from bgmodel.trials.columns import check_columns, numbers, refuse
from bgmodel.trials.files import read_rows
from bgmodel.trials.timed_readings import Source, as_written
from circuits.arrays import Array, Integers, Truths
from circuits.errors import DataWarning, InputError, require, within

CLICKS = "_s"
"""Ends the names of columns that hold the times of the clicks on one side, s."""
LATEST_S = 20.0
"""Spikes further than this from the onset of their trial have another unit or another clock."""
BEFORE_S, AFTER_S = 0.5, 0.5
"""Spikes of a continuous recording belong to a trial from this long before its start to this long
after its stop."""
ROUNDED_S = 0.001
"""Time by which the observation of a unit may fall short of a trial, s."""
APART = "."
"""Between a session and the name of a trial or cell that belongs to it."""


@dataclass(frozen=True, eq=False)
class RecordedSpikes:
    """Spike times of recorded cells."""

    names: tuple[str, ...]  # the cells, as "session.cell" if there are sessions
    trial: Integers  # (spikes,), index
    cell: Integers  # (spikes,), index
    time_s: Array  # (spikes,), from the onset of the trial; negative before
    # (trials, cells), true in all trials of a cell's session that its observation covers
    recorded: Truths

    def where(self, mask: Truths | Integers) -> RecordedSpikes:
        """Return the spikes of some trials, and the cells that were recorded in these."""
        kept = np.arange(len(self.recorded))[mask]
        cells = np.flatnonzero(self.recorded[kept].any(axis=0))
        trial, cell = np.full(len(self.recorded), -1), np.full(len(self.names), -1)
        trial[kept], cell[cells] = np.arange(len(kept)), np.arange(len(cells))
        some = (trial[self.trial] >= 0) & (cell[self.cell] >= 0)
        return RecordedSpikes(
            tuple(self.names[k] for k in cells), trial[self.trial[some]], cell[self.cell[some]],
            self.time_s[some], self.recorded[np.ix_(kept, cells)],
        )  # fmt: skip


def joined_spikes(parts: Sequence[RecordedSpikes]) -> RecordedSpikes:
    """Return the spikes of trials that follow one another."""
    names = list(dict.fromkeys(name for part in parts for name in part.names))
    recorded = np.zeros((sum(len(part.recorded) for part in parts), len(names)), bool)
    trial, cell, first = [], [], 0
    for part in parts:
        place = np.array([names.index(name) for name in part.names], dtype=np.int64)
        last = first + len(part.recorded)
        recorded[first:last, place] = part.recorded
        trial.append(part.trial + first)
        cell.append(place[part.cell])
        first = last
    time_s = np.concatenate([part.time_s for part in parts])
    return RecordedSpikes(
        tuple(names), np.concatenate(trial), np.concatenate(cell), time_s, recorded
    )


def is_nwb(source: object) -> bool:
    """Whether trials and spikes are in one file of Neurodata Without Borders."""
    return isinstance(source, (str, Path)) and Path(source).suffix == ".nwb"


def spike_table(spikes: Source) -> pd.DataFrame:
    """Return one row per spike: cell, trial, time_s, and session if there are several."""
    if isinstance(spikes, pd.DataFrame):
        return spikes.reset_index(drop=True)
    return read_rows(path_of(spikes, "spikes")).reset_index(drop=True)


def in_sessions(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table in which the names of trials tell their session, if there are sessions."""
    if "session" not in table or "trial" not in table:
        return table
    pairs = zip(table["session"], table["trial"], strict=True)
    return table.assign(trial=[f"{as_written(s)}{APART}{as_written(k)}" for s, k in pairs])


def clicks_of(table: pd.DataFrame) -> pd.DataFrame:
    """Return one row per click from columns of lists, such as left_s and right_s."""
    sides = [
        name for name in map(str, table) if name.endswith(CLICKS) and _holds_lists(table[name])
    ]
    if len(sides) < 2:
        raise InputError(
            "trials with spikes need the times of their clicks: two columns of lists, such as "
            "left_s and right_s (of a .parquet, since a .csv holds text), or evidence; got "
            f"{', '.join(map(str, table))}", "evidence",
        )  # fmt: skip
    keys = [name for name in ("participant_id", "trial") if name in table]
    parts = []
    for name in sides:
        rows = table[[*keys, name]].rename(columns={name: "time"}).explode("time")
        parts.append(rows.assign(side=name.removesuffix(CLICKS)).dropna(subset="time"))
    return pd.concat(parts, ignore_index=True)


def spikes_of(spikes: Source, trials: Sequence[str], end_s: Array) -> RecordedSpikes:
    """Return the spikes of trials, by their names in sessions, which end at ``end_s``, (trials,).

    One row per spike has cell, trial, time_s (from the onset) and perhaps session; in a row of
    which ``observed`` is false, a cell was not recorded in a trial.
    """
    try:
        table = spike_table(spikes)
        check_columns(table, ["cell", "trial", "time_s"])
        return _matched(table, trials, end_s)
    except InputError as error:
        raise within("the spikes", error, "spikes") from None


def _matched(table: pd.DataFrame, trials: Sequence[str], end_s: Array) -> RecordedSpikes:
    time_s = numbers(table["time_s"])
    hint = ": s from the onset of the trial are needed, not ms, samples or times of the session"
    last_s = float(np.nanmax(end_s, initial=0.0)) + LATEST_S
    wrong = ~((time_s >= -LATEST_S) & (time_s <= last_s))
    refuse(wrong, table["time_s"], f"within {-LATEST_S:g} to {last_s:.3g} s", hint)
    by_session = "session" in table
    sessions = [as_written(each) for each in table["session"]] if by_session else [""] * len(table)
    code, place = pd.factorize(pd.Index(in_sessions(table)["trial"].map(as_written)))
    trial = pd.Index(trials).get_indexer(place)[code]
    known = trial >= 0
    if not known.any():
        must = "must name trials of the table of trials, and their sessions in both or in neither"
        raise InputError.of("trial", must, place[0])
    if not known.all():
        DataWarning.warn(
            f"{(~known).sum()} of {len(known)} spikes are of trials that are not in the table of "
            "trials: they are left out"
        )
    cells = [as_written(each) for each in table["cell"]]
    full = [f"{s}{APART}{c}" if by_session else c for s, c in zip(sessions, cells, strict=True)]
    cell, names = pd.factorize(np.array(full, dtype=object)[known], sort=True)
    of_cell = np.array([name.rpartition(APART)[0] if by_session else "" for name in names])
    of_trial = np.array([name.rpartition(APART)[0] if by_session else "" for name in trials])
    recorded, trial, time_s = of_trial[:, None] == of_cell, trial[known], time_s[known]
    if "observed" in table:
        lost = ~table["observed"].to_numpy(bool)[known]
        recorded[trial[lost], cell[lost]] = False
    some = recorded[trial, cell]
    return RecordedSpikes(tuple(names), trial[some], cell[some], time_s[some], recorded)


def _holds_lists(column: pd.Series) -> bool:
    first = column.dropna()
    return len(first) > 0 and isinstance(first.iloc[0], (list, tuple, np.ndarray))


def read_nwb(path: Path) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the trials and the spikes of an NWB file.

    ``stimulus_s`` is from start to stop; ragged columns become lists, of times from the start if
    their name ends in ``_s``. A unit is recorded in trials that its ``obs_intervals`` cover.
    Refuses overlapping trials and spikes after the end.
    """
    try:
        import h5py
    except ImportError as error:
        raise ImportError('NWB needs h5py: pip install ".[nwb]"') from error
    require(path.is_file(), "source", "must be a file", str(path))
    with h5py.File(path) as file:
        for name, what in (("intervals/trials", "a table of trials"), ("units", "units")):
            require(name in file, "source", f"must have {what} ({name})", sorted(file))
        trials, units = _columns(file["intervals/trials"]), _columns(file["units"])
    start, stop = (np.asarray(trials[name], np.float64) for name in ("start_time", "stop_time"))
    if (start[1:] < stop[:-1]).any():
        at = int(np.argmax(start[1:] < stop[:-1]))
        raise InputError(
            f"trials must not overlap: trial {at + 1} starts at {start[at + 1]:g} s, before trial "
            f"{at} stops at {stop[at]:g} s", "start_time",
        )  # fmt: skip
    rows, begin, end = [], start - BEFORE_S, stop + AFTER_S
    blind = np.ones(len(start), bool)
    observed = units.get("obs_intervals", [np.empty((0, 2))] * len(units["id"]))
    for name, times, seen in zip(units["id"], units["spike_times"], observed, strict=True):
        late = seen.size and (times > seen.max()).any()
        if late:
            raise InputError(
                f"spikes of unit {name} come after the end of its recording, {seen.max():g} s",
                "spike_times",
            )
        first, last = (np.searchsorted(times, x) for x in (begin, end))
        since, until = (np.maximum(seen[:, [0]], begin), np.minimum(seen[:, [1]], end))
        covered_s = np.maximum(until - since, 0.0).sum(axis=0)
        missed = (covered_s < end - begin - ROUNDED_S) & bool(seen.size)
        trial = np.repeat(np.arange(len(start)), last - first)
        if missed[trial].all():
            DataWarning.warn(f"unit {name} has no spikes in any trial: it is left out")
            continue
        blind &= missed
        inside = np.concatenate([np.arange(*ends) for ends in zip(first, last, strict=True)])
        time_s = times[inside] - start[trial]
        cell, lost = {"cell": str(name)}, {"trial": np.flatnonzero(missed), "time_s": 0.0}
        rows.append(pd.DataFrame({**cell, "trial": trial, "time_s": time_s, "observed": True}))
        rows.append(pd.DataFrame({**cell, **lost, "observed": False}))
    must = "must have spikes of a unit in a trial that obs_intervals cover, from "
    require(rows, "source", f"{must}{BEFORE_S} s before to {AFTER_S} s after it", path.name)
    table = pd.DataFrame(trials).assign(trial=np.arange(len(start)), stimulus_s=stop - start)
    if blind.any():
        DataWarning.warn(f"no unit was recorded in {blind.sum()} trials: they are left out")
    spikes = pd.concat(rows, ignore_index=True)
    return table[~blind].reset_index(drop=True), spikes[~blind[spikes["trial"]]]


def _columns(group: Any) -> dict[str, Any]:
    """Return the columns of a table in HDMF's form; ragged ones as lists of arrays."""
    columns: dict[str, Any] = {}
    for name in group:
        if name.endswith("_index") or not hasattr(group[name], "shape"):
            continue
        values = group[name].asstr()[:] if group[name].dtype.kind == "O" else group[name][:]
        if f"{name}_index" in group:
            values = np.split(values, group[f"{name}_index"][:-1].astype(np.int64))
        columns[name] = list(values)
    return columns


def without_silent(spikes: RecordedSpikes, least: int) -> RecordedSpikes:
    """Return the cells that have enough spikes; warn of the others."""
    count = np.bincount(spikes.cell, minlength=len(spikes.names))
    few = count < least
    if not few.any():
        return spikes
    names = ", ".join(np.array(spikes.names)[few][:4])
    DataWarning.warn(f"{few.sum()} cells with fewer than {least} spikes are left out: {names}")
    if few.all():
        raise InputError.of("spikes", f"must be of a cell with {least} spikes or more", names)
    enough = replace(spikes, recorded=spikes.recorded & ~few)
    return enough.where(np.arange(len(spikes.recorded)))

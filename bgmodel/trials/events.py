"""Stop-signal trials from BIDS events, and delays restored from staircases.

Names of columns are those of OpenNeuro ds000030, ds000008 and similar sets, or given.

Some programs give no stop signal if the response comes first, and record a delay of 0. Such trials
look like failures to stop at the shortest delay, and imitate violations of the race model: of the
274 in the shipped set 268 have a response, from people whose staircases are near 300 ms. If all
other delays follow one-up-one-down staircases, the missing ones can be inferred from these.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from bgmodel.trials.columns import MISSING, refuse
from bgmodel.trials.files import read_rows
from bgmodel.trials.record import Trials
from circuits.arrays import Array, Integers, Truths
from circuits.errors import DataWarning, InputError, require, within

NAMES = {
    "trial_type": ("trial_type", "TrialType", "TrialOutcome", "trial_outcome"),
    "rt": ("response_time", "ReactionTime", "reaction_time", "rt", "RT"),
    "ssd": ("stop_signal_delay", "StopSignalDelay", "ssd", "SSD"),
}
"""Names of each column in published sets, in the order in which they are looked for."""
STOP, GO = re.compile("stop", re.IGNORECASE), re.compile(r"(?<!no)(?<!no-)go", re.IGNORECASE)
"""Types of stop trials, such as "STOP" and "failed stop", and of go trials, such as "GO"."""
SUBJECT = re.compile(r"sub-([A-Za-z0-9]+)")
ENDING = "_events.tsv"


def is_events(path: Path) -> bool:
    """Whether a path is that of BIDS events: a folder, or a file with their ending."""
    return path.is_dir() or path.name.endswith(ENDING)


def read_events(path: Path, columns: Mapping[str, str] | None = None) -> pd.DataFrame:
    """Return the stop-signal trials of BIDS events: of a file, or of a folder and those below it.

    ``columns`` are the set's names of trial_type, rt and ssd, where they are not among ``NAMES``.
    The table has participant_id, trial, rt and ssd (s); events of other types are left out with a
    warning.
    """
    unknown = sorted({*(columns or {})} - {*NAMES})
    require(not unknown, "columns", f"must name columns of {', '.join(NAMES)}", unknown)
    parts, left_out = [], 0
    for file in _files(path):
        try:
            part, others = _read(file, columns or {})
        except InputError as error:
            raise within(file.name, error, "path") from None
        parts.append(part)
        left_out += others
    table = pd.concat(parts, ignore_index=True)
    if left_out:
        DataWarning.warn(f"{left_out} events are neither go nor stop trials, and are left out")
    for kind, present in (("go", table["ssd"].isna()), ("stop", table["ssd"].notna())):
        require(present.any(), "trial_type", f"must include {kind} trials", "none")
    table["trial"] = table.groupby("participant_id").cumcount()
    return table[["participant_id", "trial", "rt", "ssd"]]


def _files(path: Path) -> list[Path]:
    """Return the files of events, sorted, without hidden, empty or derived ones."""
    if not path.is_dir():
        return [path]
    all_files = sorted(file for file in path.rglob(f"*{ENDING}") if _is_data(file, path))
    stops = [file for file in all_files if re.search("stop", _entity(file, "task"), re.IGNORECASE)]
    packed = [file.name for file in path.rglob(f"*{ENDING}.gz")]
    require(not packed, "path", f"must hold plain files, not {ENDING}.gz: unpack them", packed[:3])
    require(all_files, "path", f"must hold files that end in {ENDING}", str(path))
    files = stops or all_files
    for kind in ("task", "ses"):
        names = sorted({_entity(file, kind) for file in files} - {""})
        if len(names) > 1:
            each = ", ".join(f"{kind}-{name}" for name in names)
            message = f"{path.name} holds {each}: give a folder with the files of one"
            raise InputError(f"path: {message}", "path")
    return files


def _is_data(file: Path, folder: Path) -> bool:
    parts = file.relative_to(folder).parts
    hidden = any(part.startswith(".") for part in parts)
    copied = bool({"derivatives", "sourcedata"} & {*parts}) or "_desc-" in file.name
    return not hidden and not copied and file.stat().st_size > 0


def _entity(file: Path, name: str) -> str:
    """Return the label of an entity in a BIDS name, such as that of task-; "" without one."""
    match = re.search(rf"(?:^|_){name}-([A-Za-z0-9]+)", file.name)
    return match.group(1) if match else ""


def _read(file: Path, columns: Mapping[str, str]) -> tuple[pd.DataFrame, int]:
    subject = SUBJECT.search(file.name)
    require(subject, "path", 'must have a name with "sub-" and the participant', file.name)
    cells = read_rows(file).reset_index(drop=True)
    kind = cells[_column(cells, "trial_type", columns)]
    stop = kind.str.contains(STOP).to_numpy(bool)
    go = kind.str.contains(GO).to_numpy(bool) & ~stop
    rt, ssd = (_numbers(cells, _column(cells, name, columns)) for name in ("rt", "ssd"))
    early = cells[_column(cells, "rt", columns)]
    refuse((go | stop) & (rt < 0), early, "0 s or more: a premature response is no response time")
    lacking = stop & np.isnan(ssd)
    require(not lacking.any(), "ssd", "must be a number in each stop trial", int(lacking.sum()))
    table = pd.DataFrame(
        {
            "participant_id": subject.group(0) if subject else "",
            "rt": np.where(rt == 0, np.nan, rt),
            "ssd": np.where(stop, ssd, np.nan),
        }
    )
    return table[go | stop], int((~(go | stop)).sum())


def _column(cells: pd.DataFrame, name: str, columns: Mapping[str, str]) -> str:
    wanted = (columns[name],) if name in columns else NAMES[name]
    matches = [each for each in wanted if each in cells]
    if not matches:
        must = f"must be a column, called {' or '.join(wanted)}; columns= gives another name"
        if name == "ssd":
            must += " (choices without stop signals are read from files with another ending)"
        raise InputError.of(name, must, list(cells.columns))
    return matches[0]


def _numbers(cells: pd.DataFrame, column: str) -> Array:
    text = cells[column].str.strip()
    numbers = pd.to_numeric(text, errors="coerce").to_numpy(float)
    wrong = np.isnan(numbers) & ~text.isin(MISSING).to_numpy(bool)
    require(not wrong.any(), column, "must hold numbers or n/a", text[wrong].tolist()[:3])
    return numbers


STEP_MS = 50.0
"""Step of the staircases of the shipped set."""
LATE_MS = 10.0
"""A missing delay may lie this far before the response, because screens and keys have delays."""


def restored_delays(trials: Trials) -> Trials:
    """Return trials in which delays recorded as 0 are those of the participant's staircases.

    Two interleaved staircases are assumed, one step up after a successful stop and down after a
    failed one. The path with the fewest contradictions (recorded delays that neither has, or
    restored ones before the response) is found; many are warned of.
    """
    if trials.ssd_s is None:
        raise InputError("must have stop-signal delays", "ssd")
    ssd_s, rt_ms = trials.ssd_s.copy(), 1000 * trials.rt_s
    for who in trials.people():
        stops = np.flatnonzero((trials.participant == who) & ~np.isnan(ssd_s))
        missing = (ssd_s[stops] == 0) & ~np.isnan(rt_ms[stops])
        if not missing.any():
            continue
        path, contradictions = _path(1000 * ssd_s[stops], rt_ms[stops], missing)
        if contradictions > len(stops) / 10:
            DataWarning.warn(
                f"{contradictions:.0f} of {len(stops)} stop trials of {who} contradict two "
                f"staircases with steps of {STEP_MS:g} ms: their restored delays are doubtful"
            )
        ssd_s[stops[missing]] = path[missing] * STEP_MS / 1000
    return replace(trials, ssd_s=ssd_s)


def _path(ssd: Array, rt: Array, missing: Truths) -> tuple[Integers, float]:
    """Return each stop trial's step of a staircase, and the contradictions, by Viterbi's method."""
    levels = int(np.ceil(ssd.max() / STEP_MS)) + 4
    steps = np.arange(levels)
    after = np.clip(steps + np.where(np.isnan(rt), 1, -1)[:, None], 0, levels - 1)
    wrong = np.abs(ssd[:, None] - steps * STEP_MS) > STEP_MS / 2
    early = steps * STEP_MS + LATE_MS < rt[:, None]
    cost = np.where(missing[:, None], early, wrong).astype(float)
    to_come, first = np.zeros((levels, levels)), np.zeros((len(ssd), levels, levels), bool)
    for k in range(len(ssd) - 1, -1, -1):
        one = cost[k][:, None] + to_come[after[k]]
        other = cost[k][None, :] + to_come[:, after[k]]
        first[k], to_come = one <= other, np.minimum(one, other)
    state = list(np.unravel_index(int(to_come.argmin()), to_come.shape))
    path = np.empty(len(ssd), dtype=np.int64)
    for k in range(len(ssd)):
        which = 0 if first[k][state[0], state[1]] else 1
        path[k] = state[which]
        state[which] = after[k][path[k]]
    return path, float(to_come.min())

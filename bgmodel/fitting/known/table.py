"""Tables of trials with their readings: log-likelihoods, or cues, pulses and clicks with times."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.fitting.known.trials import KnownTrials
from bgmodel.support.arrays import Array, Integers
from bgmodel.support.checks import check_positive, path_of
from bgmodel.tables.cautions import ENOUGH, check_one_unit
from bgmodel.tables.columns import (
    names_once,
    numbers,
    participants,
    refuse,
    rows,
    times,
    with_index,
)
from bgmodel.tables.evidence import KEYS, read_csv_table, trials_from_table
from bgmodel.tables.foreign import renamed
from bgmodel.tables.text_files import SEPARATORS, read_rows
from bgmodel.trials.reading import OURS, Columns, check_effect
from circuits.errors import DataWarning, InputError, quiet, within

FORMS = (
    "trial, step and ll_<alternative>; trial, time (s) and ll_<alternative>; or one row per cue "
    "with trial, time (s) and side or value"
)
PLAIN_FLOAT = re.compile(r"-?(0|[1-9]\d*)\.0")
"""A whole number as a column of floating-point numbers has it; ids such as 01 are none."""
SIGNED = ("0", "1")
"""Alternatives of cues that have a sign and no side: a positive value favours response 1."""
MOST_ERRORS = 4.0
"""Standard errors above chance from which responses are taken to be exchanged."""
Source = str | Path | pd.DataFrame


@dataclass(frozen=True)
class Readings:
    """The readings of each trial of a table of evidence.

    Parameters
    ----------
    ids : list of (participant, trial)
        Ids as text; the participant is empty if the table has none.
    log_likelihood, time_s, lengths
        As in ``KnownTrials``.
    names : tuple of str
        The alternatives.
    """

    ids: list[tuple[str, str]]
    log_likelihood: Array
    time_s: Array
    lengths: Integers
    names: tuple[str, ...]


def read_known(
    data: Source,
    evidence: Source,
    *,
    step_ms: float | None = None,
    forced: bool = False,
    participant: str | None = None,
    columns: Columns = OURS,
) -> KnownTrials:
    """Read choices, response times and the readings of each trial.

    Parameters
    ----------
    data : path or DataFrame
        One row per trial: ``trial``, ``rt``, ``response``, the name of an alternative, and, for
        several participants, ``participant_id``. A trial without a response has neither ``rt`` nor
        ``response``.
    evidence : path or DataFrame
        The readings, in one of three forms. (1) As for ``read_evidence``: trial, step and
        ``ll_<alternative>``; reading k comes at ``k step_ms``. (2) The same with ``time``, s from
        the onset, instead of ``step``. (3) One row per cue, pulse or click: trial, time, and
        ``side``, the alternative that it favours; ``value``, its log likelihood ratio in nats, is
        optional and 1 by default. Without ``side``, ``value`` has a sign and a positive one
        favours response 1. Cues at the same time are added to one reading.
    step_ms : float, optional
        Time between readings, ms; required for the first form, and for that only.
    forced : bool
        Whether the last reading of a trial forces a response.
    participant : str, optional
        The participant, if there are several.
    columns : Columns
        Names, unit and codes of the columns of ``data``: rt, response, participant, rt_unit and
        upper (the alternative coded as response 1, if there are two and responses are 1 and 0).
        Times of readings are in s.

    Raises
    ------
    ValueError
        For tables that can't be read or do not match, with ``.field``: evidence, trial, time,
        response, ...

    Warns
    -----
    UserWarning
        If the evidence has trials that are not in ``data``.
    """
    name, table = _table(data, "data")
    check_effect("known evidence", columns)
    own = {each: getattr(columns, each) for each in ("rt", "response", "participant")}
    with _within(name, "data"):
        table = rows(renamed(table, **own), ["trial"], participant)
        people = sorted(set(participants(table)))
    if len(people) > 1:
        said = f"these trials are of {', '.join(people)}: give participant=NAME"
        raise InputError(f"a fit on known evidence is of one person, and {said}", "participant")
    participant = participant if "participant_id" in table else None
    readings = _read_evidence(evidence, step_ms, participant)
    order = _matched(table, readings)
    rt_s = times(table["rt"], columns.rt_unit)
    check_one_unit(rt_s)
    choice = _choices(table["response"], np.isnan(rt_s), readings.names, columns.upper)
    _check_sides(readings.log_likelihood[order], readings.time_s[order], choice, rt_s)
    return KnownTrials(
        readings.log_likelihood[order], readings.time_s[order], readings.lengths[order],
        readings.names, choice, rt_s, tuple(_text(each) for each in table["trial"]), forced, name,
        people[0],
    )  # fmt: skip


def _check_sides(log_likelihood: Array, time_s: Array, choice: Integers, rt_s: Array) -> None:
    """Raise ValueError if most responses are against the readings before them."""
    seen = np.where((time_s <= rt_s[:, None])[:, :, None], log_likelihood, 0.0).sum(axis=1)
    best, chosen = seen.max(axis=1), np.take_along_axis(seen, np.maximum(choice, 0)[:, None], 1)
    told = (choice >= 0) & (best > seen.min(axis=1))
    against = int((chosen[told, 0] == seen[told].min(axis=1)).sum())
    chance = told.sum() / log_likelihood.shape[2]
    if told.sum() >= ENOUGH and against > chance + MOST_ERRORS * np.sqrt(chance):
        raise InputError(
            f"response must agree with the evidence: {against} of {told.sum()} responses are the "
            "alternative that the readings before them speak against most. Are the names of the "
            "alternatives exchanged (upper), or the signs of values?",
            "response",
        )


def people_of(data: Source, columns: Columns = OURS) -> Sequence[str | None]:
    """Return the participants of a table of trials; one None if it names none."""
    name, table = _table(data, "data")
    table = renamed(table, participant=columns.participant)
    if "participant_id" not in table:
        return [None]
    with _within(name, "participant_id"):
        return sorted(set(participants(table)))


def readings_of(table: pd.DataFrame, step_ms: float | None = None) -> Readings:
    """Return the readings of a table of evidence; forms and errors as for ``read_known``."""
    names = names_once(table.columns)
    table = table.set_axis(names, axis=1).reset_index(drop=True)
    if "trial" not in names or not {"step", "time"} & set(names):
        raise InputError(f"evidence needs the columns {FORMS}; got {', '.join(names)}", "evidence")
    if "step" in names:
        if step_ms is None:
            said = (
                "give the time between them, step_ms, ms (--evidence FILE step_ms= at a terminal)"
            )
            raise InputError(f"the evidence has steps instead of times: {said}", "step_ms")
        check_positive(step_ms=step_ms)
        return _numbered(table, None, step_ms)
    if step_ms is not None:
        raise InputError("the evidence has times: leave step_ms out", "step_ms", step_ms)
    time_s = numbers(table["time"])
    refuse(np.isnan(time_s) | (time_s < 0), table["time"], "0 s or later")
    if not any(name.startswith("ll_") for name in names):
        table = _of_cues(table.assign(time=time_s))
        with quiet():  # cues of one value make equal trials and equal numbers: no mistake
            return _numbered(table, table["time"].to_numpy())
    return _numbered(table, time_s)


def _numbered(table: pd.DataFrame, time_s: Array | None, step_ms: float = 1.0) -> Readings:
    """Return the readings of a table with log-likelihoods, by time, or else by step."""
    keys = [name for name in KEYS if name in table.columns]
    if time_s is not None:
        by = [table[name].map(_text) for name in keys]
        place = pd.Series(time_s).groupby(by, sort=False)
        table = table.assign(step=place.rank(method="first").astype(int))
        twice = pd.DataFrame({"t": time_s}).assign(**dict(zip(keys, by, strict=True))).duplicated()
        refuse(twice.to_numpy(), table["time"], "given once for each reading of a trial")
    trials = trials_from_table(table, step_ms=step_ms)
    evidence, first = trials.evidence, trials.columns["row"].to_numpy()
    values = np.asarray(evidence.log_likelihood, dtype=np.float64)
    who = table["participant_id"] if "participant_id" in keys else None
    ids = [("" if who is None else _text(who[k]), _text(table["trial"][k])) for k in first]
    read = np.arange(evidence.steps) < evidence.readings[:, None]
    when = np.where(read, step_ms / 1000 * (1.0 + np.arange(evidence.steps)), np.inf)
    if time_s is not None:
        # Numbered as in ``trials_from_table``: in the order of their first rows.
        code = table.groupby(keys, sort=False).ngroup().to_numpy()
        when[code, table["step"].to_numpy() - 1] = time_s
    return Readings(ids, values, when, np.asarray(evidence.readings), tuple(trials.names))


def _of_cues(table: pd.DataFrame) -> pd.DataFrame:
    """Return one row per reading, with log-likelihoods, from one row per cue."""
    if not {"side", "value"} & set(table.columns):
        raise InputError(f"evidence needs the columns {FORMS}", "evidence")
    value = numbers(table["value"]) if "value" in table else np.ones(len(table))
    if "value" in table:
        refuse(np.isnan(value), table["value"], "given for every cue")
    if "side" in table:
        side = np.array([_text(each) for each in table["side"]])
        refuse((side == "") | (side == "nan"), table["side"], "given for every cue")
        names = sorted(set(side.tolist()))
        said = "cues must be on two sides or more, or have a sign and no side"
        if len(names) < 2:
            raise InputError(f"{said}; got side {', '.join(names)} only", "side")
        given = np.array(names) == side[:, None]
        if (value < 0).any():
            DataWarning.warn(
                f"{(value < 0).sum()} cues have a side and a value below 0, and count against that "
                "side: leave side out if the sign of value says which side is favoured"
            )
        columns = np.where(given, value[:, None], 0.0)
    else:
        names, columns = list(SIGNED), np.stack([-value / 2, value / 2], axis=1)
    keys = [name for name in KEYS if name in table.columns]
    likely = pd.DataFrame(columns, columns=[f"ll_{name}" for name in names])
    both = pd.concat([table[[*keys, "time"]], likely], axis=1)
    return both.groupby([*keys, "time"], sort=False, as_index=False).sum()


def _table(source: Source, field: str) -> tuple[str, pd.DataFrame]:
    """Return the name of a source and its table."""
    if isinstance(source, pd.DataFrame):
        return "a table", with_index(source)
    path = path_of(source, field)
    with _within(path.name, field):
        return path.name, read_rows(path).reset_index(drop=True)


@contextmanager
def _within(name: str, field: str) -> Iterator[None]:
    """Put the name of a table before the messages of errors in it."""
    try:
        yield
    except ValueError as error:
        raise within(name, error, field) from None


def _read_evidence(source: Source, step_ms: float | None, participant: str | None) -> Readings:
    """Return the readings of a source; those of one participant if it names participants."""
    if isinstance(source, pd.DataFrame):
        name, table = "the evidence", source.reset_index(drop=True)
    else:
        path = path_of(source, "evidence")
        name = path.name
        # Numbers stay as written, so that ids match.
        plain = path.suffix in SEPARATORS and path.is_file()
        table = read_csv_table(path) if plain else _table(path, "evidence")[1]
    if participant is not None and "participant_id" in table:
        table = table[table["participant_id"].map(_text) == participant].reset_index(drop=True)
    with _within(name, "evidence"):
        return readings_of(table, step_ms)


def _matched(table: pd.DataFrame, readings: Readings) -> npt.NDArray[np.intp]:
    """Return the index of each trial's readings; ValueError for trials without any."""
    person = any(who for who, _ in readings.ids) and "participant_id" in table
    if not person and len({trial for _, trial in readings.ids}) < len(readings.ids):
        said = "several participants share ids of trials: both tables need participant_id"
        raise InputError(f"in the evidence, {said}", "participant_id")
    place = {each if person else ("", each[1]): k for k, each in enumerate(readings.ids)}
    who = table["participant_id"].map(_text) if person else [""] * len(table)
    keys = [(str(p), _text(t)) for p, t in zip(who, table["trial"], strict=True)]
    twice = next((key for k, key in enumerate(keys) if key in set(keys[:k])), None)
    if len(set(keys)) < len(keys) and twice is not None:
        raise InputError(f"each trial may occur once, got trial {twice[1]} twice", "trial")
    lacking = [trial for *_, trial in (key for key in keys if key not in place)]
    if lacking:
        count = f" ({len(lacking)} such trials)" if len(lacking) > 1 else ""
        raise InputError(
            f"every trial needs readings in the evidence, got none for trial {lacking[0]}{count}",
            "evidence",
        )
    spare = len(place) - len(keys)
    if spare and not (person is False and "participant_id" in table):
        DataWarning.warn(f"the evidence has {spare} trials that are not in the table of trials")
    return np.array([place[key] for key in keys], dtype=np.intp)


def _choices(
    column: pd.Series, missing: npt.NDArray[np.bool_], names: Sequence[str], upper: str | None
) -> Integers:
    """Return the index of each response among the alternatives, -1 without a response."""
    said = np.array([_text(each) for each in column], dtype=object)
    if upper is not None:
        if len(names) != 2 or upper not in names:
            must = f"must be one of two alternatives of the evidence, {', '.join(names)}"
            raise InputError.of("upper", must, upper)
        other = next(name for name in names if name != upper)
        said = np.array([{"1": upper, "0": other}.get(each, each) for each in said], dtype=object)
    known = np.isin(said, list(names))
    empty = np.isin(said, ["", "nan", "NA", "None", "<NA>"])
    hint = ": name the alternative that is coded as 1 (upper)" if len(names) == 2 else ""
    refuse(~known & ~(empty & missing), column, f"one of {', '.join(names)}", hint)
    index = pd.Index(list(names)).get_indexer(pd.Index(said))
    return np.where(missing, -1, index).astype(np.int64)


def _text(value: object) -> str:
    """Return an id or a name as written; 1.0, from a column with empty cells, is 1."""
    text = str(value)
    return text[:-2] if PLAIN_FLOAT.fullmatch(text) else text

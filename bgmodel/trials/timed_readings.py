"""The readings of each trial and their times: log-likelihoods, or cues, pulses and clicks."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.support.checks import check_positive, path_of
from bgmodel.trials.cautions import ENOUGH
from bgmodel.trials.columns import names_once, numbers, refuse
from bgmodel.trials.evidence_table import KEYS, read_csv_table, trials_from_table
from bgmodel.trials.files import SEPARATORS, read_rows
from circuits.arrays import Array, Integers, Truths
from circuits.errors import DataWarning, InputError, collected, owned, quiet, within

FORMS = (
    "trial, step and ll_<alternative>; trial, time (s) and ll_<alternative>; or one row per cue "
    "with trial, time (s) and side or value"
)
PLAIN_FLOAT = re.compile(r"-?(0|[1-9]\d*)\.0")
"""A whole number as a column of floating-point numbers has it; ids such as 01 are none."""
SIGNED = ("0", "1")
"""Alternatives of cues that have a sign and no side: a positive value favours response 1."""
MOST_ERRORS = 4.0
"""Standard errors above chance from which responses are taken to be exchanged, or to belong to the
readings of another trial."""
CHANCE, RELIED = 2.0, 50
"""Standard errors above chance up to which responses do not show that they follow the readings, and
the number of responses required for a warning."""
LONGEST_TRIAL = 50.0
"""Readings of most trials may last this many times as long as the slowest response, so that they
are not in milliseconds."""
Source = str | Path | pd.DataFrame


@dataclass(frozen=True, eq=False)
class Readings:
    """The readings of each trial, and the alternatives that they are evidence for."""

    ids: list[tuple[str, str]]  # participant, empty if the table has none, and trial, as text
    # (trials, readings, alternatives), nats, up to a constant; 0 after a trial's last reading
    log_likelihood: Array
    time_s: Array  # (trials, readings), on the clock of the responses; infinite after the last
    lengths: Integers  # (trials,), readings of each trial
    names: tuple[str, ...]  # the alternatives
    choice: Integers | None = None  # (trials,), index of the alternative; -1 without a response
    forced: bool = False  # whether the last reading of a trial forces a response
    assumed: bool = False  # whether cues came without a value and count 1 nat each

    def where(self, mask: Truths | Integers) -> Readings:
        """Return the readings of some trials."""
        places = np.arange(len(self.ids))[mask]
        return replace(
            self, ids=[self.ids[k] for k in places], log_likelihood=self.log_likelihood[places],
            time_s=self.time_s[places], lengths=self.lengths[places],
            choice=None if self.choice is None else self.choice[places],
        )  # fmt: skip


def read_readings(
    evidence: Source, step_ms: float | None = None, people: Sequence[str] | None = None,
    person: str | None = None,
) -> Readings:  # fmt: skip
    """Read the readings of each trial; those of some people if the table names participants.

    The table has trial, step and ``ll_<alternative>``; or ``time``, s, instead of step; or one row
    per cue: trial, time, ``side`` and ``value``, its log likelihood ratio (by default 1; signed
    without side). Cues at the same time are added to one reading. The column ``person`` is
    taken as participant_id where no column has this name.
    """
    if isinstance(evidence, pd.DataFrame):
        name, table = "the evidence", evidence.reset_index(drop=True)
    else:
        path = path_of(evidence, "evidence")
        name = path.name
        # Numbers stay as written, so that ids match.
        plain = path.suffix in SEPARATORS and path.is_file()
        table = read_csv_table(path) if plain else read_rows(path).reset_index(drop=True)
    if person is not None and "participant_id" not in table:
        table = table.rename(columns={person: "participant_id"})
    if people is not None and "participant_id" in table:
        table = table[table["participant_id"].map(as_written).isin(people)].reset_index(drop=True)
    try:
        return readings_of(table, step_ms)
    except ValueError as error:
        raise within(name, error, "evidence") from None


def answered(
    readings: Readings, table: pd.DataFrame, who: Sequence[str], rt_s: Array, missing: Truths,
    upper: str | None,
) -> Readings:  # fmt: skip
    """Return the readings of the rows of a table of trials, with the chosen alternatives.

    ``upper`` is the alternative coded as response 1. Refuses trials without readings, unknown
    responses, and those against the evidence; warns of readings of other trials.
    """
    matched = readings.where(_matched(table, readings))
    choice = _choices(table["response"], missing, readings.names, upper)
    matched = replace(matched, choice=choice)
    _check_clock(matched, rt_s)
    people = np.unique(np.asarray(who)).tolist()
    for person in people:
        mine, owner = np.asarray(who) == person, f"participant {person}" * (len(people) > 1)
        with owned(owner, "response", InputError), collected(DataWarning) as doubts:
            _check_sides(matched.where(mine), rt_s[mine])
        for doubt in doubts:
            DataWarning.warn(f"{owner}: {doubt}" if owner else doubt)
    return matched


def _check_clock(readings: Readings, rt_s: Array) -> None:
    """Refuse readings that all come after the responses, or that last in another unit."""
    timed = np.isfinite(rt_s)
    if timed.sum() < ENOUGH:
        return
    first_s, slowest_s = readings.time_s.min(axis=1), rt_s[timed].max()
    time_s = readings.time_s
    last_s = np.median(np.where(np.isfinite(time_s), time_s, 0.0).max(axis=1))
    if (first_s >= rt_s)[timed].all():
        where = f"no response comes after a reading: the first is at {first_s[timed].min():.3g} s"
    elif last_s > LONGEST_TRIAL * slowest_s:
        where = f"readings of most trials end after {last_s:.3g} s or later"
    else:
        return
    advice = "Is time in s, and step_ms in ms?"
    raise InputError(f"{where}, the last response at {slowest_s:.3g} s. {advice}", "time")


def seen_sums(readings: Readings, rt_s: Array) -> Array:
    """Return the sum of the readings before each response, or of all, (trials, alternatives)."""
    until_s = np.where(np.isnan(rt_s), np.inf, rt_s)
    before = readings.time_s < until_s[:, None]
    return np.asarray(np.where(before[:, :, None], readings.log_likelihood, 0.0).sum(axis=1))


def _check_sides(readings: Readings, rt_s: Array) -> None:
    choice, seen = readings.choice, seen_sums(readings, rt_s)
    assert choice is not None
    best, chosen = seen.max(axis=1), np.take_along_axis(seen, np.maximum(choice, 0)[:, None], 1)
    told = (choice >= 0) & (best > seen.min(axis=1))
    against = int((chosen[told, 0] == seen[told].min(axis=1)).sum())
    chance = told.sum() / len(readings.names)
    if told.sum() >= ENOUGH and against > chance + MOST_ERRORS * np.sqrt(chance):
        raise InputError(
            f"response must agree with the evidence: {against} of {told.sum()} responses are the "
            "alternative that the readings before them speak against most. Are the names of the "
            "alternatives exchanged (upper), or the signs of values?",
            "response",
        )
    _check_pairs(readings, rt_s)


def _check_pairs(readings: Readings, rt_s: Array) -> None:
    """Refuse responses that follow the readings of the trial before or after; warn of chance."""
    assert readings.choice is not None
    responses = int((readings.choice >= 0).sum())
    own = _above_chance(readings, readings, rt_s) if responses >= ENOUGH else np.inf
    if own > CHANCE:
        return
    ids = pd.to_numeric(pd.Series([trial for _, trial in readings.ids]), errors="coerce")
    order = np.argsort(ids.to_numpy(), kind="stable") if ids.notna().all() else np.arange(len(ids))
    chosen, rt_s = readings.where(order), rt_s[order]
    for by, which in ((-1, "after"), (1, "before")):
        z = _above_chance(chosen.where(np.roll(np.arange(len(order)), by)), chosen, rt_s)
        if z > MOST_ERRORS:
            raise InputError(
                f"trial must be the same in both tables: responses follow the readings of the "
                f"trial {which} their own ({z:.1f} standard errors above chance, but {own:.1f} "
                "with their own). Do ids count from 0 in one table and from 1 in the other? "
                "If not, these responses do not follow the readings: leave the trials out",
                "trial",
            )
    if responses >= RELIED:
        DataWarning.warn(
            f"responses follow the readings before them no more often than by chance ({own:.1f} "
            f"standard errors, {responses} responses): check that trial is the same in both tables"
        )


def _above_chance(readings: Readings, chosen: Readings, rt_s: Array) -> float:
    """Return the correlation of choices with the final posterior, in standard errors."""
    assert chosen.choice is not None
    some = chosen.choice >= 0
    seen = seen_sums(readings, rt_s)[some]
    posterior = np.exp(seen - np.logaddexp.reduce(seen, axis=1, keepdims=True))
    made = np.eye(seen.shape[1])[chosen.choice[some]]
    off, made = (each - each.mean(axis=0) for each in (posterior, made))
    variance = float((off.T @ off * (made.T @ made)).sum()) / max(len(off), 1)
    return float((off * made).sum() / np.sqrt(variance)) if variance > 0 else np.inf


def readings_of(table: pd.DataFrame, step_ms: float | None = None) -> Readings:
    """Return the readings of a table of evidence; forms and errors as for ``read_readings``."""
    names = names_once(table.columns)
    table = table.set_axis(names, axis=1).reset_index(drop=True)
    if "trial" not in names or not {"step", "time"} & set(names):
        raise InputError(f"evidence needs the columns {FORMS}; got {', '.join(names)}", "evidence")
    if "step" in names:
        if step_ms is None:
            hint = (
                "give the time between them, step_ms, ms (--evidence FILE step_ms= at a terminal)"
            )
            raise InputError(f"the evidence has steps instead of times: {hint}", "step_ms")
        check_positive(step_ms=step_ms)
        return _numbered(table, None, step_ms)
    if step_ms is not None:
        raise InputError("the evidence has times: leave step_ms out", "step_ms", step_ms)
    time_s = numbers(table["time"])
    refuse(np.isnan(time_s) | (time_s < 0), table["time"], "0 s or later")
    if not any(name.startswith("ll_") for name in names):
        table = _of_cues(table.assign(time=time_s))
        with quiet():  # cues of one value make equal trials and equal numbers: no mistake
            read = _numbered(table, table["time"].to_numpy())
        return replace(read, assumed="value" not in names)
    return _numbered(table, time_s)


def _numbered(table: pd.DataFrame, time_s: Array | None, step_ms: float = 1.0) -> Readings:
    """Return the readings of a table with log-likelihoods, by time, or else by step."""
    keys = [name for name in KEYS if name in table.columns]
    if time_s is not None:
        by = [table[name].map(as_written) for name in keys]
        place = pd.Series(time_s).groupby(by, sort=False)
        table = table.assign(step=place.rank(method="first").astype(int))
        twice = pd.DataFrame({"t": time_s}).assign(**dict(zip(keys, by, strict=True))).duplicated()
        refuse(twice.to_numpy(), table["time"], "given once for each reading of a trial")
    trials = trials_from_table(table, step_ms=step_ms, shared=True)
    evidence, first = trials.evidence, trials.columns["row"].to_numpy()
    values = np.asarray(evidence.log_likelihood, dtype=np.float64)
    who = table["participant_id"] if "participant_id" in keys else None
    ids = [
        ("" if who is None else as_written(who[k]), as_written(table["trial"][k])) for k in first
    ]
    read = np.arange(evidence.steps) < evidence.readings[:, None]
    when = np.where(read, step_ms / 1000 * (1.0 + np.arange(evidence.steps)), np.inf)
    if time_s is not None:
        # Numbered as in ``trials_from_table``: in the order of their first rows.
        code = table.groupby(keys, sort=False).ngroup().to_numpy()
        when[code, table["step"].to_numpy() - 1] = time_s
    return Readings(ids, values, when, np.asarray(evidence.readings), tuple(trials.names))


def _of_cues(table: pd.DataFrame) -> pd.DataFrame:
    if not {"side", "value"} & set(table.columns):
        raise InputError(f"evidence needs the columns {FORMS}", "evidence")
    value = numbers(table["value"]) if "value" in table else np.ones(len(table))
    if "value" in table:
        refuse(np.isnan(value), table["value"], "given for every cue")
    if "side" in table:
        side = np.array([as_written(each) for each in table["side"]])
        refuse((side == "") | (side == "nan"), table["side"], "given for every cue")
        names = sorted(set(side.tolist()))
        must = "cues must be on two sides or more, or have a sign and no side"
        if len(names) < 2:
            raise InputError(f"{must}; got side {', '.join(names)} only", "side")
        on_side = np.array(names) == side[:, None]
        if (value < 0).any():
            DataWarning.warn(
                f"{(value < 0).sum()} cues have a side and a value below 0, and count against that "
                "side: leave side out if the sign of value says which side is favoured"
            )
        columns = np.where(on_side, value[:, None], 0.0)
    else:
        names, columns = list(SIGNED), np.stack([-value / 2, value / 2], axis=1)
    keys = [name for name in KEYS if name in table.columns]
    likely = pd.DataFrame(columns, columns=[f"ll_{name}" for name in names])
    both = pd.concat([table[[*keys, "time"]], likely], axis=1)
    return both.groupby([*keys, "time"], sort=False, as_index=False).sum()


def _matched(table: pd.DataFrame, readings: Readings) -> npt.NDArray[np.intp]:
    person = any(who for who, _ in readings.ids) and "participant_id" in table
    if not person and len({trial for _, trial in readings.ids}) < len(readings.ids):
        problem = "several participants share ids of trials: both tables need participant_id"
        raise InputError(f"in the evidence, {problem}", "participant_id")
    place = {each if person else ("", each[1]): k for k, each in enumerate(readings.ids)}
    who = table["participant_id"].map(as_written) if person else [""] * len(table)
    keys = [(str(p), as_written(t)) for p, t in zip(who, table["trial"], strict=True)]
    twice = pd.Series(keys, dtype=object).duplicated()
    if twice.any():
        first = keys[int(twice.argmax())][1]
        raise InputError(f"each trial may occur once, got trial {first} twice", "trial")
    lacking = [trial for *_, trial in (key for key in keys if key not in place)]
    if lacking:
        count = f" ({len(lacking)} such trials)" if len(lacking) > 1 else ""
        first = ", ".join(lacking[:3])
        raise InputError(
            f"every trial needs readings in the evidence, got none for trial {first}{count}",
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
    texts = np.array([as_written(each) for each in column], dtype=object)
    if upper is not None:
        if len(names) != 2 or upper not in names:
            must = f"must be one of two alternatives of the evidence, {', '.join(names)}"
            raise InputError.of("upper", must, upper)
        other = next(name for name in names if name != upper)
        texts = np.array([{"1": upper, "0": other}.get(each, each) for each in texts], dtype=object)
    known = np.isin(texts, list(names))
    empty = np.isin(texts, ["", "nan", "NA", "None", "<NA>"])
    wrong = ~known & ~(empty & missing)
    coded = len(names) == 2 and set(texts[wrong]) <= {"0", "1"}
    hint = ": name the alternative that is coded as 1 (upper)" if coded else ""
    refuse(wrong, column, f"one of {', '.join(names)}", hint)
    index = pd.Index(list(names)).get_indexer(pd.Index(texts))
    return np.where(missing, -1, index).astype(np.int64)


def as_written(value: object) -> str:
    """Return an id or a name as written; 1.0, from a column with empty cells, is 1."""
    text = str(value)
    return text[:-2] if PLAIN_FLOAT.fullmatch(text) else text

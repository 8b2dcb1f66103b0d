"""The reader of trials: tables, files, BIDS events, shipped sets; one set of guards for all."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.support.checks import Problems, check_flag, check_positive, check_unused, path_of
from bgmodel.trials import alternatives as several
from bgmodel.trials.cautions import (
    LEAST_RIGHT,
    check_deadline,
    check_no_stops,
    check_one_unit,
    check_signs,
    check_times,
    warn_of_abrupt,
    warn_of_copies,
    warn_of_far,
    warn_of_mixed_units,
    warn_of_order,
    warn_of_twins,
    warn_of_units,
    warn_without_strength,
    without_rounding,
)
from bgmodel.trials.columns import (
    FEWEST,
    NO_RESPONSE,
    UNITS,
    Someone,
    check_alike,
    check_answers,
    check_both,
    check_columns,
    check_people,
    code,
    delays,
    levels,
    names_of,
    of_participant,
    participants,
    refuse,
    responses,
    rows,
    silent,
    strengths,
    times,
    with_index,
    with_times,
    withholding,
)
from bgmodel.trials.events import is_events, read_events, restored_delays
from bgmodel.trials.files import CELLS_SET, SETS, STOP_SET, read_rows, renamed, shipped_table
from bgmodel.trials.record import Trials, is_covariate
from bgmodel.trials.spikes import clicks_of, in_sessions, is_nwb, read_nwb, spikes_of
from bgmodel.trials.timed_readings import Source, answered, read_readings, seen_sums
from circuits.arrays import Array, Truths
from circuits.errors import DataWarning, InputError, collected, require, within

MOST_AT_ZERO, FEWEST_AT_ZERO = 0.9, 5
"""If there are at least 5 stop trials with a delay of 0, and more than 0.9 of them have a response,
these delays are probably missing."""
READ = (*SETS, STOP_SET, CELLS_SET)
"""Shipped sets of trials, by name."""
OUR_NAMES = re.compile(
    r"(?<![\w=.'])(?:(?P<rt>rt)|(?P<ssd>ssd)|(?P<participant>participant_id)|(?P<response>"
    r"response(?= must| holds| and | empty)|(?<=rt, )response|(?<=rt and )response))(?![\w=.'])"
)
"""Our columns in messages, where they are no argument such as ``rt=`` and "response" no noun."""
SECONDS = re.compile(r"(?<![\w.'])([1-9]\d*|\d+\.\d+)(e-?\d+)? s\b|\bin seconds\b")
"""A time in messages, which is not 0."""


@dataclass(frozen=True, kw_only=True)
class Columns:
    """How a table of trials is read: names of its columns, their units and codes.

    Names are needed only where the table does not have ours, which are given in parentheses.

    Parameters
    ----------
    rt, response, participant : str, optional
        Columns of times (rt), of responses (response) and of participants (participant_id).
    ssd : str, optional
        Column of stop-signal delays, empty in go trials (ssd).
    trial_type : str, optional
        Column that tells go from stop trials in BIDS events.
    rt_unit : str
        Unit of rt and ssd: s or ms.
    upper : str, optional
        The response that counts as 1, if responses are two names instead of 1 and 0.
    stimulus : str, optional
        Column of the correct alternative, in the words of the responses. A response is then coded
        1 if it is correct and 0 if it is wrong, whichever of the others it is.
    alternatives : int, optional
        Number of alternatives, 2 to 12, if it is more than 2 and neither a column ``alternatives``
        nor ``stimulus`` gives it.
    deadline_s : float, optional
        Time at which a trial without a response ended, s.
    withheld : str, optional
        The response that is given by waiting until ``deadline_s``, as "no" in a go/no-go task;
        rows without a response are this one.
    restore_delays : bool
        Whether stop-signal delays of exactly 0 are missing, and are inferred from the staircases
        (``trials.restored``). Otherwise they are kept, with a warning if they look missing.
    """

    rt: str | None = None
    response: str | None = None
    participant: str | None = None
    ssd: str | None = None
    trial_type: str | None = None
    rt_unit: str = "s"
    upper: str | None = None
    stimulus: str | None = None
    alternatives: int | None = None
    deadline_s: float | None = None
    withheld: str | None = None
    restore_delays: bool = False

    def __post_init__(self) -> None:
        for name in ("rt", "response", "participant", "ssd", "trial_type", "stimulus"):
            text = getattr(self, name)
            named = text is None or isinstance(text, str)
            require(named, name, "must be the name of a column", text)
        for name in ("upper", "withheld"):
            text = getattr(self, name)
            named = text is None or isinstance(text, str)
            require(named, name, "must be the name of a response, as text", text)
        known = isinstance(self.rt_unit, str) and self.rt_unit in UNITS
        require(known, "rt_unit", f"must be one of {', '.join(UNITS)}", self.rt_unit)
        check_flag("restore_delays", self.restore_delays)
        if self.alternatives is not None:
            several.check_number(self.alternatives)
        if self.deadline_s is not None:
            check_positive(deadline_s=self.deadline_s)
        if self.withheld is not None:
            must = "must be given, s, if a response is given by waiting until then"
            require(self.deadline_s is not None, "deadline_s", must, None)
            for name in ("stimulus", "alternatives"):
                without = "has no meaning if a response is withheld: code stimuli by strengths"
                require(getattr(self, name) is None, name, without, getattr(self, name))

    @contextmanager
    def told(self, names: Iterable[str]) -> Iterator[None]:
        """Say errors and warnings about our columns in the names and the unit of the table.

        Names of the table that only contain one of ours are left alone.
        """
        held = [each for each in names if OUR_NAMES.search(each) and not OUR_NAMES.fullmatch(each)]
        longest = sorted(map(re.escape, held), key=len, reverse=True)
        ours = re.compile("|".join([*longest, OUR_NAMES.pattern]))
        doubts: list[str] = []
        try:
            with collected(DataWarning) as doubts:
                yield
        except ValueError as error:
            known = within("", error, "source")
            raise InputError(self._said(str(known), ours), known.field, known.given) from None
        finally:
            for doubt in doubts:
                DataWarning.warn(self._said(doubt, ours))

    def _said(self, message: str, ours: re.Pattern[str]) -> str:
        """Return a message in the names and the unit of the table."""
        message = ours.sub(lambda m: getattr(self, m.lastgroup or "", None) or m[0], message)
        if self.rt_unit == "s":
            return message
        return SECONDS.sub(
            lambda m: f"{1000 * float(m[0][:-2]):g} ms" if m[1] else "in ms", message
        )


OURS = Columns()


def read_trials(
    source: str | Path | pd.DataFrame,
    *,
    strength: str | None = None,
    conditions: str | Sequence[str] = (),
    participant: Someone = None,
    columns: Columns = OURS,
    evidence: Source | None = None,
    step_ms: float | None = None,
    forced: bool = False,
    spikes: Source | None = None,
) -> Trials:
    """Read a table of trials; none is left out.

    The columns say what kind of trials they are. With ``ssd`` they are stop-signal trials; with
    ``pair`` and ``reward`` they are choices between the items of a pair that are rewarded; others
    are choices and their times. With ``evidence`` the readings of each trial are known, and with
    ``spikes`` those of recorded cells as well.

    Strengths that differ by less than a millionth are merged, with a warning. Other warnings report
    possible errors: units of time, a deadline far beyond all responses, coarse times,
    anticipations, many times exactly equal to the longest, duplicate rows, two participants with
    the same trials, names that differ only in capitals, a strength far beyond all others, a column
    that may hold the strength, and stop-signal delays that are probably missing.

    Parameters
    ----------
    source : path, str or DataFrame
        ``.csv``, ``.tsv`` or ``.parquet``, the name of a shipped set, a folder or file of BIDS
        events with stop signals, or a table with one row per trial: ``rt``, s from the onset of
        evidence, and ``response``, 1 or 0; optionally ``participant_id``, without which all trials
        belong to one participant, "all". A trial without a response has neither ``rt`` nor
        ``response``; if no trial has ``rt``, choices alone are read. If ``rt`` is -999, as written
        for HSSM, ``response`` is ignored. Tables of HSSM (responses 1 and -1) and of PyDDM
        (columns RT and choice) are recognised. Stop-signal
        trials have ``ssd``, s, in stop trials, and are correct where a column ``correct`` is 1
        rather than 0, or else where ``stimulus`` and ``response`` are equal, if there are these.
        With rewards, response 1 is the item of the pair that is rewarded more often. With evidence
        there are ``trial`` and, as ``response``, the name of an alternative.
    strength : str, optional
        Column of the signed strength of the evidence; positive favours response 1.
    conditions : names
        Columns of conditions, read as text.
    participant : str, or sequence of str, optional
        The participant whose trials are read, or several; all by default.
    columns : Columns
        Names, units and codes of the columns, if they are not ours.
    evidence : path or DataFrame, optional
        The readings of each trial; see ``timed_readings.read_readings`` for its forms.
    step_ms : float, optional
        Time between readings, ms, if the evidence has steps instead of times.
    forced : bool
        Whether the last reading of a trial forces a response.
    spikes : path or DataFrame, optional
        One row per spike: ``cell``, ``trial``, ``time_s`` (s from the onset of the trial) and, if
        the table of trials has it too, ``session``. ``rt`` is then the time at which the evidence
        ended, and clicks may be columns of lists of times, such as ``left_s`` and ``right_s``. An
        .nwb file as ``source`` has trials and spikes.

    Returns
    -------
    Trials
        The trials, in the order of the table.

    Raises
    ------
    ValueError
        With the name of the source and, for a wrong value, its column, value and row, counted
        from 0; problems of several columns are in one message.
    """
    require(isinstance(columns, Columns), "columns", "must be Columns(...)", columns)
    check_flag("forced", forced)
    for option, is_given in (("step_ms", step_ms is not None), ("forced", forced)):
        require(not is_given or evidence is not None, option, "needs evidence", "none")
    if not isinstance(conditions, (str, list, tuple)):
        raise InputError.of("conditions", "must be names of columns", conditions)
    wanted = [conditions] if isinstance(conditions, str) else list(conditions)
    name, table, spikes = _tables(source, columns, spikes)
    try:
        roles = (columns.rt, columns.response, columns.participant, columns.ssd)
        further = (strength, columns.stimulus, *wanted)
        both = [each for each in further if isinstance(each, str) and each in roles]
        require(not both, "columns", "must be named once each", both)
        named = {"rt": columns.rt, "response": columns.response}
        if evidence is None:
            named["ssd"] = columns.ssd
        table = renamed(table, **named, participant=columns.participant)
        with columns.told(map(str, table)):
            if spikes is not None:
                table = in_sessions(table)
                evidence = clicks_of(table) if evidence is None else evidence
            if evidence is not None:
                _check_effect("known evidence", columns, strength)
                asked = (evidence, step_ms, forced)
                trials = _known(table, wanted, participant, columns, asked, spikes)
            elif "ssd" in table:
                _check_effect("stop-signal trials", columns, strength)
                trials = _stop_signals(table, wanted, participant, columns)
            elif {"pair", "reward"} <= set(table):
                _check_effect("rewarded choices", columns, strength)
                trials = _rewarded(table, wanted, participant, columns)
            else:
                _check_effect("choices", columns, strength)
                trials = _choices(table, strength, wanted, participant, columns)
    except ValueError as error:
        raise within(name, error, "source") from None
    return replace(trials, source=name)


NAMES = {"rt", "response", "participant", "rt_unit"}
OF_CHOICES = {"upper", "stimulus", "alternatives", "deadline_s", "withheld", "strength"}
USED = {
    "choices": NAMES | OF_CHOICES,
    "stop-signal trials": NAMES | {"ssd", "trial_type", "deadline_s", "restore_delays"},
    "rewarded choices": NAMES,
    "known evidence": NAMES | {"upper"},
}
"""Settings that have an effect on each kind of trials, with spikes or without."""


def _check_effect(kind: str, columns: Columns, strength: str | None) -> None:
    """Raise ValueError for a setting without effect on a kind of trials."""
    check_unused(columns, {each.name for each in fields(columns)} - USED[kind], f"on {kind}")
    if strength is not None and "strength" not in USED[kind]:
        raise InputError(f"strength has no effect on {kind}: leave it out", "strength")


def _choices(
    table: pd.DataFrame, strength: str | None, wanted: list[str], participant: Someone,
    columns: Columns,
) -> Trials:  # fmt: skip
    stimulus, upper = columns.stimulus, columns.upper
    used = [each for each in (*wanted, strength, stimulus) if each is not None]
    check_no_stops(table)
    table, timed = with_times(table)
    table = rows(table, used, participant)
    warn_of_copies(table, used)
    problems, held, withheld = Problems(), {}, None
    with problems.caught():
        rt_s = times(table["rt"], columns.rt_unit)
    with problems.caught():
        number = several.number_of(table, columns.alternatives, stimulus)
        if columns.withheld is not None:
            chosen, withheld = withholding(table, columns.withheld, upper)
        elif stimulus is None:
            chosen = responses(table["response"], table["rt"], upper)
        else:
            require(upper is None, "upper", "has no effect with stimulus: leave it out", upper)
            chosen = several.correctness(table, stimulus)
    signed = None
    if strength is not None:
        with problems.caught():
            signed = without_rounding(strengths(table[strength]))
    for column in wanted:
        with problems.caught():
            held[column] = levels(table[column])
    problems.refuse()
    if timed:
        answers = np.where(chosen == withheld, NO_RESPONSE, chosen).astype(np.int8)
        check_answers(table, rt_s, answers, columns.deadline_s)
    else:
        _check_alone(table, chosen, columns)
    check_times(rt_s)
    warn_of_mixed_units(rt_s, participants(table))
    if columns.deadline_s is not None:
        check_deadline(rt_s, columns.deadline_s)
    if signed is not None:
        warn_of_far(signed)
        warn_of_units(signed)
    trials = Trials(
        participants(table), rt_s, chosen, signed, pd.DataFrame(held, index=range(len(table))),
        columns.deadline_s, alternatives=number, withheld=withheld,
    )  # fmt: skip
    warn_of_twins(trials.participant, rt_s, chosen)
    _check_cells(trials)
    _check_both_chosen(trials)
    if number == 2:
        check_signs(signed, chosen)
    if strength is None:
        warn_without_strength(table, [*used, several.COLUMN], chosen, number)
    return trials


def _check_alone(table: pd.DataFrame, chosen: npt.NDArray[np.int8], columns: Columns) -> None:
    refuse(chosen == NO_RESPONSE, table["response"], "given in every trial if there are no times")
    for name in ("withheld", "deadline_s"):
        without = "needs times, and all of them are missing"
        require(getattr(columns, name) is None, name, without, getattr(columns, name))


def _others(
    table: pd.DataFrame, needed: list[str], wanted: list[str], participant: Someone,
    columns: Columns,
) -> tuple[pd.DataFrame, npt.NDArray[np.str_], Array, pd.DataFrame]:  # fmt: skip
    """Return the rows, participants, times and conditions of trials with further columns."""
    used = [name for name in (*needed, *wanted) if name != "response"]
    check_columns(table, ["rt", *needed, *wanted])
    check_people(table, used)
    who = participants(table)
    check_alike("participant_id", who)
    warn_of_copies(table, used)
    rt_s = times(table["rt"], columns.rt_unit)
    check_one_unit(rt_s)
    warn_of_mixed_units(rt_s, who)
    held = pd.DataFrame({each: levels(table[each]) for each in wanted}, index=range(len(table)))
    if participant is None:
        return table, who, rt_s, held
    kept = of_participant(participant, who)
    part, conditions = (each[kept].reset_index(drop=True) for each in (table, held))
    return part, who[kept], rt_s[kept], conditions


def _stop_signals(
    table: pd.DataFrame, wanted: list[str], participant: Someone, columns: Columns
) -> Trials:
    table, who, rt_s, held = _others(table, ["ssd"], wanted, participant, columns)
    if "response" in table:
        check_both(table, rt_s, silent(table))
    if columns.deadline_s is not None:
        check_deadline(rt_s, columns.deadline_s)
        late = f"no later than deadline_s, {columns.deadline_s:g} s"
        refuse(rt_s > columns.deadline_s, table["rt"], late)
    ssd_s, correct = delays(table["ssd"], columns.rt_unit), _correct(table, rt_s)
    warn_of_twins(who, rt_s, np.isnan(ssd_s).astype(np.int8))
    warn_of_order(table, who)
    warn_of_abrupt(np.where(np.isnan(ssd_s), rt_s, np.nan), who)
    for each in np.unique(who).tolist():
        if not np.isnan(ssd_s[who == each]).any():
            text = f"ssd must be empty in some trials of {each}, the go trials: it is given in all"
            raise InputError(text, "ssd")
    right = np.ones(len(rt_s), bool) if correct is None else correct
    chosen = np.where(np.isnan(rt_s), NO_RESPONSE, right).astype(np.int8)
    if not columns.restore_delays:
        _warn_of_zeros(rt_s, ssd_s)
    side = None if correct is None else np.ones(len(rt_s))
    trials = Trials(who, rt_s, chosen, side, held, columns.deadline_s, ssd_s=ssd_s)
    return restored_delays(trials) if columns.restore_delays else trials


def _rewarded(
    table: pd.DataFrame, wanted: list[str], participant: Someone, columns: Columns
) -> Trials:
    more = [name for name in wanted if name != "pair"]
    table, timed = with_times(table)
    table, who, rt_s, held = _others(
        table, ["response", "pair", "reward"], more, participant, columns
    )
    held.insert(0, "pair", levels(table["pair"]))
    refuse(timed & np.isnan(rt_s), table["rt"], "given for every trial, or for none")
    response, reward = (code(table[column]) for column in ("response", "reward"))
    warn_of_twins(who, rt_s, response)
    warn_of_order(table, who, held["pair"].to_numpy())
    warn_of_abrupt(rt_s, who)
    better, other = (reward[response == side] for side in (1, 0))
    if len(better) and len(other) and better.mean() < other.mean():
        DataWarning.warn(
            f"response 1, the better item, is rewarded in {better.mean():.0%} of its trials and "
            f"response 0 in {other.mean():.0%}: are the codes exchanged?"
        )
    return Trials(who, rt_s, response, None, held, reward=reward.astype(np.float64))


def _known(
    table: pd.DataFrame, wanted: list[str], participant: Someone, columns: Columns,
    asked: tuple[Source, float | None, bool], spikes: Source | None,
) -> Trials:  # fmt: skip
    table, timed = with_times(table)
    table, who, rt_s, held = _others(table, ["response", "trial"], wanted, participant, columns)
    evidence, step_ms, forced = asked
    asked_for = None if participant is None or "participant_id" not in table else who.tolist()
    unmatched = read_readings(evidence, step_ms, asked_for, columns.participant)
    missing = silent(table)
    if timed:
        check_both(table, rt_s, missing)
    missing |= timed & np.isnan(rt_s)
    matched = answered(unmatched, table, who.tolist(), rt_s, missing, columns.upper)
    readings = replace(matched, forced=forced)
    several.check_number(len(readings.names))
    choice = np.asarray(readings.choice)
    favoured = 1 if len(readings.names) == 2 else seen_sums(readings, rt_s).argmax(axis=1)
    response = np.where(choice < 0, NO_RESPONSE, choice == favoured).astype(np.int8)
    trials = Trials(
        who, rt_s, response, None, held, alternatives=len(readings.names), readings=readings
    )
    if spikes is None:
        return trials
    return replace(trials, spikes=spikes_of(spikes, [trial for _, trial in readings.ids], rt_s))


def _correct(table: pd.DataFrame, rt_s: Array) -> Truths | None:
    """Return which responses are correct; None if the table does not say which are right."""
    answered = np.isfinite(rt_s)
    if "correct" in table:
        correct = np.asarray(code(table["correct"]) == 1)
        hint = "is correct coded as 1?"
    elif {"stimulus", "response"} <= set(table):
        stimulus, response = (names_of(table[name]) for name in ("stimulus", "response"))
        correct = np.asarray(stimulus == response) & ~silent(table[["rt", "response"]])
        hint = "are response and stimulus in the same words? Responses are "
        hint += f"{_some(response[answered])}, stimuli {_some(stimulus)}"
    else:
        return None
    share = float(correct[answered].mean()) if answered.any() else 1.0
    if share < LEAST_RIGHT:
        DataWarning.warn(f"{share:.0%} of responses are correct: {hint}")
    return correct


def _some(names: npt.NDArray[np.object_]) -> str:
    return ", ".join(sorted({str(name) for name in names})[:4])


def _warn_of_zeros(rt_s: Array, ssd_s: Array) -> None:
    at_zero = np.isfinite(rt_s[ssd_s == 0])
    if len(at_zero) >= FEWEST_AT_ZERO and at_zero.mean() > MOST_AT_ZERO:
        DataWarning.warn(
            f"{at_zero.sum()} of {len(at_zero)} stop trials with a delay of 0 have a response: the "
            "signal was probably not given because the response came first. Columns("
            "restore_delays=True), at the terminal --columns restore_delays=true, infers the "
            "delays from the staircases"
        )


def _tables(
    source: str | Path | pd.DataFrame, columns: Columns, spikes: Source | None
) -> tuple[str, pd.DataFrame, Source | None]:
    """Return the name of a source, its table, and the spikes of an .nwb file or those given."""
    if is_nwb(source) and spikes is None:
        path = path_of(str(source), "source")
        return path.name, *read_nwb(path)
    if isinstance(source, str) and source == CELLS_SET and spikes is None:
        spikes = shipped_table(f"{CELLS_SET}_spikes")[0]
    return *_table(source, columns), spikes


def _table(source: str | Path | pd.DataFrame, columns: Columns) -> tuple[str, pd.DataFrame]:
    if isinstance(source, pd.DataFrame):
        return "a table", with_index(source)
    path = path_of(source, "source")
    if str(source) in READ:
        return str(source), shipped_table(str(source))[0]
    if is_events(path):
        named = {name: getattr(columns, name) for name in ("trial_type", "rt", "ssd")}
        events = read_events(path, {n: each for n, each in named.items() if each is not None})
        ours = {ours: theirs for theirs, ours in named.items() if ours is not None}
        return path.name, events.rename(columns={v: k for k, v in ours.items()})
    if not path.suffix:
        must = f"must be a .csv, .tsv or .parquet or one of {', '.join(READ)}"
        raise InputError.of("source", must, str(source))
    return path.name, read_rows(path).reset_index(drop=True)


def _check_cells(choices: Trials) -> None:
    levels = choices.conditions.loc[:, [not is_covariate(c) for _, c in choices.conditions.items()]]
    keys = pd.DataFrame({"participant": choices.participant}).join(levels)
    for _, cell in keys.groupby(list(keys), sort=False):
        if len(cell) < FEWEST:
            named = (f"{name} {cell[name].iloc[0]!r}" for name in cell)
            raise InputError(
                f"each participant needs at least {FEWEST} trials in each condition, got "
                f"{len(cell)} of {', '.join(named)}",
                "participant",
            )


def _check_both_chosen(choices: Trials) -> None:
    for who in choices.people():
        mine = choices.response[choices.participant == who]
        codes = sorted({int(code) for code in mine} - {NO_RESPONSE})
        if len(codes) < 2:
            got = f"{codes[0]} only" if codes else "none"
            kinds = "both" if choices.alternatives == 2 else "correct (1) and wrong (0)"
            raise InputError(
                f"{kinds} responses must occur, got {got} in the {len(mine)} trials of participant "
                f"{who!r}",
                "response",
            )

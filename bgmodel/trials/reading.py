"""The reader of trials: tables, files, shipped sets."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from bgmodel.support.checks import Problems, path_of
from bgmodel.tables import alternatives as several
from bgmodel.tables.cautions import (
    FIT_STOPS,
    check_deadline,
    check_no_stops,
    check_signs,
    check_times,
    warn_of_copies,
    warn_of_far,
    warn_of_mixed_units,
    warn_of_twins,
    warn_of_units,
    warn_without_strength,
    without_rounding,
)
from bgmodel.tables.columns import (
    FEWEST,
    NO_RESPONSE,
    check_answers,
    levels,
    participants,
    responses,
    rows,
    strengths,
    times,
)
from bgmodel.tables.foreign import renamed
from bgmodel.tables.shipped import SETS, STOP_SET, shipped
from bgmodel.tables.text_files import read_rows
from bgmodel.trials.record import Trials
from circuits.errors import InputError, require, within


def read_trials(
    source: str | Path | pd.DataFrame,
    *,
    strength: str | None = None,
    conditions: str | Sequence[str] = (),
    participant: str | None = None,
    deadline_s: float | None = None,
    upper: str | None = None,
    rt: str | None = None,
    response: str | None = None,
    participant_column: str | None = None,
    rt_unit: str = "s",
    alternatives: int | None = None,
    stimulus: str | None = None,
) -> Trials:
    """Read a table of choices and response times; no trial is left out.

    Strengths that differ by less than a millionth are merged, with a warning. Other warnings report
    possible errors: units of time, a deadline far beyond all responses, coarse times,
    anticipations, many times exactly equal to the longest, duplicate rows, two participants with
    the same trials, names that differ only in capitals, a strength far beyond all others, and a
    column that may hold the strength.

    Parameters
    ----------
    source : path, str or DataFrame
        ``.csv``, ``.tsv`` or ``.parquet``, the name of a shipped set, or a table with one row per
        trial: ``rt``, s from the onset of evidence, and ``response``, 1 or 0; optionally
        ``participant_id``, without which all trials belong to one participant, "all". A trial
        without a response has neither ``rt`` nor ``response``; if ``rt`` is -999, as written for
        HSSM, ``response`` is ignored. Tables of HSSM (responses 1 and -1) and of PyDDM (columns RT
        and choice) are recognised.
    strength : str, optional
        Column of the signed strength of the evidence; positive favours response 1.
    conditions : names
        Columns of conditions, read as text.
    participant : str, optional
        The participant whose trials are read; all by default.
    deadline_s : float, optional
        Time at which a trial without a response ended, s.
    upper : str, optional
        The response that counts as 1, if responses are two names instead of 1 and 0.
    rt, response, participant_column : str, optional
        Names of the columns of times, responses and participants, if they have others.
    rt_unit : str
        Unit of the times: s or ms.
    alternatives : int, optional
        Number of alternatives, 2 to 12, if it is more than 2 and neither a column ``alternatives``
        nor ``stimulus`` gives it.
    stimulus : str, optional
        Column of the correct alternative, in the words of the responses. A response is then coded
        1 if it is correct and 0 if it is wrong, whichever of the others it is.

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
    name, table = _table(source)
    if not isinstance(conditions, (str, list, tuple)):
        raise InputError.of("conditions", "must be names of columns", conditions)
    named = stimulus is None or isinstance(stimulus, str)
    require(named, "stimulus", "must be the name of a column", stimulus)
    wanted = [conditions] if isinstance(conditions, str) else list(conditions)
    try:
        used = [each for each in (*wanted, strength, stimulus) if each is not None]
        check_no_stops(table)
        table = renamed(table, rt=rt, response=response, participant_column=participant_column)
        table = rows(table, used, participant)
        warn_of_copies(table, used)
        problems, held = Problems(), {}
        with problems.caught():
            rt_s = times(table["rt"], rt_unit)
        with problems.caught():
            number = several.number_of(table, alternatives, stimulus)
            if stimulus is None:
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
        check_answers(table, rt_s, chosen, deadline_s)
        check_times(rt_s)
        warn_of_mixed_units(rt_s, participants(table))
        if deadline_s is not None:
            check_deadline(rt_s, deadline_s)
        if signed is not None:
            warn_of_far(signed)
            warn_of_units(signed)
        found = Trials(
            participants(table),
            rt_s,
            chosen,
            signed,
            pd.DataFrame(held, index=range(len(table))),
            deadline_s,
            name,
            number,
        )
        warn_of_twins(found.participant, rt_s, chosen)
        _check_cells(found)
        _check_both_chosen(found)
        if number == 2:
            check_signs(signed, chosen)
        if strength is None:
            warn_without_strength(table, [*used, several.COLUMN], chosen, number)
    except ValueError as error:
        raise within(name, error, "source") from None
    return found


def _table(source: str | Path | pd.DataFrame) -> tuple[str, pd.DataFrame]:
    """Return the name of a source and its unchanged table."""
    if isinstance(source, pd.DataFrame):
        return "a table", source
    path = path_of(source, "source")
    if str(source) == STOP_SET:
        raise InputError(f"it holds stop-signal trials, not choices: {FIT_STOPS}", "source")
    if source in SETS:
        return str(source), shipped()[str(source)].table
    if not path.suffix:
        must = f"must be a .csv, .tsv or .parquet or one of {', '.join(SETS)}"
        raise InputError.of("source", must, str(source))
    return path.name, read_rows(path)


def _check_cells(choices: Trials) -> None:
    """Raise ValueError if a participant has too few trials in a condition."""
    keys = pd.DataFrame({"participant": choices.participant}).join(choices.conditions)
    for _, cell in keys.groupby(list(keys), sort=False):
        if len(cell) < FEWEST:
            named = (f"{name} {cell[name].iloc[0]!r}" for name in cell)
            raise InputError(
                f"each participant needs at least {FEWEST} trials in each condition, got "
                f"{len(cell)} of {', '.join(named)}",
                "participant",
            )


def _check_both_chosen(choices: Trials) -> None:
    """Raise ValueError if a participant gave only one of the two responses, or none."""
    for who in choices.people():
        mine = choices.response[choices.participant == who]
        given = sorted({int(code) for code in mine} - {NO_RESPONSE})
        if len(given) < 2:
            got = f"{given[0]} only" if given else "none"
            kinds = "both" if choices.alternatives == 2 else "correct (1) and wrong (0)"
            raise InputError(
                f"{kinds} responses must occur, got {got} in the {len(mine)} trials of participant "
                f"{who!r}",
                "response",
            )

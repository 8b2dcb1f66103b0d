"""Columns of a user's table of choices, as arrays, with one-sentence errors."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Hashable, Iterable, Sequence

import numpy as np
import numpy.typing as npt
import pandas as pd

from circuits.arrays import Array, Truths
from circuits.checks import is_whole
from circuits.errors import DataWarning, InputError, require

MISSING = ("", "NA", "N/A", "<NA>", "n/a", "NaN", "nan", "None", "null")
"""Contents of a cell for a missing number or response."""
NOT_GIVEN = ("NA", "N/A", "n/a", "<NA>", "NaN", "nan")
"""Contents of a cell that are no level of a condition; "None" may well be one."""
MOST_MEDIAN_S = 50.0
"""Longest median time that is accepted as seconds."""
UNITS = {"s": 1.0, "ms": 1e-3}
"""Units of response times, in seconds."""
LEAST_MEDIAN_MS = 20.0
"""Shortest median time that is accepted as milliseconds."""
SLOWEST_DELAY_S = 20.0
"""Largest stop-signal delay that is accepted as seconds."""
LEAST_DELAY_S = 0.005
"""Least longest stop-signal delay that is accepted as milliseconds, s."""
MISSING_RT = -999.0
"""Response time of HSSM for a missing response."""
NO_RESPONSE = -1
FEWEST = 10
"""Least number of trials of a participant in a condition."""
Someone = str | Sequence[str] | None
"""One participant, several, or all."""
EVERYONE = "all"
"""Name of the participant of a table without participants."""
OURS = ("participant_id", "rt", "response")
"""Columns with a meaning."""
PEOPLE = ("subj_idx", "subj_id", "subj", "subject", "subject_id", "participant", "participantid")
"""Names of other tools for ids of participants."""
PERSON = re.compile(
    r"(subj(ect)?|sub|participant|ppt?|person|patient|observer|monkey|animal|rat|mouse|user)s?"
    r"[ _.-]?(id|idx|name|no|nr|num|number|code|index)?|id|pid|sid|name|initials"
)
"""Pattern of names of columns that may hold participants."""
TIME = re.compile(
    r"(.*[ _.-])?(rts?|reaction|responsetimes?|latency|latencies|times?)"
    r"([ _.-]?[(\[]?(time|s|ms|sec|msec)[)\]]?)?"
)
"""Pattern of names of columns that may hold response times."""


def names_once(columns: Iterable[object]) -> list[str]:
    """Return the names of columns as text; ValueError if one occurs twice."""
    names = [str(name) for name in columns]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        listed = ", ".join(map(repr, twice))
        raise InputError(f"each column may occur once, got {listed} twice", "columns")
    return names


def check_spelt(name: str, ours: Sequence[str]) -> None:
    """Raise ValueError for a name that differs from a known one only in spaces and capitals."""
    meant = name.strip().lower()
    if meant in ours and meant != name:
        reason = f"column {name!r} is not {meant!r}: write it so, or rename it"
        raise InputError(reason, meant)


def check_columns(table: pd.DataFrame, wanted: Sequence[str]) -> None:
    """Raise ValueError if a column is missing, duplicated or misspelt, or there are no rows."""
    names = names_once(table.columns)
    for name in names:
        if name.strip().lower() not in names:
            check_spelt(name, OURS)
    held = [] if "participant_id" in names else [n for n in names if n.strip().lower() in PEOPLE]
    if missing := [name for name in wanted if name not in names]:
        hint = ""
        if "response" in missing and "correct" in names:
            hint = "; if correct is 1 or 0, rename it to response and give unsigned strengths"
        if standard := [name for name in missing if name in ("rt", "response")]:
            standard += ["participant"] * bool(held)
            record, words = (end.join(f"{name}=..." for name in standard) for end in (", ", " "))
            hint += f"; name yours: Columns({record}), at the terminal --columns {words}"
        absent = " or ".join(missing)
        reason = f"there is no column {absent}; there are {', '.join(names)}{hint}"
        raise InputError(reason, missing[0])
    if held:
        hint = "seems to hold participants: rename it to participant_id, or name it"
        hint += " (Columns(participant=...), at the terminal --columns participant=)"
        raise InputError(f"column {held[0]!r} {hint}", "participant")
    if len(table) == 0:
        raise InputError("a table of choices needs at least one trial, got 0 rows", "table", table)


def check_people(table: pd.DataFrame, used: Sequence[str]) -> None:
    """Raise ValueError if columns seem to hold participants and none is participant_id."""
    if "participant_id" in table:
        return
    kinds = {
        name: sorted({str(value) for value in table[name]})
        for name in table
        if name not in (*OURS, *used) and PERSON.fullmatch(str(name).strip().lower())
    }
    # More names than participants with enough trials: these identify trials.
    people = {name: k for name, k in kinds.items() if 2 <= len(k) <= len(table) / FEWEST}
    if people:
        each = " and ".join(
            f"{name!r} ({len(k)} values, such as {', '.join(k[:3])})" for name, k in people.items()
        )
        raise InputError(
            f"column {each} may hold participants, whose trials would be pooled: rename it to "
            "participant_id, name it (Columns(participant=...), at the terminal --columns "
            "participant=), or name it as a condition",
            "participant",
        )


def rows(table: pd.DataFrame, wanted: list[str], participant: Someone) -> pd.DataFrame:
    """Return the rows of some participants or of all, indexed by row number."""
    for name in wanted:
        is_name = isinstance(name, str)
        require(is_name, "conditions", "and strength must be names of columns", name)
    names = [str(name) for name in table.columns]
    table = table.set_axis(names, axis=1).reset_index(drop=True)
    check_columns(table, ["rt", "response", *wanted])
    taken = sorted({name for name in wanted if name in OURS or wanted.count(name) > 1})
    must = "and strength must be separate columns, each named once"
    require(not taken, "conditions", must, taken)
    check_people(table, wanted)
    who = participants(table)
    check_alike("participant_id", who)
    if participant is None:
        return table
    return pd.DataFrame(table[of_participant(participant, who)])


def of_participant(participant: object, who: npt.NDArray[np.str_]) -> Truths:
    """Return which rows are of a participant or of several, named by text or whole numbers."""
    several = (isinstance(participant, (list, tuple)) and participant) or [participant]
    names, known = [str(each) if is_whole(each) else each for each in several], set(who.tolist())
    must = f"must be one of {', '.join(sorted(known))}"
    for name in names:
        require(isinstance(name, str) and name in known, "participant", must, name)
    return np.isin(who, names)


def participants(table: pd.DataFrame) -> npt.NDArray[np.str_]:
    """Return the participant of each row, (rows,)."""
    if "participant_id" not in table:
        return np.full(len(table), EVERYONE)
    return texts(table["participant_id"])


def with_index(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table with rows numbered from 0; levels of its index with a name are columns."""
    named = [name for name in table.index.names if name is not None and name not in table]
    return (table.reset_index(named) if named else table).reset_index(drop=True)


def with_times(table: pd.DataFrame) -> tuple[pd.DataFrame, bool]:
    """Return a table with a column rt, empty if it was absent, and whether it has times."""
    timed = any(TIME.fullmatch(str(name).strip().lower()) for name in table)
    if "response" in table and "rt" not in table and not timed:
        DataWarning.warn(
            "there is no column rt: these trials are read as choices without times; if a column "
            "holds times, name it: Columns(rt=...), at the terminal --columns rt=..."
        )
        table = table.assign(rt=np.nan)
    return table, list(table).count("rt") != 1 or not _is_missing(table["rt"]).all()


def check_both(table: pd.DataFrame, rt_s: Array, silent: Truths) -> None:
    """Raise ValueError if a time or a response is without the other."""
    refuse(np.isnan(rt_s) & ~silent, table["rt"], "given where there is a response")
    refuse(silent & ~np.isnan(rt_s), table["response"], "given where rt is")


def check_answers(
    table: pd.DataFrame, rt_s: Array, chosen: npt.NDArray[np.int8], deadline_s: float | None
) -> None:
    """Raise ValueError if a time or a response is without the other, or a time is too late."""
    rt, absent = table["rt"], np.isnan(rt_s)
    check_both(table, rt_s, chosen == NO_RESPONSE)
    if deadline_s is None:
        hint = (
            ": say when such a trial ended (deadline_s, at the terminal --columns deadline_s=, s)"
        )
        refuse(absent, rt, "given unless trials have a deadline", hint)
    else:
        refuse(rt_s > deadline_s, rt, f"no later than deadline_s, {deadline_s:g} s")


def strengths(column: pd.Series) -> Array:
    """Return signed strengths; ValueError if one is missing or all are the same."""
    values = numbers(column)
    refuse(np.isnan(values), column, "given for every trial")
    if (values == values[0]).all():
        same = f"got {values[0]:g} in all {len(values)}: leave strength out"
        raise InputError(f"{column.name} must differ between trials, {same}", column.name)
    return values


def refuse(wrong: Truths, column: pd.Series, must: str, hint: str = "") -> None:
    """Raise ValueError if any row is wrong, with the number and value of the first."""
    if wrong.any():
        at = int(np.argmax(wrong))
        count = f" ({wrong.sum()} such rows)" if wrong.sum() > 1 else ""
        empty = column.isna().iloc[at] or not str(column.iloc[at]).strip()
        value = "nothing" if empty else repr(str(column.iloc[at]))
        raise InputError(
            f"{column.name} must be {must}, got {value} in row {column.index[at]}{count}{hint}",
            column.name,
        )


def texts(column: pd.Series) -> npt.NDArray[np.str_]:
    """Return a column as text, (rows,); ValueError for an empty cell."""
    values = np.array([str(value) for value in column], dtype=np.str_)
    refuse(column.isna().to_numpy() | (values == ""), column, "given for every trial")
    return values


def levels(column: pd.Series) -> npt.NDArray[np.str_]:
    """Return a column of a condition as text; a code of a missing value, as R's NA, is no level."""
    names = texts(column)
    refuse(np.isin(names, NOT_GIVEN), column, "given for every trial")
    check_alike(column.name, names)
    return names


def check_alike(column: Hashable, names: npt.NDArray[np.str_]) -> None:
    """Refuse names that differ only in blanks or encoding; warn if only in case or digits."""
    doubtful = []
    for key in (_unblanked, _plain):
        alike: dict[str, list[str]] = {}
        for name in np.unique(names).tolist():
            alike.setdefault(key(name), []).append(name)
        pairs = [pair for pair in alike.values() if len(pair) > 1]
        if pairs and key is _unblanked:
            raise InputError(
                f"{column} must not hold names that differ only in blanks or in the encoding of a "
                f"character, got {' and '.join(map(repr, pairs[0]))}: write them alike",
                column,
            )
        doubtful = [" and ".join(map(repr, pair)) for pair in pairs]
    if doubtful:
        DataWarning.warn(
            f"{column} holds names that differ only in capitals or in how a number is written, and "
            f"count as different: {'; '.join(doubtful[:3])}. If they are the same, write them alike"
        )


def _unblanked(name: str) -> str:
    return " ".join(unicodedata.normalize("NFKC", name).split())


def _plain(name: str) -> str:
    number = _number(name)
    return f"{number:.15g}" if np.isfinite(number) else _unblanked(name).casefold()


def check_numeric(column: pd.Series) -> None:
    """Raise ValueError for a column of dates or of True and False instead of numbers."""
    require(column.dtype.kind not in "mMb", column.name, "must hold numbers", column.dtype)


def numbers(column: pd.Series) -> Array:
    """Return a column of finite numbers, (rows,), NaN for an empty cell."""
    check_numeric(column)
    missing = _is_missing(column)
    values = np.array(
        [np.nan if m else _number(v) for v, m in zip(column, missing, strict=True)],
        dtype=np.float64,
    )
    refuse(~missing & ~np.isfinite(values), column, "a finite number")
    return values


def times(column: pd.Series, unit: str = "s") -> Array:
    """Return response times above 0, (rows,), s; NaN if missing, or HSSM's code for that."""
    values = numbers(column)
    values[values == MISSING_RT] = np.nan
    finite = values[np.isfinite(values)]
    median = float(np.median(finite)) if len(finite) else 1.0 / UNITS[unit]
    if unit == "s" and median > MOST_MEDIAN_S:
        raise InputError(
            f"{column.name} must be in seconds, got a median of {median:g}: divide by 1000 if "
            "these are milliseconds, or say so (rt_unit='ms', at the terminal --columns "
            "rt_unit=ms)",
            column.name,
        )
    if unit == "ms" and 0 < median < LEAST_MEDIAN_MS:
        raise InputError(
            f"{column.name} must be in ms, got a median of {median:g}: leave rt_unit out if these "
            "are seconds",
            column.name,
        )
    hint = ": if it is a code of a missing response, leave rt and response empty"
    refuse(values <= 0, column, f"above 0 {unit}", hint)
    return values * UNITS[unit]


def code(column: pd.Series) -> npt.NDArray[np.int8]:
    """Return a column of 0 and 1; ValueError for any other cell."""
    check_numeric(column)
    values = np.array([_number(value) for value in column])
    refuse(~np.isin(values, (0, 1)), column, "0 or 1 in every trial")
    return values.astype(np.int8)


def delays(column: pd.Series, unit: str = "s") -> Array:
    """Return stop-signal delays, (rows,), s; NaN in go trials, whose cell is empty or infinite."""
    check_numeric(column)
    cells = [_number(value) for value in column]
    values = numbers(column.mask(np.isinf(cells)))
    values = values * UNITS[unit]
    refuse(values > SLOWEST_DELAY_S, column, f"in seconds, at most {SLOWEST_DELAY_S:g} s")
    refuse(values < 0, column, f"0 {unit} or more")
    latest_s = float(np.fmax.reduce(values, initial=0.0))
    if unit == "ms" and 0 < latest_s < LEAST_DELAY_S:
        raise InputError(
            f"{column.name} must be in ms, as rt is, got at most {1000 * latest_s:g}: multiply by "
            "1000 if these are seconds",
            column.name or "ssd",
        )
    return values


def responses(column: pd.Series, rt: pd.Series, upper: str | None = None) -> npt.NDArray[np.int8]:
    """Return 1 for 1 or the name ``upper``, 0 for the other, -1 without a response; (rows,)."""
    missing = silent(pd.DataFrame({"rt": rt, "response": column}))
    names = names_of(column)
    if upper is None:
        wrong = ~missing & ~np.isin(names, ["0", "1"])
        hint = (
            ": name the response that counts as 1 (upper, at the terminal --columns upper=), or, "
            "with more than two alternatives, the column of the correct one (stimulus)"
        )
        refuse(wrong, column, "1 or 0", hint)
        upper = "1"
    else:
        check_alike(column.name, names[~missing].astype(str))
        kinds = list(dict.fromkeys(names[~missing]))
        if len(kinds) > 2:
            third = ~missing & ~np.isin(names, kinds[:2])
            refuse(third, column, f"one of two names, such as {kinds[0]} and {kinds[1]}")
        if len(kinds) == 2 and upper not in kinds:
            raise InputError.of("upper", f"must be one of {', '.join(sorted(kinds))}", upper)
    coded = np.where(missing, NO_RESPONSE, names == upper)
    return coded.astype(np.int8)


def withholding(
    table: pd.DataFrame, withheld: str, upper: str | None = None
) -> tuple[npt.NDArray[np.int8], int]:
    """Return responses, (rows,), one of which is given by waiting, and the code of that one."""
    column, missing = table["response"], silent(table)
    names = names_of(column)
    waited = missing | (names == withheld)
    others = sorted(set(names[~waited]))
    require(waited.any(), "withheld", "must occur", withheld)
    must = f"must be one of two responses, the other is {' or '.join(others) or 'never given'}"
    require(len(others) == 1, "withheld", must, withheld)
    if upper is None and set(others) | {withheld} != {"0", "1"}:
        upper = others[0]
    known = upper in (None, withheld, *others)
    require(known, "upper", f"must be one of {withheld}, {others[0]}", upper)
    must = f"empty where the response is {withheld}, which is given by waiting until deadline_s"
    refuse(waited & ~_is_missing(table["rt"]) & ~missing, table["rt"], must)
    code = int(withheld == (upper or "1"))
    return np.where(waited, code, 1 - code).astype(np.int8), code


def silent(table: pd.DataFrame) -> Truths:
    """Return which rows have no response: none is given, or the time is HSSM's code for none."""
    coded = np.array([_number(value) == MISSING_RT for value in table["rt"]])
    return np.asarray(coded | _is_missing(table["response"]))


def names_of(column: pd.Series) -> npt.NDArray[np.object_]:
    """Return the names of responses, (rows,)."""
    return np.array([_name(value) for value in column], dtype=object)


def _is_missing(column: pd.Series) -> Truths:
    told = np.array([str(value).strip() in MISSING for value in column], dtype=bool)
    return np.asarray(column.isna().to_numpy() | told)


def _number(value: object) -> float:
    try:
        # Python would read 1_000 as a thousand.
        return np.nan if "_" in str(value) else float(str(value))
    except ValueError:
        return np.nan


def _name(value: object) -> str:
    """Return the name of a response; 1.0 becomes 1 (from columns with missing values)."""
    number = _number(value)
    return str(int(number)) if np.isfinite(number) and number == int(number) else str(value)

"""Tables of choices between more than two alternatives: their number, and correct responses."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.support.checks import whole
from bgmodel.trials.columns import (
    NO_RESPONSE,
    check_alike,
    names_of,
    participants,
    silent,
    texts,
)
from circuits.arrays import Array, Truths
from circuits.errors import DataWarning, InputError, require

COLUMN = "alternatives"
"""Column with the number of alternatives of each trial."""
MOST = 12
"""Largest number of alternatives, as in the circuits."""
UNEQUAL = 3.29
"""Standard errors by which accuracy may differ between stimuli without a warning."""


def check_number(alternatives: int) -> None:
    """Raise ValueError unless a number of alternatives is from 2 to 12."""
    whole(COLUMN, alternatives, 2)
    require(alternatives <= MOST, COLUMN, f"must be at most {MOST}", alternatives)


def number_of(table: pd.DataFrame, alternatives: int | None, stimulus: str | None) -> int:
    """Return the number of alternatives of a table, 2 to 12.

    That given, that of its column, or of the names in ``response`` and ``stimulus``.
    """
    held = _held(table)
    agree = held is None or alternatives in (None, held)
    require(agree, COLUMN, f"must be that of the column {COLUMN}, {held}", alternatives)
    number = held if alternatives is None else alternatives
    if stimulus is None:
        return 2 if number is None else number
    return _named(table, stimulus, number)


def _held(table: pd.DataFrame) -> int | None:
    if COLUMN not in table:
        return None
    values = pd.to_numeric(table[COLUMN], errors="coerce").to_numpy(dtype=float)
    numbers_held = np.unique(values)
    if len(numbers_held) > 1:
        numbers = " and ".join(f"{each:g}" for each in numbers_held[:2])
        raise InputError(
            f"{COLUMN} must be the same in all trials of a fit, got {numbers}: fit trials with "
            "different numbers of alternatives separately",
            COLUMN,
        )
    if not (np.isfinite(numbers_held[0]) and numbers_held[0] == int(numbers_held[0])):
        raise InputError.of(COLUMN, "must hold a whole number", table[COLUMN].iloc[0])
    check_number(int(numbers_held[0]))
    return int(numbers_held[0])


def _named(table: pd.DataFrame, stimulus: str, number: int | None) -> int:
    """Return the number of alternatives that occur by name, or the number given if they agree."""
    texts(table[stimulus])  # refuses missing ones
    answered = ~silent(table)
    answers = set(names_of(table["response"])[answered])
    shown = set(names_of(table[stimulus]))
    every = answers | shown
    if not answers & shown:
        got, other = (", ".join(sorted(names)[:3]) for names in (answers, shown))
        must = f"and {stimulus} must be in the same words"
        raise InputError(f"response {must}, got {got} and {other}", "response")
    check_alike("response", np.array(sorted(every)))
    number = len(every) if number is None else number
    if len(every) > number:
        listed = ", ".join(sorted(every))
        must = f"and {stimulus} must name at most {number} alternatives, got {listed}"
        raise InputError(f"response {must}", "response")
    if len(answers) < number:
        never = sorted(every - answers)
        names = f", never {', '.join(never)}" if never else ""
        raise InputError(
            f"each of the {number} alternatives must occur as a response, got only "
            f"{', '.join(sorted(answers))}{names}",
            "response",
        )
    check_number(number)
    if unseen := sorted(answers - shown):
        DataWarning.warn(
            f"response {', '.join(map(repr, unseen))} is never correct, and counts as one of "
            f"{number} alternatives: leave the cell empty if it means no response"
        )
    return number


def correctness(table: pd.DataFrame, stimulus: str) -> npt.NDArray[np.int8]:
    """Return 1 for a response equal to ``stimulus``, 0 for another, -1 for none; (trials,)."""
    shown, answers = names_of(table[stimulus]), names_of(table["response"])
    coded = np.where(silent(table), NO_RESPONSE, shown == answers).astype(np.int8)
    _warn_of_unequal(shown, coded, participants(table))
    return coded


def _warn_of_unequal(
    shown: npt.NDArray[np.object_], right: npt.NDArray[np.int8], who: npt.NDArray[np.str_]
) -> None:
    for person in np.unique(who):
        mine = (who == person) & (right >= 0)
        for each in sorted(set(shown[mine])):
            z = _apart(right[mine] == 1, shown[mine] == each)
            if abs(z) > UNEQUAL:
                word = "more" if z > 0 else "less"
                DataWarning.warn(
                    f"{person}: responses to {each} are {word} often correct than those to other "
                    f"stimuli, by {abs(z):.1f} standard errors, but models of more than two "
                    "alternatives treat all of them alike: a bias affects their parameters"
                )
                break


def _apart(right: Truths, some: Truths) -> float:
    n, m = int(some.sum()), int((~some).sum())
    share: Array = right.mean()
    variance = float(share * (1 - share)) * (1 / max(n, 1) + 1 / max(m, 1))
    if not (n and m and variance):
        return 0.0
    return float((right[some].mean() - right[~some].mean()) / np.sqrt(variance))

"""People who learn pairs of items: choices, times and rewards, one pair at a time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.support.arrays import Array, Integers, Truths
from bgmodel.support.checks import path_of
from bgmodel.tables.cautions import people_and_times, warn_of_twins
from bgmodel.tables.columns import code, levels, refuse
from bgmodel.tables.shipped import SETS, shipped_table
from bgmodel.tables.text_files import read_rows
from circuits.errors import InputError, require, within

SET = "pedersen_frank_2020"
"""The set that is read by default."""
COLUMNS = ("participant_id", "pair", "response", "rt", "reward")
"""Columns of a table of trials, in the order of presentation."""


@dataclass(frozen=True, eq=False)
class PairTrials:
    """The trials of one person, in the order of presentation.

    Parameters
    ----------
    pair : int array (trials,)
        Index of the pair shown.
    response : int array (trials,)
        1: the better item of the pair was chosen; 0: the other.
    rt_s : array (trials,), s
        Response time.
    reward : array (trials,)
        0 or 1.
    names : tuple of str
        Names of the pairs.

    Raises
    ------
    ValueError
        If columns differ in length, a code has another value, a time is not above 0, or a pair has
        fewer than two trials.
    """

    pair: Integers
    response: Integers
    rt_s: Array
    reward: Array
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        lengths = [len(x) for x in (self.pair, self.response, self.rt_s, self.reward)]
        if len(set(lengths)) > 1:
            raise InputError(f"columns need one value per trial, got {lengths}", "response")
        for name in ("response", "reward"):
            codes = np.unique(getattr(self, name))
            require(np.isin(codes, (0, 1)).all(), name, "must be 0 or 1 in every trial", codes)
        timed = np.isfinite(self.rt_s) & (self.rt_s > 0)
        require(timed.all(), "rt", "must be above 0 s in every trial", self.rt_s[~timed][:3])
        counts = np.bincount(self.pair, minlength=len(self.names))
        few = [name for name, n in zip(self.names, counts, strict=True) if n < 2]
        must = "must have two trials or more in every pair: values are learned from earlier ones"
        require(not few, "pair", must, few)

    @property
    def trials(self) -> int:
        """Number of trials."""
        return len(self.pair)

    @cached_property
    def within(self) -> Integers:
        """Number of each trial within its pair, from 0, (trials,)."""
        found = np.empty(self.trials, dtype=np.intp)
        for k in range(len(self.names)):
            found[self.pair == k] = np.arange((self.pair == k).sum())
        return found

    @cached_property
    def last_choice(self) -> Array:
        """Last choice of the same pair, (trials,): 1 or -1; 0 before the first."""
        sides = self.by_pair(2.0 * self.response - 1)
        before = np.concatenate([np.zeros((1, len(self.names))), sides[:-1]])
        return np.asarray(before[self.within, self.pair])

    def by_pair(self, values: npt.ArrayLike) -> Array:
        """Return values of trials as (longest, pairs), 0 after the last trial of a pair."""
        found = np.zeros((int(self.within.max()) + 1, len(self.names)))
        found[self.within, self.pair] = values
        return found


def read_pairs(source: str | Path | pd.DataFrame = SET) -> dict[str, PairTrials]:
    """Read the trials of each person.

    Parameters
    ----------
    source : str, path or DataFrame
        Name of a built-in set, or a table, .csv, .tsv or .parquet, with the columns participant_id,
        pair, response (1: the item that is rewarded more often), rt (s) and reward (0 or 1), in the
        order of presentation.

    Raises
    ------
    ValueError
        For an unknown set, missing columns, a cell that is missing or of another kind, or trials
        that ``PairTrials`` refuses.

    Warns
    -----
    UserWarning
        As for tables of choices: names that differ in capitals, copies of trials, two people with
        the same trials, times in several units.
    """
    name, table = _table(source)
    try:
        who, rt_s = people_and_times(table, COLUMNS, ["pair", "reward"])
        pair = levels(table["pair"])
        refuse(np.isnan(rt_s), table["rt"], "given for every trial")
        response, reward = (code(table[column]) for column in ("response", "reward"))
        warn_of_twins(who, rt_s, response)
        return {
            each: _trials(who == each, pair, response, rt_s, reward)
            for each in np.unique(who).tolist()
        }
    except ValueError as error:
        raise within(name, error, "source") from None


def _table(source: str | Path | pd.DataFrame) -> tuple[str, pd.DataFrame]:
    """Return the name and the rows of a table, or of a set that ships."""
    if isinstance(source, pd.DataFrame):
        return "a table", source.reset_index(drop=True)
    if source in SETS:
        return str(source), shipped_table(str(source))[0]
    path = path_of(source, "source")
    must = f"must be a table, its file, or one of {', '.join(SETS)}"
    require(path.suffix, "source", must, str(source))
    return path.name, read_rows(path).reset_index(drop=True)


def _trials(
    own: Truths, pair: npt.NDArray[np.str_], response: Integers, rt_s: Array, reward: Integers
) -> PairTrials:
    names, place = np.unique(pair[own], return_inverse=True)
    answers = response[own].astype(int), rt_s[own], reward[own].astype(float)
    return PairTrials(place, *answers, tuple(map(str, names)))

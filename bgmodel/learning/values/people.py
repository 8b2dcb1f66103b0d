"""People who learn pairs of items: choices, times and rewards, one pair at a time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.support.arrays import Array, Integers, Truths
from bgmodel.tables.shipped import SETS, shipped_table
from circuits.errors import InputError, require

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


def read_pairs(source: str | pd.DataFrame = "pedersen_frank_2020") -> dict[str, PairTrials]:
    """Read the trials of each person.

    Parameters
    ----------
    source : str or DataFrame
        Name of a built-in set, or a table with the columns participant_id, pair, response (1: the
        item that is rewarded more often), rt (s) and reward (0 or 1), in the order of presentation.

    Raises
    ------
    ValueError
        For an unknown set, missing columns, or trials that ``PairTrials`` refuses.
    """
    if isinstance(source, str):
        require(source in SETS, "source", f"must be a table or one of {', '.join(SETS)}", source)
        source = shipped_table(source)[0]
    missing = [name for name in COLUMNS if name not in source]
    must = f"must have the columns {', '.join(COLUMNS)}"
    if missing:
        raise InputError(f"source {must}; {', '.join(missing)} is missing", missing[0])
    return {str(who): _trials(rows) for who, rows in source.groupby("participant_id", sort=True)}


def _trials(rows: pd.DataFrame) -> PairTrials:
    names, pair = np.unique(rows["pair"].astype(str), return_inverse=True)
    codes = {name: pd.to_numeric(rows[name]).to_numpy(float) for name in COLUMNS[2:]}
    known: Truths = np.isfinite(codes["response"])
    require(known.all(), "response", "must be given in every trial", codes["response"][~known][:3])
    return PairTrials(
        pair, codes["response"].astype(int), codes["rt"], codes["reward"], tuple(map(str, names))
    )

"""People who learn pairs of items: choices, times and rewards, one pair at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import pandas as pd

from bgmodel.support.arrays import Array, Integers
from bgmodel.support.checks import path_of
from bgmodel.tables.cautions import people_and_times, warn_of_twins
from bgmodel.tables.columns import code, levels, refuse
from bgmodel.tables.shipped import SETS, shipped_table
from bgmodel.tables.text_files import read_rows
from bgmodel.trials.record import Trials
from circuits.errors import require, within

SET = "pedersen_frank_2020"
"""The set that is read by default."""
COLUMNS = ("participant_id", "pair", "response", "rt", "reward")
"""Columns of a table of trials, in the order of presentation."""


@dataclass(frozen=True, eq=False)
class Pairs:
    """The trials of one person by pair, from which values are learned; see ``pairs_of``.

    Parameters
    ----------
    names : tuple of str
        Names of the pairs.
    pair, within : int array (trials,)
        Index of the pair of each trial, and its number within the pair, from 0.
    chosen : array (longest, pairs, 2)
        1 for the chosen item of each trial of a pair; the better item is the second.
    reward : array (longest, pairs)
        Rewards, 0 after the last trial of a pair.
    last_choice : array (trials,)
        Last choice of the same pair: 1 or -1; 0 before the first.
    """

    names: tuple[str, ...]
    pair: Integers
    within: Integers
    chosen: Array
    reward: Array
    last_choice: Array


@lru_cache(maxsize=256)
def pairs_of(trials: Trials) -> Pairs:
    """Return the trials of one person by pair.

    Parameters
    ----------
    trials : Trials
        In the order of presentation, with rewards and the condition "pair"; response 1 is the
        better item of the pair.

    Raises
    ------
    ValueError
        For several people, no pairs or rewards, another code than 0 or 1, a time that is not above
        0, or a pair with fewer than two trials.
    """
    who, columns = trials.people(), trials.conditions
    require(len(who) == 1, "participant", "must be one person, who learns", ", ".join(who))
    require("pair" in columns, "pair", "must be a condition of the trials", list(columns))
    for name in ("response", "reward"):
        codes = np.unique(np.asarray(getattr(trials, name), dtype=np.float64))
        require(np.isin(codes, (0, 1)).all(), name, "must be 0 or 1 in every trial", codes)
    require((trials.rt_s > 0).all(), "rt", "must be above 0 s in every trial", trials.rt_s.min())
    names, pair = np.unique(columns["pair"].to_numpy(dtype=str), return_inverse=True)
    counts = np.bincount(pair)
    must = "must have two trials or more in every pair: values are learned from earlier ones"
    require(counts.min() > 1, "pair", must, names[counts < 2].tolist())
    within = np.empty(trials.trials, dtype=np.intp)
    for k, count in enumerate(counts):
        within[pair == k] = np.arange(count)
    better, reward = np.zeros((2, counts.max(), len(names)))
    better[within, pair], reward[within, pair] = trials.response, trials.reward
    before = np.concatenate([np.zeros((1, len(names))), 2 * better[:-1] - 1])
    chosen = np.stack([1 - better, better], axis=-1)
    return Pairs(tuple(names.tolist()), pair, within, chosen, reward, before[within, pair])


def read_pairs(
    source: str | Path | pd.DataFrame = SET, *, conditions: Sequence[str] = ()
) -> Trials:
    """Read the trials of people who learn; their pair is a condition of the trials.

    Parameters
    ----------
    source : str, path or DataFrame
        Name of a built-in set, or a table, .csv, .tsv or .parquet, with the columns participant_id,
        pair, response (1: the item that is rewarded more often), rt (s) and reward (0 or 1), in the
        order of presentation.
    conditions : sequence of str
        Further columns of conditions, read as text.

    Raises
    ------
    ValueError
        For an unknown set, missing columns, a cell that is missing or of another kind, or trials
        of a person that ``pairs_of`` refuses.

    Warns
    -----
    UserWarning
        As for tables of choices: names that differ in capitals, copies of trials, two people with
        the same trials, times in several units.
    """
    name, table = _table(source)
    try:
        who, rt_s = people_and_times(table, (*COLUMNS, *conditions), ["pair", "reward"])
        held = pd.DataFrame({each: levels(table[each]) for each in ("pair", *conditions)})
        refuse(np.isnan(rt_s), table["rt"], "given for every trial")
        response, reward = (code(table[column]) for column in ("response", "reward"))
        warn_of_twins(who, rt_s, response)
        found = Trials(
            who, rt_s, response.astype(np.int8), None, held, source=name,
            reward=reward.astype(np.float64),
        )  # fmt: skip
        for each in by_person(found).values():
            pairs_of(each)
    except ValueError as error:
        raise within(name, error, "source") from None
    return found


def by_person(trials: Trials) -> dict[str, Trials]:
    """Return the trials of each person, by name."""
    return {who: trials.where(trials.participant == who) for who in trials.people()}


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

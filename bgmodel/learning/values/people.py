"""People who learn pairs of items: choices, times and rewards, one pair at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import pandas as pd

from bgmodel.support.arrays import Array, Integers
from bgmodel.trials.reading import read_trials
from bgmodel.trials.record import Trials
from circuits.errors import require

SET = "pedersen_frank_2020"
"""The set that is read by default."""


@dataclass(frozen=True, eq=False)
class Pairs:
    """The trials of one person by pair, from which values are learned; see ``pairs_of``."""

    names: tuple[str, ...]
    pair: Integers  # (trials,), index of the pair
    within: Integers  # (trials,), number within the pair, from 0
    chosen: Array  # (longest, pairs, 2), 1 if chosen; the better item is the second
    reward: Array  # (longest, pairs), 0 after the last trial of a pair
    last_choice: Array  # (trials,), last choice of the same pair: 1 or -1; 0 before the first


@lru_cache(maxsize=256)
def pairs_of(trials: Trials) -> Pairs:
    """Return the trials of one person by pair, in the order of presentation."""
    who, columns = trials.people(), trials.conditions
    require(len(who) == 1, "participant", "must be one person, who learns", ", ".join(who))
    for name in ("response", "reward"):
        codes = np.unique(np.asarray(getattr(trials, name), dtype=np.float64))
        require(np.isin(codes, (0, 1)).all(), name, "must be 0 or 1 in every trial", codes)
    require("pair" in columns, "pair", "must be a condition of the trials", list(columns))
    require(
        not trials.timed or (trials.rt_s > 0).all(),
        "rt",
        "must be above 0 s in every trial",
        trials.rt_s.min(),
    )
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
    """Return the trials of people who learn pairs, checked by ``pairs_of``."""
    trials = read_trials(source, conditions=["pair", *conditions])
    for each in trials.by_participant().values():
        pairs_of(each)
    return trials

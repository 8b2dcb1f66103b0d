"""Bootstrap over trials: weights that resample them, and intervals (Efron 1979)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from bgmodel.support.checks import whole
from bgmodel.support.processes import check_memory
from bgmodel.support.seeds import generator, stream
from circuits.arrays import Array
from circuits.errors import NoiseWarning, require

FEWEST_TRIALS = 100
RESAMPLES = 1000
Z95 = 1.96
"""Standard errors from the middle to the end of a 95 % interval."""
FEWEST_DRAWN = {"resamples": 100, "groups": 10}
"""Numbers of resamples and of groups below which intervals give a warning."""


def resampled(
    trials: int,
    resamples: int,
    rng: np.random.Generator | int,
    groups: npt.ArrayLike | None = None,
) -> Array:
    """Return weights (1 + resamples, trials): ones, then how often each trial is drawn.

    Whole ``groups`` (trials,) are drawn (Efron & Tibshirani 1993), for example if trials share
    taps. With G groups the interval is too narrow by about sqrt(1 - 1 / G), and with few groups it
    is rough.
    """
    resamples, rng = whole("resamples", resamples, 1), generator(rng)
    check_memory(8.0 * resamples * trials, f"{resamples} resamples", "resamples")
    of = np.arange(trials) if groups is None else _numbered(groups, trials)
    count = int(of.max()) + 1
    drawn = rng.multinomial(count, np.full(count, 1 / count), size=resamples)
    return np.concatenate([np.ones((1, trials)), drawn[:, of]])


@lru_cache(maxsize=1)
def weights_of(trials: int, seed: int) -> Array:
    """Return the weights of ``resampled`` for separate trials, kept for the next call."""
    return resampled(trials, RESAMPLES, stream(seed, "bootstrap"))


def check_resamples(resamples: int, groups: npt.ArrayLike | None) -> None:
    """Refuse an invalid number of resamples; warn of intervals that are too rough."""
    drawn = {"resamples": whole("resamples", resamples, 1)}
    if groups is not None:
        drawn["groups"] = len(np.unique(np.asarray(groups)))
    for name, count in drawn.items():
        if count < FEWEST_DRAWN[name]:
            NoiseWarning.warn(
                f"95 % intervals from {count} {name} are too rough: give "
                f"{FEWEST_DRAWN[name]} or more"
            )


def _numbered(groups: npt.ArrayLike, trials: int) -> npt.NDArray[np.intp]:
    """Return the group of each trial as a number, 0, 1, ..."""
    names = np.asarray(groups)
    require(names.shape == (trials,), "groups", f"must be one per trial, ({trials},)", names.shape)
    kinds, of = np.unique(names, return_inverse=True)
    require(len(kinds) >= 2, "groups", "must be two or more for an interval", len(kinds))
    return of


def interval(values: Array) -> tuple[float, float, float]:
    """Return the first entry, the value, and the 95 % interval of the others, its resamples."""
    ends = np.full(2, np.nan)
    if np.isfinite(values[0]) and np.isfinite(values[1:]).mean() > 0.95:
        with np.errstate(invalid="ignore"):  # between infinite resamples an end is unknown
            ends = np.nanquantile(values[1:], [0.025, 0.975])
    return float(values[0]), float(ends[0]), float(ends[1])


def shown(value: float, low: float, high: float, form: str) -> str:
    """Return a value and its interval as text, with "unknown" for unknown ends."""
    if not np.isfinite(value):
        return "unknown"
    inside = f"{low:{form}}, {high:{form}}" if np.isfinite(low) and np.isfinite(high) else "unknown"
    return f"{value:{form}} [{inside}]"


def check_trials(trials: int) -> None:
    """Raise ValueError if there are too few trials for an interval."""
    fewest = f"must be {FEWEST_TRIALS} or more for an interval"
    require(trials >= FEWEST_TRIALS, "trials", fewest, trials)

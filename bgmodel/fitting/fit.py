"""One model held to the choices and times of one person: optimum, what it can tell, tables."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from bgmodel.arrays import Array, Integers
from bgmodel.fitting.design import Design
from bgmodel.fitting.identify import Directions, directions
from bgmodel.fitting.optimum import Likelihood, Optimum, optimum, starts_of
from bgmodel.fitting.posterior import Posterior, posterior
from bgmodel.fitting.responses import BIN_S, moments

QUANTILES = (0.1, 0.3, 0.5, 0.7, 0.9)
SHARE = 0.9
"""Share of the posterior that an interval holds."""
Tell = Callable[[str], None]


@dataclass(frozen=True)
class Fit:
    """A model held to data.

    Parameters
    ----------
    optimum : Optimum
        Where the data are most likely.
    directions : Directions
        What can be told apart there.
    posterior : Posterior, optional
        Draws, if they were asked for.
    """

    optimum: Optimum
    directions: Directions
    posterior: Posterior | None = None

    def parameters(self) -> pd.DataFrame:
        """Return one row per number of the fit.

        Columns parameter, value, standard_error (from the expected information, all others free),
        low and high (of the posterior, a middle interval of .9; NaN without one), at_bound.
        """
        names = self.optimum.likelihood.freedom.names
        found = {
            "parameter": names,
            "value": self.optimum.vector,
            "standard_error": self.directions.standard_errors,
            "low": np.nan,
            "high": np.nan,
            "at_bound": self.optimum.at_bound,
        }
        table = pd.DataFrame(found)
        if self.posterior is not None:
            table["low"], table["high"] = self.posterior.interval(SHARE)
        return table

    def cells(self) -> pd.DataFrame:
        """Return one row per cell of the design: data, and the model; see ``cells_of``."""
        return cells_of(self.optimum.likelihood.design, self.optimum.density)


def cells_of(design: Design, density: Array) -> pd.DataFrame:
    """Return one row per cell: data beside a model's densities (cells, 2, bins).

    Columns strength, conditions, trials; accuracy (share of response 1, which the strength speaks
    for), mean_s, sd_s and q10_s to q90_s of all responses, each with its like of the model as
    ``model_...``; accuracy_se and mean_se of the data; correct_s and wrong_s, mean times of
    response 1 and 0.
    """
    said = moments(density, design.grid)
    rows = []
    for cell in range(design.cells):
        seen = (design.observed.cell == cell) & (design.observed.response >= 0)
        row = {"strength": design.strength[cell]}
        row |= {name: levels[cell] for name, levels in design.conditions.items()}
        row |= {"trials": int(design.trials[cell]), "answered": int(seen.sum())}
        row |= _seen(design.observed.rt_s[seen], design.observed.response[seen])
        row |= {f"model_{name}": said[name][cell] for name in ("accuracy", "mean_s", "sd_s")}
        row |= _said(density[cell], design.grid.middles_s)
        rows.append(row)
    return pd.DataFrame(rows)


def _seen(rt: Array, right: Integers) -> dict[str, float]:
    """Return accuracy and times of a cell with their errors; NaN where there was no response."""

    def mean(some: Array) -> float:
        return float(some.mean()) if len(some) else np.nan

    accuracy, sd = mean(right == 1), float(rt.std()) if len(rt) else np.nan
    few = max(len(rt), 1)
    return {
        "accuracy": accuracy,
        "mean_s": mean(rt),
        "sd_s": sd,
        "accuracy_se": np.sqrt(accuracy * (1 - accuracy) / few),
        "mean_se": sd / np.sqrt(few),
        "correct_s": mean(rt[right == 1]),
        "wrong_s": mean(rt[right == 0]),
        **{f"q{round(100 * q)}_s": np.quantile(rt, q) if len(rt) else np.nan for q in QUANTILES},
    }


def _said(density: Array, middles_s: Array) -> dict[str, float]:
    """Return quantiles and mean times of both responses under densities (2, bins)."""
    mass = density.sum(axis=0) * BIN_S
    below = np.concatenate([[0.0], mass.cumsum() / mass.sum()])
    edges = np.concatenate([[0.0], middles_s + BIN_S / 2])
    found = {f"model_q{round(100 * q)}_s": float(np.interp(q, below, edges)) for q in QUANTILES}
    for name, one in (("model_correct_s", density[1]), ("model_wrong_s", density[0])):
        found[name] = float(one @ middles_s / one.sum())
    return found


def fit(
    likelihood: Likelihood,
    *,
    draws: bool = False,
    anyway: bool = False,
    tell: Tell = lambda _: None,
) -> Fit:
    """Return a fit: what can be told apart is asked first, then the optimum is sought.

    Parameters
    ----------
    likelihood : Likelihood
        Model, data, and what is free.
    draws : bool
        Whether to draw from the posterior too.
    anyway : bool
        Whether to fit what choices and times cannot tell apart.
    tell : function
        Called with what is done.

    Raises
    ------
    ValueError
        If two free parameters cannot be told apart in this design, unless ``anyway``.
    """
    tell("what can be told apart")
    if not anyway:
        # Where a parameter stands at a bound, as an amount at 0, others may move nothing: ask in
        # the middle of its range.
        directions(likelihood, starts_of(likelihood)[-1]).check()
    tell("optimum")
    found = optimum(likelihood, tell=lambda done, best: tell(f"optimum {done}: {best:.1f}"))
    there = directions(likelihood, found.vector)
    if not draws:
        return Fit(found, there)
    return Fit(found, there, posterior(likelihood, there, tell=lambda n: tell(f"posterior {n}")))

"""A model fitted to the data of one person: optimum, identifiability, tables."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from bgmodel.fitting.cautions import cautions, resolved, warn_of_slow
from bgmodel.fitting.design import Design
from bgmodel.fitting.likelihood import Likelihood
from bgmodel.fitting.misfit import Misfit, misfit
from bgmodel.fitting.optimum import Optimum, optimum
from bgmodel.fitting.parameters import told_priors
from bgmodel.fitting.posterior import Directions, Posterior, directions, posterior
from bgmodel.fitting.quantiles import (
    SIDES,
    observed_quantiles,
    phrase,
    predicted_quantiles,
    residuals,
    too_few,
)
from bgmodel.fitting.responses import QUANTILES, TINY, moments
from bgmodel.fitting.simulated.error import SimulationErrors, simulation_error, without_parts
from bgmodel.support.saved import Facts
from bgmodel.support.tables import Readable
from circuits.arrays import Array, Integers
from circuits.errors import FitWarning

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHARE = 0.9
"""Share of the posterior within an interval."""
WORST = 3
"""Number of residuals in the text of a fit."""
Tell = Callable[[str], None]


@dataclass(frozen=True, repr=False)
class Fit(Facts):
    """A model fitted to data."""

    optimum: Optimum
    directions: Directions
    simulation: SimulationErrors  # Errors due to the simulated trials of a circuit.
    misfit: Misfit
    posterior: Posterior | None = None  # Only if samples were requested.

    @property
    def log_likelihood(self) -> float:
        """Log likelihood of the data, nats, without the bias of simulated runs."""
        return float(self.optimum.likelihood.unbiased(self.optimum.vector).sum())

    def facts(self) -> dict[str, str]:
        """Return log likelihood, each number with its standard error, and largest residuals."""
        likelihood, table = self.optimum.likelihood, self.parameters()
        error = self.simulation.log_likelihood
        uncertainty = f" +- {error:.1f}" if error else ""
        facts = {
            "data": likelihood.design.who,
            "trials": f"{likelihood.design.trials.sum()}",
            "log likelihood": f"{self.log_likelihood:.1f}{uncertainty} nats",
        }
        for row in table.itertuples():
            facts[str(row.parameter)] = f"{row.value:.4g} +- {row.standard_error:.2g}"
        worst = self.residuals()[:WORST].to_dict("records")
        facts |= {f"residual {n}": phrase(row) for n, row in enumerate(worst, 1)}
        few = too_few(self.cells())
        return facts | ({"errors": few} if few else {})

    def residuals(self) -> pd.DataFrame:
        """Return differences between quantiles of data and model; see ``quantiles.residuals``."""
        return residuals(self.cells())

    def summary(self) -> pd.DataFrame:
        """Return the numbers of the fit with their errors and intervals, as a table to read."""
        table = self.parameters().set_index("parameter").drop(columns="simulation_error")
        shown = table.dropna(axis="columns", how="all").map(
            lambda value: value if isinstance(value, (bool, np.bool_)) else float(f"{value:.4g}")
        )
        return Readable(shown).with_note(told_priors(self.priors))

    @property
    def priors(self) -> dict[str, tuple[float, float]]:
        """Central 95 % of the priors, by the names of the numbers that have one."""
        return self.optimum.likelihood.freedom.priors

    def to_dataframe(self) -> pd.DataFrame:
        """Return ``parameters()``."""
        return self.parameters()

    def plot(self) -> Figure:
        """Draw data with 95 % intervals and the model; see the likelihood's ``draw``."""
        peak = self.optimum.likelihood, self.optimum.vector
        return peak[0].draw({"Model": self.cells()}, {"Model": peak}, peak[0].design.who)

    def parameters(self) -> pd.DataFrame:
        """Return one row per number of the fit.

        ``standard_error`` is with all others free; ``simulation_error`` the part due to a circuit's
        trials (NaN at a bound); ``low`` and ``high`` the central 0.9 of the posterior, if there is
        one.
        """
        errors = self.simulation.parameters
        columns = {
            "parameter": self.optimum.likelihood.freedom.names,
            "value": self.optimum.vector,
            "standard_error": np.hypot(self.directions.standard_errors, np.nan_to_num(errors)),
            "simulation_error": errors,
            "low": np.nan,
            "high": np.nan,
            "at_bound": self.optimum.at_bound,
        }
        table = pd.DataFrame(columns)
        if self.posterior is not None:
            table["low"], table["high"] = widened(self.posterior, errors)
        return table

    def cells(self) -> pd.DataFrame:
        """Return data and model for each cell of the design; see ``cells_with_misfit``."""
        return cells_with_misfit(self.optimum, self.misfit)


def _impossible(fitted: Optimum) -> list[str]:
    """Return a warning if trials are impossible under the fitted model: a sign of a poor start."""
    seen, log = fitted.likelihood.design.observed, fitted.likelihood.each(fitted.vector)
    out = np.flatnonzero(log <= np.log(TINY))
    if not len(out):
        return []
    rt_s, response = seen.rt_s[out[0]], seen.response[out[0]]
    return [
        f"{len(out)} of {len(log)} trials are impossible under the fitted model, such as response "
        f"{response} at {rt_s:.3g} s: begin the search where all are possible (start of a "
        "Parameter), or give the model lapses"
    ]


def widened(drawn: Posterior, simulation: Array) -> Array:
    """Return the central interval of a posterior, (2, parameters), with the simulation error."""
    middle = np.median(drawn.draws, axis=0)
    low, high = drawn.interval(SHARE)
    half = NormalDist().inv_cdf((1 + SHARE) / 2) * np.nan_to_num(simulation)
    return np.stack([middle - np.hypot(middle - low, half), middle + np.hypot(high - middle, half)])


def cells_with_misfit(fitted: Optimum, apart: Misfit) -> pd.DataFrame:
    """Return ``cells_of`` an optimum, with ``z_accuracy`` and ``z_mean_rt`` of its ``Misfit``."""
    table = cells_of(fitted.complete.likelihood.design, fitted.complete.density)
    return table.assign(z_accuracy=apart.z_accuracy, z_mean_rt=apart.z_mean_rt)


def cells_of(design: Design, density: Array) -> pd.DataFrame:
    """Return data and predictions of densities (cells, 2, bins), 1/s, one row per cell.

    ``accuracy`` is the share of response 1, which the strength favours; times are of all responses,
    or ``correct_...`` and ``wrong_...``; predictions are ``model_...``, and ``_se`` standard
    errors.
    """
    every, _ = design.observed.outcomes(density)
    mass = design.observed.with_times(every)
    with np.errstate(invalid="ignore"):  # without times
        model = moments(mass / design.grid.width_s, design.grid)
    model["accuracy"] = every[:, 1].sum(axis=1) / every.sum(axis=(1, 2))
    rows = []
    for cell in range(design.cells):
        seen = (design.observed.cell == cell) & (design.observed.response >= 0)
        rt_s, response = design.observed.rt_s[seen], design.observed.response[seen]
        row = {"strength": design.strength[cell]}
        row |= {name: levels[cell] for name, levels in design.conditions.items()}
        row |= {"trials": int(design.trials[cell]), "answered": int(seen.sum())}
        row |= _seen(rt_s, response) | observed_quantiles(rt_s, response)
        row |= {f"model_{name}": model[name][cell] for name in ("accuracy", "mean_s", "sd_s")}
        row |= predicted_quantiles(mass[cell], design.grid.width_s)
        total = mass[cell].sum(axis=1)
        total[total == 0] = np.nan  # of a response that the model never gives
        means_s = mass[cell] @ design.grid.middles_s / total
        row |= {f"model_{name}_s": means_s[side] for name, side in SIDES.items()}
        rows.append(row)
    return pd.DataFrame(rows)


def _seen(rt: Array, right: Integers) -> dict[str, float]:
    """Return accuracy and times of a cell with their errors; NaN without a response."""

    def mean(some: Array) -> float:
        return float(some.mean()) if len(some) else np.nan

    accuracy, answered = mean(right == 1), max(len(rt), 1)
    right, rt = right[np.isfinite(rt)], rt[np.isfinite(rt)]
    sd, few = float(rt.std()) if len(rt) else np.nan, max(len(rt), 1)
    return {
        "accuracy": accuracy,
        "mean_s": mean(rt),
        "sd_s": sd,
        "accuracy_se": np.sqrt(accuracy * (1 - accuracy) / answered),
        "mean_se": sd / np.sqrt(few),
        "correct_s": mean(rt[right == 1]),
        "wrong_s": mean(rt[right == 0]),
        **{f"q{round(100 * q)}_s": np.quantile(rt, q) if len(rt) else np.nan for q in QUANTILES},
    }


def fit_likelihood(
    likelihood: Likelihood, *, draws: bool = False, tell: Tell = lambda _: None
) -> Fit:
    """Find the optimum, its identifiability and misfit, and, with ``draws``, the posterior.

    Warns of whatever makes the result doubtful; ``tell`` is called with the progress.
    """
    tell("search")
    so_far = "search: log likelihood {1:.1f} after {0} evaluations".format
    fitted = optimum(likelihood, tell=lambda done, best: tell(so_far(done, best)))
    fitted = resolved(fitted)
    likelihood = fitted.likelihood
    warn_of_slow(fitted)
    there = directions(likelihood, fitted.vector)
    tell("simulation error")
    left = without_parts(likelihood, there)
    simulated = simulation_error(likelihood, there, left)
    apart = misfit(fitted, left)
    drawn = None
    if draws:
        drawn = posterior(likelihood, there, tell=lambda n: tell(f"posterior {n}"))
    warnings = [*_impossible(fitted), *apart.cautions(fitted), *there.cautions()]
    for caution in [*warnings, *cautions(fitted, there, simulated, drawn)]:
        FitWarning.warn(caution)
    return Fit(fitted, there, simulated, apart, drawn)

"""A model fitted to many people: a distribution of the group, and each person's parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from bgmodel.fitting.cautions import of_cuts
from bgmodel.fitting.hierarchy.approximation import Person, estimates, started
from bgmodel.fitting.hierarchy.chains import (
    CHAINS,
    FEWEST_EFFECTIVE,
    LARGEST_RHAT,
    MOST,
    Agreement,
    agreement,
    sampled,
)
from bgmodel.fitting.hierarchy.group import ALIKE, Predictors, Scale, priors_of
from bgmodel.fitting.hierarchy.labels import draw_group, labelled, legend, pooled
from bgmodel.fitting.hierarchy.sampler import Draws, Sampler
from bgmodel.fitting.likelihood import Likelihood
from bgmodel.fitting.misfit import GroupMisfit, group_misfit
from bgmodel.fitting.optimum import Optimum
from bgmodel.fitting.parameters import told_priors
from bgmodel.fitting.person_fit import SHARE as SHARE
from bgmodel.fitting.person_fit import cells_with_misfit
from bgmodel.fitting.posterior import directions
from bgmodel.support.files import replacing
from bgmodel.support.processes import shared_map
from bgmodel.support.saved import Facts
from bgmodel.support.tables import Readable
from circuits.arrays import Array, Arrays, Truths
from circuits.errors import FitWarning, InputError, require
from circuits.store import Entry

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

HIERARCHY_SEED = 24_401
"""Seed of the chains."""
FEWEST_PEOPLE, FEWEST_TRIALS = 3, 20
"""Smallest number of people, and of each person's responses."""
Tell = Callable[[str], None]


@dataclass(frozen=True, repr=False)
class GroupFit(Facts):
    """A model fitted to a group of people, whose parameters differ by a fitted amount."""

    likelihoods: dict[str, Likelihood]
    scale: Scale  # The scale on which people are Gaussian.
    chains: list[Draws]  # Draws from the posterior, on the scale.
    predictors: Predictors = ALIKE  # What differs between people and moves their parameters.

    @property
    def people(self) -> list[str]:
        """Names of the people."""
        return list(self.likelihoods)

    @property
    def parameters(self) -> list[str]:
        """Names of the parameters."""
        return next(iter(self.likelihoods.values())).freedom.names

    @cached_property
    def agreement(self) -> Agreement:
        """Diagnostics of the chains."""
        return agreement(self.chains)

    def _all(self, name: str) -> Array:
        return np.stack([getattr(each, name) for each in self.chains])

    @cached_property
    def group(self) -> Array:
        """The median person's parameters, (chains, draws, parameters), in their own units."""
        return self.scale.back(self._all("mean"))

    @cached_property
    def between(self) -> Array:
        """Standard deviation between people, (chains, draws, parameters), in their own units."""
        return np.asarray(self._all("sd") * self.scale.slope(self._all("mean")))

    @cached_property
    def slopes(self) -> dict[str, Array]:
        """Change of the median person's parameter per unit of each predictor, in its units."""
        mean, slope, changes = self._all("mean"), self._all("slopes"), {}
        for n, (name, k) in enumerate(zip(self.predictors.names, self.predictors.of, strict=True)):
            values, width = np.unique(self.predictors.columns[n]), self.predictors.widths[n]
            two = len(values) == 2
            ends = values if two else np.array([-0.5, 0.5]) / width
            every = np.repeat(mean[None], 2, axis=0)
            every[..., k] += slope[None, ..., n] * ends[:, None, None]
            low, high = self.scale.back(every)[..., k]
            changes[name] = (high - low) / (width if two else 1.0)
        return changes

    @property
    def priors(self) -> dict[str, tuple[float, float]]:
        """Central 95 % of the prior of the median person's value, where it is not uniform."""
        return next(iter(self.likelihoods.values())).freedom.stated

    @cached_property
    def correlation(self) -> dict[tuple[str, str], Array]:
        """Correlation of two parameters between people, on the scale, (chains, draws)."""
        draws = self._all("correlation")
        pairs = zip(*np.tril_indices(draws.shape[2], -1), strict=True)
        return {(self.parameters[j], self.parameters[k]): draws[..., k, j] for k, j in pairs}

    def correlations(self) -> pd.DataFrame:
        """Return correlations between people: median, low_95, high_95, above_zero."""
        rows = {
            pair: [*np.quantile(draws, [0.5, 0.025, 0.975]), (draws > 0).mean()]
            for pair, draws in self.correlation.items()
            if draws.any()
        }
        index = pd.MultiIndex.from_tuples(rows, names=["first", "second"])
        columns = ["median", "low_95", "high_95", "above_zero"]
        values = np.array(list(rows.values())).reshape(-1, len(columns))
        return Readable(values, index if rows else None, columns)

    def effects(self) -> pd.DataFrame:
        """Return the effects of predictors between people: median, low, high (0.9), above_zero."""
        rows = {name: _of_one(draws) for name, draws in self.slopes.items()}
        columns = [*MIDDLE, "above_zero"]
        table = pd.DataFrame.from_dict(rows, orient="index", columns=columns)
        return Readable(table.rename_axis("predictor"))

    @cached_property
    def individual(self) -> Array:
        """Each person's parameters, (chains, draws, people, parameters)."""
        return self.scale.back(self._all("scaled"))

    @cached_property
    def typical(self) -> dict[str, Optimum]:
        """Each person's likelihood at the medians of the person's parameters."""
        optima = {}
        for who, vector in zip(self.people, np.median(self.individual, axis=(0, 1)), strict=True):
            likelihood = self.likelihoods[who]
            optima[who] = Optimum(likelihood, vector, likelihood(vector), evaluations=1)
        return optima

    @cached_property
    def misfit(self) -> GroupMisfit:
        """Difference between data and the model at the medians of each person's parameters."""
        return group_misfit(self.typical)

    @property
    def log_likelihood(self) -> Array:
        """Log likelihood of each person's trials, (chains, draws, people), nats."""
        return self._all("log_likelihood")

    def facts(self) -> dict[str, str]:
        """Return the numbers of people, trials and draws, and the group's parameters."""
        trials = sum(each.design.trials.sum() for each in self.likelihoods.values())
        facts = {"people": f"{len(self.people)}", "trials": f"{trials}"}
        for row in (*self.summary().itertuples(), *self.effects().itertuples()):
            facts[str(row.Index)] = f"{row.median:.4g} ({row.low:.4g} to {row.high:.4g})"
        for (first, second), draws in self.correlation.items():
            if draws.any():  # not of parameters that people share
                facts[f"correlation of {first} and {second}"] = f"{np.median(draws):.2f}"
        return facts | {"effective sample size": f"{self.agreement.effective.min():.0f}"}

    def summary(self) -> pd.DataFrame:
        """Return one row per parameter of the group, with central intervals of 0.9.

        ``median`` is of the median person, ``between_...`` of the standard deviation of people.
        """
        rhat, effective = (
            np.asarray(each)[: 2 * len(self.parameters)].reshape(2, -1)
            for each in (self.agreement.rhat, self.agreement.effective)
        )
        columns = {
            **_middle(self.group, MIDDLE),
            **_middle(self.between, ("between_people", "between_low", "between_high")),
            "rhat": rhat.max(axis=0),
            "effective_sample_size": effective.min(axis=0),
        }
        index = pd.Index(self.parameters, name="parameter")
        notes = filter(None, (legend(self.parameters), self.notes()))
        return Readable(columns, index=index).with_note("\n".join(notes))

    def notes(self) -> str:
        """Return priors and correlations as text."""
        related = self.correlations()
        table = f"correlations between people:\n{related.round(3)}" if len(related) else ""
        return "\n".join(each for each in (told_priors(self.priors), table) if each)

    def to_dataframe(self) -> pd.DataFrame:
        """Return each person's parameters: participant, parameter, median, low, high."""
        index = pd.MultiIndex.from_product(
            [self.people, self.parameters], names=["participant", "parameter"]
        )
        flat = self.individual.reshape(*self.individual.shape[:2], -1)
        return pd.DataFrame(_middle(flat, MIDDLE), index=index).reset_index()

    def cells(self) -> pd.DataFrame:
        """Return ``Fit.cells`` of each participant, at the medians of the person's parameters."""
        parts = []
        for who, each in self.typical.items():
            parts.append(cells_with_misfit(each, self.misfit.people[who]))
            parts[-1].insert(0, "participant", who)
        return pd.concat(parts, ignore_index=True)

    def difference(self, first: str, second: str) -> dict[str, float]:
        """Return the posterior of one parameter of the median person minus another."""
        for field, name in (("first", first), ("second", second)):
            if name not in self.parameters:
                raise InputError.of(field, f"must be one of {', '.join(self.parameters)}", name)
        draws = self.group[..., self.parameters.index(first)]
        draws = draws - self.group[..., self.parameters.index(second)]
        return _of_one(draws)

    def cautions(self) -> list[str]:
        """Return warnings of misfit, parameters that choices leave open, and short chains."""
        first = next(iter(self.typical.values()))
        timed = first.likelihood.design.timed
        alike = [] if timed else directions(first.likelihood, first.vector).cautions()
        people = self.likelihoods.items()
        own = [f"{who}: {text}" for who, each in people for text in each.cautions()]
        own = own if len(own) < 2 else [f"{len(own)} people, such as {own[0]}"]
        cuts = of_cuts(self.typical.values())
        return [*self.misfit.cautions(), *alike, *cuts, *own, *self._short()]

    def _short(self) -> list[str]:
        if self.agreement.reached:
            return []
        names = [f"mean of {each}" for each in self.parameters]
        names += [f"spread of {each}" for each in self.parameters]
        names += [f"{each} of {who}" for who in self.people for each in self.parameters]
        names += self.predictors.names
        names += [f"correlation of {first} and {second}" for first, second in self.correlation]
        worst = np.argsort(self.agreement.effective)[:3]
        told = ", ".join(f"{names[k]} ({self.agreement.effective[k]:.0f})" for k in worst)
        return [
            f"chains of {len(self.chains[0])} draws have not converged: R-hat is up to "
            f"{self.agreement.rhat.max():.3f} (at most {LARGEST_RHAT} is required), and the "
            f"effective sample sizes are as small as {told}, not {FEWEST_EFFECTIVE:.0f}. "
            "Intervals are rough: draw more (most_draws), or fix a parameter that the data do not "
            "determine"
        ]

    def to_datatree(self) -> xarray.DataTree:
        """Return posterior, log likelihood per trial and data for ArviZ; see ``labels``."""
        names = self.parameters
        group = {name: self.group[..., k] for k, name in enumerate(names)}
        group |= {f"{name}_between_people": self.between[..., k] for k, name in enumerate(names)}
        group |= self.slopes
        group |= {f"correlation of {a} and {b}": each for (a, b), each in self.correlation.items()}
        individual = {name: self.individual[..., k] for k, name in enumerate(names)}
        tree = labelled(group, individual, self.log_likelihood, self.likelihoods)
        tree.attrs["notes"] = self.notes()
        return tree

    def to_netcdf(self, path: str | Path) -> Path:
        """Write ``to_datatree()`` atomically as a netCDF file that ArviZ opens; return its path."""
        with replacing(path) as partial:
            self.to_datatree().to_netcdf(partial, engine="h5netcdf")
        return Path(path)

    def plot(self) -> Figure:
        """Draw each person's parameters with intervals, and the distribution of the group."""
        trials = sum(int(each.design.trials.sum()) for each in self.likelihoods.values())
        return draw_group(self.to_dataframe(), self.summary(), trials)

    def plot_cells(self) -> Figure:
        """Draw data and model over strength, with all people's trials pooled, as ``Fit.plot``."""
        from bgmodel.fitting.quantiles import draw_fits

        table = pooled(self.typical.values())
        if table is None:
            message = "people have different strengths or conditions: cells() has each person's"
            raise InputError(message, "strength")
        return draw_fits({"Model": table}, f"{len(self.people)} people, trials pooled")


MIDDLE = ("median", "low", "high")


def _middle(draws: Array, names: tuple[str, ...]) -> dict[str, Array]:
    """Return median, low and high end of the central interval of draws (chains, draws, numbers)."""
    at = np.quantile(draws, [0.5, (1 - SHARE) / 2, (1 + SHARE) / 2], axis=(0, 1))
    return dict(zip(names, at, strict=True))


def _of_one(draws: Array) -> dict[str, float]:
    """Return median, low, high and the probability that a number (chains, draws) is positive."""
    middle = {name: float(each[0]) for name, each in _middle(draws[..., None], MIDDLE).items()}
    return middle | {"above_zero": float((draws > 0).mean())}


def check_people(likelihoods: Mapping[str, Likelihood]) -> None:
    """Raise ValueError unless a group can be fitted: enough people and trials, same parameters."""
    if len(likelihoods) < FEWEST_PEOPLE:
        raise InputError.of(
            "participant", f"must be at least {FEWEST_PEOPLE} for a hierarchical fit",
            ", ".join(likelihoods) or "none",
        )  # fmt: skip
    few = {
        who: int((each.design.observed.response >= 0).sum()) for who, each in likelihoods.items()
    }
    few = {who: count for who, count in few.items() if count < FEWEST_TRIALS}
    if few:
        told = ", ".join(f"{who} ({count})" for who, count in few.items())
        raise InputError(
            f"each person must have at least {FEWEST_TRIALS} responses, and these have fewer: "
            f"{told}. Leave them out",
            "data",
        )
    first = next(iter(likelihoods.values())).freedom
    for who, each in likelihoods.items():
        lacking = set(first.names) ^ set(each.freedom.names)
        if lacking:
            raise InputError(
                f"{who} and {next(iter(likelihoods))} must have the same levels of each condition; "
                f"only one of them has {', '.join(sorted(lacking))}",
                "vary",
            )


def _shared(likelihood: Likelihood, shared: Sequence[str] | None) -> Truths:
    """Return which numbers of a fit people share; ValueError for a name that is not free."""
    moved = [each.parameter for each in likelihood.freedom.moved]
    names = list(dict.fromkeys(each.name for each in moved))
    for name in shared or ():
        require(name in names, "shared", f"must be of {', '.join(names)}", name)
    return np.array([p.shared if shared is None else p.name in shared for p in moved])


def fit_group(
    likelihoods: Mapping[str, Likelihood],
    *,
    predictors: Predictors = ALIKE,
    seed: int = HIERARCHY_SEED,
    workers: int = 1,
    most_draws: int = MOST,
    shared: Sequence[str] | None = None,
    correlated: bool = False,
    kept: Entry[Arrays] | None = None,
    tell: Tell = lambda _: None,
) -> GroupFit:
    """Fit a model to a group of people, with partial pooling of their parameters.

    Parameters named ``shared`` are the same for everyone; people are Gaussian on a scale, see
    ``group.Group``. Chains run until they agree or have ``most_draws``, and continue from ``kept``.
    Warns of misfit, and of chains that do not agree.
    """
    check_people(likelihoods)
    every = list(likelihoods.values())
    same = _shared(every[0], shared)
    if correlated and (~same).sum() < 2:
        raise InputError("correlated needs two parameters in which people differ", "correlated")
    tell(f"start of {len(every)} people")
    first = estimates(every, min(workers, len(every)))
    scale = Scale.of(every[0].freedom, np.median(first, axis=0))
    people = [Person(each, scale) for each in every]
    with shared_map(min(workers, max(len(people), CHAINS)), people) as over_people:
        group, expansion = started(over_people, scale.to(first), same)
        highest = scale.to(scale.high)
        group = replace(
            group, mean=np.minimum(group.mean, highest), highest=highest,
            slopes=np.zeros(len(predictors.names)), predictors=predictors,
            prior=priors_of(every[0].freedom, scale),
            correlation=np.eye(len(same)) if correlated else None,
        )  # fmt: skip
        chains = sampled(
            Sampler(people, expansion), group,
            seed=seed, over_people=over_people, most=most_draws, kept=kept, tell=tell,
        )  # fmt: skip
    group_fit = GroupFit(dict(likelihoods), scale, chains, predictors)
    for caution in group_fit.cautions():
        FitWarning.warn(caution)
    return group_fit

"""Comparison of models by how well they predict trials that they were not fitted to."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from bgmodel.fitting.cautions import resolved
from bgmodel.fitting.design import Design
from bgmodel.fitting.hierarchy.group_fit import GroupFit
from bgmodel.fitting.hierarchy.labels import each_trial
from bgmodel.fitting.likelihood import Likelihood
from bgmodel.fitting.optimum import Optimum, optimum
from bgmodel.fitting.person_fit import Fit
from bgmodel.fitting.posterior import directions
from bgmodel.fitting.simulated.error import jackknifed, without_parts
from bgmodel.support.saved import Facts
from bgmodel.support.seeds import stream
from circuits.arrays import Array, Integers
from circuits.errors import FitWarning, InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FOLDS, FOLDS_SEED = 5, 24_301
"""Number of parts into which trials are divided, and the seed of the division."""


@dataclass(frozen=True)
class Predicted:
    """Log likelihood of each trial under the fit to the other folds."""

    each: Array  # (trials,), nats
    without: Array  # (parts, trials), without each part of simulated trials; no rows if exact
    draws_error: float = 0.0  # of the sum, nats, from the finite number of a hierarchy's draws


@dataclass(frozen=True)
class Better:
    """Advantage of one model's predictions over another's, summed over trials, nats."""

    nats: float
    error: float  # from the data, and from the simulated trials and draws of both models
    simulation_error: float  # the part due to simulated trials and draws


def predicted(likelihood: Likelihood, *, start: Array | None = None) -> Predicted:
    """Return the log likelihood of each trial under the fit to the other folds.

    The trials of each cell are divided evenly; all models have the same folds.
    """
    part = _divided(likelihood.groups, FOLDS, FOLDS_SEED)
    each = np.empty(len(part))
    without = np.empty((len(likelihood.without_parts()), len(part)))
    starts = None if start is None else [start]
    for fold in range(FOLDS):
        left = likelihood.part(np.flatnonzero(part != fold))
        rest = likelihood.part(np.flatnonzero(part == fold))
        vector = optimum(left, starts=starts).vector
        each[part == fold] = rest.unbiased(vector)
        if len(without):
            moved = without_parts(left, directions(left, vector))
            for row, less, (_, at) in zip(without, rest.without_parts(), moved, strict=True):
                row[part == fold] = less.each(at)
    return Predicted(each, without)


def better_by(first: Predicted, second: Predicted, person: Integers | None = None) -> Better:
    """Return the advantage of predictions over others' on the same folds, nats.

    With several people, ``person`` (trials,), they are the sample: trials of one are alike.
    """
    apart = first.each - second.each
    if person is not None and person.max() > 0:
        apart = by_person(apart, person)
    sampling = float(apart.std(ddof=1) * math.sqrt(len(apart)))
    one, other = (
        each.without.sum(axis=1) if len(each.without) else np.zeros(1) for each in (first, second)
    )
    simulation_error = math.hypot(
        float(jackknifed(one - other)), first.draws_error, second.draws_error
    )
    return Better(float(apart.sum()), math.hypot(sampling, simulation_error), simulation_error)


def by_person(trials: Array, person: Integers) -> Array:
    """Return the sum of a quantity over the trials of each person, (people,)."""
    return np.asarray(np.bincount(person, trials), dtype=np.float64)


def _divided(cell: Integers, folds: int, seed: int) -> Integers:
    cell = np.asarray(cell)
    order = stream(seed, "folds").permutation(len(cell))
    part = np.empty(len(cell), dtype=np.int64)
    first = 0
    for each in np.unique(cell):
        some = order[cell[order] == each]
        part[some] = (first + np.arange(len(some))) % folds
        first += len(some)
    return part


DRAWS = 500
"""Number of draws of each chain for the scores of hierarchical fits."""
UNCERTAIN = 2.0
"""Difference, in standard errors, up to which two models cannot be told apart."""
SEARCHED = 0.1
"""Difference, nats, that the searches for the best parameters of the parts can make alone."""
ABOVE_NATS = 1.0
"""A left-out score above the log likelihood of the fit by more shows that its search failed."""
SMOOTH = 0.7
"""Largest Pareto k at which importance sampling is reliable (Vehtari, Gelman & Gabry 2017)."""
Tell = Callable[[str], None]


@dataclass(frozen=True)
class ModelScore:
    """How well a model predicts each trial."""

    predicted: Predicted  # each trial under the model fitted without it
    person: Integers  # (trials,), index of the person
    log_likelihood: float = np.nan  # at its maximum, nats; NaN for a hierarchy
    # Number of fitted parameters; NaN for a hierarchy, where people are not free of each other.
    numbers: float = np.nan
    unreliable: int = 0  # number of trials with an unreliable score

    @property
    def bic(self) -> float:
        """Bayesian information criterion, nats: smaller is better (Schwarz 1978)."""
        return float(self.numbers * np.log(len(self.predicted.each)) - 2 * self.log_likelihood)


@dataclass(frozen=True, repr=False)
class ModelComparison(Facts):
    """Models compared on the same trials."""

    scores: dict[str, ModelScore]
    people: list[str]
    method: str  # ``cross-validation`` or ``PSIS-LOO``.

    @property
    def best(self) -> str:
        """Name of the model with the highest score."""
        return max(self.scores, key=lambda name: self.scores[name].predicted.each.sum())

    def facts(self) -> dict[str, str]:
        """Return the method, the number of trials and the verdict on each model."""
        table = self.table
        facts = {"method": self.method, "trials": f"{len(self.scores[self.best].predicted.each)}"}
        return facts | {str(name): str(verdict) for name, verdict in table["verdict"].items()}

    @cached_property
    def table(self) -> pd.DataFrame:
        """One row per model, the best first; likelihoods and BIC are unknown for hierarchies.

        ``score`` is the sum of log densities of trials, each predicted without it, nats; errors of
        ``difference`` are from trials, or from people if there are several, and from the simulated
        trials and draws (``simulation_error``).
        """
        best = self.scores[self.best]
        rows = {
            name: {
                "log_likelihood": score.log_likelihood,
                "parameters": score.numbers,
                "bic": score.bic,
                "score": score.predicted.each.sum(),
                **_apart(score, best),
            }
            for name, score in self.scores.items()
        }
        table = pd.DataFrame.from_dict(rows, orient="index").rename_axis("model")
        table = table.sort_values("score", ascending=False)
        table["verdict"] = [self._verdict(row) for _, row in table.iterrows()]
        return table

    def _verdict(self, row: pd.Series) -> str:
        if row.name == self.best:
            return "best score"
        if -row["difference"] > max(UNCERTAIN * row["standard_error"], SEARCHED):
            return f"{self.best} predicts better"
        return f"cannot tell from {self.best}"

    def summary(self) -> str:
        """Return the table and how to read it, as text."""
        trials = len(self.scores[self.best].predicted.each)
        head = (
            f"{trials} trials of {len(self.people)} participants, predicted by {self.method}. "
            f"Scores are in nats; differences of less than {UNCERTAIN:g} standard errors decide "
            "nothing."
        )
        return f"{head}\n{self.table.dropna(axis=1, how='all').round(2).to_string()}"

    def to_dataframe(self) -> pd.DataFrame:
        """Return the table with the names of models as a column."""
        return self.table.reset_index()

    def plot(self) -> Figure:
        """Draw each model's difference from the best, in total and for each person."""
        from bgmodel.fitting.quantiles import draw_comparison

        best = self.scores[self.best]
        apart = {
            name: by_person(score.predicted.each - best.predicted.each, score.person)
            for name, score in self.scores.items()
        }
        title = (
            f"{len(best.predicted.each)} trials of {len(self.people)} participants, {self.method}"
        )
        return draw_comparison(self.table, apart, title)


def _apart(score: ModelScore, best: ModelScore) -> dict[str, float]:
    same = score is best
    advantage = (
        Better(0.0, 0.0, 0.0) if same else better_by(score.predicted, best.predicted, score.person)
    )
    each = by_person(score.predicted.each - best.predicted.each, score.person)
    return {
        "difference": advantage.nats,
        "standard_error": advantage.error,
        "simulation_error": advantage.simulation_error,
        "people_better": float((each > 0).sum()),
    }


def compare_fits(
    fits: Mapping[str, Fit] | Mapping[str, Mapping[str, Fit]] | Mapping[str, GroupFit],
) -> ModelComparison:
    """Compare models fitted to the same trials by how well they predict trials left out.

    Fits to one person, or to several separately, are repeated without each of five parts of the
    trials (cross-validation; see ``predicted``). For hierarchical fits, importance sampling from
    the draws replaces these repetitions (PSIS-LOO; Vehtari, Gelman & Gabry 2017).

    Parameters
    ----------
    fits : dict of str to Fit, to dict of str to Fit, or to GroupFit
        Each model's fit, its fit to each person, or its hierarchical fit, by name of the model.

    Raises
    ------
    ValueError
        For fewer than two models, for fits to different trials, and for fits of different kinds.

    Warns
    -----
    FitWarning
        If importance sampling is unreliable for some trials.
    """
    if not isinstance(fits, Mapping) or len(fits) < 2:
        raise InputError.of("fits", "must map the names of at least two models to fits", fits)
    if all(isinstance(each, GroupFit) for each in fits.values()):
        groups = {name: each for name, each in fits.items() if isinstance(each, GroupFit)}
        _check_same({name: each.likelihoods for name, each in groups.items()})
        scores = {name: _left_out(each) for name, each in groups.items()}
        _warn_of_unreliable(scores)
        return ModelComparison(scores, next(iter(groups.values())).people, "PSIS-LOO")
    optima = {name: {who: fit.optimum for who, fit in _people(each).items()}
              for name, each in fits.items()}  # fmt: skip
    return crossvalidated(optima)


def crossvalidated(
    optima: Mapping[str, Mapping[str, Optimum]], *, tell: Tell = lambda _: None
) -> ModelComparison:
    """Compare models by cross-validation from each person's optimum; see ``compare_fits``."""
    _check_same({m: {who: one.likelihood for who, one in p.items()} for m, p in optima.items()})
    scores = {}
    for name, people in optima.items():
        tell(f"cross-validation of {name}")
        scores[name] = _crossvalidated(name, list(people.values()))
    return ModelComparison(scores, list(next(iter(optima.values()))), "cross-validation")


def _people(fit: object) -> dict[str, Fit]:
    if isinstance(fit, Fit):
        return {fit.optimum.likelihood.design.who: fit}
    if isinstance(fit, Mapping) and fit and all(isinstance(each, Fit) for each in fit.values()):
        return dict(fit)
    raise InputError.of(
        "fits", "must be Fit records, mappings of people to them, or GroupFit records, all alike",
        type(fit).__name__,
    )  # fmt: skip


def _check_same(likelihoods: Mapping[str, Mapping[str, Likelihood]]) -> None:
    first_name, first = next(iter(likelihoods.items()))
    for name, each in likelihoods.items():
        if list(each) != list(first):
            raise InputError(f"{name} and {first_name} are fits to different people", "fits")
        for who, likelihood in each.items():
            mine, others = (some.design for some in (likelihood, first[who]))
            if not _same_trials(mine, others):
                raise InputError(f"{name} and {first_name} are fits to different trials", "fits")
            if mine.observed.window_s != others.observed.window_s:
                raise InputError(f"{name} and {first_name} have different rt_window", "fits")


def _same_trials(one: Design, other: Design) -> bool:
    names = ("rt_s", "response", "ssd_s", "reward", "deadline_s")
    records = [design.choices or design.observed for design in (one, other)]
    mine, others = ([getattr(each, name, None) for name in names] for each in records)
    return all(
        np.array_equal(np.asarray(a, float), np.asarray(b, float), equal_nan=True)
        for a, b in zip(mine, others, strict=True)
    )


def _crossvalidated(name: str, people: list[Optimum]) -> ModelScore:
    """Return the score of fits to single people, in bins as narrow as each fit needs."""
    fits = [resolved(each) for each in people]
    parts = [predicted(each.likelihood, start=each.vector) for each in fits]
    nats = [float(each.likelihood.unbiased(each.vector).sum()) for each in fits]
    for fit, part, highest in zip(fits, parts, nats, strict=True):
        score, error = part.each.sum(), UNCERTAIN * float(jackknifed(part.without.sum(axis=1)))
        if score > highest + ABOVE_NATS + error:
            FitWarning.warn(
                f"{fit.likelihood.design.who}, {name}: the search failed, since trials left out of "
                f"a fit must not be likelier than in the fit to all of them ({score:.1f} and "
                f"{highest:.1f} nats): fix a parameter, or scale the data nearer to its defaults"
            )
    return ModelScore(
        Predicted(
            np.concatenate([part.each for part in parts]),
            np.concatenate([part.without for part in parts], axis=1),
        ),
        _person([each.likelihood for each in fits]),
        sum(nats),
        sum(len(each.vector) for each in fits),
    )


def _person(likelihoods: Iterable[Likelihood]) -> Integers:
    counts = [len(each.design.observed.response) for each in likelihoods]
    return np.repeat(np.arange(len(counts)), counts)


def _left_out(fit: GroupFit) -> ModelScore:
    draws = len(fit.chains[0])
    places = np.unique(np.linspace(0, draws - 1, min(draws, DRAWS)).astype(int))
    log = each_trial(fit.likelihoods, fit.individual[:, places])
    trials, khat = importance_sampled(log)
    medians = np.median(fit.individual, axis=(0, 1))
    vectors = list(zip(fit.likelihoods.values(), medians, strict=True))
    # The error of simulated trials is that of the log likelihood at everyone's medians.
    parts = [[part.each(at) for part in one.without_parts()] for one, at in vectors]
    without = np.array([np.concatenate(row) for row in zip(*parts, strict=True)])
    without = without.reshape(len(parts[0]), log.shape[2])
    return ModelScore(
        Predicted(trials, without, draws_error(log)),
        _person(fit.likelihoods.values()),
        unreliable=int((khat > SMOOTH).sum()),
    )


def importance_sampled(log: Array) -> tuple[Array, Array]:
    """Return the PSIS-LOO score of each trial, nats, and its Pareto k; see ``draws_error``.

    Importance weights are not smoothed if the largest are equal, as those of a go trial of stop
    signals, which is certain, or of a trial that a model rules out. Scores of the latter are
    unreliable unless all weights are equal.
    """
    from arviz_stats.base import array_stats

    flat = log.reshape(-1, log.shape[2])
    low, draws = flat.min(axis=0), len(flat)
    scores = low - np.log(np.exp(low - flat).mean(axis=0))
    khat = np.where(flat.max(axis=0) == low, -np.inf, np.inf)
    tail = int(min(draws / 5, 3 * math.sqrt(draws)))
    uneven = (flat == low).sum(axis=0) < tail
    if uneven.any():
        some = np.moveaxis(log[..., uneven], 2, 0)
        scores[uneven], khat[uneven], *_ = array_stats.loo(some, chain_axis=1, draw_axis=2)
    return scores, khat


def draws_error(log: Array) -> float:
    """Return the standard error of a PSIS-LOO score from the number of its draws, nats.

    ``log`` (chains, draws, trials) is the log density of each trial given each draw. To first order
    a draw moves the score by its importance weights, 1 / density, summed over trials.
    """
    from arviz_stats.base import array_stats

    weights = np.exp(log.min(axis=(0, 1)) - log)
    moved = (weights / weights.mean(axis=(0, 1))).sum(axis=2)
    return float(array_stats.mcse(moved, chain_axis=0, draw_axis=1, method="mean"))


def _warn_of_unreliable(scores: Mapping[str, ModelScore]) -> None:
    for name, score in scores.items():
        if score.unreliable:
            FitWarning.warn(
                f"{name}: the scores of {score.unreliable} of {len(score.person)} trials are "
                f"unreliable (Pareto k above {SMOOTH:g}), since the fit depends much on them. "
                "If the models hardly differ, compare fits to single people by cross-validation "
                "(without --people hierarchical)"
            )

"""Held-out spikes and choices under models of recorded cells, and under descriptive regressions.

Everything is summed over five folds of trials in a row, the same for all. Spikes are given the
clicks and choice of the trial, and the recent rate of the cell. A regression has no noise of the
sum: the course of a cell (PSTH), its recent rate, and the sum of clicks or the choice over time.
"""

from __future__ import annotations

import argparse
import itertools
import re
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import minimize

from bgmodel.fit_trials import question
from bgmodel.fitting.cells.density import SUMS, chosen, encoded_by, p_right, variance
from bgmodel.fitting.cells.model import SHARED, CellsLikelihood, numbers_of
from bgmodel.fitting.cells.sessions import BIN_S, KNOTS, LAG_S, RecordedSession, sessions_of
from bgmodel.fitting.model_comparison import FOLDS
from bgmodel.fitting.optimum import optimum
from bgmodel.fitting.settings import FitSettings
from bgmodel.support.seeds import stream
from bgmodel.trials.reader import Columns, read_trials
from bgmodel.trials.record import Trials
from circuits.arrays import Array, Integers

SHIPPED = "striatum_clicks"
COLUMNS = Columns(rt="stimulus_s", response="chose_right", participant="rat", upper="right")
LEAK = {"leak_per_s": 0.0, "adaptation": 0.13, "recovery_s": 0.1}
"""The sum of the regressions."""
RIDGE, STEPS = 1e-3, 25
GROUPS = list(itertools.product(range(3), (0, 1)))
SHOWN, FEWEST = 20, 10
"""Bins of the courses that are shown, and the fewest trials of a group."""
NO_NOISE = ("noise=0.02", "start_noise=0.02")
CORRELATION = "shared_noise"
REFERENCE, NO_SHARED, NO_RECENT = "exponential", "no shared noise", "no recent rate"
ENCODINGS = ("linear", "step", "macaque D1", "macaque D2")
"""Encodings that are compared with the reference."""
MODELS = (REFERENCE, *ENCODINGS, NO_SHARED, NO_RECENT)
CHOICES_ALONE = "choices alone"
OF_CHOICE = ("deciding_noise", "deciding_leak_per_s", "bias", "lapse")
"""Parameters of the choices without regard to spikes."""
REGRESSIONS = ("psth", "clicks", "choice", "clicks and choice")
LATER = range(4)
"""Bins by which cells are tried to read the sum of clicks later."""


@cache
def trials_of(folder: str) -> Trials:
    """Return the shipped trials, or those of a folder with trials.parquet and spikes.parquet."""
    if folder == SHIPPED:
        return read_trials(SHIPPED)
    path = Path(folder)
    return read_trials(path / "trials.parquet", columns=COLUMNS, spikes=path / "spikes.parquet")


def likelihood_of(trials: Trials, name: str, *fixed: str) -> CellsLikelihood:
    """Return the likelihood of one animal's trials under a model, with further fixed numbers."""
    free: tuple[str, ...] = ()
    if name == NO_SHARED:
        fixed += NO_NOISE
    elif name == NO_RECENT:
        cells = (cell for session in sessions_of(trials) for cell in session.names)
        fixed += tuple(f"{numbers_of(cell)[-2]}=0" for cell in cells)
        # Noise that absorbs slow changes of cells does not decide as a whole.
        free = (f"+{CORRELATION}",)
    encoding = REFERENCE if name in (NO_SHARED, NO_RECENT) else name
    one = question(FitSettings(fix=fixed, free=free), trials, [encoding], alone=True)
    (likelihood,) = one.likelihoods(encoding).values()
    assert isinstance(likelihood, CellsLikelihood)
    return likelihood


@dataclass(frozen=True)
class Fold:
    """Trials of a fit, and those that are left out."""

    kept: Integers
    left: Integers


def folds(likelihood: CellsLikelihood) -> Iterator[Fold]:
    """Yield folds: a fifth of each session in a row, since every cell belongs to one session."""
    groups = likelihood.groups
    part = np.empty(len(groups), int)
    for each in np.unique(groups):
        some = np.flatnonzero(groups == each)
        part[some] = np.arange(len(some)) * FOLDS // len(some)
    for number in range(FOLDS):
        yield Fold(np.flatnonzero(part != number), np.flatnonzero(part == number))


def scored(folder: str, name: str) -> pd.DataFrame:
    """Return held-out nats of one model: a row per trial, and a row per cell.

    Of a trial: ``together``, all spikes given the choice, in the order in which they come;
    ``choices``, and ``told``, how much better they are predicted with the spikes. Of a cell:
    ``apart``, the mean over paths that clicks and choice leave, bin by bin: what a regression
    predicts.
    """
    trials, begun = trials_of(folder), time.process_time()
    likelihood = likelihood_of(trials, name)
    start = optimum(likelihood).vector
    fitted_s, tables = time.process_time() - begun, []
    for fold in folds(likelihood):
        vector = optimum(likelihood.part(fold.kept), starts=[start]).vector
        left = likelihood.part(fold.left)
        together, choices = left.each(vector), left.choices(vector)
        spikes = _without_choices(left).each(vector)
        tables += [
            pd.DataFrame({
                "trial": fold.left, "together": together - choices, "choices": choices,
                "told": together - spikes - choices,
            }),
            pd.DataFrame(
                {"cell": cell, "apart": float(log.sum())}
                for cell, log, _ in expected(left, vector)
            ),
        ]  # fmt: skip
    table = _summed(tables).assign(model=name)
    numbers = dict(zip(likelihood.freedom.names, start, strict=True))
    names = (each.name for each in SHARED if each.free or each.name == CORRELATION)
    shared = {name: numbers.get(name, np.nan) for name in names}
    return table.assign(**shared, cpu_s=fitted_s)


def chosen_alone(folder: str) -> pd.DataFrame:
    """Return held-out nats of choices under a fit of choices alone: a row per trial."""
    likelihood = likelihood_of(trials_of(folder), REFERENCE)
    names = likelihood.freedom.names
    at = [names.index(name) for name in OF_CHOICE]
    space, vector = likelihood.freedom, likelihood.freedom.start.copy()

    def fitted(part: CellsLikelihood) -> Array:
        def loss(numbers: Array) -> float:
            vector[at] = numbers
            return -float(part.choices(vector).sum())

        bounds = list(zip(space.low[at], space.high[at], strict=True))
        vector[at] = minimize(loss, vector[at], method="L-BFGS-B", bounds=bounds).x
        return vector

    shared, tables = dict(zip(OF_CHOICE, fitted(likelihood)[at], strict=True)), []
    for fold in folds(likelihood):
        left, vector = likelihood.part(fold.left), fitted(likelihood.part(fold.kept))
        tables.append(pd.DataFrame({"trial": fold.left, "choices": left.choices(vector)}))
    return _summed(tables).assign(model=CHOICES_ALONE, **shared)


def _summed(tables: list[pd.DataFrame]) -> pd.DataFrame:
    """Return sums over folds of each trial and of each cell."""
    rows = pd.concat(tables, ignore_index=True)
    keys = [name for name in ("trial", "cell") if name in rows]
    return rows.groupby(keys, as_index=False, dropna=False).sum(min_count=1)


def _without_choices(likelihood: CellsLikelihood) -> CellsLikelihood:
    """Return the likelihood of the spikes of the same trials."""
    some = (replace(one, choice=np.full_like(one.choice, -1)) for one in likelihood.sessions)
    return replace(likelihood, sessions=tuple(some))


def expected(likelihood: CellsLikelihood, vector: Array) -> Iterator[tuple[str, Array, Array]]:
    """Yield cells with log probability and mean of their spikes, given clicks and choice.

    In each bin that belongs to a trial, from the mean over the noise that clicks and choice leave.
    """
    values, encoding = likelihood.values(vector), likelihood.model.encoding
    nodes, weights = np.polynomial.hermite_e.hermegauss(21)
    for session in likelihood.sessions:
        sums, on = session.sums(*(values[name] for name in SUMS)), session.on
        now, p = _given_choice(session, values, nodes)
        weight = weights * p[on]
        weight /= weight.sum(axis=1, keepdims=True)
        x = (sums[:, :-1, None] + now)[on]
        read = encoded_by(encoding, values, x)[0]
        for name, count, past in zip(session.names, session.counts, session.past, strict=True):
            cell = np.array([values[each] for each in numbers_of(name)])
            base = (session.basis @ cell[:-2] + cell[-2] * past)[on]
            rate = encoding.rate(base[:, None], cell[-1] * read)[1] * BIN_S
            log = np.log((weight * rate ** count[on][:, None] * np.exp(-rate)).sum(axis=1))
            yield name, log, (weight * rate).sum(axis=1)


def _given_choice(
    session: RecordedSession, values: dict[str, float], nodes: Array
) -> tuple[Array, Array]:
    """Return the noise of each bin at nodes, and the probability of the choice given each."""
    now = np.sqrt(variance(values, session.middles_s))[:, None] * nodes
    rest_s = np.maximum(session.end_s[:, None] - session.middles_s, 0.0)
    return now[None], chosen(p_right(session, values, now[None], rest_s), session)


def regressed(
    folder: str, past: bool = True, names: Sequence[str] = REGRESSIONS, later: int = 0
) -> pd.DataFrame:
    """Return held-out nats of the regressions, a row per cell and regression.

    Cells read the sum of clicks ``later`` bins later than ``LAG_S``.
    """
    likelihood = likelihood_of(trials_of(folder), REFERENCE)
    rows = []
    for fold in folds(likelihood):
        kept, left = likelihood.part(fold.kept), likelihood.part(fold.left)
        for fitted, tested in zip(kept.sessions, left.sessions, strict=True):
            for name in names:
                for k, cell in enumerate(fitted.names):
                    train, test = (_columns(one, name, k if past else None, later)
                                   for one in (fitted, tested))  # fmt: skip
                    log = test @ _regression(train, fitted.counts[k][fitted.on])
                    nats = float((tested.counts[k][tested.on] * log - np.exp(log)).sum())
                    rows.append({"model": name, "cell": cell, "apart": nats})
    return pd.DataFrame(rows).groupby(["model", "cell"], as_index=False).sum().assign(past=past)


def delayed(folder: str) -> pd.DataFrame:
    """Return held-out nats of the regression on clicks, a row per cell and delay."""
    base = regressed(folder, names=("psth",)).set_index("cell")["apart"]
    rows = [
        regressed(folder, names=("clicks",), later=later).assign(delay_s=LAG_S + later * BIN_S)
        for later in LATER
    ]
    table = pd.concat(rows, ignore_index=True)
    return table.assign(nats=table["apart"] - base.loc[table["cell"]].to_numpy())


def _columns(session: RecordedSession, name: str, cell: int | None, later: int = 0) -> Array:
    """Return the predictors of a regression in each bin, with the recent rate of a cell if any."""
    on, parts = session.on, [np.broadcast_to(session.basis, (*session.on.shape, KNOTS))]
    if "clicks" in name:
        sums = session.sums(*LEAK.values())[:, :-1]
        parts.append(np.pad(sums, ((0, 0), (later, 0)))[:, : sums.shape[1], None])
    if "choice" in name:
        parts.append((2 * session.choice - 1)[:, None, None] * parts[0])
    if cell is not None:
        parts.append(session.past[cell][:, :, None])
    return np.concatenate([each[on] for each in parts], axis=1)


def _regression(design: Array, spikes: Array) -> Array:
    """Return the numbers of a Poisson regression with a small ridge."""
    numbers = np.zeros(design.shape[1])
    numbers[:KNOTS] = np.log(max(float(spikes.mean()), 1e-3))
    for _ in range(STEPS):
        rate = np.exp(np.clip(design @ numbers, -20, 5))
        slope = design.T @ (spikes - rate) - RIDGE * numbers
        curve = (design.T * rate) @ design + RIDGE * np.eye(len(numbers))
        numbers = numbers + np.clip(np.linalg.solve(curve, slope), -1, 1)
    return numbers


def controls(folder: str, seed: int, shuffles: int) -> pd.DataFrame:
    """Return gains by clicks, and their errors, of spikes as recorded and of other trials'.

    Without noise of the sum: a gain on noise that cells share would not need the clicks. Shuffled
    spikes have the leak of recorded ones, since one that is fitted to them is chosen for its gains.
    """
    trials = trials_of(folder)
    spikes, rows = trials.spikes, []
    assert spikes is not None
    likelihood = likelihood_of(trials, NO_SHARED)
    vector = optimum(likelihood).vector
    leak = f"leak_per_s={likelihood.values(vector)['leak_per_s']}"
    for shuffle in range(shuffles + 1):
        if shuffle:
            order = _shuffled(trials, seed, shuffle)
            moved = replace(trials, spikes=replace(spikes, trial=order[spikes.trial]))
            likelihood = likelihood_of(moved, NO_SHARED, leak)
            vector = optimum(likelihood).vector
        numbers = zip(likelihood.freedom.names, vector, errors(likelihood, vector), strict=True)
        rows += [
            {"spikes": "shuffled" if shuffle else "recorded", "shuffle": shuffle,
             "cell": name.removesuffix(" gain"), "gain": gain, "error": error}
            for name, gain, error in numbers if name.endswith(" gain")
        ]  # fmt: skip
    return pd.DataFrame(rows)


def chosen_elsewhere(folder: str, seed: int) -> pd.DataFrame:
    """Return the held-out information of spikes about choices that are exchanged between trials.

    One row per trial, nats. The model is fitted to the shuffled choices.
    """
    trials = trials_of(folder)
    readings, order = trials.readings, _shuffled(trials, seed)
    assert readings is not None
    assert readings.choice is not None
    choice = np.empty_like(readings.choice)
    choice[order] = readings.choice
    shuffled = replace(
        trials, readings=replace(readings, choice=choice), response=choice.astype(np.int8)
    )
    likelihood, tables = likelihood_of(shuffled, REFERENCE), []
    start = optimum(likelihood).vector
    for fold in folds(likelihood):
        vector = optimum(likelihood.part(fold.kept), starts=[start]).vector
        left = likelihood.part(fold.left)
        told = left.each(vector) - _without_choices(left).each(vector) - left.choices(vector)
        tables.append(pd.DataFrame({"trial": fold.left, "told": told}))
    return _summed(tables).assign(model="shuffled choices")


def errors(likelihood: CellsLikelihood, vector: Array) -> Array:
    """Return the standard error of each number."""
    return np.sqrt(np.diag(np.linalg.inv(likelihood.information(vector)[0])))


def _shuffled(trials: Trials, seed: int, *shuffle: int) -> Integers:
    """Return another trial of the same session for each trial."""
    order, rng = np.arange(trials.trials), stream(seed, "shuffled", *shuffle)
    for session in sessions_of(trials):
        order[session.trials] = rng.permutation(session.trials)
    return order


@cache
def reference_of(folder: str) -> dict[str, float]:
    """Return the numbers of a fit of the reference to all trials."""
    return optimum(likelihood_of(trials_of(folder), REFERENCE)).values


def recovered(folder: str, session: int, seed: int, sets: int) -> pd.DataFrame:
    """Return errors of numbers fitted to simulated sets, in standard errors, by kind of number.

    Sets have the trials of one session; true numbers are those of a fit to all trials. A fit to
    one session has many at the ends of their ranges, where standard errors say little. Numbers
    that are searched on a logarithmic scale have their errors there.
    """
    trials = trials_of(folder)
    trials = trials.where(np.isin(np.arange(trials.trials), sessions_of(trials)[session].trials))
    fitted, rows = likelihood_of(trials, REFERENCE), []
    space, names = fitted.freedom, fitted.freedom.names
    true = np.array([reference_of(folder)[name] for name in names])
    for number in range(sets):
        simulated = fitted.simulated(true, stream(seed, f"session {session}", number))
        likelihood = likelihood_of(simulated, REFERENCE)
        vector = optimum(likelihood).vector
        away = (space.to_scale(vector) - space.to_scale(true)) * space.scale_rate(vector)
        z = away / errors(likelihood, vector)
        rows += [
            {"number": re.sub(r"^\S+ (\D+).*", r"\1", name).strip(), "z": z[k]}
            for k, name in enumerate(names)
        ]
    return pd.DataFrame(rows).assign(sets=sets)


def courses(folder: str) -> pd.DataFrame:
    """Return rates over time by clicks and choice, recorded and of the reference.

    Relative to the mean of the cell in that bin, averaged over cells with a gain of at least two
    standard errors; clicks and choice count for the side that the cell prefers. Clicks are those at
    the end, in thirds of the trials by their difference.
    """
    likelihood, rows = likelihood_of(trials_of(folder), REFERENCE), []
    vector = optimum(likelihood).vector
    of_each = zip(vector, errors(likelihood, vector), strict=True)
    numbers = dict(zip(likelihood.freedom.names, of_each, strict=True))
    rates = {name: rate for name, _, rate in expected(likelihood, vector)}
    for session in likelihood.sessions:
        ends = session.sums(*LEAK.values())[:, -1]
        for name, count in zip(session.names, session.counts, strict=True):
            gain, uncertain = numbers[numbers_of(name)[-1]]
            if abs(gain) < 2 * uncertain:
                continue
            model = np.zeros(session.on.shape)
            model[session.on] = rates[name]
            side = np.sign(gain)
            third = np.searchsorted(np.quantile(side * ends, (1 / 3, 2 / 3)), side * ends)
            preferred = np.where(side > 0, session.choice, 1 - session.choice)
            for (clicks, choice), k in itertools.product(
                GROUPS, range(session.on.shape[1])[:SHOWN]
            ):
                some = session.on[:, k] & (third == clicks) & (preferred == choice)
                mean = count[session.on[:, k], k].mean()
                if some.sum() >= FEWEST and mean > 0:
                    rows.append({
                        "time_s": session.middles_s[k], "clicks": clicks - 1, "choice": choice,
                        "recorded": count[some, k].mean() / mean,
                        "model": model[some, k].mean() / mean,
                    })  # fmt: skip
    groups = pd.DataFrame(rows).groupby(["time_s", "clicks", "choice"])
    error = groups["recorded"].sem()
    return groups.mean().assign(error=error, cells=groups.size()).reset_index()


def main() -> None:
    """Print nats over the regression on course and recent rate, by model; for other animals."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", help="folder with trials.parquet and spikes.parquet")
    parser.add_argument("models", nargs="*", default=["exponential"], help="encodings to fit")
    asked = parser.parse_args()
    regressions = regressed(asked.folder).groupby("model")["apart"].sum()
    base = regressions["psth"]
    print((regressions - base).round(1).to_string())
    for model in asked.models:
        nats = scored(asked.folder, model)[["together", "apart", "choices"]].sum()
        print(
            f"{model}: {nats['together'] - base:.1f} nats of all spikes of a trial together, "
            f"{nats['apart'] - base:.1f} bin by bin; choices {nats['choices']:.1f}"
        )


if __name__ == "__main__":
    main()

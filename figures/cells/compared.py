"""Held-out spikes and choices under models of recorded cells, and under descriptive regressions.

Everything is summed over five folds of trials, the same for all. Spikes of a trial are given its
clicks and choice, and the recent rate of their own cell. A regression has no noise of the sum: the
course of a cell (PSTH), its recent rate, and the sum of clicks or the choice over time.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.special import ndtr

from bgmodel.fits import question, settings_of
from bgmodel.fitting.cells.grid import SUMS
from bgmodel.fitting.cells.model import CellsLikelihood, numbers_of
from bgmodel.fitting.cells.sessions import BIN_S, Session
from bgmodel.fitting.optimum import optimum
from bgmodel.fitting.predicted import FOLDS, FOLDS_SEED
from bgmodel.support.arrays import Array, Integers
from bgmodel.support.seeds import stream
from bgmodel.trials.reading import Columns, read_trials
from bgmodel.trials.record import Trials

SHIPPED = "striatum_clicks"
COLUMNS = Columns(rt="stimulus_s", response="chose_right", participant="rat", upper="right")
LEAK = {"leak_per_s": 0.0, "adaptation": 0.13, "recovery_s": 0.1}
"""The sum of the regressions."""
RIDGE, STEPS = 1e-3, 25
NO_NOISE = {"noise": 0.02, "start_noise": 0.02}
MODELS = {
    "exponential": ("exponential", {}),
    "linear": ("linear", {}),
    "step": ("step", {}),
    "no shared noise": ("exponential", {"fix": NO_NOISE, "free": ["+choice_noise"]}),
}
"""Models by name: their reading and options of a fit."""
REGRESSIONS = ("psth", "clicks", "choice", "clicks and choice")


@cache
def trials_of(folder: str) -> Trials:
    """Return the shipped trials, or those of a folder with trials.parquet and spikes.parquet."""
    if folder == SHIPPED:
        return read_trials(SHIPPED)
    path = Path(folder)
    return read_trials(path / "trials.parquet", columns=COLUMNS, spikes=path / "spikes.parquet")


def likelihood_of(trials: Trials, name: str) -> CellsLikelihood:
    """Return the likelihood of one animal's trials under a model."""
    reading, options = MODELS.get(name, (name, {}))
    one = question(settings_of(**options), trials, [reading], alone=True)
    (found,) = one.likelihoods(reading).values()
    assert isinstance(found, CellsLikelihood)
    return found


@dataclass(frozen=True)
class Fold:
    """Trials of a fit, and those that are left out."""

    kept: Integers
    left: Integers


def folds(likelihood: CellsLikelihood) -> Iterator[Fold]:
    """Yield folds with trials of every session in each."""
    groups = likelihood.groups
    order, part = stream(FOLDS_SEED, "folds").permutation(len(groups)), np.empty(len(groups), int)
    for each in np.unique(groups):
        some = order[groups[order] == each]
        part[some] = np.arange(len(some)) % FOLDS
    for number in range(FOLDS):
        yield Fold(np.flatnonzero(part != number), np.flatnonzero(part == number))


def scored(folder: str, name: str) -> pd.DataFrame:
    """Return held-out nats of spikes given choices, and of choices, of one model: a row per cell.

    ``together`` is of all spikes of a trial, in the order in which they come; ``apart`` is the mean
    over paths that the clicks and the choice leave, bin by bin: what a regression predicts.
    """
    trials, begun = trials_of(folder), time.process_time()
    likelihood = likelihood_of(trials, name)
    start = optimum(likelihood).vector
    fitted_s, rows = time.process_time() - begun, []
    for fold in folds(likelihood):
        vector = optimum(likelihood.part(fold.kept), starts=[start]).vector
        left = likelihood.part(fold.left)
        choices = left.choices(vector)
        together = left.each(vector).sum() - choices.sum()
        rows += [
            {"model": name, "cell": "all", "together": together, "choices": choices.sum()},
            *({"model": name, "cell": cell, "apart": nats} for cell, nats in _apart(left, vector)),
        ]
    table = pd.DataFrame(rows).groupby(["model", "cell"], as_index=False).sum()
    numbers = dict(zip(likelihood.freedom.names[:8], start, strict=False))
    shared = {each.name: numbers.get(each.name, np.nan) for each in likelihood.model.shared}
    return table.assign(**shared, cpu_s=fitted_s)


def _apart(likelihood: CellsLikelihood, vector: Array) -> Iterator[tuple[str, float]]:
    """Yield each cell's nats bin by bin, given the clicks and the choice of the trial."""
    values, reading = likelihood.values(vector), likelihood.model.reading
    nodes, weights = np.polynomial.hermite_e.hermegauss(21)
    for session in likelihood.sessions:
        sums = session.sums(*(values[name] for name in SUMS))
        now, p = _given_choice(session, values, sums, nodes)
        weight = weights * p / (weights * p).sum(axis=2, keepdims=True)
        x = values.get("nats_per_click", 1.0) * (sums[:, :-1, None] + now)
        read = reading.read(x)[0]
        for name, count, past in zip(session.names, session.counts, session.past, strict=True):
            cell = np.array([values[each] for each in numbers_of(name)])
            base = session.basis @ cell[:-2] + cell[-2] * past
            rate = reading.rate(base[:, :, None] + cell[-1] * read)[1] * BIN_S
            log = np.log((weight * rate ** count[:, :, None] * np.exp(-rate)).sum(axis=2))
            yield name, float(log[session.on].sum())


def _given_choice(
    session: Session, values: dict[str, float], sums: Array, nodes: Array
) -> tuple[Array, Array]:
    """Return the noise of each bin at nodes, and the probability of the choice given each."""
    leak, noise, start = (values[x] for x in ("leak_per_s", "noise", "start_noise"))
    leak = leak if abs(leak) > 1e-6 else 1e-6

    def variance(time_s: Array) -> Array:
        more = noise**2 * -np.expm1(-2 * leak * time_s) / (2 * leak)
        return np.asarray(start**2 * np.exp(-2 * leak * time_s) + more)

    now = np.sqrt(variance(session.middles_s))[:, None] * nodes
    rest_s = np.maximum(session.end_s[:, None] - session.middles_s, 0.0)
    var = noise**2 * -np.expm1(-2 * leak * rest_s) / (2 * leak) + values["choice_noise"] ** 2
    mean = np.exp(-leak * rest_s)[:, :, None] * now + sums[:, -1, None, None] + values["bias"]
    right = ndtr(mean / np.sqrt(var)[:, :, None])
    right = (1 - values["lapse"]) * right + values["lapse"] / 2
    return now[None], np.where(session.choice[:, None, None] == 1, right, 1 - right)


def regressed(folder: str, past: bool = True) -> pd.DataFrame:
    """Return held-out nats of the regressions, a row per cell and regression."""
    likelihood = likelihood_of(trials_of(folder), "exponential")
    rows = []
    for fold in folds(likelihood):
        kept, left = likelihood.part(fold.kept), likelihood.part(fold.left)
        for fitted, tested in zip(kept.sessions, left.sessions, strict=True):
            for name in REGRESSIONS:
                both = [_columns(each, name) for each in (fitted, tested)]
                for k, cell in enumerate(fitted.names):
                    own = [
                        np.column_stack([x, each.past[k][each.on]]) if past else x
                        for x, each in zip(both, (fitted, tested), strict=True)
                    ]
                    numbers = _regression(own[0], fitted.counts[k][fitted.on])
                    log, spikes = own[1] @ numbers, tested.counts[k][tested.on]
                    nats = float((spikes * log - np.exp(log)).sum())
                    rows.append({"model": name, "cell": cell, "apart": nats})
    return pd.DataFrame(rows).groupby(["model", "cell"], as_index=False).sum().assign(past=past)


def _columns(session: Session, name: str) -> Array:
    """Return the predictors of a regression in each bin that belongs to a trial."""
    on, parts = session.on, [np.broadcast_to(session.basis, (*session.on.shape, 6))]
    if "clicks" in name:
        parts.append(session.sums(*LEAK.values())[:, :-1, None])
    if "choice" in name:
        parts.append((2 * session.choice - 1)[:, None, None] * parts[0])
    return np.concatenate([each[on] for each in parts], axis=1)


def _regression(design: Array, spikes: Array) -> Array:
    """Return the numbers of a Poisson regression with a small ridge."""
    numbers = np.zeros(design.shape[1])
    numbers[:6] = np.log(max(float(spikes.mean()), 1e-3))
    for _ in range(STEPS):
        rate = np.exp(np.clip(design @ numbers, -20, 5))
        slope = design.T @ (spikes - rate) - RIDGE * numbers
        curve = (design.T * rate) @ design + RIDGE * np.eye(len(numbers))
        numbers = numbers + np.clip(np.linalg.solve(curve, slope), -1, 1)
    return numbers


def controls(folder: str, seed: int) -> pd.DataFrame:
    """Return gains by clicks, and their errors, of spikes as recorded and of other trials'.

    Without noise of the sum: a gain on noise that cells share would not need the clicks.
    """
    trials = trials_of(folder)
    spikes, rng = trials.spikes, stream(seed, "shuffled")
    assert spikes is not None
    order = np.arange(trials.trials)
    for session in likelihood_of(trials, "exponential").sessions:
        order[session.trials] = rng.permutation(session.trials)
    shuffled = replace(trials, spikes=replace(spikes, trial=order[spikes.trial]))
    found = []
    for name, each in (("recorded", trials), ("shuffled", shuffled)):
        likelihood = likelihood_of(each, "no shared noise")
        vector = optimum(likelihood).vector
        error = np.sqrt(np.diag(np.linalg.inv(likelihood.information(vector)[0])))
        for k, number in enumerate(likelihood.freedom.names):
            if number.endswith(" gain"):
                row = {"spikes": name, "cell": number.removesuffix(" gain")}
                found.append(row | {"gain": vector[k], "error": error[k]})
    return pd.DataFrame(found)


def main() -> None:
    """Print nats over the regression on course and recent rate, by model; for other animals."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", help="folder with trials.parquet and spikes.parquet")
    parser.add_argument("models", nargs="*", default=["exponential"], help="readings to fit")
    asked = parser.parse_args()
    regressions = regressed(asked.folder).groupby("model")["apart"].sum()
    base = regressions["psth"]
    print((regressions - base).round(1).to_string())
    for model in asked.models:
        found = scored(asked.folder, model)
        whole = found[found["cell"] == "all"].iloc[0]
        apart = found.loc[found["cell"] != "all", "apart"].sum() - base
        print(
            f"{model}: {whole['together'] - base:.1f} nats of all spikes of a trial together, "
            f"{apart:.1f} bin by bin; choices {whole['choices']:.1f}"
        )


if __name__ == "__main__":
    main()

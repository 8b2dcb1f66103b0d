"""Simulated observers on known evidence, and which model their trials prefer."""

from __future__ import annotations

import time
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from statistics import NormalDist

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel import Evidence, gaussian_evidence, stream
from bgmodel.comparison.designed import RISE_NATS_S, STEP_MS, designs
from bgmodel.fitting.known.known_circuit import KnownCircuit
from bgmodel.fitting.known.known_likelihood import (
    KnownModel,
    known_likelihood,
    observed,
    readings_from,
)
from bgmodel.fitting.known.models import EXACT
from bgmodel.fitting.known.trials import KnownTrials, responding, waiting
from bgmodel.fitting.optimum import Optimum, optimum
from bgmodel.fitting.posterior import directions
from bgmodel.fitting.simulated.error import jackknifed
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from circuits.anatomy import DEFAULT, load_circuit
from circuits.arrays import Array
from circuits.circuit import Circuit

RANDOM, DESIGNED = "Gaussian, N = 2", "designed, N = 4"
KINDS = {RANDOM: 2, DESIGNED: 4}
"""Kinds of evidence, and their number of alternatives."""
D_PRIME, READINGS = 0.5, {RANDOM: 60, DESIGNED: 100}
RATES = (0.6, 1.0, 1.8)
"""Rates at which the leader of designed trials rises, relative to that of ``designed``: with one
rate, threshold and non-decision time could not be told apart."""
TEST, LEAKY, CIRCUIT = "msprt", "leaky_sum", DEFAULT
RESPONSE = {"t0_s": 0.3, "t0_sd_s": 0.05, "lapse": 0.02}
OBSERVERS: Mapping[str, Mapping[str, Mapping[str, float]]] = {
    RANDOM: {
        TEST: {"gain": 1.0, "threshold": 0.12, "noise": 0.03},
        LEAKY: {"leak_hz": 1.0, "threshold": 0.9, "noise": 0.1},
        CIRCUIT: {"threshold": 0.25},
    },
    DESIGNED: {
        TEST: {"gain": 0.5, "threshold": 0.25, "noise": 0.03},
        LEAKY: {"leak_hz": 0.5, "threshold": 3.0, "noise": 0.12},
        CIRCUIT: {"threshold": 0.25},
    },
}
"""Parameters of the observers; the circuit has its default gain and its own noise."""
STRONG_NATS = 3.0
"""Log Bayes factor, 20 to 1, from which a model is preferred (Kass & Raftery 1995)."""
SURE = NormalDist().inv_cdf(0.95)
UNKNOWN = "cannot tell"
EVIDENCE = ("log_likelihood", "time_s", "lengths")


@dataclass(frozen=True)
class Fitted:
    """The optimum of a model on known evidence, with the quantities for Bayes factors."""

    optimum: Optimum

    @cached_property
    def each(self) -> Array:
        """Log likelihood of each trial without the bias of simulated runs, nats."""
        return self.optimum.likelihood.unbiased(self.optimum.vector)

    @cached_property
    def error(self) -> float:
        """Standard error of the log likelihood due to simulated runs, nats."""
        parts = self.optimum.likelihood.without_parts()
        return float(jackknifed([part(self.optimum.vector) for part in parts]))

    @property
    def log_evidence(self) -> float:
        """Approximate log marginal likelihood, -BIC / 2, nats (Schwarz 1978)."""
        return float(self.each.sum() - len(self.optimum.vector) * np.log(len(self.each)) / 2)

    @cached_property
    def errors(self) -> dict[str, float]:
        """Standard error of each free parameter."""
        there = directions(self.optimum.likelihood, self.optimum.vector)
        return dict(zip(there.names, there.standard_errors.tolist(), strict=True))


def verdict(fits: Mapping[str, Fitted]) -> str:
    """Return the preferred model, or "cannot tell".

    It is preferred if its log Bayes factor over every other exceeds 3 nats (20 to 1), with 1.64
    standard errors of simulation subtracted.
    """
    first, *others = sorted(fits, key=lambda name: -fits[name].log_evidence)
    best = fits[first]
    low = [
        best.log_evidence - fits[name].log_evidence - SURE * np.hypot(best.error, fits[name].error)
        for name in others
    ]
    return first if min(low) > STRONG_NATS else UNKNOWN


def trials_needed(log_ratio: npt.ArrayLike, more_parameters: int = 0) -> float:
    """Return the number of trials at which a true model is preferred with probability 0.95.

    The log ratio of each trial (trials,), nats, is that of the true model over a rival, both at the
    parameters that fit many trials best; the true model has k ``more_parameters``. The sum over n
    trials is about Gaussian with mean n m and standard deviation s sqrt(n); BIC subtracts k ln(n) /
    2. The answer is the least n with ``n m - 1.64 s sqrt(n) - k ln(n) / 2 >= STRONG_NATS``,
    infinite if m is not above 0 by two standard errors: the two are not told apart.
    """
    values = np.asarray(log_ratio, dtype=np.float64)
    mean, spread = float(values.mean()), float(values.std(ddof=1))
    if mean <= 2 * spread / np.sqrt(len(values)):
        return np.inf
    count: Array = np.unique(np.round(np.geomspace(10, 1e6, 4000)))
    sure = mean * count - SURE * spread * np.sqrt(count) - more_parameters * np.log(count) / 2
    enough = count[sure >= STRONG_NATS]
    return float(enough[0]) if len(enough) else np.inf


def evidence_of(kind: str, trials: int, seed: int) -> Evidence:
    """Return the readings of some trials of a kind."""
    if kind == RANDOM:
        rng = stream(seed, "known", kind)
        return gaussian_evidence(trials, d_prime=D_PRIME, t_max=READINGS[kind], seed=rng)
    rng = stream(seed, "known", kind)
    every, kappa = designs(KINDS[kind]), gain_of(circuit_of(kind))
    values = np.zeros((trials, READINGS[kind], KINDS[kind]))
    truth = rng.integers(KINDS[kind], size=trials)
    for trial in range(trials):
        rise = RATES[rng.integers(len(RATES))] * RISE_NATS_S * STEP_MS / 1000
        values[trial, :, 0] = rise
        values[trial, 0, 1:] = rng.permutation(every[trial % len(every)].competitors)
        values[trial] = np.roll(values[trial], truth[trial], axis=1) / kappa
    return Evidence(values, truth, step_ms=STEP_MS, baseline=0.0)


def circuit_of(kind: str) -> Circuit:
    """Return the default circuit with the channels of a kind of evidence."""
    return load_circuit(DEFAULT, KINDS[kind])


def trials_of(kind: str, who: str, trials: int, seed: int, **more: float) -> KnownTrials:
    """Return the trials of a simulated observer; ``more`` are further parameters."""
    evidence = evidence_of(kind, trials, seed)
    values = {**RESPONSE, **OBSERVERS[kind][who], **more}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if who == CIRCUIT:
            model = BasalGanglia(circuit_of(kind), seed=seed)
            decisions = model.decided(evidence, values["threshold"])
            rng = stream(seed, "known evidence", model.circuit.name)
            blank = waiting(readings_from(evidence))
            return responding(blank, decisions.choice, decisions.time_ms / 1000, values, rng)
        return observed(EXACT[who], readings_from(evidence), values, seed)


def models_of(kind: str) -> dict[str, KnownModel]:
    """Return the models that are compared: test, leaky sum and circuit."""
    return {TEST: EXACT[TEST], LEAKY: EXACT[LEAKY], CIRCUIT: KnownCircuit(circuit_of(kind))}


def fitted(model: KnownModel, trials: KnownTrials, free: tuple[str, ...] = ()) -> Fitted:
    """Return the fit of a model."""
    return Fitted(optimum(known_likelihood(model, trials, free=free)))


def expected(kind: str, who: str, trials: int, seed: int) -> pd.DataFrame:
    """Return the log Bayes factor per trial of an observer's model over the others.

    Columns evidence, observer, rival, trials, per_trial (mean difference of log likelihoods,
    corrected for the bias of simulated runs), error (standard error over trials and, in
    quadrature, of the runs), sd (over trials), needed (trials at which the model is preferred with
    probability 0.95).
    """
    data = trials_of(kind, who, trials, seed)
    fits = {name: fitted(model, data) for name, model in models_of(kind).items()}
    rows = []
    right = fits[who]
    for name, fit in fits.items():
        if name == who:
            continue
        apart = right.each - fit.each
        more = len(right.optimum.vector) - len(fit.optimum.vector)
        error = np.hypot(apart.std(ddof=1) / np.sqrt(trials), fit.error / trials)
        error = np.hypot(error, right.error / trials)
        needed = trials_needed(apart, more)
        rows.append((kind, who, name, trials, apart.mean(), error, apart.std(ddof=1), needed))
    names = ["evidence", "observer", "rival", "trials", "per_trial", "error", "sd", "needed"]
    return pd.DataFrame(rows, columns=names)


def preferred(kind: str, who: str, trials: int, observers: int, seed: int) -> pd.DataFrame:
    """Return which model the trials of each of some observers prefer, and the parameters.

    Columns evidence, observer, number, trials, verdict, over_<model> (log Bayes factor of the
    observer's own model over another), cpu_s (of the fit of the circuit), and gain, threshold, ...
    of the fit of the own model.
    """
    rows = []
    for number in range(observers):
        data = trials_of(kind, who, trials, seed + number)
        fits, cpu_s = {}, np.nan
        for name, model in models_of(kind).items():
            begun = time.process_time()
            fits[name] = fitted(model, data)
            cpu_s = time.process_time() - begun if name == CIRCUIT else cpu_s
        evidence = {name: fit.log_evidence for name, fit in fits.items()}
        row = {"evidence": kind, "observer": who, "number": number, "trials": trials}
        row |= {"verdict": verdict(fits), "cpu_s": cpu_s}
        row |= {f"over_{name}": evidence[who] - evidence[name] for name in fits}
        rows.append(row | fits[who].optimum.values)
    return pd.DataFrame(rows)


def recovered(kind: str, trials: int, observers: int, seed: int) -> pd.DataFrame:
    """Return true parameters of simulated tests, and their estimates.

    Columns evidence, parameter, true, trials, observers, mean, error (of the mean), spread (between
    observers), within (share of observers whose 90 % interval covers the true value).
    """
    estimates, errors = [], []
    true = {**RESPONSE, **OBSERVERS[kind][TEST]}
    for number in range(observers):
        fit = fitted(EXACT[TEST], trials_of(kind, TEST, trials, seed + number))
        names = list(fit.errors)
        estimates.append(fit.optimum.vector)
        errors.append(list(fit.errors.values()))
    values, error = np.array(estimates), np.array(errors)
    rows = []
    for k, name in enumerate(names):
        if name not in true:
            continue
        near = np.abs(values[:, k] - true[name]) <= 1.645 * error[:, k]
        spread = values[:, k].std(ddof=1)
        mean_error = spread / np.sqrt(observers)
        row = (true[name], trials, observers, values[:, k].mean(), mean_error, spread, near.mean())
        rows.append((kind, name, *row))
    names = ["evidence", "parameter", "true", "trials", "observers", "mean", "error", "spread"]
    return pd.DataFrame(rows, columns=[*names, "within"])


def runs_found(kind: str, effect: float, trials: int, observers: int, seed: int) -> pd.DataFrame:
    """Return the effect of a run of equal cues that is found in observers who are tests.

    Columns effect (put in, nats per further cue), number, trials, run_effect, standard_error,
    log_bayes_factor (with the effect over without it).
    """
    rows = []
    for number in range(observers):
        data = trials_of(kind, TEST, trials, seed + number, run_effect=effect)
        without, with_it = (fitted(EXACT[TEST], data, free) for free in ((), ("+run_effect",)))
        row = {
            "effect": effect,
            "number": number,
            "trials": trials,
            "run_effect": with_it.optimum.values["run_effect"],
            "standard_error": with_it.errors["run_effect"],
            "log_bayes_factor": with_it.log_evidence - without.log_evidence,
        }
        rows.append(row)
    return pd.DataFrame(rows)


def shuffled(kind: str, trials: int, observers: int, seed: int) -> pd.DataFrame:
    """Return the gain of tests on their own evidence, and on that of other trials.

    Columns evidence, number, trials, gain, standard_error, shuffled_gain, shuffled_error.
    """
    rows = []
    for number in range(observers):
        data = trials_of(kind, TEST, trials, seed + number)
        other = stream(seed + number, "shuffled").permutation(trials)
        evidence = {name: getattr(data, name)[other] for name in EVIDENCE}
        mixed = replace(data, **evidence)
        row: list[float] = [number, trials]
        for some in (data, mixed):
            fit = fitted(EXACT[TEST], some, ("+gain",))
            row += [fit.optimum.values["gain"], fit.errors["gain"]]
        rows.append((kind, *row))
    names = ["evidence", "number", "trials", "gain", "standard_error"]
    return pd.DataFrame(rows, columns=[*names, "shuffled_gain", "shuffled_error"])

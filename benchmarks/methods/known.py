"""Simulated observers on known evidence, and which model their trials prefer."""

from __future__ import annotations

import time
import warnings
from collections.abc import Mapping

import numpy as np
import pandas as pd

from bgmodel import Evidence, gaussian_evidence, stream
from bgmodel.comparison.designed import RISE_NATS_S, STEP_MS, designs
from bgmodel.fitting.known.circuit import KnownCircuit
from bgmodel.fitting.known.comparison import compared, trials_needed, verdict
from bgmodel.fitting.known.fit import KnownFit
from bgmodel.fitting.known.likelihood import known_likelihood
from bgmodel.fitting.known.models import EXACT, KnownModel
from bgmodel.fitting.known.observers import observed, observed_circuit, readings_from
from bgmodel.fitting.known.optimum import known_optimum
from bgmodel.fitting.known.trials import KnownTrials
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from circuits.anatomy import DEFAULT, load_circuit
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
            return observed_circuit(
                BasalGanglia(circuit_of(kind), seed=seed), evidence, values, seed
            )
        return observed(EXACT[who], readings_from(evidence), values, seed)


def models_of(kind: str) -> dict[str, KnownModel]:
    """Return the models that are compared: test, leaky sum and circuit."""
    return {TEST: EXACT[TEST], LEAKY: EXACT[LEAKY], CIRCUIT: KnownCircuit(circuit_of(kind))}


def fitted(model: KnownModel, trials: KnownTrials, free: tuple[str, ...] = ()) -> KnownFit:
    """Return the fit of a model, without its warnings."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return KnownFit(known_optimum(known_likelihood(model, trials, free=free)))


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
    own = fits[who]
    for name, fit in fits.items():
        if name == who:
            continue
        apart = own.likelihood.each(own.optimum.vector) - fit.likelihood.each(fit.optimum.vector)
        bias = [each.score.log_likelihood - each.optimum.log_likelihood for each in (own, fit)]
        apart = apart + (bias[0] - bias[1]) / trials
        more = len(own.optimum.vector) - len(fit.optimum.vector)
        error = np.hypot(apart.std(ddof=1) / np.sqrt(trials), fit.score.error / trials)
        error = np.hypot(error, own.score.error / trials)
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
        table = compared(fits)
        evidence = {name: fit.score.log_evidence for name, fit in fits.items()}
        row = {"evidence": kind, "observer": who, "number": number, "trials": trials}
        row |= {"verdict": verdict(table), "cpu_s": cpu_s}
        row |= {f"over_{name}": evidence[who] - evidence[name] for name in fits}
        rows.append(row | fits[who].values)
    return pd.DataFrame(rows)


def recovered(kind: str, trials: int, observers: int, seed: int) -> pd.DataFrame:
    """Return parameters that are put into tests and found in their trials.

    Columns evidence, parameter, true, trials, observers, mean, error (of the mean), spread (between
    observers), within (share of observers whose 90 % interval covers the true value).
    """
    found, errors = [], []
    true = {**RESPONSE, **OBSERVERS[kind][TEST]}
    for number in range(observers):
        fit = fitted(EXACT[TEST], trials_of(kind, TEST, trials, seed + number))
        names = fit.likelihood.freedom.names
        found.append(fit.optimum.vector)
        errors.append(fit.optimum.standard_errors)
    values, error = np.array(found), np.array(errors)
    rows = []
    for k, name in enumerate(names):
        if name not in true:
            continue
        near = np.abs(values[:, k] - true[name]) <= 1.645 * error[:, k]
        spread = values[:, k].std(ddof=1)
        mean_error = spread / np.sqrt(observers)
        own = (true[name], trials, observers, values[:, k].mean(), mean_error, spread, near.mean())
        rows.append((kind, name, *own))
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
        place = with_it.likelihood.freedom.names.index("run_effect")
        found = {
            "effect": effect,
            "number": number,
            "trials": trials,
            "run_effect": float(with_it.optimum.vector[place]),
            "standard_error": float(with_it.optimum.standard_errors[place]),
            "log_bayes_factor": with_it.score.log_evidence - without.score.log_evidence,
        }
        rows.append(found)
    return pd.DataFrame(rows)


def shuffled(kind: str, trials: int, observers: int, seed: int) -> pd.DataFrame:
    """Return the gain of tests on their own evidence, and on that of other trials.

    Columns evidence, number, trials, gain, standard_error, shuffled_gain, shuffled_error.
    """
    rows = []
    for number in range(observers):
        data = trials_of(kind, TEST, trials, seed + number)
        other = stream(seed + number, "shuffled").permutation(trials)
        mixed = KnownTrials(
            data.log_likelihood[other], data.time_s[other], data.lengths[other], data.names,
            data.choice, data.rt_s, data.ids, data.forced, data.source,
        )  # fmt: skip
        row: list[float] = [number, trials]
        for some in (data, mixed):
            fit = fitted(EXACT[TEST], some, ("+gain",))
            place = fit.likelihood.freedom.names.index("gain")
            row += [float(fit.optimum.vector[place]), float(fit.optimum.standard_errors[place])]
        rows.append((kind, *row))
    names = ["evidence", "number", "trials", "gain", "standard_error"]
    return pd.DataFrame(rows, columns=[*names, "shuffled_gain", "shuffled_error"])

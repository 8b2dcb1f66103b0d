"""Tuning of the Simon task of the score ``medication``, to five means that were known.

``python -m benchmarks.tuning.simon`` finds, for each course of the location's input, the d' of a
reading, the input, the posterior and the time outside the circuit at which simulated controls have
the printed mean time of correct responses (553 ms congruent, 33 ms longer if incongruent), the
printed shares of correct responses (0.956, 0.923), and as many trials without a response as there
are in the training of all people, a share of 0.097 that was seen when the columns of the table were
read. The value of the test is that at which a difference of 0.6 gives the share of 0.752 that other
people have with items rewarded in 80 and in 20 % of trials (the set of HDDM's example of learning).
It then writes what the circuit predicts to ``figures/dopamine/medication.toml``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import brentq, minimize

from bgmodel.deciding.decision import UNDECIDED
from bgmodel.integrators.sprt import threshold_from_posterior
from circuits.arrays import Array
from figures.dopamine.simon_model import (
    DEADLINE_MS,
    Simon,
    circuit_at,
    colour,
    crossings,
    items,
)
from figures.dopamine.simon_predictions import (
    KINDS,
    MAIN,
    TOLD,
    Told,
    contrasts,
    models,
    predictions,
    written,
)

SEED, PREDICTION_SEED = 92_101, 92_201
"""Of the fits, and of the simulated people of the predictions."""
TRIALS, PEOPLE = 4000, 200
KNOWN = np.array([553.0, 33.0, 0.956, 0.923, 0.097])
"""Of controls: mean time if congruent, cost, shares of correct responses, and of missing ones."""
ERRORS = np.array([13.0, 4.0, 0.008, 0.008, 0.01])
"""Their standard errors over people; those of the shares, which are not printed, are assumed."""
POSTERIORS, OUTSIDE_MS = np.linspace(0.65, 0.93, 57), np.arange(200.0, 401.0, 5.0)
START, STEPS_OF_START = np.log([0.5, 0.4]), np.log([[0.5, 0.4], [0.65, 0.4], [0.5, 0.7]])
NEAR, SHARE = 0.6, 0.752


def means(simon: Simon, posteriors: Array, outside_ms: Array) -> Array:
    """Return the five means of simulated controls, (outside_ms, posteriors, 5)."""
    evidence, congruent = colour(simon, TRIALS, SEED)
    levels = threshold_from_posterior(posteriors, 2)
    choice, time_ms = crossings(circuit_at(1.0, SEED), evidence, levels)
    right = choice == evidence.truth
    values = np.empty((len(outside_ms), len(posteriors), 5))
    for k, t0_ms in enumerate(outside_ms):
        rt = t0_ms + time_ms
        answered = (choice != UNDECIDED) & (rt <= DEADLINE_MS)
        time, share = [], []
        for some in (congruent, np.logical_not(congruent)):
            mine, correct = answered & some, answered & some & right
            count = np.maximum(correct.sum(axis=1), 1)
            time.append(np.where(correct, rt, 0.0).sum(axis=1) / count)
            share.append(count / np.maximum(mine.sum(axis=1), 1))
        missed = 1 - answered.mean(axis=1)
        values[k] = np.stack([time[0], time[1] - time[0], *share, missed], axis=1)
    return values


def fitted(kind: str) -> tuple[Simon, Array]:
    """Return the parameters closest to the known means, and the means that they give."""
    start = Simon(0.5, 0.4, 0.8, 1.0, 250.0, kind)

    def losses(logs: Array) -> Array:
        d_prime, nats = map(float, np.exp(logs))
        simon = replace(start, d_prime=d_prime, location_nats=nats)
        simulated = means(simon, POSTERIORS, OUTSIDE_MS)
        loss: Array = (((simulated - KNOWN) / ERRORS) ** 2).sum(axis=2)
        return loss

    options = {"xatol": 0.01, "fatol": 0.02, "maxfev": 50, "initial_simplex": STEPS_OF_START}
    best = minimize(lambda x: losses(x).min(), START, method="Nelder-Mead", options=options)
    d_prime, nats = map(float, np.exp(best.x))
    last = losses(best.x)
    outside, level = np.unravel_index(last.argmin(), last.shape)
    closest = replace(
        start, d_prime=round(d_prime, 3), location_nats=round(nats, 3),
        posterior=round(float(POSTERIORS[level]), 3), t0_ms=float(OUTSIDE_MS[outside]),
    )  # fmt: skip
    return closest, means(closest, np.array([closest.posterior]), np.array([closest.t0_ms]))[0, 0]


def value_of(simon: Simon) -> float:
    """Return the value at which a difference of 0.6 gives the share that other people have."""
    levels = np.array([threshold_from_posterior(simon.posterior, 2)])

    def apart(value: float) -> float:
        # Pairs with a difference of 0.5 only, scaled to 0.6.
        evidence, pairs = items(replace(simon, value=value * NEAR / 0.5), 12 * 300, SEED)
        choice, _ = crossings(circuit_at(1.0, SEED), evidence, levels)
        some = np.array(["".join(sorted(pair)) in ("AB", "AC", "BD", "CD") for pair in pairs])
        answered = some & (choice[0] != UNDECIDED)
        return float((choice[0][answered] == 0).mean() - SHARE)

    return round(float(brentq(apart, 0.05, 3.0, xtol=0.01)), 2)


def main() -> None:
    """Print the parameters of all kinds, and write the predictions of those in ``KINDS``."""
    told = Told(PREDICTION_SEED, PEOPLE, [], [])
    for kind in KINDS:
        simon, means_of = fitted(kind)
        simon = replace(simon, value=value_of(simon))
        print(simon, means_of.round(3), flush=True)
        told.models.append(simon)
        table = contrasts(models(simon, PEOPLE, PREDICTION_SEED, tested=kind == MAIN))
        told.predictions.extend(predictions(kind, table))
    TOLD.write_text(written(told))
    print(*fitted("brief"))


if __name__ == "__main__":
    main()

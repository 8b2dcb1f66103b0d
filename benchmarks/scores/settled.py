"""How far trials that share a settled state are correlated: python -m benchmarks.scores.settled.

Trials of the population engine begin in states that several of them share
(``circuits.engines.population.settled``). Their evidence and their noise from the onset on are
independent, so that only the common state can correlate them. If the correlation is rho, the
variance of a mean over trials, m of which share a state, is ``1 + (m - 1) rho`` times that of
independent trials.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import pandas as pd

from benchmarks.scores.pieces import Made, Piece, Score, main
from bgmodel import stream
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from bgmodel.integrators.deciding import CIRCUIT, decide_at_thresholds
from bgmodel.simulated_evidence import gaussian_evidence
from bgmodel.support.arrays import Array
from circuits.anatomy import DEFAULT, load_circuit
from circuits.engines import engine_of
from circuits.engines.population.settled import number_of

SCORING_SEED = 46_101
POSTERIORS = (0.7, 0.85, 0.95)
D_PRIME, STEP_MS, READINGS = 0.7, 50.0, 60
TRIALS, COARSE_TRIALS = {2: 32_768, 4: 16_384}, 2048
MANY = 50_000
"""Trials for which the growth of a standard error is stated."""
RESAMPLES = 1000


def correlation(values: Array, state: Array) -> tuple[float, float, float]:
    """Return the mean correlation of pairs that share a state, with its 95 % interval."""
    z = (values - values.mean()) / values.std()
    count = np.bincount(state)
    products = np.bincount(state, z) ** 2 - np.bincount(state, z**2)
    pairs = count * (count - 1.0)
    drawn = stream(SCORING_SEED, "resamples").integers(len(count), size=(RESAMPLES, len(count)))
    resampled = products[drawn].sum(axis=1) / pairs[drawn].sum(axis=1)
    low, high = np.quantile(resampled, (0.025, 0.975))
    return products.sum() / pairs.sum(), float(low), float(high)


def larger_error(rho: float, trials: int = MANY) -> float:
    """Return how much larger the standard error of a mean is than that of independent trials."""
    count = np.bincount(number_of(np.arange(trials)))
    return float(np.sqrt(1 + rho * (count * (count - 1.0)).sum() / trials) - 1)


def shared(channels: int, trials: int, workers: int) -> pd.DataFrame:
    """Return the correlation of decision times and of choices, by posterior."""
    circuit = load_circuit(DEFAULT, channels)
    rng = stream(SCORING_SEED, "evidence", str(channels))
    given = {"d_prime": D_PRIME, "t_max": READINGS, "step_ms": STEP_MS}
    evidence = gaussian_evidence(trials, channels=channels, seed=rng, **given)
    engine = engine_of("population", workers=workers)
    model = BasalGanglia(circuit, engine, gain_of(circuit), SCORING_SEED)
    thresholds = -np.log(POSTERIORS)
    found = decide_at_thresholds(model, evidence, thresholds, decoder_tau_ms=None)[CIRCUIT]
    state, rows = number_of(np.arange(trials)), []
    for k, posterior in enumerate(np.exp(-np.asarray(found.settings))):
        row = {"channels": channels, "posterior": posterior, "mean_ms": found.time_ms[k].mean()}
        right = (found.choice[k] == evidence.truth).astype(np.float64)
        for name, values in (("time", found.time_ms[k]), ("right", right)):
            rho, low, high = correlation(values, state)
            row |= {f"{name}_r": rho, f"{name}_r_low": low, f"{name}_r_high": high}
        rows.append(row | {"larger_error": larger_error(max(row["time_r_high"], 0.0))})
    return pd.DataFrame(rows)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return the only table."""
    return {"shared": ("shared", made["shared"])}


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield a piece per number of alternatives."""
    for channels, many in TRIALS.items():
        trials = COARSE_TRIALS if fast else many
        make = partial(shared, channels, trials, workers)
        yield Piece("shared", f"N = {channels}", trials, trials * channels / 4000, make)


SCORE = Score("settled", SCORING_SEED, tuple(TRIALS), pieces, tables, circuit=DEFAULT)

if __name__ == "__main__":
    main(SCORE)

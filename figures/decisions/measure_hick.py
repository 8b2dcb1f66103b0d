"""Times over the number of alternatives: the MSPRT, populations and spikes, Gaussian and tactile.

Hick's law says that times grow with the logarithm of the number. The circuit is the default one,
with its default gain for each number. All deciders see the same trials, spikes the first ones.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy.optimize import curve_fit
from scipy.stats import chi2

from bgmodel import BasalGanglia, Msprt, stream
from bgmodel.bootstrap import RESAMPLES, interval, resampled
from bgmodel.comparison.matched import MOST_FORCED
from bgmodel.comparison.thresholds import MSPRT, MSPRT_AT_GAIN, swept
from bgmodel.deciding.tradeoff import Tradeoff, curve, time_at, tradeoff
from bgmodel.evidence import Evidence
from bgmodel.integrators.at_thresholds import (
    sample_ms,
)
from bgmodel.integrators.criterion import gain_of
from bgmodel.simulated_evidence import gaussian_evidence
from circuits.anatomy import DEFAULT, load_circuit
from circuits.engines import engine_of
from figures.decisions.measure_calibrated import TACTILE, kinds, tapped
from figures.pieces import Made, Piece, Score

SCORING_SEED = 74_001
D_PRIME, STEP_MS, READINGS = 0.5, 50.0, 160
COUNTS = (2, 3, 4, 6, 8, 12, 20)
"""Alternatives of the Gaussian problem; above ``most_alternatives`` the MSPRT decides alone."""
SPIKING = {2: 600, 4: 600, 8: 300}
"""Trials in spikes, by alternatives."""
TRIALS, COARSE_TRIALS, TACTILE_TRIALS = 5000, 500, 1998
ACCURACIES = (0.7, 0.75, 0.8, 0.85, 0.9, 0.95, 0.97)
HICK = (0.9, 0.95)
"""Accuracies at which a line is fitted over ln N."""


def drawn(trials: int, alternatives: int, d_prime: float, seed: int = SCORING_SEED) -> Evidence:
    """Draw the Gaussian problem; likelihoods assume d' = 0.5 at any d'."""
    rng = stream(seed, "hick", str(alternatives), f"{d_prime:g}")
    settings = {"d_prime": d_prime, "t_max": READINGS, "step_ms": STEP_MS}
    evidence = gaussian_evidence(trials, channels=alternatives, seed=rng, **settings)
    return replace(evidence, log_likelihood=evidence.log_likelihood * (D_PRIME / d_prime))


def deciders(evidence: Evidence, spiking: int) -> dict[str, Tradeoff]:
    """Return decisions of the tests, of populations, and of spikes on the first trials."""
    by_decider = {MSPRT: tradeoff(Msprt().run(evidence), evidence)}
    if evidence.hypotheses > most_alternatives():
        return by_decider
    gain = gain_of(load_circuit(DEFAULT, evidence.hypotheses))
    by_decider[MSPRT_AT_GAIN] = tradeoff(Msprt(gain).run(evidence), evidence)
    for engine, trials in (("population", evidence.trials), ("spikes", spiking)):
        if trials:
            model = model_of(evidence, engine)
            by_decider[engine] = swept(model, evidence[:trials], by_decider[MSPRT_AT_GAIN])
    return by_decider


def most_alternatives() -> int:
    """Return the largest number of alternatives that the circuit takes."""
    return load_circuit(DEFAULT, 2).most_channels


def model_of(evidence: Evidence, engine: str) -> BasalGanglia:
    """Return the default circuit at its default gain, with noise of the scoring seed."""
    table = load_circuit(DEFAULT, evidence.hypotheses)
    chosen = engine_of(engine, workers=2, sample_ms=sample_ms(evidence.step_ms))
    return BasalGanglia(table, chosen, gain_of(table), SCORING_SEED)


def at_accuracies(
    by_decider: dict[str, Tradeoff], groups: npt.NDArray[np.intp] | None = None
) -> pd.DataFrame:
    """Return mean times at equal accuracies, and extra times over the MSPRT at the circuit's gain.

    Intervals of 95 % are from a bootstrap over trials, or over whole groups of them. NaN where an
    accuracy lies beyond the curve of a decider, at settings whose deadline decides most trials, or
    where the MSPRT is not run at a gain.
    """
    rows = []
    for name, one in by_decider.items():
        of = None if groups is None else groups[: one.trials]
        weights = resampled(one.trials, RESAMPLES, stream(SCORING_SEED, "bootstrap"), of)
        late = one.forced.mean(axis=1) > MOST_FORCED
        time = time_at(ACCURACIES, curve(one.at(~late), weights))
        test = by_decider.get(MSPRT_AT_GAIN)
        longer = np.full_like(time, np.nan)
        if test is not None:
            longer = time - time_at(ACCURACIES, curve(first_trials(test, one.trials), weights))
        for k, accuracy in enumerate(ACCURACIES):
            row: dict[str, Any] = {"decider": name, "trials": one.trials, "accuracy": accuracy}
            for what, values in (("time_ms", time[:, k]), ("longer_ms", longer[:, k])):
                value, low, high = interval(values)
                value = value if np.isfinite(low) else np.nan
                row |= {what: value, f"{what}_low": low, f"{what}_high": high}
            rows.append(row)
    return pd.DataFrame(rows)


def first_trials(decisions: Tradeoff, trials: int) -> Tradeoff:
    """Return the decisions of the first trials."""
    names = ("choice", "time_ms", "forced", "premature", "posterior")
    return Tradeoff(decisions.settings, *(getattr(decisions, name)[:, :trials] for name in names))


def gaussian(alternatives: int, trials: int, spiking: int) -> pd.DataFrame:
    """Return times at accuracies on the Gaussian problem."""
    by_decider = deciders(drawn(trials, alternatives, D_PRIME), spiking)
    return at_accuracies(by_decider).assign(evidence="Gaussian, d' 0.5", alternatives=alternatives)


# ---- taps


def tactile(evidence: str, alternatives: int, trials: int) -> pd.DataFrame:
    """Return times at accuracies on a kind of taps, which come every 500 ms.

    The posterior is replaced by whether a choice is right: accuracy is then counted, since the
    likelihoods of taps are fitted and need not be calibrated.
    """
    taps, groups = tapped(evidence, alternatives, trials, SCORING_SEED)
    by_decider = deciders(taps, 0)
    counted = {
        name: replace(one, posterior=(one.choice == taps.truth).astype(np.float64))
        for name, one in by_decider.items()
    }
    return at_accuracies(counted, groups).assign(evidence=evidence, alternatives=alternatives)


# ---- Hick's law


def lines(times: pd.DataFrame) -> pd.DataFrame:
    """Return lines of time over ln N, weighted by the intervals, and how well they fit.

    Columns decider, accuracy, of (``time_ms`` or ``longer_ms``), counts (how many numbers of
    alternatives), intercept_ms and slope_ms (per unit of ln N) with standard errors, pearson_r,
    chi2_p (of the scatter about the line, if it is that of the intervals).
    """
    rows = []
    some = times[times["evidence"].str.startswith("Gaussian") & times["accuracy"].isin(HICK)]
    for (decider, accuracy), part in some.groupby(["decider", "accuracy"], sort=False):
        for what in ("time_ms", "longer_ms")[: 1 if decider == MSPRT_AT_GAIN else 2]:
            known = part.dropna(subset=[what, f"{what}_low"])
            error = (known[f"{what}_high"] - known[f"{what}_low"]) / (2 * 1.96)
            known, error = known[error > 0], error[error > 0]
            if len(known) < 3:
                continue
            x = np.log(known["alternatives"])
            coefficients, covariance = curve_fit(
                lambda x, a, b: a + b * x, x, known[what], sigma=error, absolute_sigma=True
            )
            off = (known[what] - coefficients[0] - coefficients[1] * x) / error
            errors = np.sqrt(np.diag(covariance))
            row = {"decider": decider, "accuracy": accuracy, "of": what, "counts": len(known)}
            row |= {"intercept_ms": coefficients[0], "intercept_se": errors[0]}
            row |= {"slope_ms": coefficients[1], "slope_se": errors[1]}
            row |= {"pearson_r": np.corrcoef(x, known[what])[0, 1]}
            rows.append(row | {"chi2_p": chi2.sf((off**2).sum(), len(known) - 2)})
    return pd.DataFrame(rows)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield pieces of Gaussian evidence and of taps."""
    trials = COARSE_TRIALS if fast else TRIALS
    for count in COUNTS:
        spiking = SPIKING.get(count, 0) // (5 if fast else 1)
        make = partial(gaussian, count, trials, spiking)
        seconds = trials * count / 200 + spiking * count / 5
        yield Piece("times", f"Gaussian N = {count}", trials, seconds, make)
    for evidence in kinds():
        for count in TACTILE:
            some = min(trials, TACTILE_TRIALS)
            make = partial(tactile, evidence, count, some)
            yield Piece("times", f"{evidence} N = {count}", some, some * count / 100, make)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return times, and lines over ln N."""
    return {
        name: ("times", table)
        for name, table in (("times", made["times"]), ("lines", lines(made["times"])))
    }


SCORE = Score("hick", SCORING_SEED, (2, 4, 8), pieces, tables, circuit=DEFAULT)

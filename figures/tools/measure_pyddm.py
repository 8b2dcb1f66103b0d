"""Fits of a biased diffusion with variable drift and a falling gap, and the same by PyDDM's solver.

Both see the same trials, drawn from the closed form. PyDDM's error is of the first order in its
step, so that its limit is twice the log likelihood at a step minus that at twice the step. Its
search starts away from our optimum in every parameter. How much worse its optimum is than ours is
measured by our likelihood and by PyDDM's at a quarter of the step. Seconds are CPU time of one
thread; those of a whole fit by PyDDM are its likelihood's at our number of evaluations. Needs the
extra ``compare``.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats.qmc import LatinHypercube

from bgmodel import stream
from bgmodel.fitting.algorithms import GAPS, GapModel
from bgmodel.fitting.design import Design, design_of
from bgmodel.fitting.likelihood import Likelihood, likelihood_of
from bgmodel.fitting.optimum import optimum
from bgmodel.fitting.responses import BIN_S, Grid, responded
from bgmodel.trials.reader import read_trials
from figures.pieces import Made, Piece, Score
from figures.tools.pyddm_gaps import ByPyddm

SCORING_SEED = 74_101
"""Of the trials."""
STRENGTHS = np.array([-0.3, -0.1, 0.0, 0.1, 0.3])
SECONDS, STEP, FINEST = 4.0, 0.001, 0.00025
"""Deadline, and PyDDM's steps in its fit and in a comparison of both optima, in s and in sd of the
evidence after one second."""
VALUES = {
    **{"sensitivity": 10.0, "bound": 0.9, "start": 0.25, "drift_sd": 1.0, "fall_per_s": 1.0},
    **{"fall_shape": 3.0, "t0_s": 0.3, "t0_sd_s": 0.05, "lapse": 0.01},
}
"""What the trials are drawn from."""
KNOWN = ("t0_sd_s", "lapse", "fall_shape")
"""Parameters that both fits are given."""
OFF, POINTS, ROUNDS = 0.03, 48, 4
"""Of PyDDM's search: half range of the points around a centre, as a proportion of each parameter,
their number, and the largest number of centres. The first is half of this range off our optimum."""
CASES = {f"{name}, one drift": (name, 0.0) for name in GAPS} | {
    f"{name}, variable drift": (name, 1.0) for name in ("falling_gap", "weibull_gap")
}
"""Gaps, and standard deviations of the drift."""


def trials_of(model: GapModel, values: Mapping[str, float], trials: int, name: str) -> pd.DataFrame:
    """Return trials at each strength, drawn from the density of the closed form."""
    grid = Grid(round(SECONDS / BIN_S))
    every = {k: np.full(len(STRENGTHS), v) for k, v in values.items()}
    response = {k: every[k] for k in ("t0_s", "t0_sd_s", "lapse")}
    density = responded(model.decided(every, STRENGTHS, grid), grid, **response)
    rng, rows = stream(SCORING_SEED, name), []
    for strength, one in zip(STRENGTHS, density, strict=True):
        below = np.maximum(one, 0).ravel().cumsum()
        place = np.searchsorted(below / below[-1], rng.random(trials), side="right")
        choice, bins = np.divmod(place, grid.bins)
        rt = (bins + rng.random(trials)) * BIN_S
        rows.append(pd.DataFrame({"rt": rt, "response": choice, "coherence": strength}))
    return pd.concat(rows, ignore_index=True).assign(participant_id="a")


def compared(case: str, trials: int) -> pd.DataFrame:
    """Return both optima, one row per parameter, with log likelihoods and seconds."""
    shape, drift_sd = CASES[case]
    model = GapModel(GAPS[shape])
    names = [n for n in VALUES if n in {each.name for each in model.parameters}]
    values = {n: VALUES[n] for n in names} | {"drift_sd": drift_sd}
    table = trials_of(model, values, trials, case)
    choices = read_trials(table, strength="coherence")
    design: Design = design_of(choices, rt_window=(0, SECONDS), sides=True)
    free = [n for n in names if n not in KNOWN and values[n]]
    fixed = {n: values[n] for n in values if n not in free}
    ours = likelihood_of(model, design, free=free, fixed=fixed)
    seconds, best = _timed(lambda: optimum(ours))
    at = dict(zip(ours.freedom.names, best.vector.tolist(), strict=True))
    theirs = _both_steps(table, model)
    their_best, limit = _maximum(theirs, fixed, at)
    one, fine = _timed(lambda: float(theirs[0].each(fixed | at).sum()))
    here = _limit(theirs, fixed | at)
    shared = {
        "case": case,
        "trials": len(table),
        "evaluations": best.evaluations,
        "log_likelihood": best.log_likelihood,
        "pyddm_log_likelihood": here,
        "pyddm_step_error_nats": fine - here,
        "pyddm_gain_nats": limit - here,
        # Of the fit, whose every likelihood is at other parameters: those repeated are kept.
        "likelihood_s": seconds / best.evaluations,
        "pyddm_likelihood_s": one,
        "fit_s": seconds,
        "pyddm_fit_s": one * best.evaluations,
        **_worse(ours, by_pyddm(table, model, FINEST), fixed, at, their_best),
    }
    rows = [
        shared | {"parameter": n, "true": values[n], "fitted": at[n], "pyddm_fitted": their_best[n]}
        for n in free
    ]
    return pd.DataFrame(rows)


def by_pyddm(table: pd.DataFrame, model: GapModel, step: float) -> ByPyddm:
    """Return PyDDM's likelihood of trials at a step."""
    columns = (table[name].to_numpy() for name in ("coherence", "response", "rt"))
    trials = dict(zip(("strength", "response", "rt_s"), columns, strict=True))
    return ByPyddm(model.gap, step, SECONDS, **trials)


def _both_steps(table: pd.DataFrame, model: GapModel) -> tuple[ByPyddm, ByPyddm]:
    """Return PyDDM's likelihood of trials at the finer and at the coarser step."""
    return by_pyddm(table, model, STEP), by_pyddm(table, model, 2 * STEP)


def _worse(
    ours: Likelihood,
    theirs: ByPyddm,
    fixed: Mapping[str, float],
    at: Mapping[str, float],
    their_best: Mapping[str, float],
) -> dict[str, float]:
    """Return the log likelihood at our optimum minus that at PyDDM's, by us and by PyDDM, nats."""
    by_us = [ours(np.array([each[n] for n in ours.freedom.names])) for each in (at, their_best)]
    by_it = [float(theirs.each({**fixed, **each}).sum()) for each in (at, their_best)]
    return {"worse_nats": by_us[0] - by_us[1], "pyddm_worse_nats": by_it[0] - by_it[1]}


def _limit(theirs: tuple[ByPyddm, ByPyddm], values: Mapping[str, float]) -> float:
    """Return the limit of PyDDM's log likelihood as its step goes to 0."""
    fine, coarse = (one.each(values).sum() for one in theirs)
    return float(2 * fine - coarse)


def _maximum(
    theirs: tuple[ByPyddm, ByPyddm], fixed: Mapping[str, float], at: Mapping[str, float]
) -> tuple[dict[str, float], float]:
    """Return PyDDM's optimum, and the log likelihood of its quadratic there.

    PyDDM places bounds and starts on its grid, so that its log likelihood has small steps. A
    quadratic is therefore fitted to points around a centre, which moves to the maximum until this
    is among the points.
    """
    names, unit = list(at), np.array([*at.values()])
    centre = 1 + OFF / 2 * (-1.0) ** np.arange(len(names))
    terms = [*combinations_with_replacement(range(len(names)), 2)]
    sampler = LatinHypercube(len(names), rng=SCORING_SEED)
    for _ in range(ROUNDS):
        x = OFF * (2 * sampler.random(POINTS) - 1)
        y = [
            _limit(theirs, {**fixed, **dict(zip(names, (centre + dx) * unit, strict=True))})
            for dx in x
        ]
        columns = [np.ones(POINTS), *x.T, *(x[:, i] * x[:, j] for i, j in terms)]
        fitted = np.linalg.lstsq(np.stack(columns, axis=1), np.array(y), rcond=None)[0]
        slope, curvature = fitted[1 : len(names) + 1], np.zeros((len(names), len(names)))
        for (i, j), value in zip(terms, fitted[len(names) + 1 :], strict=True):
            curvature[i, j] += value
            curvature[j, i] += value
        move = -np.linalg.solve(curvature, slope)
        centre = centre + np.clip(move, -OFF, OFF)
        if (np.abs(move) <= OFF).all():
            break
    top = float(fitted[0] + slope @ move / 2)
    return dict(zip(names, (centre * unit).tolist(), strict=True)), top


def _timed(call: Callable[[], Any]) -> tuple[float, Any]:
    """Return CPU seconds of this thread, and a result."""
    begun = time.thread_time()
    result = call()
    return time.thread_time() - begun, result


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield a fit of each gap, with and without variable drifts."""
    trials = 100 if fast else 800
    for case, (_, drift_sd) in CASES.items():
        seconds = 1500.0 if drift_sd else 200.0
        make = partial(compared, case, trials)
        yield Piece("optimum", case, trials * len(STRENGTHS), seconds, make)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return the optima, and log likelihoods with seconds."""
    rows = made["optimum"]
    by = ["parameter", "true", "fitted", "pyddm_fitted"]
    of_case = rows.drop(columns=by).drop_duplicates(ignore_index=True)
    apart = (rows["pyddm_fitted"] / rows["fitted"] - 1).abs().groupby(rows["case"], sort=False)
    return {
        "optima": ("optimum", rows[["case", *by]]),
        "likelihoods": (
            "optimum",
            of_case.assign(
                off_nats=of_case["pyddm_log_likelihood"] - of_case["log_likelihood"],
                times_likelihood=of_case["pyddm_likelihood_s"] / of_case["likelihood_s"],
                largest_difference=apart.max().to_numpy(),
            ),
        ),
    }


SCORE = Score("pyddm", SCORING_SEED, (), pieces, tables, circuit="")

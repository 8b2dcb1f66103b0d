"""Cross-checks of the tests against PyDDM and ssm-simulators on the same problems.

Needs the extra ``compare``. Decisions are those of ``Sprt``, ``Race`` and ``Lca`` by
``first_crossing``; the calls of the other tools are in ``other_tools.py``. Times are whole
readings; for a Kolmogorov-Smirnov test each is spread uniformly over its last reading to avoid
ties. The points of a grid are judged jointly: by the sum of squared z, and by the smallest p of
these tests with Bonferroni's correction. Each table has controls that are wrong on purpose.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from importlib import util

import numpy as np
import pandas as pd

from bgmodel import Sprt, stream
from bgmodel.deciding.decision import first_crossing
from bgmodel.evidence import Evidence
from bgmodel.simulated_evidence import separated_evidence
from circuits.arrays import Array
from figures.pieces import Made, Piece, Score
from figures.tools.other_tools import (
    Accumulators,
    Ends,
    by_pyddm,
    by_ssm_simulators,
    exact,
    readings_needed,
)

SCORING_SEED = 73_001
TOOLS = ("pyddm", "ssms")
SEPARATIONS, BOUNDS, STARTS = (0.03, 0.05), (0.5, 1.0, 1.5, 2.0, 3.0), (0.0, 0.4)
"""The grid: d per reading; bounds, nats; where Z starts, as a share of the bound."""
COARSE_D = 0.5
"""A separation at which one reading is not small relative to the bound."""
WRONG = 1.03
"""Factor on the drift in controls."""
TRIALS, COARSE_TRIALS, NUMBERS = 20_000, 2000, 10_000_000
"""Trials of a point, and readings in memory at a time."""
POINTS = (
    *(Accumulators(n, 0.3, bound) for n in (2, 3, 4) for bound in (6.0, 12.0)),
    *(
        Accumulators(n, 0.3, 8.0, leak, inhibition)
        for n in (3, 4)
        for leak, inhibition in ((0.1, 0.1), (0.02, 0.0), (0.02, 0.04))
    ),
)
"""Races, then leaky competing accumulators: balanced, leak alone, more inhibition than leak."""


def decided(
    d: float, theta: float, start: float, trials: int, *names: object
) -> tuple[Array, Array]:
    """Return whether each trial of the test is right, and its number of readings."""
    steps = readings_needed(d, theta)
    prior = np.array([1.0, np.exp(start)]) / (1 + np.exp(start))
    batch = max(2, NUMBERS // steps // 2 * 2)
    correct, readings = [], []
    for first in range(0, trials, batch):
        rng = stream(SCORING_SEED, "walk", d, theta, start, first, *names)
        drawn = separated_evidence(min(batch, trials - first), steps, d / np.sqrt(2), rng=rng)
        evidence = Evidence(drawn.log_likelihood, drawn.truth, prior)
        decision = first_crossing(Sprt().run(evidence), -theta)
        correct.append(decision.choice == drawn.truth)
        readings.append(decision.steps)
    return np.concatenate(correct), np.concatenate(readings)


def spread(readings: Array, *names: object) -> Array:
    """Return times, each drawn evenly from its last reading."""
    return np.asarray(readings - stream(SCORING_SEED, "spread", *names).random(len(readings)))


def held(correct: Array, readings: Array, ends: Ends, times: Array) -> dict[str, float]:
    """Compare the simulation with a solution: z of error rate and mean, KS distance and its p."""
    from scipy.stats import kstest

    n, rate = len(correct), ends.error_rate
    test = kstest(times, ends.before)
    return {
        "z_error": (np.mean(np.logical_not(correct)) - rate) / np.sqrt(rate * (1 - rate) / n),
        "z_mean": (readings.mean() - ends.mean) / (readings.std() / np.sqrt(n)),
        "ks": float(test.statistic),
        "p": float(test.pvalue),
    }


def walks(d: float, share: float, trials: int) -> pd.DataFrame:
    """Return one row per bound and solution: how the simulation compares with it."""
    rows = []
    for theta in BOUNDS:
        at = d, theta, share * theta
        correct, readings = decided(*at, trials)
        times = spread(readings, *at)
        solutions = {
            "exact": exact(*at),
            "PyDDM": by_pyddm(*at),
            "PyDDM, overshoot left out": by_pyddm(*at, overshoot=0.0),
            f"PyDDM, drift times {WRONG:g}": by_pyddm(*at, drift=WRONG),
        }
        for name, ends in solutions.items():
            rows.append({"solution": name} | held(correct, readings, ends, times))
    return pd.DataFrame(rows)


def verdict(rows: pd.DataFrame) -> dict[str, float]:
    """Return the joint verdict of the z and p of several points."""
    from scipy.stats import chi2

    points = len(rows)
    told: dict[str, float] = {"points": points}
    for name in ("error", "mean"):
        z = rows[f"z_{name}"]
        told[f"z_{name}_most"] = float(z.abs().max())
        told[f"z_{name}_p"] = float(chi2.sf((z**2).sum(), points))
    p = min(1.0, points * float(rows["p"].min()))
    return told | {"ks_most": float(rows["ks"].max()), "p_bonferroni": p}


def accumulators(number: int, trials: int) -> pd.DataFrame:
    """Return one point of a race or an LCA: ours against theirs, and against two controls."""
    from scipy.stats import ks_2samp

    point = POINTS[number]
    integrator, threshold = point.ours()
    batch = COARSE_TRIALS
    correct, readings = [], []
    for first in range(0, trials, batch):
        rng = stream(SCORING_SEED, "accumulators", number, first)
        evidence = point.evidence(min(batch, trials - first), rng)
        decision = first_crossing(integrator.run(evidence), threshold)
        correct.append(decision.choice == 0)
        readings.append(decision.steps)
    right, taken = np.concatenate(correct), np.concatenate(readings)
    theirs = {
        "ssm-simulators": point.theirs(),
        f"drift times {WRONG:g}": point.theirs(drift=WRONG),
        "their floor at the start": point.theirs(floor=0.0),
    }
    rows = []
    for k, (name, (model, parameters)) in enumerate(theirs.items()):
        seed = int(stream(SCORING_SEED, "ssm-simulators", number, k).integers(2**31))
        other = by_ssm_simulators(model, parameters, trials, seed)
        test = ks_2samp(spread(taken, number, k), spread(other.readings, number, k, "theirs"))
        gap = float(np.mean(other.correct) - np.mean(right))
        error = float(np.hypot(right.std(), other.correct.std()) / np.sqrt(trials))
        late = float(other.readings.mean() - taken.mean())
        late_error = float(np.hypot(taken.std(), other.readings.std()) / np.sqrt(trials))
        rows.append(
            {"theirs": name, "z_error": gap / error, "z_mean": late / late_error,
             "ks": float(test.statistic), "p": float(test.pvalue)}
        )  # fmt: skip
    return pd.DataFrame(rows)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield the grid, coarse readings and accumulators.

    Nothing if one of the other tools is not installed; threads are not used.
    """
    if any(util.find_spec(name) is None for name in TOOLS):
        return
    trials = COARSE_TRIALS if fast else TRIALS
    for d in (*SEPARATIONS, COARSE_D):
        for share in STARTS:
            kind = "coarse" if d == COARSE_D else "grid"
            make = partial(walks, d, share, trials)
            yield Piece(kind, f"d = {d:g}, start {share:g}", trials, 4e-6 * trials / d**2, make)
    for number, point in enumerate(POINTS):
        name = f"{number} {point.theirs()[0]}"
        make = partial(accumulators, number, trials)
        yield Piece("accumulators", name, trials, 4e-4 * trials, make)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return verdicts of walks and accumulators."""
    by_name: dict[str, tuple[str, pd.DataFrame]] = {}
    for kind, by in (("grid", "solution"), ("coarse", "solution"), ("accumulators", "theirs")):
        rows = [{by: name} | verdict(part) for name, part in made[kind].groupby(by, sort=False)]
        by_name[kind] = kind, pd.DataFrame(rows)
    return by_name


SCORE = Score("crosschecks", SCORING_SEED, (), pieces, tables, circuit="")

"""Warnings of a fit: numbers at bounds, late or slow responses, short chains, errors, bins."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from bgmodel.fitting.likelihood import STEP, BinnedLikelihood, Likelihood
from bgmodel.fitting.optimum import Optimum, optimum
from bgmodel.fitting.posterior import ENOUGH, Directions, Posterior, directions
from bgmodel.fitting.responses import BinnedResponses, Grid, responded
from bgmodel.fitting.simulated.error import SimulationErrors
from bgmodel.trials.cautions import ABRUPT, FASTEST, fastest
from circuits.arrays import Array
from circuits.errors import FitWarning

LARGE = 1 / 3
"""A fit warns if bins move a parameter by more than this share of its standard error."""
PARTS = 4
"""Number of parts of a bin, by which the error of bins is estimated."""
LARGE_NATS, MOST_TIMES = 0.3, 3
"""A fit is repeated with narrower bins if these change its log likelihood by more, nats, or move a
parameter by more than ``LARGE``; and how often that may be."""


def resolved(fitted: Optimum) -> Optimum:
    """Return the optimum, fitted again with narrower bins of time while that changes it."""
    for _ in range(MOST_TIMES):
        likelihood, at = fitted.likelihood, fitted.vector
        if not _has_bins(likelihood):
            break
        there = directions(likelihood, at)
        share = np.abs(moved_by_bins(likelihood, there)) / there.standard_errors
        off = abs(finer(likelihood).each(at).sum() - fitted.log_likelihood)
        if off <= LARGE_NATS and not (share > LARGE).any():
            break
        fitted = optimum(finer(likelihood), starts=[at])
    return fitted


def _has_bins(likelihood: Likelihood) -> bool:
    return isinstance(likelihood, BinnedLikelihood) and hasattr(likelihood.model, "any_width")


def finer(likelihood: Likelihood) -> Likelihood:
    """Return a likelihood with ``PARTS`` bins in place of each."""
    design = likelihood.design
    lapses = design.grid.lapse_bins
    grid = Grid(PARTS * design.grid.bins, design.grid.width_s / PARTS, lapses and PARTS * lapses)
    return replace(likelihood, design=replace(design, observed=replace(design.observed, grid=grid)))


def moved_by_bins(likelihood: Likelihood, there: Directions) -> Array:
    """Return the error of each estimate that is due to bins, (parameters,).

    By a step of Fisher scoring with finer bins, which removes ``1 - 1 / PARTS`` of the error.
    """
    if not (_has_bins(likelihood) and np.isfinite(there.standard_errors).all()):
        return np.zeros(len(there.vector))
    fine = finer(likelihood)
    low, high = likelihood.freedom.low, likelihood.freedom.high
    score = np.empty(len(there.vector))
    for k, step in enumerate(STEP * there.standard_errors):
        ends = np.array([there.vector, there.vector])
        ends[:, k] = np.clip(ends[:, k] + [-step, step], low[k], high[k])
        below, above = ((fine.each(end) - likelihood.each(end)).sum() for end in ends)
        score[k] = (above - below) / (ends[1, k] - ends[0, k])
    return np.asarray(-PARTS / (PARTS - 1) * np.linalg.solve(there.information, score))


def of_bins(likelihood: Likelihood, there: Directions) -> list[str]:
    """Return a warning if bins move a parameter by more than ``LARGE`` standard errors."""
    moved = moved_by_bins(likelihood, there)
    share = np.abs(moved) / there.standard_errors
    named = [
        f"{name} by about {by:+.1g} ({size:.1f} standard errors)"
        for name, by, size in zip(there.names, moved, share, strict=True)
        if size > LARGE
    ]
    if not named:
        return []
    off = (likelihood.each(there.vector) - finer(likelihood).each(there.vector)).sum()
    return [
        f"decisions are so fast that bins of {likelihood.design.grid.width_s:g} s move the "
        f"estimates of {', '.join(named)}, and the log likelihood by {off:+.1f} nats"
    ]


SMALL_SHARE = 1 / 3
"""A fit warns if the simulation error over the error from the data exceeds this ratio."""
VAGUE_SHARE = 0.5
"""A number that can't be near 0 is hardly identified if its error exceeds this share of it."""
LATEST_T0_S = 1.0
"""A fit warns if the non-decision time exceeds this, s: sensing and moving take less."""


def cautions(
    fitted: Optimum, there: Directions, simulated: SimulationErrors, drawn: Posterior | None
) -> list[str]:
    """Return the warnings of a fit, apart from those of misfit and identifiability."""
    numerical = [*_rough(there, simulated), *of_bins(fitted.likelihood, there)]
    values = [*_ended(fitted), *_vague(fitted, there), *_late(fitted), *_short(drawn)]
    return [*numerical, *values, *fitted.likelihood.cautions(), *of_cuts([fitted])]


def _ended(fitted: Optimum) -> list[str]:
    return [
        f"{name} ends at a bound of its range, {value:.3g}: its standard error is meaningless"
        for (name, value), ends in zip(fitted.values.items(), fitted.at_bound, strict=True)
        if ends
    ]


def _vague(fitted: Optimum, there: Directions) -> list[str]:
    """Return a warning for each number that can't be near 0 with an error above half of it."""
    numbers, sized = fitted.likelihood.freedom.moved, fitted.likelihood.sized
    errors = zip(numbers, fitted.vector, there.standard_errors, fitted.at_bound, strict=True)
    return [
        f"these trials hardly identify {each.name} ({value:.3g} +- {error:.2g}): fix it, or add "
        "trials with other evidence"
        for each, value, error, ends in errors
        if each.parameter.name in sized
        and not each.effect
        and not ends
        and VAGUE_SHARE * value < error < np.inf
    ]


def _late(fitted: Optimum) -> list[str]:
    return [
        f"{name} is {value:.3g} s, longer than sensing and moving take: check that rt begins at "
        "the onset of evidence, not of the trial"
        for name, value in fitted.values.items()
        if name.partition("[")[0] == "t0_s" and value > LATEST_T0_S
    ]


def _short(drawn: Posterior | None) -> list[str]:
    if drawn is None or drawn.long_enough:
        return []
    return [
        f"the chain of draws lasts {drawn.lasts:.0f} of its autocorrelation times, not "
        f"{ENOUGH}: its effective sample size is below {drawn.effective:.0f}, and "
        "intervals are rough"
    ]


def _rough(there: Directions, simulated: SimulationErrors) -> list[str]:
    share = simulated.parameters / there.standard_errors
    rough = [
        f"{name} ({value:.0%})"
        for name, value in zip(there.names, share, strict=True)
        if value > SMALL_SHARE
    ]
    if not rough:
        return []
    return [
        "the error that comes from the number of simulated trials is more than a third of that "
        f"from the data: {', '.join(rough)}. Simulate more trials (trials)"
    ]


TAILS_S = (0.75, 1.5, 3.0)
"""Means of the exponential delays that slow trials may have, s."""
SHARES = (0.005, 0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.2)
"""Shares of trials that may be slow."""
GAIN_NATS = 1.25
"""Gain in log likelihood above which slow trials are reported (checked by ``make validate``)."""


class Slow(NamedTuple):
    """The most likely slow trials: gain in log likelihood, nats; share; mean delay, s."""

    gain_nats: float
    share: float
    tail_s: float


def slow_trials(fitted: Optimum) -> Slow:
    """Return the gain in log likelihood of an optimum if a share of trials is delayed."""
    observed, density = fitted.likelihood.design.observed, fitted.density
    log = observed.each(density)
    best = Slow(0.0, 0.0, 0.0)
    for tail_s in TAILS_S:
        delayed = _delayed(density, tail_s / observed.grid.width_s)
        ratio = np.exp(observed.each(delayed) - log)
        for share in SHARES:
            gain = float(np.log1p(share * (ratio - 1)).sum())
            best = max(best, Slow(gain, share, tail_s))
    return best


def warn_of_slow(fitted: Optimum) -> None:
    """Warn if a tail of slow trials makes the data more likely than the fitted model alone."""
    untimed = fitted.likelihood.design.observed.untimed is not None
    if untimed or not isinstance(fitted.likelihood, BinnedLikelihood):
        return
    slow = slow_trials(fitted)
    if slow.gain_nats <= GAIN_NATS:
        return
    likelihood = fitted.likelihood
    design, model = likelihood.design, likelihood.model.identity()["model"]
    held = "lapse" in likelihood.freedom.held
    free = "free lapse, which absorbs some of them, or " if held else ""
    count = round(slow.share * len(design.observed.cell))
    FitWarning.warn(
        f"{design.who}, {model}: about {count} of {len(design.observed.cell)} trials are slower "
        f"than the model allows (with an exponential delay of {slow.tail_s:g} s in "
        f"{slow.share:.1%} of trials the log likelihood is {slow.gain_nats:.1f} nats higher). "
        f"Such trials bias sensitivity and criterion: {free}compare with a fit to an earlier "
        "rt_window (at the terminal --columns rt_window=)"
    )


EARLIER_S, WIDER_S = (0.0, 0.02, 0.04, 0.06, 0.09, 0.12), (0.0, 0.03, 0.06)
"""Shifts and additional spreads of the non-decision time that a cut may have hidden, s."""
FEW = 4
"""Most people who are named in a warning."""
EDGE_NATS = 7.0
"""Gain in log likelihood above which fast trials are taken to be left out. Of 240 simulated sets
that the model fits, none was warned of, and 5 of 360 that it does not fit; without a tenth of the
trials, 28 of 30 sets of 1000 and 15 of 30 sets of 300."""


def _first_s(seen: BinnedResponses) -> float:
    """Return where times begin, s: half a step early if rounded."""
    times_s = np.unique(seen.rt_s[np.isfinite(seen.rt_s)])
    step_s = np.diff(times_s).min(initial=np.inf)
    half_s = step_s / 2 if np.isfinite(step_s) else 0.0
    return max(float(times_s[0]) - half_s, seen.window_s[0])


def cut_nats(fitted: Optimum) -> float:
    """Return the gain in log likelihood if trials before the first were left out; 0 if times rise.

    The non-decision time may then have begun earlier and spread more, if that is no gain without a
    cut. The gain does not count lapses, which may all be slow.
    """
    seen, density = fitted.likelihood.design.observed, fitted.density
    _, below = fastest(seen.rt_s)
    if below.mean() < ABRUPT:
        return 0.0
    edge_s = _first_s(seen)
    cut = replace(seen, window_s=(edge_s, seen.window_s[1]))
    mass, same = density * seen.grid.width_s, np.ones(len(density))
    usual, best = seen.each(density).sum(), 0.0
    for earlier_s in EARLIER_S:
        for wider_s in WIDER_S:
            moved = responded(
                mass, seen.grid, t0_s=-earlier_s * same, t0_sd_s=wider_s * same, lapse=0 * same
            )
            gain = cut.each(moved).sum() - max(usual, seen.each(moved).sum())
            best = max(best, float(gain))
    lapses = density[seen.cell, :, 0].sum() * (edge_s - seen.window_s[0])
    return float(best - lapses)


def of_cuts(people: Iterable[Optimum]) -> list[str]:
    """Return a warning if times of some people begin where faster trials were left out."""
    told = []
    for fitted in people:
        seen, who = fitted.likelihood.design.observed, fitted.likelihood.design.who
        binned = isinstance(fitted.likelihood, BinnedLikelihood) and seen.untimed is None
        enough = binned and np.isfinite(seen.rt_s).sum() > FASTEST
        if enough and (nats := cut_nats(fitted)) > EDGE_NATS:
            told.append(f"{who} at {_first_s(seen):.4g} s ({nats:.1f} nats)")
    listed = ", ".join(told[:FEW]) + f" and {len(told) - FEW} more" * (len(told) > FEW)
    every = [
        f"response times begin abruptly, of {listed}: the log likelihood is that much "
        "higher if faster trials were left out. The fit assumes that none were, which biases t0_s, "
        "t0_sd_s and the bound: let its window begin where they were left out, or at this time, "
        "which is half a step early if times are rounded (rt_window, at the terminal --columns "
        "rt_window=T,inf)"
    ]
    return every if told else []


def _delayed(density: Array, tail: float) -> Array:
    """Return densities (cells, 2, bins) with an exponential delay, its mean in bins, added."""
    bins = density.shape[2]
    delay = np.exp(-np.arange(bins) / tail)
    delay *= -np.expm1(-1 / tail)
    size = 2 * bins
    spectrum = np.fft.rfft(density, size, axis=2) * np.fft.rfft(delay, size)
    return np.maximum(np.fft.irfft(spectrum, size, axis=2)[:, :, :bins], 0.0)

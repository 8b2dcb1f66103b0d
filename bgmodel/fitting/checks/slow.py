"""Trials that are slower than a fitted model allows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bgmodel.fitting.likelihood import BinnedLikelihood
from bgmodel.fitting.optimum import Optimum
from bgmodel.support.arrays import Array
from circuits.errors import FitWarning

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
    """Return the gain in log likelihood of an optimum if a share of trials is slow.

    A slow trial is one of the model's with an exponential delay. Parameters stay at the optimum, so
    this is a lower bound on the gain of a fit of share and delay.
    """
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


def _delayed(density: Array, tail: float) -> Array:
    """Return densities (cells, 2, bins) with an exponential delay, its mean in bins, added."""
    bins = density.shape[2]
    delay = np.exp(-np.arange(bins) / tail)
    delay *= -np.expm1(-1 / tail)
    size = 2 * bins
    spectrum = np.fft.rfft(density, size, axis=2) * np.fft.rfft(delay, size)
    return np.maximum(np.fft.irfft(spectrum, size, axis=2)[:, :, :bins], 0.0)

"""Likelihood of decoded angles under each hypothesis: fitted densities, shrunk and capped."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array
from circuits.errors import InputError

# Readings per hypothesis, enough to fit the shrinkage, and a density.
SHRINK_SAMPLES = 4000
KDE_SAMPLES = 100_000
INNER_FOLDS = 10
"""Number of folds of the fitted taps used to choose the shrinkage; our choice."""


@dataclass(frozen=True)
class TabulatedLikelihood:
    """Log densities of a reading under each hypothesis, tabulated."""

    grid_deg: Array  # (points,), evenly spaced readings
    log_density: Array  # (hypotheses, points), nats, up to a constant per reading
    period_deg: float | None  # of circular readings
    shrink: float  # factor in [0, 1] on all log-likelihood ratios

    def __call__(self, reading_deg: npt.ArrayLike) -> Array:
        """Return ``log p(reading | hypothesis)``, (..., hypotheses), nats.

        A reading outside the table raises.
        """
        reading = np.asarray(reading_deg, dtype=np.float64)
        if not np.isfinite(reading).all():
            raise InputError("a reading must be finite degrees, got NaN or infinity", "reading_deg")
        low, high = self.grid_deg[0], self.grid_deg[-1]
        if (
            self.period_deg is None
            and reading.size
            and (reading.min() < low or reading.max() > high)
        ):
            raise InputError(
                f"the likelihood table covers {low:g}..{high:g} degrees, got readings in "
                f"{reading.min():g}..{reading.max():g}",
                "reading_deg",
            )
        columns = [
            np.interp(reading, self.grid_deg, row, period=self.period_deg)
            for row in self.log_density
        ]
        return np.stack(columns, axis=-1)


Pool = Sequence[Array]
Readings = Callable[[Pool], list[Array]]


def fit_likelihood(
    pool: Pool,
    readings: Readings,
    range_deg: tuple[float, float],
    *,
    circular: bool = False,
) -> TabulatedLikelihood:
    """Fit the density of readings under each hypothesis to decoded angles, degrees.

    The log-likelihood ratios are multiplied by a factor in [0, 1] that maximises the log score on
    held-out taps (so that pure noise is shrunk to 0), and capped at the log of the number of fitted
    taps: odds cannot exceed the number of taps that could have contradicted them. Both are our
    choice. ``pool`` has one array (taps,) per kind of stimulus; ``readings`` turns it, or disjoint
    parts of it, into one array per hypothesis. For circular readings, ``range_deg`` spans the
    period.
    """
    taps = min(len(part) for part in pool)
    check_fitted(taps)
    if not all(np.isfinite(part).all() for part in pool):
        raise InputError("decoded angles must be finite, got NaN or infinity", "readings", readings)
    if few := [k for k, x in enumerate(readings(pool)) if not len(x)]:
        raise InputError(
            f"{taps} taps are too few for a likelihood: hypothesis {few[0]} has no reading", "pool"
        )
    grid = np.linspace(*range_deg, 721)
    period = range_deg[1] - range_deg[0] if circular else None

    def log_densities(part: Pool) -> Array:
        count = min(len(p) for p in part)
        return np.stack([_log_density(x, grid, period, count) for x in readings(part)])

    raw = log_densities(pool)
    shrink = _cross_validated_shrink(pool, readings, grid, period, log_densities)
    logs = shrink * (raw - raw.max(axis=0))
    return TabulatedLikelihood(grid, np.maximum(logs, -np.log(taps)), period, shrink)


def check_fitted(taps: int) -> None:
    """Raise ValueError if so many taps of each kind are too few to fit a likelihood to."""
    if taps < 4 * INNER_FOLDS:
        raise InputError(
            f"a likelihood needs at least {4 * INNER_FOLDS} taps of each kind, got {taps}",
            "pool",
        )


def _cross_validated_shrink(
    pool: Pool,
    readings: Readings,
    grid: Array,
    period: float | None,
    log_densities: Callable[[Pool], Array],
) -> float:
    """Return a conservative estimate of the factor that best predicts held-out taps.

    It maximises the gain in log score, relative to factor 0 (no evidence), minus the standard error
    of this gain over the inner folds. It is 0 if no gain exceeds its standard error.
    """
    from scipy.optimize import minimize_scalar

    held: list[list[Array]] = []
    for k in range(INNER_FOLDS):
        inside = [np.arange(len(part)) % INNER_FOLDS == k for part in pool]
        logs = log_densities([part[~i] for part, i in zip(pool, inside, strict=True)])
        test = readings([part[i] for part, i in zip(pool, inside, strict=True)])
        if not all(len(x) for x in test):
            continue
        held.append(
            [_against_truth(_thinned(x), i, grid, logs, period) for i, x in enumerate(test)]
        )
    if len(held) < 2:
        raise InputError(
            f"too few taps to judge the likelihood: only {len(held)} of {INNER_FOLDS} "
            "inner folds have readings of every hypothesis",
            "pool",
        )

    def losses(factor: float) -> Array:
        """Return the mean negative log score of each inner fold, nats per reading."""
        scores = [[np.log(np.exp(factor * y).sum(axis=1)).mean() for y in fold] for fold in held]
        return np.asarray(np.mean(scores, axis=1))

    silent = losses(0.0)

    def doubt(factor: float) -> float:
        gain = silent - losses(factor)
        return float(gain.std(ddof=1) / np.sqrt(len(gain)) - gain.mean())

    best = minimize_scalar(doubt, bounds=(0, 1), method="bounded", options={"xatol": 1e-3}).x
    return float(best) if doubt(best) < 0 else 0.0


def _against_truth(x: Array, truth: int, grid: Array, logs: Array, period: float | None) -> Array:
    """Return log-likelihoods relative to the true hypothesis, (readings, hypotheses)."""
    y = np.stack([np.interp(x, grid, row, period=period) for row in logs], axis=-1)
    return np.asarray(y - y[:, [truth]])


def _log_density(x: Array, grid: Array, period: float | None, taps: int) -> Array:
    from scipy.ndimage import gaussian_filter1d

    # A thousand taps give a million pairs, no more informative than this subset.
    x = _thinned(x, KDE_SAMPLES)
    step = grid[1] - grid[0]
    width = max(1.0, _silverman(x, period, taps))
    if period is not None:
        x = grid[0] + np.mod(x - grid[0], period)
    edges = np.append(grid, grid[-1] + step) - step / 2
    counts = np.histogram(np.clip(x, grid[0], grid[-1]), edges)[0].astype(float)
    if period is not None:
        # The first and last points of a circular grid coincide.
        counts[0] += counts[-1]
        smooth = gaussian_filter1d(counts[:-1], width / step, mode="wrap", truncate=6)
        smooth = np.append(smooth, smooth[0])
    else:
        smooth = gaussian_filter1d(counts, width / step, mode="reflect", truncate=6)
    # A floor far below one tap keeps logarithms finite; the cap limits its effect.
    return np.asarray(np.log(smooth / len(x) + 1e-9))


def _silverman(x: Array, period: float | None, taps: int) -> float:
    """Return Silverman's bandwidth (1986), degrees, with a robust spread.

    n is ``taps``, as pairs are dependent.
    """
    if period is not None:
        mean = np.angle(np.exp(2j * np.pi * x / period).mean()) * period / (2 * np.pi)
        x = np.mod(x - float(mean) + period / 2, period)
    quartiles = np.percentile(x, [25, 75])
    spread = min(x.std(), (quartiles[1] - quartiles[0]) / 1.349) or x.std()
    return float(0.9 * spread * taps ** (-1 / 5))


def _thinned(x: Array, most: int = SHRINK_SAMPLES) -> Array:
    # A prime stride, because pairs of taps are ordered in rows of equal length.
    return x if len(x) <= most else x[(np.arange(most) * 7919) % len(x)]

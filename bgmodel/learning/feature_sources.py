"""Sources of features: tactile taps, drifting or not, Gaussian evidence and Poisson cells."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.learning.features import Features, even_centres, soft_histogram
from bgmodel.support.checks import check_finite, check_positive, check_range, whole
from bgmodel.support.seeds import generator
from bgmodel.tactile.source import FOLDS, Tactile, source
from circuits.arrays import Array, Integers
from circuits.errors import require

UNITS = 16
"""Default number of sensory units; our choice."""


def _shuffled_truth(trials: int, hypotheses: int, rng: np.random.Generator) -> Integers:
    """Return the truth of each trial, equally often each hypothesis, in random order."""
    return np.asarray(rng.permutation(np.arange(trials) % hypotheses))


@dataclass(frozen=True)
class PooledFeatures:
    """All readings of some taps as features, from which trials are drawn with replacement."""

    readings: tuple[Array, ...]  # per hypothesis (readings,), degrees
    # Per hypothesis (readings, hypotheses), nats, fitted on other taps than are scored.
    log_likelihood: tuple[Array, ...]
    names: tuple[str, ...]
    centres: Array  # (units,), preferred readings, degrees
    period: float | None = None  # of circular readings, degrees
    t_max: int = 40  # readings in a trial
    step_ms: float = 50.0

    @cached_property
    def values(self) -> tuple[Array, ...]:
        """Activity of the sensory units under each hypothesis, (readings, units)."""
        return tuple(self.activity(part) for part in self.readings)

    def activity(self, readings: npt.ArrayLike) -> Array:
        """Return the activity of the sensory units at some readings in degrees, (..., units)."""
        return soft_histogram(readings, self.centres, self.period)

    def drifted(self, scale: float = 1.0, shift_deg: float = 0.0) -> PooledFeatures:
        """Return the same taps seen by a sensor that reads ``scale * reading + shift_deg``.

        The units keep their preferred readings, so that they are active at other taps than before.
        The log-likelihoods of the taps do not change: the mapping is invertible and loses nothing.
        """
        check_positive(scale=scale)
        return replace(self, readings=tuple(scale * part + shift_deg for part in self.readings))

    def draw(self, trials: int, *, rng: np.random.Generator | int) -> Features:
        """Draw trials of independent readings."""
        rng = generator(rng)
        truth = _shuffled_truth(whole("trials", trials, 1), len(self.names), rng)
        place = rng.random((trials, self.t_max))
        values = np.empty((trials, self.t_max, len(self.centres)))
        exact = np.empty((trials, self.t_max, len(self.names)))
        for i, (table, nats) in enumerate(zip(self.values, self.log_likelihood, strict=True)):
            index = (place[truth == i] * len(table)).astype(np.intp)
            values[truth == i], exact[truth == i] = table[index], nats[index]
        return Features(values, truth, self.names, self.step_ms, log_likelihood=exact)


def tap_features(
    taps: pd.DataFrame,
    task: Tactile,
    *,
    units: int = UNITS,
    fold: int = 0,
    t_max: int = 40,
    step_ms: float = 50.0,
) -> tuple[PooledFeatures, PooledFeatures]:
    """Return the features of decoded taps for learning, and of other taps for scoring.

    A reading is a decoded angle, or a difference of two; units have triangular tuning curves over
    it. Fold ``fold`` (0..5) is scored; the other five are for learning, and the exact likelihoods
    are fitted to them.
    """
    known = source(taps, task, fold=fold)
    known.warn_if_silent()
    likelihood, pool = known.likelihood, task.pool(taps)
    held = [np.arange(len(part)) % FOLDS == fold for part in pool]
    parts = [
        task.readings([part[mask == out] for part, mask in zip(pool, held, strict=True)])
        for out in (False, True)
    ]
    # Equal weight to each hypothesis: same/different has more readings of one than of the other.
    few = min(len(part) for part in parts[0])
    thinned = [part[np.linspace(0, len(part) - 1, few).astype(np.intp)] for part in parts[0]]
    centres = even_centres(thinned, units)
    period = task.range_deg[1] - task.range_deg[0] if task.circular else None
    learned, scored = (
        PooledFeatures(
            tuple(readings),
            tuple(likelihood(part) for part in readings),
            task.names,
            centres,
            period,
            t_max,
            step_ms,
        )
        for readings in parts
    )
    return learned, scored


@dataclass(frozen=True)
class GaussianFeatures:
    """Gaussian evidence seen through tuned units: one sample per channel and reading.

    The samples are those of ``bgmodel.gaussian_evidence``; each channel has ``units`` units with
    triangular tuning curves.
    """

    d_prime: float = 0.5
    """Discriminability of two hypotheses by one reading."""
    channels: int = 2
    """Number of hypotheses."""
    units: int = 8
    """Number of units per channel."""
    t_max: int = 40
    """Readings in a trial."""
    step_ms: float = 50.0
    """Time between readings, ms."""

    def __post_init__(self) -> None:
        check_positive(d_prime=self.d_prime, step_ms=self.step_ms)
        whole("channels", self.channels, 2)
        whole("t_max", self.t_max, 1)
        whole("units", self.units, 2)

    @property
    def centres(self) -> Array:
        """Preferred samples (units,), 2 standard deviations beyond both means."""
        return np.linspace(-2.0, 2.0 + self.d_prime / np.sqrt(2), self.units)

    def draw(self, trials: int, *, rng: np.random.Generator | int) -> Features:
        """Draw trials of independent readings."""
        rng = generator(rng)
        separation = self.d_prime / np.sqrt(2)
        truth = _shuffled_truth(whole("trials", trials, 1), self.channels, rng)
        samples = rng.standard_normal((trials, self.t_max, self.channels))
        samples[np.arange(trials), :, truth] += separation
        values = soft_histogram(samples, self.centres).reshape(trials, self.t_max, -1)
        names = tuple(str(i) for i in range(self.channels))
        return Features(values, truth, names, self.step_ms, log_likelihood=separation * samples)


@dataclass(frozen=True)
class PoissonFeatures:
    """Spike counts of a population with circular tuning curves, for N evenly spaced stimuli.

    The count of unit k in a reading is Poisson with mean
    ``base + peak exp(width (cos(theta_k - theta_i) - 1))`` under hypothesis i.
    """

    channels: int = 4
    """Number of hypotheses."""
    units: int = UNITS
    """Number of units, their preferred stimuli evenly spaced."""
    peak: float = 0.3
    """Largest tuned mean count per reading."""
    base: float = 0.2
    """Untuned mean count per reading."""
    width: float = 1.0
    """Concentration of the tuning curves."""
    centred: bool = False
    """Whether the mean count of each unit over the hypotheses is subtracted."""
    t_max: int = 40
    """Readings in a trial."""
    step_ms: float = 50.0
    """Time between readings, ms."""

    def __post_init__(self) -> None:
        check_positive(peak=self.peak, base=self.base, width=self.width, step_ms=self.step_ms)
        whole("channels", self.channels, 2)
        whole("t_max", self.t_max, 1)
        require(
            self.units >= self.channels, "units", "must be one per hypothesis or more", self.units
        )

    @property
    def means(self) -> Array:
        """Mean count of each unit under each hypothesis, (hypotheses, units)."""
        stimulus = 2 * np.pi * np.arange(self.channels) / self.channels
        preferred = 2 * np.pi * np.arange(self.units) / self.units
        distance = stimulus[:, None] - preferred
        return np.asarray(self.base + self.peak * np.exp(self.width * (np.cos(distance) - 1)))

    def draw(self, trials: int, *, rng: np.random.Generator | int) -> Features:
        """Draw trials of independent readings."""
        rng = generator(rng)
        means = self.means
        truth = _shuffled_truth(whole("trials", trials, 1), self.channels, rng)
        shape = (trials, self.t_max, self.units)
        counts = rng.poisson(np.broadcast_to(means[truth][:, None], shape)).astype(np.float64)
        exact = counts @ np.log(means).T - means.sum(axis=1)
        names = tuple(str(i) for i in range(self.channels))
        features = Features(counts, truth, names, self.step_ms, log_likelihood=exact)
        if not self.centred:
            return features
        removed = means.mean(axis=0)
        return replace(features, values=counts - removed, removed=removed)


@dataclass(frozen=True)
class DriftingSensor:
    """Taps whose decoded readings change over the trials, as a worn or a displaced sensor's do.

    A reading x becomes ``scale x + shift_deg``; both change linearly over ``lasts`` trials, in
    steps of 250 trials. The taps and their exact log-likelihoods stay the same, so that a learner
    that follows the drift loses nothing but the resolution of its units. Learning under a drift
    needs a constant step size, ``WeightLearner(half_trials=inf)``.
    """

    pool: PooledFeatures
    # Factor after the drift, that of a difference of two angles too, in which a shift cancels.
    scale: float = 1.0
    shift_deg: float = 0.0
    begins: int = 0  # trial from which readings change
    lasts: int = 0  # 0 is an abrupt change

    def __post_init__(self) -> None:
        require(isinstance(self.pool, PooledFeatures), "pool", "must be pooled taps", self.pool)
        check_positive(scale=self.scale)
        check_finite(shift_deg=self.shift_deg)
        check_range(0, np.inf, begins=self.begins, lasts=self.lasts)

    def at_trial(self, number: int) -> PooledFeatures:
        """Return the taps as a drifting sensor reads them in a trial."""
        if number < self.begins:
            return self.pool
        share = min(1.0, (number - self.begins) / self.lasts) if self.lasts else 1.0
        return self.pool.drifted(1 + share * (self.scale - 1), share * self.shift_deg)

    @property
    def after(self) -> PooledFeatures:
        """The taps as the sensor reads them after the drift."""
        return self.pool.drifted(self.scale, self.shift_deg)

    def draw(self, trials: int, *, rng: np.random.Generator | int) -> Features:
        """Draw trials from before the drift."""
        return self.pool.draw(trials, rng=rng)


FeatureSource = PooledFeatures | GaussianFeatures | PoissonFeatures | DriftingSensor | Features
"""What draws trials of features: a distribution, a pool of taps, or a table."""


def source_at(source: FeatureSource, number: int) -> FeatureSource:
    """Return the source of a trial's features, which changes with trials if the sensor drifts."""
    return source.at_trial(number) if isinstance(source, DriftingSensor) else source

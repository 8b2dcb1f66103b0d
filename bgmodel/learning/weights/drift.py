"""Drift of the sensor: the same taps come to be read differently."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bgmodel.learning.weights.features import Features, FeatureSource
from bgmodel.learning.weights.sources import PooledFeatures
from bgmodel.support.checks import check_finite, check_positive, check_range
from circuits.errors import require


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


def source_at(source: FeatureSource, number: int) -> FeatureSource:
    """Return the source of the features of a trial: another one for each if the sensor drifts."""
    return source.at_trial(number) if isinstance(source, DriftingSensor) else source

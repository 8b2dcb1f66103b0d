"""Policies: distributions over actions, with the gradients of REINFORCE."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from bgmodel.support.arrays import Array
from bgmodel.support.checks import check_positive
from circuits.errors import InputError, require

# Range of gaps, nats (that of the paper's exhaustive search).
SEPARATIONS = (0.0, 8.0)


class Policy(Protocol):
    """A distribution over actions, with parameters, for several runs at once."""

    @property
    def pace(self) -> float:
        """Factor on the learner's step size that suits the parameters."""
        ...

    def start(self, mean: Array) -> Array:
        """Return parameters (runs, p) with these mean actions (runs,)."""
        ...

    def sample(self, parameters: Array, noise: Array, episode: int) -> tuple[Array, Array]:
        """Return actions (runs,) and the gradient of log probability (runs, p)."""
        ...

    def mean(self, parameters: Array) -> Array:
        """Return the mean action of each run, (runs,)."""
        ...

    def bounded(self, parameters: Array) -> Array:
        """Return parameters clipped to the range that the policy allows."""
        ...

    @property
    def noise(self) -> int:
        """Number of standard normal numbers per sample."""
        ...


@dataclass(frozen=True)
class GaussianPolicy:
    """``x ~ N(mu, sd)``, clipped to bounds (Williams 1992): a gap, or a level of dopamine.

    Exploration starts wide, to detect the slope of a flat reward, and narrows.
    """

    bounds: tuple[float, float] = SEPARATIONS
    """Lowest and highest action."""
    first_share: float = 0.25
    """Initial exploration, sd as a share of the range; assumed (not printed in the paper)."""
    last_share: float = 0.05
    """Final exploration, sd as a share of the range; assumed."""
    half_episodes: float = 2_000.0
    """Trials after which the sd is half-way between its first and last value; assumed."""
    noise = 1

    def __post_init__(self) -> None:
        if not -np.inf < self.bounds[0] < self.bounds[1] < np.inf:
            raise InputError.of("bounds", "must rise", self.bounds)
        check_positive(first_share=self.first_share, last_share=self.last_share)
        require(self.half_episodes > 0, "half_episodes", "must be > 0", self.half_episodes)

    @property
    def pace(self) -> float:
        """The learner's step suits a gap of 0..8 nats; gradients have the inverse unit."""
        return ((self.bounds[1] - self.bounds[0]) / (SEPARATIONS[1] - SEPARATIONS[0])) ** 2

    def sd(self, episode: int) -> float:
        """Return the exploration (sd) in a trial, in the unit of actions."""
        wide = self.first_share - self.last_share
        share = self.last_share + wide / (1 + episode / self.half_episodes)
        return share * (self.bounds[1] - self.bounds[0])

    def start(self, mean: Array) -> Array:
        """Return mu (runs, 1)."""
        return mean[:, None].copy()

    def sample(self, parameters: Array, noise: Array, episode: int) -> tuple[Array, Array]:
        """Return actions (runs,) and d log p / d mu (runs, 1)."""
        sd = self.sd(episode)
        return np.clip(parameters[:, 0] + sd * noise[:, 0], *self.bounds), noise / sd

    def mean(self, parameters: Array) -> Array:
        """Return mu (runs,)."""
        return parameters[:, 0]

    def bounded(self, parameters: Array) -> Array:
        """Clip mu to the bounds."""
        return np.clip(parameters, *self.bounds)


@dataclass(frozen=True)
class BernoulliPolicy:
    """A gap coded by stochastic binary units: ``delta = sum_j s_j y_j`` (Lepora 2016).

    ``y_j`` is 1 with probability ``logistic(w_j)`` and the ``s_j`` fall as powers of two, such that
    all units together give the upper end of ``SEPARATIONS``.
    """

    units: int = 8
    """Number of units; assumed."""
    saturation: float = 4.0
    """Largest |w_j|, so that no unit ever stops exploring; assumed."""

    # The gap changes by s_j p (1 - p), less than 1, per unit of w.
    pace = 8.0

    @property
    def noise(self) -> int:
        """One number per unit."""
        return self.units

    @property
    def sizes(self) -> Array:
        """``s_j`` (units,), nats."""
        powers = 0.5 ** np.arange(1, self.units + 1)
        return np.asarray(SEPARATIONS[1] * powers / powers.sum(), dtype=np.float64)

    def start(self, mean: Array) -> Array:
        """Return w (runs, units), all equal within a run, with these mean gaps (runs,)."""
        p = np.clip(mean / SEPARATIONS[1], 1e-9, 1 - 1e-9)
        return self.bounded(np.tile(np.log(p / (1 - p))[:, None], self.units))

    def sample(self, parameters: Array, noise: Array, episode: int) -> tuple[Array, Array]:
        """Return gaps (runs,) and ``y_j - p_j`` (runs, units)."""
        from scipy.special import expit, ndtr

        p = expit(parameters)
        y = ndtr(noise) < p
        return y @ self.sizes, y - p

    def mean(self, parameters: Array) -> Array:
        """Return ``sum_j s_j p_j`` (runs,)."""
        from scipy.special import expit

        return np.asarray(expit(parameters) @ self.sizes)

    def bounded(self, parameters: Array) -> Array:
        """Clip every w to the saturation."""
        return np.clip(parameters, -self.saturation, self.saturation)

"""The policy of a learner: a distribution over actions, with the gradient of REINFORCE."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bgmodel.support.arrays import Array
from bgmodel.support.checks import check_positive
from circuits.errors import InputError, require

# Range of gaps, nats (that of the paper's exhaustive search).
SEPARATIONS = (0.0, 8.0)


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

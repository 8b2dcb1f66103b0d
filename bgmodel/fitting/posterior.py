"""The posterior of the parameters under a flat prior within their bounds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bgmodel.arrays import Array
from bgmodel.fitting.identify import Directions
from bgmodel.fitting.optimum import Likelihood
from bgmodel.seeds import stream

POSTERIOR_SEED = 24_201
WALKERS, STEPS = 32, 500
"""Walkers of the sampler, and steps of each; the first half is thrown away."""


@dataclass(frozen=True)
class Posterior:
    """Draws from the posterior.

    Parameters
    ----------
    names : list of str
        The parameters.
    draws : array (draws, parameters)
        Parameters.
    log_likelihood : array (draws,), nats
        Of each.
    effective : float
        How many independent draws they are worth, of the worst parameter.
    """

    names: list[str]
    draws: Array
    log_likelihood: Array
    effective: float

    def interval(self, share: float = 0.9) -> Array:
        """Return the middle interval of a share of the posterior, (2, parameters)."""
        return np.asarray(np.quantile(self.draws, [(1 - share) / 2, (1 + share) / 2], axis=0))

    @property
    def mean(self) -> Array:
        """Mean of each parameter."""
        return np.asarray(self.draws.mean(axis=0))


def posterior(
    likelihood: Likelihood,
    start: Directions,
    *,
    walkers: int = WALKERS,
    steps: int = STEPS,
    seed: int = POSTERIOR_SEED,
    tell: Callable[[int], None] | None = None,
) -> Posterior:
    """Draw from the posterior by an ensemble of walkers (Goodman & Weare 2010; emcee).

    The likelihood of stored crossings costs a few milliseconds and has no noise, so it is sampled
    itself; nothing is put in its place.

    Parameters
    ----------
    likelihood : Likelihood
        Of the data.
    start : Directions
        At the optimum: the walkers begin about it, as far as its standard errors say.
    walkers, steps : int
        Of the ensemble.
    seed : int
        Of the sampler.
    tell : function, optional
        Called with the number of steps done.
    """
    import emcee

    rng = stream(seed, "walkers")
    low, high = likelihood.freedom.low, likelihood.freedom.high
    width = np.minimum(np.nan_to_num(start.standard_errors, posinf=np.inf), (high - low) / 8)
    near = start.vector + 0.5 * width * rng.normal(size=(walkers, len(low)))
    margin = 1e-3 * (high - low)
    sampler = emcee.EnsembleSampler(walkers, len(low), likelihood)
    state = np.random.RandomState(int(rng.integers(2**31))).get_state()
    sampler.random_state = state
    for done, _ in enumerate(
        sampler.sample(np.clip(near, low + margin, high - margin), iterations=steps)
    ):
        if tell is not None:
            tell(done + 1)
    kept = steps // 2
    correlated = float(np.max(sampler.get_autocorr_time(discard=kept, quiet=True)))
    return Posterior(
        likelihood.freedom.names,
        sampler.get_chain(discard=kept, flat=True),
        sampler.get_log_prob(discard=kept, flat=True),
        walkers * (steps - kept) / correlated,
    )

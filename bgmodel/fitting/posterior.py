"""What the data say of parameters: identifiability, and the posterior under their priors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bgmodel.fitting.likelihood import STEP, Likelihood
from bgmodel.support.seeds import stream
from circuits.arrays import Array

ALIKE = 0.95
"""Cosine of two directions above which a fit that frees both gives a warning."""
SINGULAR = 1e-12
"""Below this least eigenvalue of the cosines, some parameters are not identifiable."""


@dataclass(frozen=True)
class Directions:
    """How parameters change the likelihood at a point, for a design and its numbers of trials."""

    names: list[str]
    vector: Array
    information: Array  # (parameters, parameters), Fisher; 0 if stored trials are too few
    idle: tuple[str, ...] = ()  # Parameters without effect on any probability.

    @property
    def cosines(self) -> Array:
        """Cosine of the score directions of each pair; 1 or -1 if they are not distinguishable."""
        length = np.sqrt(np.diag(self.information))
        safe = np.where(length > 0, length, np.inf)
        return np.asarray(np.clip(self.information / np.outer(safe, safe), -1.0, 1.0))

    @cached_property
    def standard_errors(self) -> Array:
        """Standard error of each with all others free; infinite if it is not identifiable."""
        length = np.sqrt(np.diag(self.information))
        errors = np.full(len(length), np.inf)
        some = np.flatnonzero(length > 0)
        cosines = self.cosines[np.ix_(some, some)]
        # An estimate of a nearly singular matrix may have negative eigenvalues.
        if len(some) and np.linalg.eigvalsh(cosines)[0] > SINGULAR:
            errors[some] = np.sqrt(np.diag(np.linalg.inv(cosines))) / length[some]
        return errors

    def cautions(self) -> list[str]:
        """Return warnings of pairs and parameters that these data cannot identify."""
        cosines = self.cosines
        warnings = []
        for i, j in zip(*np.triu_indices(len(self.names), 1), strict=True):
            if abs(cosines[i, j]) < ALIKE:
                continue
            step = STEP * abs(self.vector[i]) or STEP
            ridge = -self.information[i, j] / self.information[j, j] * step
            warnings.append(
                f"trials of this design hardly distinguish {self.names[i]} from "
                f"{self.names[j]} (cosine {cosines[i, j]:.2f}): a change of {self.names[i]} by "
                f"{step:+.3g} is compensated by one of {self.names[j]} by {ridge:+.3g}. Fix one "
                "of them, or add a condition that changes it alone"
            )
        warnings += [f"nothing in this design depends on {name}: fix it" for name in self.idle]
        lacking = [
            name
            for name, error in zip(self.names, self.standard_errors, strict=True)
            if np.isinf(error)
        ]
        if lacking and not warnings:
            warnings.append(
                f"no standard error can be given for {', '.join(lacking)}: the design, or too few "
                "simulated trials, do not identify them. Fix one of them, or simulate more "
                "trials (trials)"
            )
        return warnings


def directions(likelihood: Likelihood, vector: Array) -> Directions:
    """Return how parameters change the likelihood at a point, priors included."""
    information, still = likelihood.information(vector)
    _, precision = likelihood.freedom.prior_slope(vector)
    return Directions(likelihood.freedom.names, vector, information + np.diag(precision), still)


POSTERIOR_SEED = 24_201
WALKERS, STEPS, MOST_STEPS = 32, 500, 3000
"""Number of walkers, steps between two checks of the chain, and largest number of steps per walker.
The first half of the chain is discarded.
"""
ENOUGH = 50
"""Least length of the kept half, in autocorrelation times (Goodman & Weare 2010)."""


@dataclass(frozen=True)
class Posterior:
    """Samples from the posterior."""

    names: list[str]
    draws: Array  # (draws, parameters)
    log_density: Array  # (draws,), nats, up to a constant; with flat priors the log likelihood
    effective: float  # number of draws / autocorrelation time of the worst parameter
    # Length of the chain in autocorrelation times; below ``ENOUGH``, ``effective`` is too large.
    lasts: float

    @property
    def long_enough(self) -> bool:
        """Whether the chain is long compared with its autocorrelation time."""
        return self.lasts >= ENOUGH

    def interval(self, share: float = 0.9) -> Array:
        """Return the central interval with a share of the posterior, (2, parameters)."""
        return np.asarray(np.quantile(self.draws, [(1 - share) / 2, (1 + share) / 2], axis=0))


def posterior(
    likelihood: Likelihood,
    start: Directions,
    *,
    walkers: int = WALKERS,
    steps: int = STEPS,
    most_steps: int = MOST_STEPS,
    seed: int = POSTERIOR_SEED,
    tell: Callable[[int], None] | None = None,
) -> Posterior:
    """Sample from the posterior by an ensemble of walkers (Goodman & Weare 2010; emcee).

    They step along differences of others (ter Braak 2006), until the second half of the
    chain is ``ENOUGH`` autocorrelation times long, or for ``most_steps``.
    """
    import emcee

    rng = stream(seed, "walkers")
    state = _first(likelihood, start, walkers, rng)
    # Without its snooker moves, which up to emcee 3.1.6 make draws too narrow.
    moves = emcee.moves.DEMove()

    def heights(vectors: Array) -> Array:
        log_posterior = likelihood.heights(vectors)
        for k in np.flatnonzero(np.isfinite(log_posterior)):
            log_posterior[k] += likelihood.freedom.log_slope(vectors[k])
        return log_posterior

    size = state.shape[1]
    sampler = emcee.EnsembleSampler(walkers, size, heights, moves=moves, vectorize=True)
    sampler.random_state = np.random.RandomState(int(rng.integers(2**31))).get_state()
    lasts = 0.0
    for done, _ in enumerate(sampler.sample(state, iterations=most_steps), 1):
        if tell is not None:
            tell(done)
        if done % steps == 0 or done == most_steps:
            lasts = (done - done // 2) / _correlated(sampler.get_chain(discard=done // 2))
            if lasts >= ENOUGH:
                break
    return Posterior(
        likelihood.freedom.names,
        sampler.get_chain(discard=done // 2, flat=True),
        sampler.get_log_prob(discard=done // 2, flat=True),
        walkers * lasts,
        lasts,
    )


def _first(
    likelihood: Likelihood, start: Directions, walkers: int, rng: np.random.Generator
) -> Array:
    """Return initial walkers, (walkers, parameters), around the optimum and within the bounds."""
    low, high = likelihood.freedom.low, likelihood.freedom.high
    width = np.minimum(start.standard_errors, (high - low) / 8)
    near = start.vector + 0.5 * width * rng.normal(size=(walkers, len(low)))
    # Reflected, not clipped: walkers on one point or plane have no differences to step along.
    near = low + np.abs(near - low)
    return np.asarray(np.clip(high - np.abs(high - near), low, high))


def _correlated(chain: Array) -> float:
    """Return the autocorrelation time, steps, of the slowest parameter, at least 1."""
    from emcee.autocorr import integrated_time

    # With a tolerance of 0 emcee does not complain about short chains; see ``lasts``.
    steps = float(np.max(integrated_time(chain, tol=0)))
    return max(steps, 1.0) if np.isfinite(steps) else float(len(chain))

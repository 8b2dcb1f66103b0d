"""The optimal policy of the stop-signal task, by dynamic programming.

The state after t readings consists of L, the log odds of the two responses, and a = ln A, the
evidence for a signal that has begun (see ``observer``). Go and stop evidence are independent, so
the next reading changes L and a independently, and one backward step is a product with two
transition matrices.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special, stats

from bgmodel.support.arrays import Array, Integers

WAIT, RESPOND, WITHHOLD = 0, 1, 2


@dataclass(frozen=True)
class Rewards:
    """Rewards of the outcomes of a trial, and the cost per reading."""

    response: float = 1.0
    """A correct response in a go trial."""
    error: float = 0.0
    """A wrong response in a go trial."""
    failed: float = -1.0
    """A response in a stop trial."""
    stop: float = 1.0
    """No response in a stop trial."""
    omission: float = 0.0
    """No response in a go trial."""
    reading: float = 0.005
    """Cost per reading, until a response is made or withheld for good."""


@dataclass(frozen=True)
class Policy:
    """The best action in every state."""

    log_odds: Array  # (L,), nats, grid of states
    begun: Array  # (A,), nats, grid of states
    action: Integers  # (1 + steps, L, A): WAIT, RESPOND (the leading response) or WITHHOLD
    value: float  # expected reward per trial


def optimal_policy(
    d_prime: float,
    stop_d_prime: float,
    share: float,
    begins: Array,
    rewards: Rewards,
    points: int = 161,
) -> Policy:
    """Return the policy of highest expected reward for Gaussian evidence and two responses.

    ``d_prime`` separates the means of go readings, in standard deviations: the log odds have a
    drift of ``+-d_prime**2 / 2`` and a variance of ``d_prime**2`` per reading. ``stop_d_prime`` is
    the mean of a stop reading with the signal, ``begins`` (steps,) the prior that reading k is the
    first with it, and ``points`` the size of the grid along each dimension.
    """
    odds = np.linspace(-8, 8, points)
    begun = np.linspace(-12, 12, points)
    right = special.expit(np.abs(odds))
    later = np.clip(1 - np.cumsum(np.append(0, begins)), 0, None)
    steps = len(begins)
    go = _kernel(odds, odds, d_prime**2 / 2, d_prime)
    # The log odds rise under one hypothesis and fall under the other, each with its probability.
    p_up = special.expit(odds)[:, None]
    go = p_up * go + (1 - p_up) * _kernel(odds, odds, -(d_prime**2) / 2, d_prime)
    action = np.zeros((1 + steps, points, points), np.int8)
    value = np.zeros((points, points))
    for t in range(steps, -1, -1):
        with np.errstate(divide="ignore"):
            z = special.logit(share) + np.logaddexp(begun, np.log(later[t]))
        p_stop = special.expit(z)
        go_reward = right * rewards.response + (1 - right) * rewards.error
        respond = np.outer(go_reward, 1 - p_stop) + rewards.failed * p_stop
        withhold = np.broadcast_to(
            rewards.stop * p_stop + rewards.omission * (1 - p_stop), respond.shape
        )
        wait = np.full_like(respond, -np.inf)
        if t < steps:
            wait = go @ value @ _stop_step(begun, t, begins, later, share, stop_d_prime).T
            wait = wait - rewards.reading
        every = np.stack([wait, respond, withhold])
        action[t], value = every.argmax(axis=0), every.max(axis=0)
    # No signal has begun before the first reading: the lowest point of the grid.
    return Policy(odds, begun, action, float(value[points // 2, 0]))


def _stop_step(
    begun: Array, t: int, begins: Array, later: Array, share: float, d_prime: float
) -> Array:
    """Return the probabilities (A, A) that reading t + 1 moves ln A from one value to another."""
    with np.errstate(divide="ignore"):
        prior = np.logaddexp(begun, np.log(begins[t]))
        weights = np.stack([prior, np.full_like(begun, np.log(later[t + 1]))])
    on = share * np.exp(weights[0])
    off = share * np.exp(weights[1]) + 1 - share
    p_on = (on / (on + off))[:, None]
    low = _kernel(prior, begun, -(d_prime**2) / 2, d_prime)
    high = _kernel(prior, begun, d_prime**2 / 2, d_prime)
    return np.asarray(p_on * high + (1 - p_on) * low)


def _kernel(start: Array, grid: Array, drift: float, sd: float) -> Array:
    """Return the probabilities (start, grid) of Gaussian steps; tails go to the ends."""
    edges = np.concatenate([[-np.inf], (grid[1:] + grid[:-1]) / 2, [np.inf]])
    below = stats.norm.cdf(edges, loc=(start + drift)[:, None], scale=sd)
    return np.asarray(np.diff(below, axis=1))

"""Proposals that follow a surrogate of the likelihood.

The exact likelihood accepts or rejects the end of a chain under the surrogate (surrogate transition
method, Liu 2001), whose moves are reversible: a proposal y from x is accepted with the exact
likelihood L and that of the surrogate L* by ``L(y) L*(x) / (L(x) L*(y))``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bgmodel.fitting.hierarchy.group import (
    FREEDOM,
    SPREAD,
    Group,
    Law,
    asked_mean,
    draw_covariance,
    gain_of_mean,
    log_mean,
    log_sd,
    shift,
)
from bgmodel.fitting.hierarchy.surrogate import Surrogate, value, values
from bgmodel.support.compiling import compiled
from circuits.arrays import Array, Integers

MOVES_OF_PEOPLE, MOVES_OF_ALL = 20, 500
"""Number of moves of people given their group, and of people and group: after as many, the end of a
chain hardly depends on its beginning."""
PEOPLE, GROUP = 0.3, 0.3
"""Shares of moves of people, and of the group given its people; the others move both."""
SINGLE = 0.25
"""Share of moves of a person that draw one parameter from the distribution of the group."""
LONGEST, SHORTEST = 2.4, 0.03
"""Largest standard deviation of a step of a random walk, in standard deviations of the draws and
divided by the root of the number of parameters that move (Roberts, Gelman & Gilks 1997), and the
smallest as a share of it. Steps are log-uniform between them."""


@dataclass(frozen=True)
class Guide:
    """Moves through the posterior under a surrogate."""

    surrogate: Surrogate
    step: Array  # (2, parameters), sds of draws of the group's means and sds, 0 if shared

    def moved(
        self, group: Group, scaled: Array, vague: Array, rng: np.random.Generator, *,
        people_alone: bool = False,
    ) -> tuple[Group, Array, Array]:  # fmt: skip
        """Move people and group; return the group, people, and the rise of the surrogate."""
        moves, share = (MOVES_OF_PEOPLE, 1.0) if people_alone else (MOVES_OF_ALL, PEOPLE)
        mean, sd, now = group.mean.copy(), np.sqrt(group.variance), scaled.copy()
        law = (group.law[0].copy(), *group.law[1:])
        settings = (self.step, np.cumsum(vague)[:-1], law, self.surrogate.arrays, rng)
        slopes, offsets = group.slopes.copy(), np.zeros(now.shape) + group.offsets
        between = (slopes, group.predictors.columns, group.predictors.of)
        rise = _wander(mean, sd, now, offsets, moves, share, between, *settings)
        return group.with_law(law[0], mean=mean, variance=sd**2, slopes=slopes), now, rise


@compiled
def _wander(
    mean: Array, sd: Array, scaled: Array, offsets: Array, moves: int, share: float,
    between: tuple[Array, Array, Integers], step: Array, cumulative: Array, law: Law,
    surrogate: tuple[Array, ...], rng: np.random.Generator,
) -> Array:  # fmt: skip
    """Move a group and its people in place; return the rise of everyone's log likelihood."""
    slopes = between[0]
    logs = values(scaled, surrogate)
    before = logs.copy()
    for _ in range(moves):
        kind = rng.random()
        if kind < share:
            _move_people(mean, sd, scaled, offsets, logs, step, cumulative, law, surrogate, rng)
        elif kind < share + GROUP:
            _move_group(mean, sd, scaled, offsets, step, law, rng)
        elif len(slopes) and share < 1 and rng.random() < 0.5:
            _move_slope(scaled, offsets, logs, between, step, surrogate, rng)
        else:
            _move_together(mean, sd, scaled, offsets, logs, step, cumulative, law, surrogate, rng)
    return logs - before


@compiled
def _move_slope(
    scaled: Array, offsets: Array, logs: Array, between: tuple[Array, Array, Integers],
    step: Array, surrogate: tuple[Array, ...], rng: np.random.Generator,
) -> None:  # fmt: skip
    """Move one slope, and everyone with it at fixed distances from their means."""
    slopes, columns, of = between
    n = int(rng.random() * len(slopes))
    k, column = of[n], columns[n]
    reach = LONGEST * SHORTEST ** rng.random() * step[0, k] / np.sqrt((column**2).mean())
    change = reach * rng.normal()
    asked = scaled.copy()
    asked[:, k] += change * column
    new = values(asked, surrogate)
    gain = (new - logs).sum()
    gain += (slopes[n] ** 2 - (slopes[n] + change) ** 2) / (2 * SPREAD**2)
    if np.log(rng.random()) < gain:
        slopes[n] += change
        offsets[:, k] += change * column
        scaled[:] = asked
        logs[:] = new


@compiled
def _move_people(
    mean: Array, sd: Array, scaled: Array, offsets: Array, logs: Array, step: Array,
    cumulative: Array, law: Law, surrogate: tuple[Array, ...], rng: np.random.Generator,
) -> None:  # fmt: skip
    """Move each person given the group: one parameter to a draw from it, or all by a step."""
    size, root, inverse = len(mean), surrogate[0], law[0]
    for person in range(len(scaled)):
        now, middle = scaled[person], mean + offsets[person]
        asked = now.copy()
        scores = (now - middle) / sd
        gain = 0.0
        if rng.random() < SINGLE:
            alone = int(np.searchsorted(cumulative, rng.random()))
            moved = rng.normal() / np.sqrt(inverse[alone, alone])
            asked[alone] = middle[alone] + sd[alone] * (shift(scores, alone, inverse) + moved)
        else:
            reach = LONGEST / np.sqrt(size) * SHORTEST ** rng.random()
            for i in range(size):
                asked += reach * rng.normal() * root[person, :, i]
            for k in range(size):
                if step[1, k] == 0:
                    asked[k] = now[k]
            new = (asked - middle) / sd
            for k in range(size):
                for j in range(size):
                    gain += inverse[k, j] * (scores[k] * scores[j] - new[k] * new[j]) / 2
        log = value(asked, person, surrogate)
        if np.log(rng.random()) < gain + log - logs[person]:
            scaled[person] = asked
            logs[person] = log


@compiled
def _move_group(
    mean: Array, sd: Array, scaled: Array, offsets: Array, step: Array, law: Law,
    rng: np.random.Generator,
) -> None:  # fmt: skip
    """Draw a mean or a standard deviation as ``Group.drawn``; both in turn are not reversible."""
    (people, size), correlated = scaled.shape, len(law[3])
    average = np.array([(scaled[:, k] - offsets[:, k]).mean() for k in range(size)])
    for turn in range(size):
        k = int(rng.random() * size) if correlated else turn
        if rng.random() < 0.5:
            error, normal = sd[k] / np.sqrt(people), rng.normal()
            asked = asked_mean(k, mean, sd, average, error, normal, law)
            gain = gain_of_mean(k, mean[k], asked, law)
            if gain > -np.inf and np.log(rng.random()) < gain:
                mean[k] = asked
        elif correlated:
            draw_covariance(scaled - offsets - mean, sd, law, rng)
        elif step[1, k] > 0:
            rate = FREEDOM / sd[k] ** 2 + 1 / SPREAD**2
            mixing = rate / rng.standard_gamma((FREEDOM + 1) / 2)
            squares = ((scaled[:, k] - offsets[:, k] - mean[k]) ** 2).sum()
            shape = (FREEDOM + people) / 2
            sd[k] = np.sqrt((FREEDOM / mixing + squares / 2) / rng.standard_gamma(shape))


@compiled
def _move_together(
    mean: Array, sd: Array, scaled: Array, offsets: Array, logs: Array, step: Array,
    cumulative: Array, law: Law, surrogate: tuple[Array, ...], rng: np.random.Generator,
) -> None:  # fmt: skip
    """Move mean and standard deviation of one parameter, and everyone at fixed standard scores."""
    k = np.searchsorted(cumulative, rng.random())
    reach = LONGEST * SHORTEST ** rng.random()
    middle = mean[k] + reach * step[0, k] * rng.normal()
    # A negative standard deviation is a positive one with scores, and correlations, of the other
    # sign.
    spread = sd[k] + reach * step[1, k] * rng.normal()
    inverse, prior, highest, correlated = law
    if middle > highest[k]:
        return
    asked = scaled.copy()
    centred = scaled[:, k] - offsets[:, k]
    asked[:, k] = offsets[:, k] + middle + spread * (centred - mean[k]) / sd[k]
    new = values(asked, surrogate)
    gain = (new - logs).sum() + log_mean(middle, prior[k]) - log_mean(mean[k], prior[k])
    own, count = inverse[k, k], len(correlated)
    gain += log_sd(spread, own, count) - log_sd(sd[k], own, count)
    if np.log(rng.random()) < gain:
        mean[k], sd[k] = middle, abs(spread)
        if spread < 0:
            inverse[k], inverse[:, k] = -inverse[k], -inverse[:, k]
            inverse[k, k] = own
        scaled[:] = asked
        logs[:] = new


def guide_of(surrogate: Surrogate, means: Array, sds: Array) -> Guide:
    """Return the guide from draws of the group's means and standard deviations (draws, ...)."""
    moved = np.where(np.ptp(sds, axis=0) > 0, sds.std(axis=0), 0.0)
    return Guide(surrogate, np.stack([means.std(axis=0), moved]))

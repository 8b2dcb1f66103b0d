"""Proposals that follow a surrogate of the likelihood.

The exact likelihood accepts or rejects the end of a chain under the surrogate (surrogate transition
method, Liu 2001). The moves of such a chain are reversible, and so is any number of them, chosen at
random: a chain from x ends in y with ``p*(x) q(x, y) = p*(y) q(y, x)``, where p* is the posterior
under the surrogate. A proposal y is therefore accepted with the exact likelihood L and that of the
surrogate L* by ``L(y) L*(x) / (L(x) L*(y))``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bgmodel.fitting.hierarchy.group import FREEDOM, SPREAD, Group
from bgmodel.fitting.hierarchy.surrogate import Surrogate, value, values
from bgmodel.support.arrays import Array, Integers
from bgmodel.support.compiling import compiled

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

    def people_moved(
        self, group: Group, scaled: Array, vague: Array, rng: np.random.Generator
    ) -> tuple[Array, Array]:
        """Move people given the group; return them and the rise of each log likelihood.

        The rise is under the surrogate. ``vague`` has the probability with which each parameter is
        chosen by moves of a single one.
        """
        _, now, rise = self._moved(group, scaled, vague, rng, MOVES_OF_PEOPLE, 1.0)
        return now, rise

    def all_moved(
        self, group: Group, scaled: Array, vague: Array, rng: np.random.Generator
    ) -> tuple[Group, Array, Array]:
        """Move people and group; return the group, and people and rise as ``people_moved``."""
        return self._moved(group, scaled, vague, rng, MOVES_OF_ALL, PEOPLE)

    def _moved(
        self, group: Group, scaled: Array, vague: Array, rng: np.random.Generator, moves: int,
        share: float,
    ) -> tuple[Group, Array, Array]:  # fmt: skip
        mean, sd, now = group.mean.copy(), np.sqrt(group.variance), scaled.copy()
        highest = np.broadcast_to(group.highest, mean.shape).astype(float)
        settings = (self.step, np.cumsum(vague)[:-1], highest, self.surrogate.arrays, rng)
        slopes, offsets = group.slopes.copy(), np.zeros(now.shape) + group.offsets
        between = (slopes, group.predictors.columns, group.predictors.of)
        rise = _wander(mean, sd, now, offsets, moves, share, between, *settings)
        return replace(group, mean=mean, variance=sd**2, slopes=slopes), now, rise


@compiled
def _wander(
    mean: Array, sd: Array, scaled: Array, offsets: Array, moves: int, share: float,
    between: tuple[Array, Array, Integers], step: Array, cumulative: Array, highest: Array,
    surrogate: tuple[Array, ...], rng: np.random.Generator,
) -> Array:  # fmt: skip
    """Move a group and its people in place; return the rise of everyone's log likelihood.

    ``share`` of the moves are of people; ``cumulative`` holds the cumulative probabilities of all
    parameters but the last to be moved alone. ``offsets`` (people, parameters) are those of slopes
    in ``between``.
    """
    slopes = between[0]
    logs = values(scaled, surrogate)
    before = logs.copy()
    for _ in range(moves):
        kind = rng.random()
        if kind < share:
            _move_people(mean, sd, scaled, offsets, logs, step, cumulative, surrogate, rng)
        elif kind < share + GROUP:
            _move_group(mean, sd, scaled, offsets, step, highest, rng)
        elif len(slopes) and share < 1 and rng.random() < 0.5:
            _move_slope(scaled, offsets, logs, between, step, surrogate, rng)
        else:
            _move_together(
                mean, sd, scaled, offsets, logs, step, cumulative, highest, surrogate, rng
            )
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
    cumulative: Array, surrogate: tuple[Array, ...], rng: np.random.Generator,
) -> None:  # fmt: skip
    """Move each person given the group: one parameter to a draw from it, or all by a step.

    The group's density of a parameter drawn from it cancels that of the prior. Parameters that
    people share stay where they are in steps.
    """
    size, root = len(mean), surrogate[0]
    for person in range(len(scaled)):
        now, middle = scaled[person], mean + offsets[person]
        asked = now.copy()
        gain = 0.0
        if rng.random() < SINGLE:
            alone = np.searchsorted(cumulative, rng.random())
            asked[alone] = middle[alone] + sd[alone] * rng.normal()
        else:
            reach = LONGEST / np.sqrt(size) * SHORTEST ** rng.random()
            for i in range(size):
                asked += reach * rng.normal() * root[person, :, i]
            for k in range(size):
                if step[1, k] == 0:
                    asked[k] = now[k]
                gain += ((now[k] - middle[k]) ** 2 - (asked[k] - middle[k]) ** 2) / (2 * sd[k] ** 2)
        log = value(asked, person, surrogate)
        if np.log(rng.random()) < gain + log - logs[person]:
            scaled[person] = asked
            logs[person] = log


@compiled
def _move_group(
    mean: Array, sd: Array, scaled: Array, offsets: Array, step: Array, highest: Array,
    rng: np.random.Generator,
) -> None:  # fmt: skip
    """Draw a mean or a standard deviation as ``Group.drawn``; both in turn are not reversible."""
    people, size = scaled.shape
    for k in range(size):
        centred = scaled[:, k] - offsets[:, k]
        if rng.random() < 0.5:
            asked = centred.mean() + sd[k] / np.sqrt(people) * rng.normal()
            gain = np.logaddexp(0, -mean[k]) - np.logaddexp(0, -asked)
            if asked <= highest[k] and np.log(rng.random()) < gain:
                mean[k] = asked
        elif step[1, k] > 0:
            rate = FREEDOM / sd[k] ** 2 + 1 / SPREAD**2
            mixing = rate / rng.standard_gamma((FREEDOM + 1) / 2)
            squares = ((centred - mean[k]) ** 2).sum()
            shape = (FREEDOM + people) / 2
            sd[k] = np.sqrt((FREEDOM / mixing + squares / 2) / rng.standard_gamma(shape))


@compiled
def _move_together(
    mean: Array, sd: Array, scaled: Array, offsets: Array, logs: Array, step: Array,
    cumulative: Array, highest: Array, surrogate: tuple[Array, ...], rng: np.random.Generator,
) -> None:  # fmt: skip
    """Move mean and standard deviation of one parameter, and everyone at fixed standard scores."""
    k = np.searchsorted(cumulative, rng.random())
    reach = LONGEST * SHORTEST ** rng.random()
    middle = mean[k] + reach * step[0, k] * rng.normal()
    # A negative standard deviation is a positive one with scores of the other sign.
    spread = sd[k] + reach * step[1, k] * rng.normal()
    if middle > highest[k]:
        return
    asked = scaled.copy()
    centred = scaled[:, k] - offsets[:, k]
    asked[:, k] = offsets[:, k] + middle + spread * (centred - mean[k]) / sd[k]
    new = values(asked, surrogate)
    gain = (new - logs).sum() + np.logaddexp(0, -mean[k]) - np.logaddexp(0, -middle)
    unit = FREEDOM * SPREAD**2
    gain -= (FREEDOM + 1) / 2 * (np.log1p(spread**2 / unit) - np.log1p(sd[k] ** 2 / unit))
    if np.log(rng.random()) < gain:
        mean[k], sd[k] = middle, abs(spread)
        scaled[:] = asked
        logs[:] = new


def guide_of(surrogate: Surrogate, means: Array, sds: Array) -> Guide:
    """Return the guide from draws of the group's means and standard deviations (draws, ...)."""
    moved = np.where(np.ptp(sds, axis=0) > 0, sds.std(axis=0), 0.0)
    return Guide(surrogate, np.stack([means.std(axis=0), moved]))

"""Chains that follow a surrogate: their ends are proposals for the exact likelihood (Liu 2001).

The moves of such a chain are reversible, and so is any number of them, chosen at random: a chain
from x ends in y with ``p*(x) q(x, y) = p*(y) q(y, x)``, where p* is the posterior under the
surrogate. A proposal y is therefore accepted with the exact likelihood L and that of the surrogate
L* by ``L(y) L*(x) / (L(x) L*(y))``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bgmodel.fitting.hierarchy.group import FREEDOM, SPREAD, Group
from bgmodel.fitting.hierarchy.surrogate import Surrogate, value, values
from bgmodel.support.arrays import Array
from bgmodel.support.compiling import compiled

ALONE, TOGETHER = 20, 500
"""Number of moves of people given their group, and of people and group."""
SINGLE = 0.25
"""Share of moves of a person that draw one parameter from the distribution of the group."""
PEOPLE, GROUP = 0.3, 0.6
"""Share of moves that are of people; of people, or of the group given its people."""
SHORTEST = 0.03
"""Steps of a random walk are up to 2.4 standard deviations of draws, over the root of the number of
parameters (Roberts, Gelman & Gilks 1997), and this share of it at least."""
LONGEST = 2.4


@dataclass(frozen=True)
class Guide:
    """Moves through the posterior under a surrogate.

    Parameters
    ----------
    surrogate : Surrogate
        Everyone's approximate log likelihood.
    root : array (people, parameters, parameters)
        Lower Cholesky factors of the covariances of people's draws.
    step : array (2, parameters)
        Standard deviations of draws of the group's means and of its standard deviations.
    vague : array (parameters,)
        How often each parameter is moved alone, sums to 1.
    """

    surrogate: Surrogate
    root: Array
    step: Array
    vague: Array

    def people_moved(
        self, group: Group, scaled: Array, rng: np.random.Generator
    ) -> tuple[Array, Array]:
        """Return people's parameters after moves given the group.

        And by how much everyone's log likelihood rose under the surrogate, (people,).
        """
        _, _, now, rise = self._moved(group, scaled, rng, ALONE, 1.0)
        return now, rise

    def all_moved(
        self, group: Group, scaled: Array, rng: np.random.Generator
    ) -> tuple[Group, Array, Array]:
        """Return group and people after moves of both, and the rise as for ``people_moved``."""
        mean, sd, now, rise = self._moved(group, scaled, rng, TOGETHER, PEOPLE)
        return Group(mean, sd**2), now, rise

    def _moved(
        self, group: Group, scaled: Array, rng: np.random.Generator, moves: int, people: float
    ) -> tuple[Array, Array, Array, Array]:
        mean, sd, now = group.mean.copy(), np.sqrt(group.variance), scaled.copy()
        own = (self.root, self.step, np.cumsum(self.vague)[:-1], self.surrogate.arrays)
        rise = _wander(mean, sd, now, moves, people, *own, rng)
        return mean, sd, now, rise


@compiled
def _wander(
    mean: Array, sd: Array, scaled: Array, moves: int, people: float, root: Array, step: Array,
    below: Array, surrogate: tuple[Array, ...], rng: np.random.Generator,
) -> Array:  # fmt: skip
    """Move a group (parameters,) and its people (people, parameters) in place.

    ``below`` has the probabilities that an earlier parameter than each but the first moves alone.
    Returns the rise of everyone's log likelihood.
    """
    logs = values(scaled, surrogate)
    before = logs.copy()
    for _ in range(moves):
        kind = rng.random()
        if kind < people:
            _move_people(mean, sd, scaled, logs, root, below, surrogate, rng)
        elif kind < GROUP:
            _move_group(mean, sd, scaled, rng)
        else:
            _move_together(mean, sd, scaled, logs, step, below, surrogate, rng)
    return logs - before


@compiled
def _move_people(
    mean: Array, sd: Array, scaled: Array, logs: Array, root: Array, below: Array,
    surrogate: tuple[Array, ...], rng: np.random.Generator,
) -> None:  # fmt: skip
    """Move each person given the group: one parameter to a draw from the group, or all by a step.

    The group's density of a parameter drawn from it cancels that of the prior.
    """
    size = len(mean)
    for person in range(len(scaled)):
        now = scaled[person]
        asked = now.copy()
        gain = 0.0
        if rng.random() < SINGLE:
            alone = np.searchsorted(below, rng.random())
            asked[alone] = mean[alone] + sd[alone] * rng.normal()
        else:
            far = LONGEST / np.sqrt(size) * SHORTEST ** rng.random()
            for i in range(size):
                asked += far * rng.normal() * root[person, :, i]
            for k in range(size):
                gain += ((now[k] - mean[k]) ** 2 - (asked[k] - mean[k]) ** 2) / (2 * sd[k] ** 2)
        log = value(asked, person, surrogate)
        if np.log(rng.random()) < gain + log - logs[person]:
            scaled[person] = asked
            logs[person] = log


@compiled
def _move_group(mean: Array, sd: Array, scaled: Array, rng: np.random.Generator) -> None:
    """Draw the mean or the standard deviation of each parameter given people; see ``Group.drawn``.

    One of the two, since a draw of one after the other would not be reversible.
    """
    people, size = scaled.shape
    for k in range(size):
        if rng.random() < 0.5:
            asked = scaled[:, k].mean() + sd[k] / np.sqrt(people) * rng.normal()
            if np.log(rng.random()) < np.logaddexp(0, -mean[k]) - np.logaddexp(0, -asked):
                mean[k] = asked
        else:
            rate = FREEDOM / sd[k] ** 2 + 1 / SPREAD**2
            mixing = rate / rng.standard_gamma((FREEDOM + 1) / 2)
            squares = ((scaled[:, k] - mean[k]) ** 2).sum()
            shape = (FREEDOM + people) / 2
            sd[k] = np.sqrt((FREEDOM / mixing + squares / 2) / rng.standard_gamma(shape))


@compiled
def _move_together(
    mean: Array, sd: Array, scaled: Array, logs: Array, step: Array, below: Array,
    surrogate: tuple[Array, ...], rng: np.random.Generator,
) -> None:  # fmt: skip
    """Move mean and standard deviation of one parameter, and everyone at fixed standard scores."""
    k = np.searchsorted(below, rng.random())
    far = LONGEST * SHORTEST ** rng.random()
    middle = mean[k] + far * step[0, k] * rng.normal()
    # A negative standard deviation is a positive one with scores of the other sign.
    spread = sd[k] + far * step[1, k] * rng.normal()
    asked = scaled.copy()
    asked[:, k] = middle + spread * (scaled[:, k] - mean[k]) / sd[k]
    new = values(asked, surrogate)
    gain = (new - logs).sum() + np.logaddexp(0, -mean[k]) - np.logaddexp(0, -middle)
    unit = FREEDOM * SPREAD**2
    gain -= (FREEDOM + 1) / 2 * (np.log1p(spread**2 / unit) - np.log1p(sd[k] ** 2 / unit))
    if np.log(rng.random()) < gain:
        mean[k], sd[k] = middle, abs(spread)
        scaled[:] = asked
        logs[:] = new


def guide_of(surrogate: Surrogate, means: Array, sds: Array, vague: Array) -> Guide:
    """Return the guide from draws of the group's means and standard deviations (draws, ...)."""
    step = np.stack([means.std(axis=0), sds.std(axis=0)])
    return Guide(surrogate, np.asarray(np.linalg.inv(surrogate.inverse)), step, vague)

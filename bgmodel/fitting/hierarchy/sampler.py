"""Draws from the joint posterior of a group and its people, by Metropolis within Gibbs.

After a warm-up, proposals follow a surrogate of the likelihood (``guide``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import numpy as np

from bgmodel.fitting.hierarchy.approximation import Expansion, Person
from bgmodel.fitting.hierarchy.group import Group, shift
from bgmodel.fitting.hierarchy.guide import SINGLE, Guide, guide_of
from bgmodel.fitting.hierarchy.surrogate import surrogate_of
from bgmodel.support.processes import SharedMap
from circuits.arrays import Array

UNGUIDED = 0.2
"""Share of the sweeps with a guide that do without it, so that chains leave points where the
surrogate is far too low."""
ALONE = 0.5
"""Share of the draws with standard scores fixed that are of one parameter."""


@dataclass(frozen=True)
class Draws:
    """States of a chain after each of its sweeps."""

    mean: Array  # (draws, parameters), of the group, on the scale
    sd: Array  # (draws, parameters), between people, on the scale
    scaled: Array  # (draws, people, parameters), on the scale
    log_likelihood: Array  # (draws, people), nats
    # (draws, slopes), of the predictors between people
    slopes: Array = field(default_factory=lambda: np.zeros((0, 0)))
    # (draws, parameters, parameters), of people; (draws, 0, 0) if they are independent
    correlation: Array = field(default_factory=lambda: np.zeros((0, 0, 0)))

    def __post_init__(self) -> None:
        for name, shape in (("slopes", (0,)), ("correlation", (0, 0))):
            if len(getattr(self, name)) != len(self.mean):
                object.__setattr__(self, name, np.zeros((len(self.mean), *shape)))

    def __len__(self) -> int:
        return len(self.mean)

    def part(self, first: int) -> Draws:
        """Return the draws from a number on."""
        return Draws(*(getattr(self, each.name)[first:] for each in fields(self)))


def joined(parts: Sequence[Draws]) -> Draws:
    """Return parts of a chain, or several chains, one after the other."""
    names = [each.name for each in fields(Draws)]
    return Draws(*(np.concatenate([getattr(each, name) for each in parts]) for name in names))


@dataclass(frozen=True)
class ChainState:
    """State of a chain: distribution of the group, people's parameters, and random numbers."""

    group: Group
    scaled: Array  # (people, parameters), on the scale
    log: Array  # (people,), log likelihoods, nats
    rng: np.random.Generator


@dataclass(frozen=True)
class Sampler:
    """A sampler of the distribution of a group and of the parameters of its people.

    A sweep has three steps. It draws each person given the group: all parameters from the expansion
    or, with probability ``SINGLE``, one parameter from the group. It draws the group given its
    people. It draws means and standard deviations with everyone's standard scores fixed (Yu & Meng
    2011). With a guide, the first and last step of most sweeps are many cheap moves under the
    surrogate, whose end point the exact likelihood then accepts or rejects.
    """

    people: list[Person]
    expansion: Expansion
    guide: Guide | None = None  # Moves under a surrogate, made from draws of the warm-up.

    @cached_property
    def vague(self) -> Array:
        """How little one person's trials determine each parameter, (parameters,), sums to 1."""
        apart = np.diagonal(self.expansion.precision, axis1=1, axis2=2).mean(axis=0)
        share = 1 / (1 + apart * self.expansion.point.var(axis=0))
        return np.asarray(share / share.sum())

    def first(self, group: Group, rng: np.random.Generator) -> ChainState:
        """Return a first state, drawn from the approximation."""
        scaled = self.expansion.times(group).draw(rng)
        return ChainState(group, scaled, self.logs(scaled), rng)

    def run(self, state: ChainState, sweeps: int) -> tuple[ChainState, Draws]:
        """Return the state after some sweeps, and those after each of them."""
        kept = []
        for _ in range(sweeps):
            guide = self.guide
            if guide is not None and state.rng.random() < UNGUIDED:
                guide = None
            state = self._individual(state) if guide is None else self._guided(guide, state)
            state = replace(state, group=state.group.drawn(state.scaled, state.rng))
            state = self._together(state) if guide is None else self._guided_together(guide, state)
            sd = np.sqrt(state.group.variance)
            # The square of the kept root, so that a chain continues from it with the same bytes.
            state = replace(state, group=replace(state.group, variance=sd**2))
            group = state.group
            related = np.zeros((0, 0)) if group.correlation is None else group.correlation
            kept.append((group.mean, sd, state.scaled, state.log, group.slopes, related))
        return state, Draws(*(np.array(each) for each in zip(*kept, strict=True)))

    def logs(self, scaled: Array) -> Array:
        """Return everyone's log likelihood at parameters (people, parameters), (people,), nats."""
        return np.array([p(x) for p, x in zip(self.people, scaled, strict=True)])

    def _individual(self, state: ChainState) -> ChainState:
        group, now, rng = state.group, state.scaled, state.rng
        proposal = self.expansion.times(group)
        asked = proposal.draw(rng)
        single = rng.random(len(now)) < SINGLE
        asked = np.where(single[:, None], self._single(state), asked)
        log = self.logs(asked)
        gain = log - state.log
        # A parameter drawn from the group: its density cancels that of the prior.
        apart = proposal.log_density(asked) - proposal.log_density(now)
        gain += np.where(single, 0.0, group.log_prior(asked) - group.log_prior(now) - apart)
        return _taken(state, asked, log, gain)

    def _single(self, state: ChainState) -> Array:
        """Return everyone's parameters with one of them drawn from the group, (people, ...)."""
        group, rng, places = state.group, state.rng, np.arange(len(state.scaled))
        which = rng.choice(len(self.vague), size=len(places), p=self.vague)
        asked, inverse, sd = state.scaled.copy(), group.law[0], np.sqrt(group.variance)
        means = np.broadcast_to(group.means, asked.shape)
        scores = zip((asked - means) / sd, which, strict=True)
        moved = np.array([shift(own, k, inverse) for own, k in scores])
        moved += rng.normal(size=len(places)) / np.sqrt(np.diag(inverse)[which])
        asked[places, which] = means[places, which] + sd[which] * moved
        return asked

    def _together(self, state: ChainState) -> ChainState:
        mean, sd, rng = state.group.mean, np.sqrt(state.group.variance), state.rng
        scores, now, size = (state.scaled - state.group.means) / sd, np.append(mean, sd), len(mean)
        drawn = np.logical_not(state.group.shared) & np.ones(size, bool)
        which = np.flatnonzero(np.append(np.ones(size, bool), drawn))
        if rng.random() < ALONE:
            k = rng.choice(size, p=self.vague)
            which = np.intersect1d(which, (k, k + size))
        proposal = self.expansion.shared(scores, now, which, state.group)
        asked = now.copy()
        asked[which] = proposal.draw(rng)
        group = replace(state.group, mean=asked[:size], variance=asked[size:] ** 2)
        # A negative standard deviation is a positive one with scores, and correlations, of the
        # other sign.
        if group.correlation is not None:
            sign = np.sign(asked[size:])
            group = replace(group, correlation=group.correlation * np.outer(sign, sign))
        scaled = group.means + asked[size:] * scores
        log = self.logs(scaled)
        gain = log.sum() + group.log_own_prior() - proposal.log_density(asked[which])
        gain -= state.log.sum() + state.group.log_own_prior() - proposal.log_density(now[which])
        taken = np.log(rng.uniform()) < gain
        return ChainState(group, scaled, log, rng) if taken else state

    def _guided(self, guide: Guide, state: ChainState) -> ChainState:
        now = state.group, state.scaled, self.vague, state.rng
        _, asked, rise = guide.moved(*now, people_alone=True)
        log = self.logs(asked)
        return _taken(state, asked, log, log - state.log - rise)

    def _guided_together(self, guide: Guide, state: ChainState) -> ChainState:
        group, asked, rise = guide.moved(state.group, state.scaled, self.vague, state.rng)
        log = self.logs(asked)
        taken = np.log(state.rng.uniform()) < (log - state.log - rise).sum()
        return ChainState(group, asked, log, state.rng) if taken else state


def guided(over_people: SharedMap, draws: Draws, rng: np.random.Generator) -> Guide:
    """Return a guide made from draws; ``over_people`` maps functions of the list of people."""
    surrogate = surrogate_of(over_people, draws.scaled, draws.log_likelihood, rng)
    return guide_of(surrogate, draws.mean, draws.sd)


def _taken(state: ChainState, asked: Array, log: Array, gain: Array) -> ChainState:
    """Return the state with accepted proposals; ``gain`` is the log of acceptance ratios."""
    taken = np.log(state.rng.uniform(size=len(gain))) < gain
    scaled = np.where(taken[:, None], asked, state.scaled)
    return ChainState(state.group, scaled, np.where(taken, log, state.log), state.rng)

"""Draws from the joint posterior of a group and its people, by Metropolis within Gibbs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bgmodel.fitting.hierarchy.approximation import Expansion, Person
from bgmodel.fitting.hierarchy.group import Group
from bgmodel.support.arrays import Array


@dataclass(frozen=True)
class Draws:
    """States of a chain after each of its sweeps.

    Parameters
    ----------
    mean, sd : array (draws, parameters)
        Distribution of the group, on the scale.
    scaled : array (draws, people, parameters)
        People's parameters on the scale.
    log_likelihood : array (draws, people), nats
        Log likelihood of each person's trials.
    """

    mean: Array
    sd: Array
    scaled: Array
    log_likelihood: Array

    def __len__(self) -> int:
        """Return the number of draws."""
        return len(self.mean)


def joined(parts: Sequence[Draws]) -> Draws:
    """Return consecutive draws of one chain as one."""
    fields = ("mean", "sd", "scaled", "log_likelihood")
    return Draws(*(np.concatenate([getattr(each, name) for each in parts]) for name in fields))


@dataclass(frozen=True)
class State:
    """State of a chain: distribution of the group, people's parameters, and random numbers.

    Parameters
    ----------
    group : Group
        Distribution of the group.
    scaled : array (people, parameters)
        People's parameters on the scale.
    log : array (people,), nats
        Log likelihood of each person's trials.
    rng : Generator
        Random numbers of the chain.
    """

    group: Group
    scaled: Array
    log: Array
    rng: np.random.Generator


@dataclass(frozen=True)
class Sampler:
    """A sampler of the distribution of a group and of the parameters of its people.

    Parameters
    ----------
    people : list of Person
        Exact likelihood of each person's trials.
    expansion : Expansion
        Its approximation.

    Notes
    -----
    A sweep has three steps. It draws each person's parameters given the group: the proposal is the
    approximate likelihood times the distribution of the group, with heavier tails, which the exact
    likelihood accepts or rejects. It draws the group given its people. And it draws the group's
    means and standard deviations once more with everyone's standard scores fixed, so that everyone
    moves with them (interweaving, Yu & Meng 2011): parameters that one person's trials hardly
    determine would mix slowly without it.
    """

    people: list[Person]
    expansion: Expansion

    def first(self, group: Group, rng: np.random.Generator) -> State:
        """Return a first state, drawn from the approximation."""
        scaled = self.expansion.times(group).draw(rng)
        return State(group, scaled, self._logs(scaled), rng)

    def run(self, state: State, sweeps: int) -> tuple[State, Draws]:
        """Return the state after some sweeps, and those after each of them."""
        kept = []
        for _ in range(sweeps):
            state = self._individual(state)
            state = State(
                state.group.drawn(state.scaled, state.rng), state.scaled, state.log, state.rng
            )
            state = self._together(state)
            sd = np.sqrt(state.group.variance)
            kept.append((state.group.mean, sd, state.scaled, state.log))
        return state, Draws(*(np.array(each) for each in zip(*kept, strict=True)))

    def _logs(self, scaled: Array) -> Array:
        return np.array([p(x) for p, x in zip(self.people, scaled, strict=True)])

    def _individual(self, state: State) -> State:
        """Draw each person's parameters given the group."""
        group, now, rng = state.group, state.scaled, state.rng
        proposal = self.expansion.times(group)
        asked = proposal.draw(rng)
        log = self._logs(asked)
        gain = log + group.log_prior(asked) - proposal.log_density(asked)
        gain -= state.log + group.log_prior(now) - proposal.log_density(now)
        taken = np.log(rng.uniform(size=len(gain))) < gain
        scaled = np.where(taken[:, None], asked, now)
        return State(group, scaled, np.where(taken, log, state.log), rng)

    def _together(self, state: State) -> State:
        """Draw the group given everyone's standard scores."""
        mean, sd, rng = state.group.mean, np.sqrt(state.group.variance), state.rng
        scores = (state.scaled - mean) / sd
        proposal, now = self.expansion.shared(scores), np.concatenate([mean, sd])
        asked = proposal.draw(rng)
        # A negative standard deviation is a positive one with scores of the other sign.
        group = Group(asked[: len(mean)], asked[len(mean) :] ** 2)
        scaled = group.mean + asked[len(mean) :] * scores
        log = self._logs(scaled)
        gain = log.sum() + group.log_own_prior() - proposal.log_density(asked)
        gain -= state.log.sum() + state.group.log_own_prior() - proposal.log_density(now)
        taken = np.log(rng.uniform()) < gain
        return State(group, scaled, log, rng) if taken else state

"""Chains of draws: run side by side until they agree, kept in files from which they continue."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from bgmodel.fitting.hierarchy.approximation import Expansion, Person
from bgmodel.fitting.hierarchy.group import Group
from bgmodel.fitting.hierarchy.guide import Guide
from bgmodel.fitting.hierarchy.sampler import Draws, Sampler, State, joined
from bgmodel.fitting.hierarchy.surrogate import Surrogate
from bgmodel.support import files
from bgmodel.support.arrays import Array
from bgmodel.support.processes import Each, here
from bgmodel.support.seeds import stream

CHAINS, ROUNDS, WARM_UP, BLOCK, MOST = 4, 2, 100, 100, 4000
"""Number of chains, rounds of the warm-up, sweeps in each of them, sweeps between two checks, and
largest number of sweeps."""
FEWEST_EFFECTIVE, LARGEST_RHAT = 400.0, 1.01
"""Effective sample size and R-hat at which chains end (Vehtari et al. 2021)."""
RENEWED, POOR = (400, 600), 200.0
"""Numbers of sweeps after which the guide is made anew, once at each, if an effective sample size
is smaller than ``POOR``."""
SAME_NATS = 1e-6
"""Largest difference of the log likelihood at a kept draw from that which was kept with it."""
DRAWS, SURROGATE = ([each.name for each in fields(kind)] for kind in (Draws, Surrogate))


@dataclass(frozen=True)
class Agreement:
    """Diagnostics of chains.

    Parameters
    ----------
    rhat, effective : array (numbers,)
        R-hat and effective sample size (bulk and tail, the smaller) of the mean and of the standard
        deviation of the group in each parameter, then of each person's parameters.
    """

    rhat: Array
    effective: Array

    @property
    def reached(self) -> bool:
        """Whether chains agree and are long enough."""
        return bool(self.rhat.max() < LARGEST_RHAT and self.effective.min() >= FEWEST_EFFECTIVE)


def agreement(chains: list[Draws]) -> Agreement:
    """Return the diagnostics of chains of equal length."""
    from arviz_stats.base import array_stats

    parts = [
        np.stack([getattr(each, name) for each in chains]).reshape(len(chains), len(chains[0]), -1)
        for name in ("mean", "sd", "scaled")
    ]
    numbers = np.moveaxis(np.concatenate(parts, axis=2), 2, 0)
    axes = {"chain_axis": 1, "draw_axis": 2}
    bulk = array_stats.ess(numbers, method="bulk", **axes)
    tail = array_stats.ess(numbers, method="tail", prob=0.05, **axes)
    return Agreement(np.asarray(array_stats.rhat(numbers, **axes)), np.minimum(bulk, tail))


def sampled(
    sampler: Sampler,
    group: Group,
    *,
    seed: int,
    each: Each | None = None,
    most: int = MOST,
    path: Path | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> list[Draws]:
    """Return chains of draws, as long as they need to agree.

    Parameters
    ----------
    sampler : Sampler
        The sampler.
    group : Group
        Where chains start.
    seed : int
        Seed of the chains; each has its own stream.
    each : Each, optional
        Map of functions of the sampler's people, by default in this process. The draws do not
        depend on it.
    most : int
        Largest number of sweeps of each chain.
    path : path, optional
        File (.npz) that keeps the chains after each block; those that it holds are continued.
    tell : function
        Called with a text on the progress.

    Notes
    -----
    Where a surrogate is far too low, because no chain was there while it was made, chains stay for
    long. If effective sample sizes are poor after ``RENEWED`` sweeps, the guide is therefore made
    anew from all draws, which are left out, as those of a warm-up are.
    """
    work = _Work(sampler, seed, each or here(sampler.people), tell)
    kept = _kept(path, sampler, group) or work.warmed(group)
    while True:
        if kept.draws:
            found = work.agreement(kept.draws)
            if found.reached or len(kept.draws[0]) >= most:
                return kept.draws
            if found.effective.min() < POOR:
                kept = work.renewed(kept)
        kept = work.longer(kept)
        _keep(path, kept)


@dataclass(frozen=True)
class _Kept:
    """Chains between two blocks: guide, states and draws, and how often the guide was made."""

    guide: Guide
    states: list[State]
    draws: list[Draws]
    made: int


@dataclass(frozen=True)
class _Work:
    """Work on chains of a sampler."""

    sampler: Sampler
    seed: int
    each: Each
    tell: Callable[[str], None]

    def run(
        self, guide: Guide | None, states: list[State], sweeps: int
    ) -> tuple[list[State], list[Draws]]:
        """Return states after some sweeps of each chain, and the draws."""
        jobs = [(self.sampler.expansion, guide, state, sweeps) for state in states]
        found = self.each(_run, jobs)
        return [state for state, _ in found], [draws for _, draws in found]

    def guide(self, draws: list[Draws], number: int) -> Guide:
        """Return the guide from the draws of all chains, so that each knows what any has found."""
        rng = stream(self.seed, "surrogate", number)
        return self.sampler.guide_from(joined(draws), rng, self.each)

    def warmed(self, group: Group) -> _Kept:
        """Return the guide of a warm-up, and the states at its end.

        In each round the guide is made from the draws of the round before, whose first quarter is
        left out.
        """
        guide = None
        states = [
            self.sampler.first(group, stream(self.seed, "hierarchy", n)) for n in range(CHAINS)
        ]
        for number in range(ROUNDS):
            self.tell(f"warm-up {number + 1} of {ROUNDS}")
            states, draws = self.run(guide, states, WARM_UP)
            guide = self.guide([one.part(len(one) // 4) for one in draws], number)
        assert guide is not None
        return _Kept(guide, states, [], ROUNDS)

    def renewed(self, kept: _Kept) -> _Kept:
        """Return chains with a new guide and no draws, if they are long enough for it."""
        number = kept.made - ROUNDS
        if number == len(RENEWED) or len(kept.draws[0]) < RENEWED[number]:
            return kept
        self.tell("chains move too slowly: they begin anew, with what they have found")
        return _Kept(self.guide(kept.draws, kept.made), kept.states, [], kept.made + 1)

    def longer(self, kept: _Kept) -> _Kept:
        """Return chains after another block of sweeps."""
        states, new = self.run(kept.guide, kept.states, BLOCK)
        before = kept.draws
        whole = [joined(both) for both in zip(before, new, strict=True)] if before else new
        return replace(kept, states=states, draws=whole)

    def agreement(self, draws: list[Draws]) -> Agreement:
        """Return the diagnostics, and tell them."""
        found = agreement(draws)
        self.tell(
            f"{len(draws[0])} draws in each of {CHAINS} chains, effective sample size "
            f"{found.effective.min():.0f}, R-hat {found.rhat.max():.3f}"
        )
        return found


def _run(
    people: list[Person], expansion: Expansion, guide: Guide | None, state: State, sweeps: int
) -> tuple[State, Draws]:
    return Sampler(people, expansion, guide).run(state, sweeps)


def _keep(path: Path | None, kept: _Kept) -> None:
    """Write the guide, the draws of all chains and their random numbers atomically."""
    if path is None:
        return
    numbers = json.dumps([each.rng.bit_generator.state for each in kept.states])
    arrays: dict[str, Any] = {
        name: np.stack([getattr(each, name) for each in kept.draws]) for name in DRAWS
    }
    arrays |= {name: getattr(kept.guide.surrogate, name) for name in SURROGATE}
    arrays |= {"rng": np.array(numbers), "step": kept.guide.step, "made": np.array(kept.made)}
    with files.replacing(path) as partial, partial.open("wb") as file:
        np.savez(file, **arrays)


def _kept(path: Path | None, sampler: Sampler, group: Group) -> _Kept | None:
    """Return kept chains; None without a complete file, or if it is of other data."""
    if path is None:
        return None
    try:
        with np.load(path, allow_pickle=False) as file:
            parts = [file[name] for name in DRAWS]
            numbers = json.loads(str(file["rng"]))
            guide = Guide(Surrogate(*(file[name] for name in SURROGATE)), file["step"])
            made = int(file["made"])
    except (OSError, ValueError, KeyError, EOFError, BadZipFile):
        return None
    draws = [Draws(*each) for each in zip(*parts, strict=True)]
    states = [_restored(*each, group) for each in zip(draws, numbers, strict=True)]
    if not all(_is_of(each, sampler) for each in states):
        return None
    return _Kept(guide, states, draws, made)


def _restored(draws: Draws, numbers: dict[str, Any], group: Group) -> State:
    """Return the last state of a chain."""
    rng = np.random.default_rng()
    rng.bit_generator.state = numbers
    last = replace(group, mean=draws.mean[-1], variance=draws.sd[-1] ** 2)
    return State(last, draws.scaled[-1], draws.log_likelihood[-1], rng)


def _is_of(state: State, sampler: Sampler) -> bool:
    """Whether a kept state is of as many people and parameters, with the same likelihood."""
    if state.scaled.shape != sampler.expansion.point.shape:
        return False
    return bool(np.allclose(sampler.logs(state.scaled), state.log, rtol=0, atol=SAME_NATS))

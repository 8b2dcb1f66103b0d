"""Chains of draws: run side by side until they agree, kept in files from which they continue."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from bgmodel.fitting.hierarchy.group import Group
from bgmodel.fitting.hierarchy.guide import Guide
from bgmodel.fitting.hierarchy.sampler import Draws, Sampler, State, joined
from bgmodel.fitting.hierarchy.surrogate import Surrogate
from bgmodel.support import files
from bgmodel.support.arrays import Array
from bgmodel.support.processes import processes
from bgmodel.support.seeds import stream

CHAINS, ROUNDS, WARM_UP, BLOCK, MOST = 4, 2, 100, 100, 4000
"""Number of chains, rounds of the warm-up, sweeps in each of them, sweeps between two checks, and
largest number of sweeps."""
FEWEST_EFFECTIVE, LARGEST_RHAT = 400.0, 1.01
"""Effective sample size and R-hat at which chains end (Vehtari et al. 2021)."""
SAME_NATS = 1e-6
"""Largest difference of the log likelihood at a kept draw from that which was kept with it."""
DRAWS, SURROGATE = ([each.name for each in fields(kind)] for kind in (Draws, Surrogate))

Run = Callable[[list[State], int], list[tuple[State, Draws]]]
# Guide of the warm-up, and state and draws of each chain.
Kept = tuple[Guide, list[State], list[Draws]]

_here: list[Sampler] = []


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
    workers: int = 1,
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
    workers : int
        Number of processes; the draws do not depend on it.
    most : int
        Largest number of sweeps of each chain.
    path : path, optional
        File (.npz) that keeps the chains after each block; those that it holds are continued.
    tell : function
        Called with a text on the progress.
    """
    kept = _kept(path, sampler, group)
    if kept is None:
        kept = _warmed(sampler, group, seed, workers, tell)
    guide, states, draws = kept
    with _runner(replace(sampler, guide=guide), workers) as run:
        while not draws or not _ended(draws, most, tell):
            states, draws = _longer(states, draws, run)
            _keep(path, guide, states, draws)
    return draws


def _warmed(
    sampler: Sampler, group: Group, seed: int, workers: int, tell: Callable[[str], None]
) -> Kept:
    """Return the guide of a warm-up, and the states at its end.

    In each round the guide is made from the draws of the round before, of all chains, so that every
    chain reaches what any of them has found. The first quarter of a round is left out.
    """
    states = [sampler.first(group, stream(seed, "hierarchy", n)) for n in range(CHAINS)]
    for number in range(ROUNDS):
        tell(f"warm-up {number + 1} of {ROUNDS}")
        with _runner(sampler, workers) as run:
            found = run(states, WARM_UP)
        states = [state for state, _ in found]
        late = joined([draws.part(len(draws) // 4) for _, draws in found])
        guide = sampler.guide_from(late, stream(seed, "surrogate", number))
        sampler = replace(sampler, guide=guide)
    return guide, states, []


def _longer(states: list[State], draws: list[Draws], run: Run) -> tuple[list[State], list[Draws]]:
    """Return chains after another block of sweeps."""
    found = run(states, BLOCK)
    new = [each for _, each in found]
    whole = [joined(both) for both in zip(draws, new, strict=True)] if draws else new
    return [state for state, _ in found], whole


def _ended(draws: list[Draws], most: int, tell: Callable[[str], None]) -> bool:
    """Return whether chains agree or are as long as allowed."""
    there = agreement(draws)
    tell(
        f"{len(draws[0])} draws in each of {CHAINS} chains, effective sample size "
        f"{there.effective.min():.0f}, R-hat {there.rhat.max():.3f}"
    )
    return there.reached or len(draws[0]) >= most


@contextmanager
def _runner(sampler: Sampler, workers: int) -> Iterator[Run]:
    """Yield the function that runs some chains, in this process or in others."""
    if workers == 1:
        yield lambda states, sweeps: [sampler.run(state, sweeps) for state in states]
        return
    with processes(workers, _receive, (sampler,)) as pool:
        yield lambda states, sweeps: list(pool.map(_run, states, [sweeps] * len(states)))


def _receive(sampler: Sampler) -> None:
    _here[:] = [sampler]


def _run(state: State, sweeps: int) -> tuple[State, Draws]:
    return _here[0].run(state, sweeps)


def _keep(path: Path | None, guide: Guide, states: list[State], draws: list[Draws]) -> None:
    """Write the guide, the draws of all chains and their random numbers atomically."""
    if path is None:
        return
    numbers = json.dumps([each.rng.bit_generator.state for each in states])
    arrays: dict[str, Any] = {
        name: np.stack([getattr(each, name) for each in draws]) for name in DRAWS
    }
    arrays |= {name: getattr(guide.surrogate, name) for name in SURROGATE}
    with files.replacing(path) as partial, partial.open("wb") as file:
        np.savez(file, rng=np.array(numbers), step=guide.step, **arrays)


def _kept(path: Path | None, sampler: Sampler, group: Group) -> Kept | None:
    """Return kept chains; None without a complete file, or if it is of other data."""
    if path is None:
        return None
    try:
        with np.load(path, allow_pickle=False) as file:
            parts = [file[name] for name in DRAWS]
            numbers = json.loads(str(file["rng"]))
            guide = Guide(Surrogate(*(file[name] for name in SURROGATE)), file["step"])
    except (OSError, ValueError, KeyError, EOFError, BadZipFile):
        return None
    draws = [Draws(*each) for each in zip(*parts, strict=True)]
    states = [_restored(*each, group) for each in zip(draws, numbers, strict=True)]
    if not all(_is_of(each, sampler) for each in states):
        return None
    return guide, states, draws


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

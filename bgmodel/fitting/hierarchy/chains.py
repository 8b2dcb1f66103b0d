"""Chains of draws: run side by side until they agree, kept in files from which they continue."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from bgmodel.fitting.hierarchy.approximation import Expansion, Person
from bgmodel.fitting.hierarchy.group import Group
from bgmodel.fitting.hierarchy.guide import Guide
from bgmodel.fitting.hierarchy.sampler import ChainState, Draws, Sampler, guided, joined
from bgmodel.fitting.hierarchy.surrogate import Surrogate
from bgmodel.support import __version__
from bgmodel.support.processes import SharedMap, local_map
from bgmodel.support.seeds import stream
from circuits.arrays import Array, Arrays
from circuits.store import Entry

CHAINS, ROUNDS, WARM_UP, BLOCK, MOST = 4, 2, 100, 100, 4000
"""Number of chains, rounds of the warm-up, sweeps in each of them, sweeps between two checks, and
largest number of sweeps."""
FEWEST_EFFECTIVE, LARGEST_RHAT = 400.0, 1.01
"""Effective sample size and R-hat at which chains end (Vehtari et al. 2021)."""
REMADE, POOR = (400, 600), 200.0
"""Lengths of chains at which the surrogate is learned again, at most once each, if an effective
sample size is below ``POOR``."""
SAME_NATS = 1e-6
"""Largest difference of the log likelihood at a kept draw from that which was kept with it."""
DRAWS, SURROGATE = ([each.name for each in fields(kind)] for kind in (Draws, Surrogate))


@dataclass(frozen=True)
class Agreement:
    """R-hat and effective sample size (smaller of bulk and tail) of each number of a fit.

    Means, standard deviations, people, slopes, and correlations, in this order.
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

    below = np.tril_indices(chains[0].correlation.shape[1], -1)
    every = [
        np.stack([getattr(each, name) for each in chains])
        for name in ("mean", "sd", "scaled", "slopes")
    ]
    every.append(np.stack([each.correlation[:, *below] for each in chains]))
    parts = [each.reshape(*each.shape[:2], -1) for each in every if each.size]
    numbers = np.moveaxis(np.concatenate(parts, axis=2), 2, 0)
    axes = {"chain_axis": 1, "draw_axis": 2}
    bulk = array_stats.ess(numbers, method="bulk", **axes)
    tail = array_stats.ess(numbers, method="tail", prob=0.05, **axes)
    # Standard deviations between people of parameters that they share do not move.
    with np.errstate(invalid="ignore"):
        rhat = np.asarray(array_stats.rhat(numbers, **axes))
    still = np.ptp(numbers, axis=(1, 2)) == 0
    return Agreement(np.where(still, 1.0, rhat), np.where(still, np.inf, np.minimum(bulk, tail)))


def sampled(
    sampler: Sampler,
    group: Group,
    *,
    seed: int,
    over_people: SharedMap | None = None,
    most: int = MOST,
    kept: Entry[Arrays] | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> list[Draws]:
    """Return chains of draws, as long as they need to agree, with at most ``most`` each.

    Chains are ``kept`` after each block and continued. If effective sample sizes are small after
    ``REMADE`` sweeps, the surrogate is learned again from all draws, which are discarded.
    """
    work = _Chains(sampler, seed, over_people or local_map(sampler.people), tell)
    now = _kept(kept, sampler, group) or work.warmed(group)
    while True:
        if now.draws:
            diagnostics = agreement(now.draws)
            tell(
                f"{len(now.draws[0])} draws in each of {CHAINS} chains, effective sample size "
                f"{diagnostics.effective.min():.0f}, R-hat {diagnostics.rhat.max():.3f}"
            )
            if diagnostics.reached or len(now.draws[0]) >= most:
                return now.draws
            if now.stuck(diagnostics):
                tell("chains mix too slowly: learning the surrogate again, without their draws")
                now = work.remade(now)
        now = work.longer(now, BLOCK)
        if kept is not None and now.guide is not None:
            kept.put(_arrays(now, now.guide))


def chains_entry(folder: Path, title: str, key: dict[str, Any]) -> Entry[Arrays]:
    """Return the place of chains in a folder; the key is all that they depend on."""
    return Entry(folder, __version__, key, dict, dict, f"{title} chains")


@dataclass(frozen=True)
class _Kept:
    """Chains between two blocks: guide, states and draws, and how often the guide was made."""

    guide: Guide | None
    states: list[ChainState]
    draws: list[Draws]
    made: int

    def stuck(self, diagnostics: Agreement) -> bool:
        """Whether the surrogate must be learned again, which is asked only at ``REMADE``."""
        ahead = REMADE[self.made - ROUNDS :]
        at = bool(ahead) and len(self.draws[0]) == ahead[0]
        return at and bool(diagnostics.effective.min() < POOR)


@dataclass(frozen=True)
class _Chains:
    sampler: Sampler
    seed: int
    over_people: SharedMap
    tell: Callable[[str], None]

    def warmed(self, group: Group) -> _Kept:
        """Return guide and states after a warm-up, whose rounds each make a new guide."""
        rngs = [stream(self.seed, "hierarchy", number) for number in range(CHAINS)]
        kept = _Kept(None, [self.sampler.first(group, rng) for rng in rngs], [], 0)
        for number in range(ROUNDS):
            self.tell(f"warm-up {number + 1} of {ROUNDS}")
            kept = self.remade(self.longer(kept, WARM_UP), WARM_UP // 4)
        return kept

    def longer(self, kept: _Kept, sweeps: int) -> _Kept:
        """Return chains after more sweeps."""
        jobs = [(self.sampler.expansion, kept.guide, state, sweeps) for state in kept.states]
        runs = self.over_people(_run, jobs)
        draws = [new for _, new in runs]
        if kept.draws:
            draws = [joined(both) for both in zip(kept.draws, draws, strict=True)]
        return replace(kept, states=[state for state, _ in runs], draws=draws)

    def remade(self, kept: _Kept, skipped: int = 0) -> _Kept:
        """Return chains with a guide from the draws of all of them, which are discarded."""
        every = joined([draws.part(skipped) for draws in kept.draws])
        guide = guided(self.over_people, every, stream(self.seed, "surrogate", kept.made))
        return _Kept(guide, kept.states, [], kept.made + 1)


def _run(
    people: list[Person], expansion: Expansion, guide: Guide | None, state: ChainState, sweeps: int
) -> tuple[ChainState, Draws]:
    return Sampler(people, expansion, guide).run(state, sweeps)


def _arrays(kept: _Kept, guide: Guide) -> Arrays:
    numbers = json.dumps([each.rng.bit_generator.state for each in kept.states])
    return {
        **{name: np.stack([getattr(each, name) for each in kept.draws]) for name in DRAWS},
        **{name: getattr(guide.surrogate, name) for name in SURROGATE},
        "rng": np.array(numbers), "step": guide.step, "made": np.array(kept.made),
    }  # fmt: skip


def _kept(entry: Entry[Arrays] | None, sampler: Sampler, group: Group) -> _Kept | None:
    """Return kept chains; None without a complete file, or if it is of other data."""
    arrays = None if entry is None else entry.get()
    if arrays is None or not arrays.keys() >= {*DRAWS, *SURROGATE}:
        return None
    parts = [arrays[name] for name in DRAWS]
    numbers = json.loads(str(arrays["rng"]))
    guide = Guide(Surrogate(*(arrays[name] for name in SURROGATE)), arrays["step"])
    made = int(arrays["made"])
    draws = [Draws(*each) for each in zip(*parts, strict=True)]
    states = [_restored(*each, group) for each in zip(draws, numbers, strict=True)]
    for state in states:
        if state.scaled.shape != sampler.expansion.point.shape:
            return None
        if not np.allclose(sampler.logs(state.scaled), state.log, rtol=0, atol=SAME_NATS):
            return None
    return _Kept(guide, states, draws, made)


def _restored(draws: Draws, numbers: dict[str, Any], group: Group) -> ChainState:
    rng = np.random.default_rng()
    rng.bit_generator.state = numbers
    last = replace(
        group, mean=draws.mean[-1], variance=draws.sd[-1] ** 2, slopes=draws.slopes[-1],
        correlation=draws.correlation[-1] if draws.correlation.size else None,
    )  # fmt: skip
    return ChainState(last, draws.scaled[-1], draws.log_likelihood[-1], rng)

"""Settled states: where trials begin, simulated once per circuit and seed instead of in each trial.

A trial begins in the state of the circuit after ``settle_ms`` at rest. Without noise it is the same
in all trials. With noise, trials share states, and trial t has number ``t % n``, where n grows with
t from ``FEWEST`` to ``MOST_STATES`` (``number_of``). The noise of a state depends only on the seed
and on its number, so that circuits are compared from the same noise, and no trial depends on its
neighbours. Trials that share a state have separate noise and evidence from the onset on. The first
``FEWEST`` states of a circuit and a seed are also kept between runs.
"""

from __future__ import annotations

import hashlib
import threading
from collections import OrderedDict
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import numpy.typing as npt

from circuits.arrays import Index
from circuits.dynamics import loops, noise
from circuits.dynamics.ticks import Clock, Scheme
from circuits.dynamics.wiring import Wiring
from circuits.engines.compiling import SOURCES
from circuits.engines.population import kernel, records
from circuits.engines.population.plan import rest, window, workspace
from circuits.engines.shipped import PopulationsEngine
from circuits.store import cached

FEWEST, MOST_STATES = 512, 8192
"""Least and largest number of states of a circuit and a seed."""
SHARED = 16
"""Number of trials that share a state before there are more states."""
FIRST = 2**63
"""Number of the first state's trial in the keys of noise, which no other trial reaches."""
MOST_BYTES = 2**26
"""Memory of all kept states; those used least recently are dropped, except the latest."""
FILES, KIND = 64, "states"
"""Largest number of circuits and seeds whose first states are kept between runs, and their folder:
a file has 1 MB with two alternatives, 7 MB with twelve."""


class Bank:
    """Settled states of one circuit and seed (the key), simulated when they are first needed.

    ``initial`` is the state at rest without noise, in which settling begins.
    """

    def __init__(self, initial: records.State, key: str) -> None:
        self.initial, self.key = initial, key
        self.made = np.zeros(0, dtype=bool)
        self.states = _room(initial, 0)
        if stored := cached(KIND, SOURCES, key).get():
            self.states = records.State(**stored)
            self.made = np.ones(FEWEST, dtype=bool)

    def remember(self) -> None:
        """Store the first states for later runs."""
        first = {name: part[:FEWEST] for name, part in self.states._asdict().items()}
        cached(KIND, SOURCES, self.key, most=FILES).put(first)

    def grow(self, count: int) -> None:
        """Make room for a number of states."""
        if count > len(self.made):
            new = _room(self.initial, count)
            for part, old in zip(new, self.states, strict=True):
                part[: len(old)] = old
            self.states = new
            self.made = np.append(self.made, np.zeros(count - len(self.made), bool))

    @property
    def nbytes(self) -> int:
        """Memory, bytes."""
        return sum(part.nbytes for part in self.states)


def number_of(trials: Index) -> Index:
    """Return the number of the state in which each trial begins."""
    doublings = np.ceil(np.log2(trials // (SHARED * FEWEST) + 1.0)).astype(np.int64)
    return np.asarray(trials % np.minimum(FEWEST << doublings, MOST_STATES))


def _room(like: records.State, entries: int) -> records.State:
    return records.State(*(np.zeros((entries, *part.shape[1:]), np.float32) for part in like))


_BANKS: OrderedDict[str, Bank] = OrderedDict()
_LOCK = threading.Lock()


def settled(
    p: records.Plan,
    scheme: Scheme,
    clock: Clock,
    engine: PopulationsEngine,
    trials: Index,
    seed: int,
) -> tuple[records.State, Index]:
    """Return initial states, and the number of that of each of ``trials``."""
    initial = rest(scheme)
    if not clock.settle_ticks:
        return initial, np.zeros(len(trials), dtype=np.intp)
    entries = number_of(trials) if engine.noise else np.zeros_like(trials)
    at_rest = _at_rest(p, clock.settle_ticks)
    with _LOCK:
        bank = _bank(at_rest, scheme.wiring.names, initial, seed)
        bank.grow(int(entries.max(initial=0)) + 1)
        # The states used least recently are dropped.
        while len(_BANKS) > 1 and sum(each.nbytes for each in _BANKS.values()) > MOST_BYTES:
            _BANKS.popitem(last=False)
        missing = np.unique(entries[~bank.made[entries]])
        if len(missing):
            before = bank.made[:FEWEST].sum()
            # The run's own window where it fits: a loop is compiled for each.
            ticks = min(window(p), window(at_rest), key=len)
            _settle(bank, at_rest, scheme, engine, missing, seed, ticks)
            if before < bank.made[:FEWEST].sum() == FEWEST:
                bank.remember()
        return bank.states, entries.astype(np.intp)


def _at_rest(p: records.Plan, ticks: int) -> records.Plan:
    """Return the plan of a run at rest, with one reading and one sample at the end."""
    clock, units, blocks = p.clock.copy(), p.units.copy(), p.blocks.copy()
    clock["step"], clock["sample"] = ticks, ticks
    units["course"], blocks["course"] = 0, 0
    return p._replace(clock=clock, units=units, blocks=blocks, factors=None, nats=None)


def _bank(p: records.Plan, names: list[str], initial: records.State, seed: int) -> Bank:
    """Return the states of a circuit and a seed, made earlier or still to be made."""
    # Names are part of the key because noise is keyed by them.
    digest = hashlib.sha1(f"{seed} {names}".encode(), usedforsecurity=False)
    for part in (*p, *initial):
        if part is not None:
            # The bytes of records include padding, which is arbitrary.
            named = part.dtype.names is not None
            digest.update(repr(part.tolist()).encode() if named else part.tobytes())
    key = digest.hexdigest()
    bank = _BANKS.pop(key, None) or Bank(initial, key)
    _BANKS[key] = bank
    return bank


def _settle(
    bank: Bank,
    p: records.Plan,
    scheme: Scheme,
    engine: PopulationsEngine,
    missing: Index,
    seed: int,
    ticks: tuple[int, ...],
) -> None:
    names = scheme.wiring.names if engine.noise else []
    streams = noise.stream_keys(seed, np.uint64(FIRST) + missing.astype(np.uint64), names)
    groups = np.array_split(np.arange(len(missing)), -(-len(missing) // kernel.LANES))
    work = [workspace(p, kept=False) for _ in range(int(engine.workers))]

    def task(k: int) -> None:
        for group in groups[k :: len(work)]:
            keys = streams[group if names else []]
            _settle_group(bank, p, work[k], missing[group], keys, ticks, scheme.wiring)

    with ThreadPoolExecutor(max_workers=len(work)) as pool:
        list(pool.map(task, range(len(work))))
    bank.made[missing] = True


def _settle_group(
    bank: Bank,
    p: records.Plan,
    work: records.Work,
    entries: Index,
    streams: npt.NDArray[np.uint64],
    ticks: tuple[int, ...],
    wiring: Wiring,
) -> None:
    """Simulate states in neighbouring lanes; the wiring is for the error."""
    count, channels = len(entries), len(p.readout)
    drive = np.zeros((count, 1, 1 + int(p.blocks["drive"].max(initial=0))))
    out, rates = np.empty((count, 1, channels)), np.empty((count, 1, 0), np.float32)
    saved = _room(bank.initial, count)
    begin = np.zeros(count, dtype=np.intp)
    arguments = p, work, bank.initial, begin, drive, streams, -np.inf, out, rates, saved, ticks
    if kernel.trials(*arguments, np.zeros(1, np.int64)):
        what = f"rates of {wiring.circuit.name} run away before the onset of evidence"
        raise loops.runaway(wiring, np.zeros(wiring.circuit.columns), what)
    for part, settled in zip(bank.states, saved, strict=True):
        part[entries] = settled

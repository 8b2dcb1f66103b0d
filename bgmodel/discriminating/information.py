"""Information of one trial about which of two models produced it.

The divergence of choices and response times, and of spike counts if cells are recorded.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from bgmodel.support.checks import check_range, whole
from circuits.arrays import Array, Integers
from circuits.circuit import Circuit
from circuits.errors import InputError, require
from circuits.laws.fluctuation import count_ratio

CORRECT, COMPETITOR, OTHER, MISSED = range(4)
"""Trials; without conflict every error is ``OTHER``."""
BINS = 6
"""Most bins of response times for each choice."""
COUNTS = 4
"""Most bins of spike counts."""
FEWEST = 40
"""Least number of trials of both models in a bin of response times and counts."""
PSEUDO = 0.5
"""Trials that are added to each bin of each model (Krichevsky & Trofimov 1981)."""
GROUPS = 50
"""Parts of the trials that the jackknife leaves out."""


@dataclass(frozen=True)
class Recorded:
    """Choices and response times of one kind of trials."""

    choice: Integers
    time_ms: Array
    spikes: Integers | None = None

    def later(self, shift_ms: float) -> Recorded:
        """Return the same trials with a longer non-decision time."""
        return replace(self, time_ms=self.time_ms + shift_ms)


@dataclass(frozen=True)
class Partition:
    """Bins of what a trial shows."""

    edges: tuple[Array, ...]
    counts: Array = field(default_factory=lambda: np.empty(0))

    @classmethod
    def of(cls, *models: Recorded) -> Partition:
        """Return bins with equal numbers of trials, all models together."""
        spikes = [one.spikes for one in models if one.spikes is not None]
        shares = np.arange(1, COUNTS) / COUNTS
        counts = np.unique(np.quantile(np.concatenate(spikes), shares)) if spikes else np.empty(0)
        choice = np.concatenate([one.choice for one in models])
        time_ms = np.concatenate([one.time_ms for one in models])
        edges = []
        for each in (CORRECT, COMPETITOR, OTHER):
            times = time_ms[choice == each]
            bins = int(np.clip(len(times) // (FEWEST * (len(counts) + 1)), 1, BINS))
            inner = np.quantile(times, np.arange(1, bins) / bins) if bins > 1 else np.empty(0)
            edges.append(np.unique(inner))
        return cls(tuple(edges), counts)

    @property
    def bins(self) -> int:
        """Number of bins."""
        return self._times * (len(self.counts) + 1)

    @property
    def _times(self) -> int:
        return sum(len(edges) + 1 for edges in self.edges) + 1

    def place(self, trials: Recorded) -> Integers:
        """Return the bin of each trial, (trials,)."""
        bins = np.full(len(trials.choice), self._times - 1, dtype=np.int64)
        first = 0
        for each, edges in enumerate(self.edges):
            here = trials.choice == each
            bins[here] = first + np.searchsorted(edges, trials.time_ms[here], side="left")
            first += len(edges) + 1
        if trials.spikes is None:
            return bins
        counted = np.searchsorted(self.counts, trials.spikes, side="left")
        return np.asarray(bins * (len(self.counts) + 1) + counted)


@dataclass(frozen=True)
class Information:
    """Information of one trial that the first of two models produced."""

    nats: float
    error: float
    values: Array
    weights: Array

    @property
    def plain_nats(self) -> float:
        """The divergence before the correction."""
        return float(self.weights @ self.values)


def information(
    true: list[Recorded], other: list[Recorded], shares: list[float]
) -> tuple[Information, list[Partition]]:
    """Return the divergence of one model's trials from another's, and the bins of each kind.

    Probabilities of a kind of trials are its share times those within it. Trial t of both models
    has the same evidence and noise, and is left out of both by the jackknife, so that what they
    have in common does not count as error.

    Estimated probabilities differ by chance, so that the divergence is too large by about
    (bins - 1) / trials for independent models, less with common random numbers. The jackknife
    removes the term of order 1 / trials whatever the dependence (Quenouille 1956).
    """
    partitions = [Partition.of(*both) for both in zip(true, other, strict=True)]
    values, weights, parts = [], [], np.zeros(GROUPS)
    for share, bins, mine, rival in zip(shares, partitions, true, other, strict=True):
        p, q = (_probabilities(bins, one) for one in (mine, rival))
        ratio = np.log(p / q)
        values.append(ratio[0])
        weights.append(share * p[0])
        parts += share * (p[1:] * ratio[1:]).sum(axis=1)
    every, share_of = np.concatenate(values), np.concatenate(weights)
    plain = float(share_of @ every)
    pseudo = GROUPS * plain - (GROUPS - 1) * parts
    error = float(pseudo.std(ddof=1) / np.sqrt(GROUPS))
    return Information(float(pseudo.mean()), error, every, share_of), partitions


def divergence(true: list[Recorded], other: list[Recorded], shares: list[float]) -> float:
    """Return the divergence alone, uncorrected: for searches over many rivals."""
    total = 0.0
    for share, mine, rival in zip(shares, true, other, strict=True):
        bins = Partition.of(mine, rival)
        p, q = (_smooth(np.bincount(bins.place(one), minlength=bins.bins)) for one in (mine, rival))
        total += share * float(p @ np.log(p / q))
    return total


def _smooth(counts: Integers) -> Array:
    raised = counts + PSEUDO
    return np.asarray(raised / raised.sum(axis=-1, keepdims=True))


def _probabilities(bins: Partition, trials: Recorded) -> Array:
    """Return probabilities of all trials, then without each group, (1 + groups, bins)."""
    group = np.arange(len(trials.choice)) * GROUPS // len(trials.choice)
    joint = np.bincount(group * bins.bins + bins.place(trials), minlength=GROUPS * bins.bins)
    counts = joint.reshape(GROUPS, bins.bins)
    return _smooth(np.concatenate([counts.sum(axis=0)[None], counts.sum(axis=0) - counts]))


MOST_CELLS = 1000


@dataclass(frozen=True)
class Recording:
    """Cells of one nucleus whose spikes are counted in every trial.

    Parameters
    ----------
    nucleus : str
        The nucleus, spiking in both circuits.
    window_ms : tuple of float
        Beginning and end of the window, ms from the onset of evidence. Evidence continues after a
        decision, so the window should end before most decisions.
    cells : int
        Number of cells that are recorded at once. All are in the channel of the true alternative.

    Raises
    ------
    ValueError
        If the window is not one, or the number of cells is out of range.
    """

    nucleus: str
    window_ms: tuple[float, float] = (100.0, 300.0)
    cells: int = 1

    def __post_init__(self) -> None:
        named = isinstance(self.nucleus, str)
        require(named, "nucleus", "must be the name of a nucleus", self.nucleus)
        pair = isinstance(self.window_ms, (list, tuple)) and len(self.window_ms) == 2
        require(pair, "window_ms", "must be the beginning and the end", self.window_ms)
        first, last = self.window_ms
        check_range(0, 60_000, window_ms=first)
        check_range(0, 60_000, window_ms=last)
        require(first < last, "window_ms", "must begin before it ends", self.window_ms)
        require(
            whole("cells", self.cells, 1) <= MOST_CELLS, "cells", "must be 1000 or less", self.cells
        )

    def check(self, circuit: Circuit) -> None:
        """Raise ValueError unless the nucleus has cells in a circuit."""
        spiking = circuit.spiking()
        if self.nucleus not in spiking:
            known = ", ".join(spiking) or "it has no cells"
            must = f"must be a nucleus of {circuit.name} with spikes: {known}"
            raise InputError.of("nucleus", must, self.nucleus)

    def mean_hz(self, rate_hz: Array, time_ms: Array, truth: Integers) -> Array:
        """Return the mean rate in the window of the true alternative's cells, (trials,) Hz."""
        first, last = self.window_ms
        inside = (time_ms > first) & (time_ms <= last)
        channel = truth if rate_hz.shape[2] > 1 else np.zeros_like(truth)
        mean = rate_hz[:, inside].mean(axis=1, dtype=np.float64)
        return np.asarray(mean[np.arange(len(mean)), channel])

    def counts(self, mean_hz: Array, circuit: Circuit, rng: np.random.Generator) -> Integers:
        """Draw the number of spikes of all recorded cells in each trial, (trials,).

        A cell's phase begins anywhere between two spikes and moves on by the expected number m of
        spikes and a Gaussian of variance F m, with F from ``count_ratio``; every whole number that
        it passes is a spike. The mean is m, apart from phases below 0, and the variance F m + 1/6,
        in long windows about that of a renewal process such as ``circuits.cells.Phase`` (Cox 1962).
        """
        first, last = self.window_ms
        expected = mean_hz[:, None] * (last - first) / 1000
        shape = len(mean_hz), self.cells
        noise = np.sqrt(count_ratio(circuit, self.nucleus) * expected) * rng.standard_normal(shape)
        passed = np.floor(rng.random(shape) + expected + noise)
        return np.asarray(np.maximum(passed, 0).sum(axis=1).astype(np.int64))

"""Spikes of recorded cells, counted in a window: the information they add to choices and times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bgmodel.support.arrays import Array, Integers
from bgmodel.support.checks import check_range, whole
from circuits.circuit import Circuit
from circuits.errors import InputError, require
from circuits.laws.fluctuation import count_ratio

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
        spiking = [row.name for row in circuit.populations if row.spiking]
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
        that of a diffusing phase (``circuits.cells.Phase``) and of renewal processes of long
        windows (Cox 1962).
        """
        first, last = self.window_ms
        expected = mean_hz[:, None] * (last - first) / 1000
        shape = len(mean_hz), self.cells
        noise = np.sqrt(count_ratio(circuit, self.nucleus) * expected) * rng.standard_normal(shape)
        passed = np.floor(rng.random(shape) + expected + noise)
        return np.asarray(np.maximum(passed, 0).sum(axis=1).astype(np.int64))

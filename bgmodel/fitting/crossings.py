"""Stored crossings: trials that a circuit decided once, read at any threshold and any drift.

A trial is simulated at full length with evidence of some drift v_j. What the circuit did up to its
decision depends on the drift through the evidence alone, and the evidence X up to time t has the
likelihood ratio ``exp(v X - v^2 t / 2)`` between drift v and none. So every stored trial stands for
a trial of any drift, with the weight ``exp(v X - v^2 t / 2) / sum_j a_j exp(v_j X - v_j^2 t / 2)``
(the balance heuristic, Veach & Guibas 1995), and the likelihood of data is smooth in the drift. A
circuit whose channels are alike also did the mirror image of every trial.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from bgmodel.arrays import Array, Integers
from bgmodel.decision import Trace, first_crossing
from bgmodel.fitting.responses import BIN_S, Grid
from bgmodel.seeds import stream

DRIFTS = (0.0, 1.0, 2.0, 4.0, 7.0, 11.0, 16.0)
"""Drifts at which trials are simulated, 1/sqrt(s)."""
BATCH = 500
"""Trials that are simulated at a time."""
Run = Callable[[Array, int], Trace]
"""From evidence (trials, readings, 2), accumulated, sqrt(s), and the number of the first trial, to
OUT: reading k, which is heard from k to k + 1 bins on, is the last that OUT may depend on then."""


@dataclass(frozen=True)
class Crossings:
    """When and how trials decided, at each of several thresholds.

    Parameters
    ----------
    thresholds_nats : array (thresholds,)
        Rising.
    drifts : array (nodes,), 1/sqrt(s)
        Drifts of the trials, as many of each.
    bins : int array (thresholds, trials)
        Bin of the decision, which is also its last reading; the last bin where there was none.
    choice : int array (thresholds, trials)
        0 or 1, -1 where there was none. Evidence of positive drift speaks for 0.
    evidence : array (thresholds, trials), sqrt(s)
        X, the difference of what the two channels had read by then.
    """

    thresholds_nats: Array
    drifts: Array
    bins: Integers
    choice: Integers
    evidence: Array

    @cached_property
    def log_mixture(self) -> Array:
        """Log of the mean of ``exp(+-v_j X - v_j^2 t / 2)`` over drifts and signs."""
        found = np.zeros(self.evidence.shape)
        read_s, far = (self.bins + 1) * BIN_S, np.abs(self.evidence)
        for v in self.drifts:
            for apart in (far - v * read_s, far + v * read_s):
                found += np.exp(-(apart**2) / (2 * read_s)) / 2
        # Of each summand exp(X^2 / 2 t) was left out, which alone would overflow.
        return np.asarray(far**2 / (2 * read_s) + np.log(found / len(self.drifts)))

    def half(self, which: int) -> Crossings:
        """Return every other trial, from the first (0) or the second (1) on."""
        return Crossings(
            self.thresholds_nats,
            self.drifts,
            np.ascontiguousarray(self.bins[:, which::2]),
            np.ascontiguousarray(self.choice[:, which::2]),
            np.ascontiguousarray(self.evidence[:, which::2]),
        )

    def around(self, threshold_nats: float) -> tuple[slice, Array]:
        """Return the stored thresholds that a threshold lies between, and its share of each."""
        last = len(self.thresholds_nats) - 1
        place = float(np.interp(threshold_nats, self.thresholds_nats, np.arange(last + 1)))
        low = min(int(place), last)
        if low == place:
            return slice(low, low + 1), np.ones(1)
        return slice(low, low + 2), np.array([low + 1 - place, place - low])


def decided(
    settings: Sequence[tuple[Crossings, float]],
    threshold_nats: float,
    drift: npt.ArrayLike,
    grid: Grid,
) -> Array:
    """Return the probability of a decision for 0 and 1 in each bin, at drifts.

    Parameters
    ----------
    settings : sequence of (Crossings, float)
        The same trials at settings of a circuit that the asked one lies between, and its share of
        each; they sum to 1.
    threshold_nats : float
        Within those stored.
    drift : array (drifts,), 1/sqrt(s)
        In favour of response 1.
    grid : Grid
        Bins.

    Returns
    -------
    array (drifts, 2, bins)
    """
    from bgmodel.fitting.weights import between, gather

    rows, shares = settings[0][0].around(threshold_nats)
    names = ("bins", "choice", "evidence", "log_mixture")
    parts = ([getattr(each, name)[rows] for each, _ in settings] for name in names)
    # Without a copy where there is one setting.
    bins, choice, evidence, mixtures = (p[0] if len(p) == 1 else np.concatenate(p) for p in parts)
    share = np.concatenate([part * shares for _, part in settings])
    # In single precision: several times as fast, and as good as the number of trials needs.
    place, read, weight = np.empty((3, bins.size), np.float32)
    chosen = np.empty(bins.size, np.int8)
    used = between(bins, choice, evidence, mixtures, share, place, chosen, read, weight)
    place, chosen, read = place[:used], chosen[:used], read[:used]
    v = np.asarray(drift, np.float32)[:, None]
    common = weight[:used] - v**2 * ((place + np.float32(1)) * np.float32(BIN_S / 2))
    apart = v * read
    as_zero, as_one = np.exp(common - apart), np.exp(common + apart)
    found = np.zeros((len(v), 2, grid.bins))
    gather(place, chosen, as_zero, as_one, found)
    return found


def simulated(
    run: Run,
    thresholds_nats: Array,
    *,
    seconds: float,
    trials: int,
    seed: int,
    drifts: npt.ArrayLike = DRIFTS,
) -> Crossings:
    """Return the crossings of trials simulated for the purpose.

    The same seed gives every circuit the same evidence.

    Parameters
    ----------
    run : function
        What makes OUT; see ``Run``.
    thresholds_nats : array (thresholds,)
        Rising.
    seconds : float, s
        Length of a trial.
    trials : int
        How many at each drift.
    seed : int
        Of the evidence.
    drifts : array (nodes,), 1/sqrt(s)
        Drifts.
    """
    readings = math.ceil(seconds / BIN_S)
    parts: list[tuple[npt.NDArray[Any], ...]] = []
    nodes = np.asarray(drifts, float)
    for number, drift in enumerate(nodes):
        rng = stream(seed, "evidence", f"{drift:g}")
        for first in range(0, trials, BATCH):
            few = min(BATCH, trials - first)
            steps = rng.normal(0.0, math.sqrt(BIN_S / 2), (few, readings, 2))
            steps += np.array([drift, -drift]) * BIN_S / 2
            read = steps.cumsum(axis=1)
            trace = run(read, number * trials + first)
            parts.append(_crossed(trace, read, thresholds_nats))
    bins, choice, evidence = (np.concatenate(part, axis=1) for part in zip(*parts, strict=True))
    return Crossings(
        thresholds_nats,
        nodes,
        np.ascontiguousarray(bins, np.int32),
        np.ascontiguousarray(choice, np.int8),
        np.ascontiguousarray(evidence),
    )


def _crossed(trace: Trace, read: Array, thresholds_nats: Array) -> tuple[npt.NDArray[Any], ...]:
    """Return bin, choice and evidence of each trial at each threshold."""
    decision = first_crossing(trace, thresholds_nats, forced=False)
    never = decision.choice < 0
    # A tick at the very end of a reading still hears that one.
    bins = np.ceil(np.where(never, 0.0, decision.time_ms) / (1000 * BIN_S) - 1e-9) - 1
    bins = np.where(never, read.shape[1] - 1, np.maximum(bins, 0)).astype(np.int64)
    apart = read[:, :, 0] - read[:, :, 1]
    return bins, decision.choice, apart[np.arange(len(read)), bins]

"""Stored crossings: trials that a circuit decided once, read at any threshold and any drift.

A trial is simulated at full length with evidence of some drift v_j. What the circuit did up to its
decision depends on the drift through the evidence alone, and the evidence X up to time t has the
likelihood ratio ``exp(v X - v^2 t / 2)`` between drift v and none. So every stored trial stands for
a trial of any drift, with the weight ``exp(v X - v^2 t / 2) / sum_j a_j exp(v_j X - v_j^2 t / 2)``
(the balance heuristic, Veach & Guibas 1995), and the likelihood of data is smooth in the drift. A
circuit whose channels are alike also did the mirror image of every trial.

The weight depends on a trial only through t and X, so trials are counted on a grid of both, once
for each stored threshold, and a drift costs one product with these counts, however many trials
there are. Between stored thresholds, densities are interpolated so that the likelihood has a
continuous slope. Chance differences that a test without noise has on the same evidence, whose law
is known exactly, are subtracted (``control``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from bgmodel.deciding.decision import Trace, first_crossing
from bgmodel.fitting.responses import BIN_S
from bgmodel.support.arrays import Array, Integers, Truths
from bgmodel.support.seeds import stream
from circuits.errors import InputError

DRIFTS = (0.0, 1.0, 2.0, 4.0, 7.0, 11.0, 16.0)
"""Drifts at which trials are simulated, 1/sqrt(s)."""
LARGEST_EXPONENT = 650.0
"""Of e in the weights of trials: beyond it numbers overflow."""
EVIDENCE_BIN = 0.05
"""Width of a bin of evidence, sqrt(s)."""
BATCH = 500
"""Trials that are simulated at a time."""
Run = Callable[[Array, int], Trace]
"""From evidence (trials, readings, 2), accumulated, sqrt(s), and the number of the first trial, to
OUT: reading k, which is heard from k to k + 1 bins on, is the last that OUT may depend on then."""


class Divided(Protocol):
    """What can be taken for some parts of the trials, as a ``control.Control``."""

    def part(self, parts: Truths) -> Divided:
        """Return it for some parts."""


@dataclass(frozen=True, repr=False)
class FirstPassageTimes:
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
        0 or 1, -1 where there was none. Evidence of positive drift favours 0.
    evidence : array (thresholds, trials), sqrt(s)
        X, the difference of what the two channels had read by then.
    control : control.Control, optional
        Walks on the same evidence, whose chance differences are subtracted.
    parts : bool array (parts,)
        Which trials count: trial k does where ``parts[k % len(parts)]`` is true. Trials are
        independent, so estimates from different parts are too.
    """

    thresholds_nats: Array
    drifts: Array
    bins: Integers
    choice: Integers
    evidence: npt.NDArray[np.floating[Any]]
    control: Divided | None = None
    parts: Truths = field(default_factory=lambda: np.ones(1, dtype=np.bool_))
    _counted: dict[int, Counts] = field(default_factory=dict, compare=False)

    def part(self, parts: Truths) -> FirstPassageTimes:
        """Return the crossings of some parts of the trials."""
        control = None if self.control is None else self.control.part(parts)
        return replace(self, parts=parts, control=control, _counted={})

    @cached_property
    def ends(self) -> int:
        """Number of bins of a trial."""
        return int(self.bins.max()) + 1

    @cached_property
    def reach(self) -> tuple[int, int]:
        """Bins of evidence on either side of none: of trials that decided, and of all others."""
        far = np.abs(self.evidence)
        decided = self.choice >= 0
        farthest = (far[some].max(initial=0.0) for some in (decided, ~decided))
        first, second = (int(each / EVIDENCE_BIN) + 2 for each in farthest)
        return first, second

    def counted(self, row: int) -> Counts:
        """Return the trials counted at one stored threshold."""
        if row not in self._counted:
            self._counted[row] = _count([(self, 1.0)], row)
        return self._counted[row]


@dataclass(frozen=True)
class Counts:
    """Trials on a grid of time and evidence.

    Parameters
    ----------
    decided : array (bins, evidence)
        Number of trials that decided in each bin of time, by the evidence for their choice, so
        spread over neighbouring bins of evidence that sums of smooth weights are those of trials.
    never : array (evidence,)
        Number of trials without a decision, by their evidence for one of the two choices.
    """

    decided: Array
    never: Array


def interpolated(place: float, rows: int) -> list[tuple[int, float]]:
    """Return rows of a table that a place between two of them is read from, with their weights.

    By cubic convolution (Keys 1981): quadratics are met exactly, and the slope is continuous.
    Beyond the first and the last row, these count again.

    Parameters
    ----------
    place : float
        0 is the first row.
    rows : int
        How many there are.
    """
    low = min(int(place), max(rows - 2, 0))
    x = place - low
    weights = (
        -x * (1 - x) ** 2,
        2 - 5 * x**2 + 3 * x**3,
        x + 4 * x**2 - 3 * x**3,
        x**2 * (x - 1),
    )
    found: dict[int, float] = {}
    for row, weight in enumerate(weights, low - 1):
        row = min(max(row, 0), rows - 1)
        found[row] = found.get(row, 0.0) + weight / 2
    return [(row, weight) for row, weight in found.items() if weight]


def read(
    settings: Sequence[tuple[FirstPassageTimes, float]], rows: Sequence[tuple[int, float]], v: Array
) -> Array:
    """Return the probability of a decision in each bin, and one more, from the trials alone.

    Parameters
    ----------
    settings : sequence of (FirstPassageTimes, float)
        As of ``decided``.
    rows : sequence of (int, float)
        Stored thresholds and their weights.
    v : array (drifts,), 1/sqrt(s)
        In favour of response 1.

    Returns
    -------
    array (bins + 1, 2, drifts)
    """
    first = settings[0][0]
    weighed = [
        (first.counted(row) if len(settings) == 1 else _count(settings, row), weight)
        for row, weight in rows
    ]
    seen = np.sum([weight * counts.decided for counts, weight in weighed], axis=0)
    never = np.sum([weight * counts.never for counts, weight in weighed], axis=0)
    read_s = (np.arange(len(seen)) + 1) * BIN_S
    # A stored trial and its mirror image: with the drift for the choice, and against it.
    read_so_far = _evidence(seen.shape[1])
    moved = _moved(np.abs(v) * read_so_far[-1])
    towards = np.exp(read_so_far[:, None] * np.concatenate([v, -v]) - np.tile(moved, 2))
    seen *= _unmixed(tuple(first.drifts.tolist()), *seen.shape)
    mass = (seen @ towards).reshape(len(seen), 2, len(v))
    mass *= np.exp(moved - np.outer(read_s, v**2) / 2)[:, None]
    last_s, evidence = read_s[_ends(settings) - 1], _evidence(len(never))[:, None]
    apart = v * evidence - v**2 * last_s / 2 - log_mixture(first.drifts, last_s, evidence)
    undecided = never @ (np.exp(apart) + np.exp(apart - 2 * v * evidence))
    return np.asarray(mass[:, ::-1] / (mass.sum(axis=(0, 1)) + undecided))


def _moved(largest: Array) -> Array:
    """Return what is taken from exponents of evidence and given back to those of time.

    Trials that are decided late have read so much that the exponential alone would overflow.
    """
    if largest.max() > 2 * LARGEST_EXPONENT:
        raise InputError(
            f"a circuit that still decides after {largest.max():.0f} nats of evidence cannot be "
            f"weighed: at most {2 * LARGEST_EXPONENT:.0f}. Simulate shorter trials (seconds)",
            "seconds",
        )
    return np.where(largest > LARGEST_EXPONENT, largest / 2, 0.0)


def log_mixture(drifts: npt.ArrayLike, read_s: npt.ArrayLike, evidence: npt.ArrayLike) -> Array:
    """Return the log of the mean of ``exp(+-v_j X - v_j^2 t / 2)`` over drifts and signs.

    Parameters
    ----------
    drifts : array (nodes,), 1/sqrt(s)
        The v_j.
    read_s, evidence : arrays that broadcast, s and sqrt(s)
        t and X.
    """
    nodes = np.asarray(drifts, float)
    time_s, read = np.broadcast_arrays(np.asarray(read_s, float), np.asarray(evidence, float))
    found = np.full(time_s.shape, -np.inf)
    for v in (*nodes, *-nodes):
        found = np.logaddexp(found, v * read - v**2 * time_s / 2)
    return np.asarray(found - math.log(2 * len(nodes)))


@lru_cache(maxsize=16)
def _unmixed(drifts: tuple[float, ...], bins: int, columns: int) -> Array:
    """Return one over the mixture of ``log_mixture`` on the grid of ``Counts.decided``."""
    read_s = (np.arange(bins) + 1) * BIN_S
    return np.exp(-log_mixture(drifts, read_s[:, None], _evidence(columns)))


def log_odds(threshold_nats: npt.ArrayLike) -> Any:
    """Return the log odds at which OUT of an ideal circuit is at a threshold."""
    return -np.log(np.expm1(threshold_nats))


def _ends(settings: Sequence[tuple[FirstPassageTimes, float]]) -> int:
    """Return the number of bins of the longest trial."""
    return max(each.ends for each, _ in settings)


def _evidence(columns: int) -> Array:
    """Return the middles of bins of evidence, sqrt(s)."""
    return np.asarray((np.arange(columns) - columns // 2) * EVIDENCE_BIN, dtype=np.float64)


def _count(settings: Sequence[tuple[FirstPassageTimes, float]], row: int) -> Counts:
    """Count the trials of several settings at one stored threshold."""
    from bgmodel.fitting.weights import count

    bins, choice, evidence = (
        np.stack([getattr(each, name)[row] for each, _ in settings])
        for name in ("bins", "choice", "evidence")
    )
    first = settings[0][0]
    reach, far = np.max([each.reach for each, _ in settings], axis=0)
    decided, never = np.zeros((_ends(settings) + 1, 2 * reach + 1)), np.zeros(2 * far + 1)
    share = np.array([share for _, share in settings])
    count(bins, choice, evidence, share, first.parts, EVIDENCE_BIN, decided, never)
    return Counts(_sharpened(decided), _sharpened(never))


def _sharpened(counts: Array) -> Array:
    """Return counts over evidence whose weighted sums are those of the trials.

    Counting a trial in the two bins next to it adds, for trials anywhere in a bin, a twelfth of the
    second difference of a weight: it is taken out of the counts.
    """
    padded = np.pad(counts, [(0, 0)] * (counts.ndim - 1) + [(1, 1)])
    return np.asarray(counts - np.diff(padded, n=2, axis=-1) / 12)


def simulated(
    run: Run,
    thresholds_nats: Array,
    *,
    seconds: float,
    trials: int,
    seed: int,
    drifts: npt.ArrayLike = DRIFTS,
) -> FirstPassageTimes:
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
    return FirstPassageTimes(
        thresholds_nats,
        nodes,
        np.ascontiguousarray(bins, np.int16),
        np.ascontiguousarray(choice, np.int8),
        np.ascontiguousarray(evidence, np.float32),
    )


def _crossed(trace: Trace, read: Array, thresholds_nats: Array) -> tuple[npt.NDArray[Any], ...]:
    """Return bin, choice and evidence of each trial at each threshold."""
    decision = first_crossing(trace, thresholds_nats, forced=False, checked=False)
    never = decision.choice < 0
    # A tick at the very end of a reading still hears that one.
    bins = np.ceil(np.where(never, 0.0, decision.time_ms) / (1000 * BIN_S) - 1e-9) - 1
    bins = np.where(never, read.shape[1] - 1, np.maximum(bins, 0)).astype(np.int64)
    apart = read[:, :, 0] - read[:, :, 1]
    return bins, decision.choice, apart[np.arange(len(read)), bins]

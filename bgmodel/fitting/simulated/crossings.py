"""Stored crossings: trials simulated once, from which any threshold and drift can be computed.

The activity of a circuit up to its decision depends on the drift only through the evidence, and the
evidence X up to time t has the likelihood ratio ``exp(v X - v^2 t / 2)`` between drift v and no
drift. Every stored trial, simulated at a drift v_j, therefore counts as a trial of any drift with
the weight ``exp(v X - v^2 t / 2) / sum_j a_j exp(v_j X - v_j^2 t / 2)`` (the balance heuristic,
Veach & Guibas 1995), and the likelihood of data is smooth in the drift. If a circuit's channels are
equal, the mirror image of every trial counts too.

Trials are counted on a grid of t and X, once for each stored threshold, so that a drift costs one
product with these counts. With a bias of one channel, trials with the bias and the mirror images of
those with the opposite bias are counted by choice. Between stored thresholds densities are
interpolated. A test without noise on the same evidence serves as control variate (``error``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from bgmodel.deciding.decision import first_crossing
from bgmodel.deciding.trace import Trace
from bgmodel.fitting.responses import BIN_S
from bgmodel.support.compiling import compiled, inlined
from bgmodel.support.seeds import stream
from circuits.arrays import Array, Integers, Truths


@compiled
def count(
    bins: Any, choice: Any, evidence: Any, share: Any, parts: Any, width: Any,
    decided: Any, never: Any,
) -> None:  # fmt: skip
    """Add trials to the counts ``decided`` and ``never`` of a grid; see ``crossings.Counts``.

    A trial is given at several settings of weights ``share``: if its choice is the same at all,
    time and evidence are interpolated; otherwise it is divided among them.
    """
    settings, trials = len(bins), len(bins[0])
    part = -1
    for trial in range(trials):
        part = part + 1 if part + 1 < len(parts) else 0
        if not parts[part]:
            continue
        same = True
        when, read = 0.0, 0.0
        for setting in range(settings):
            same = same and choice[setting][trial] == choice[0][trial]
            when += share[setting] * bins[setting][trial]
            read += share[setting] * evidence[setting][trial]
        if same:
            add(when, choice[0][trial], read / width, 1.0, decided, never)
        else:
            for setting in range(settings):
                add(
                    float(bins[setting][trial]), choice[setting][trial],
                    evidence[setting][trial] / width, share[setting], decided, never,
                )  # fmt: skip


@inlined
def add(when: Any, chosen: Any, read: Any, weight: Any, decided: Any, never: Any) -> None:
    """Add one trial, or part of one, to the counts."""
    read = -read if chosen == 1 else read
    if chosen < 0:
        place = never.shape[0] // 2 + read
        left = int(place)  # the central column is far above 0
        right = weight * (place - left)
        never[left] += weight - right
        never[left + 1] += right
    else:
        place = decided.shape[2] // 2 + read
        left, low = int(place), int(when)
        side = chosen if decided.shape[0] == 2 else 0
        right = weight * (place - left)
        later = when - low
        decided[side, low, left] += (1 - later) * (weight - right)
        decided[side, low, left + 1] += (1 - later) * right
        if later > 0:
            decided[side, low + 1, left] += later * (weight - right)
            decided[side, low + 1, left + 1] += later * right


DRIFTS = (0.0, 1.0, 2.0, 4.0, 7.0, 11.0, 16.0)
"""Drifts at which trials are simulated, 1/sqrt(s)."""
LARGEST_EXPONENT = 650.0
"""Largest exponent of e in the weights of trials: larger ones overflow."""
EVIDENCE_BIN = 0.05
"""Width of a bin of evidence, sqrt(s)."""
BATCH = 500
"""Number of trials simulated at a time."""
Run = Callable[[Array, int], Trace]
"""Maps accumulated evidence (trials, readings, 2), sqrt(s), and the number of the first trial to
OUT. From k to k + 1 bins, reading k is the last that OUT may depend on."""


@dataclass(frozen=True, repr=False)
class FirstPassageTimes:
    """Times and choices of trials at each of several thresholds."""

    thresholds_nats: Array  # Increasing.
    drifts: Array  # (nodes,), 1/sqrt(s), with equal numbers of trials
    # (thresholds, trials), of the decision and its last reading; the last bin if none
    bins: Integers
    choice: Integers  # (thresholds, trials); -1 if none; positive drift favours 0
    # (thresholds, trials), sqrt(s): X, the difference of both channels up to then.
    evidence: npt.NDArray[np.floating[Any]]
    # Walks on the same evidence, whose chance differences are subtracted: an ``error.Control``.
    control: Any = None
    # Trial k counts if ``parts[k % len(parts)]``; estimates from different parts are independent.
    parts: Truths = field(default_factory=lambda: np.ones(1, dtype=np.bool_))
    # Trials with the opposite bias, whose mirror images count; without a bias, each trial's own
    # does.
    opposite: FirstPassageTimes | None = None
    _reach: tuple[int, int] | None = field(default=None, compare=False)
    _counted: dict[int, Counts] = field(default_factory=dict, compare=False, init=False)

    def __post_init__(self) -> None:
        # Trials are counted at one threshold at a time: in memory they stand side by side.
        for name in ("bins", "choice", "evidence"):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name)))

    def part(self, parts: Truths) -> FirstPassageTimes:
        """Return the crossings of some parts of the trials."""
        control = None if self.control is None else self.control.part(parts)
        # The reach of all trials serves every part: to find it takes longer than to count them.
        return replace(self, parts=parts, control=control, _reach=self.reach)

    @cached_property
    def mirrored(self) -> FirstPassageTimes:
        """The mirror images of all trials."""
        choice = np.where(self.choice < 0, self.choice, 1 - self.choice)
        return replace(
            self, choice=choice, evidence=-self.evidence, opposite=None, _reach=self.reach
        )  # fmt: skip

    @cached_property
    def ends(self) -> int:
        """Number of bins of a trial."""
        both = (self,) if self.opposite is None else (self, self.opposite)
        return int(max(each.bins.max() for each in both)) + 1

    @cached_property
    def reach(self) -> tuple[int, int]:
        """Bins of evidence on either side of 0: for trials with a decision, and for the others."""
        if self._reach is not None:
            return self._reach
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
    """Trials on a grid of time and evidence for their choice; undecided ones for choice 0.

    They are still to be ``sharpened``: once for the sum of all that are added.
    """

    decided: Array  # (1 or 2, bins, evidence); with a bias, choices 0 and 1 are apart
    never: Array  # (evidence,), without a decision

    @cached_property
    def box(self) -> tuple[int, int, int]:
        """Bins up to the last decision; first column and one past the last, with one to spare."""
        bins, columns = (np.flatnonzero(self.decided.any(axis=axis)) for axis in ((0, 2), (0, 1)))
        if not len(bins):
            return 0, 0, 0
        return int(bins[-1]) + 1, max(int(columns[0]) - 1, 0), int(columns[-1]) + 2


def interpolated(place: float, rows: int) -> list[tuple[int, float]]:
    """Return the rows used to interpolate a table at a place between two rows, with weights.

    By cubic convolution (Keys 1981): exact for quadratics, with a continuous slope.
    """
    low = min(int(place), max(rows - 2, 0))
    x = place - low
    weights = (
        -x * (1 - x) ** 2,
        2 - 5 * x**2 + 3 * x**3,
        x + 4 * x**2 - 3 * x**3,
        x**2 * (x - 1),
    )
    weight_of: dict[int, float] = {}
    for row, weight in enumerate(weights, low - 1):
        row = min(max(row, 0), rows - 1)
        weight_of[row] = weight_of.get(row, 0.0) + weight / 2
    return [(row, weight) for row, weight in weight_of.items() if weight]


def read(
    settings: Sequence[tuple[FirstPassageTimes, float]], rows: Sequence[tuple[int, float]], v: Array
) -> Array:
    """Return the probability of a decision from trials alone, (bins + 1, 2, drifts).

    Arguments are as for ``error.decided``, ``rows`` stored thresholds with weights.
    """
    first = settings[0][0]
    weighed = [
        (first.counted(row) if len(settings) == 1 else _count(settings, row), weight)
        for row, weight in rows
    ]
    drifts = tuple(first.drifts.tolist())
    sides, *shape = weighed[0][0].decided.shape
    never = sharpened(np.sum([weight * counts.never for counts, weight in weighed], axis=0))
    read_s = (np.arange(shape[0]) + 1) * BIN_S
    seen, box = _seen(weighed)
    seen *= _unmixed(drifts, *shape)[box]
    read_so_far = _evidence(shape[1])[box[1]]
    mass = np.zeros((shape[0], 2, len(v)))
    for times, moved in _offsets(seen, read_so_far, v):
        # Drift in favour of the choice, and against it: without a bias, the first for a stored
        # trial and the second for its mirror image; with one, the first for choice 0, the second
        # for 1.
        towards = read_so_far[:, None] * np.concatenate([v, -v]) - np.tile(moved, 2)
        towards = np.exp(np.minimum(towards, LARGEST_EXPONENT))  # larger where there are no trials
        each = np.split(towards, sides, axis=1)
        parts = [one[times] @ ways for one, ways in zip(seen, each, strict=True)]
        weighted = np.concatenate(parts, axis=1).reshape(-1, 2, len(v))
        scale = np.exp(moved - np.outer(read_s[box[0]][times], v**2) / 2)
        mass[box[0]][times] = weighted * scale[:, None]
    last_s, evidence = float(read_s[_ends(settings) - 1]), _evidence(len(never))[:, None]
    apart = v * evidence - v**2 * last_s / 2 - _mixed(drifts, last_s, len(never))
    undecided = never @ np.exp(apart)
    if sides == 1:
        undecided = never @ (np.exp(apart) + np.exp(apart - 2 * v * evidence))
    return np.asarray(mass[:, ::-1] / (mass.sum(axis=(0, 1)) + undecided))


def _seen(weighed: Sequence[tuple[Counts, float]]) -> tuple[Array, tuple[slice, slice]]:
    """Return the weighted sum of counts, sharpened, in the box that holds all; and that box."""
    boxes = [counts.box for counts, _ in weighed if counts.box[0]] or [(0, 0, 0)]
    late, low, high = np.array(boxes).T
    box = (slice(late.max()), slice(low.min(), high.max()))
    seen = weighed[0][1] * weighed[0][0].decided[:, *box]
    for counts, weight in weighed[1:]:
        seen += weight * counts.decided[:, *box]
    return sharpened(seen), box


def _offsets(seen: Array, read: Array, v: Array) -> list[tuple[slice | Truths, Array]]:
    """Return groups of times with the offset that is moved from exponents of evidence to time.

    ``seen`` are weighed trials (sides, times, evidence), and ``read`` is their evidence. Without an
    offset exponents would overflow. If a single one is too small, late times get a larger one. It
    makes some of their weights 0: those of trials with evidence far below v t, which hardly ever
    comes from a drift v.
    """
    largest = np.abs(v) * np.abs(read).max(initial=0.0)
    if largest.max() <= 2 * LARGEST_EXPONENT:
        return [(slice(None), np.where(largest > LARGEST_EXPONENT, largest / 2, 0.0))]
    far = (seen.any(axis=0) * np.abs(read)).max(axis=1, initial=0.0)
    late = far * np.abs(v).max() > 2 * LARGEST_EXPONENT
    early = np.abs(v) * far[~late].max(initial=0.0)
    largest = np.abs(v) * far[late].max(initial=0.0)
    return [
        (~late, np.where(early > LARGEST_EXPONENT, early / 2, 0.0)),
        (late, np.maximum(largest - LARGEST_EXPONENT, 0.0)),
    ]


def log_mixture(drifts: npt.ArrayLike, read_s: npt.ArrayLike, evidence: npt.ArrayLike) -> Array:
    """Return the log of the mean of ``exp(+-v_j X - v_j^2 t / 2)`` over drifts and signs."""
    nodes = np.asarray(drifts, float)
    time_s, read = np.broadcast_arrays(np.asarray(read_s, float), np.asarray(evidence, float))
    logs = np.full(time_s.shape, -np.inf)
    for v in (*nodes, *-nodes):
        logs = np.logaddexp(logs, v * read - v**2 * time_s / 2)
    return np.asarray(logs - math.log(2 * len(nodes)))


@lru_cache(maxsize=16)
def _unmixed(drifts: tuple[float, ...], bins: int, columns: int) -> Array:
    read_s = (np.arange(bins) + 1) * BIN_S
    return np.exp(-log_mixture(drifts, read_s[:, None], _evidence(columns)))


@lru_cache(maxsize=16)
def _mixed(drifts: tuple[float, ...], last_s: float, columns: int) -> Array:
    return log_mixture(drifts, last_s, _evidence(columns)[:, None])


def log_odds(threshold_nats: npt.ArrayLike) -> Any:
    """Return the log odds at which OUT of an ideal circuit equals a threshold."""
    return -np.log(np.expm1(threshold_nats))


def _ends(settings: Sequence[tuple[FirstPassageTimes, float]]) -> int:
    return max(each.ends for each, _ in settings)


def _evidence(columns: int) -> Array:
    return np.asarray((np.arange(columns) - columns // 2) * EVIDENCE_BIN, dtype=np.float64)


def _count(settings: Sequence[tuple[FirstPassageTimes, float]], row: int) -> Counts:
    biased = [each.opposite.mirrored for each, _ in settings if each.opposite is not None]
    every = [[each for each, _ in settings], *([biased] if biased else [])]
    reach, far = np.max([each.reach for group in every for each in group], axis=0)
    share = np.array([share for _, share in settings])
    decided = np.zeros((len(every), _ends(settings) + 1, 2 * reach + 1))
    never = np.zeros(2 * far + 1)
    for group in every:
        bins, choice, evidence = (
            tuple(getattr(each, name)[row] for each in group)
            for name in ("bins", "choice", "evidence")
        )
        count(bins, choice, evidence, share, group[0].parts, EVIDENCE_BIN, decided, never)
    return Counts(decided, never)


def sharpened(counts: Array) -> Array:
    """Return counts corrected for the division of trials between the two nearest bins.

    It adds a twelfth of the second difference of a weight.
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
    """Simulate ``trials`` at each drift; the same seed gives every circuit the same evidence."""
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
            apart = read[:, :, 0] - read[:, :, 1]
            parts.append(crossed(run(read, number * trials + first), apart, thresholds_nats))
    bins, choice, evidence = (np.concatenate(part, axis=1) for part in zip(*parts, strict=True))
    small = bins.astype(np.int16), choice.astype(np.int8), evidence.astype(np.float32)
    return FirstPassageTimes(thresholds_nats, nodes, *small)


def crossed(trace: Trace, read: Array, thresholds_nats: Array) -> tuple[npt.NDArray[Any], ...]:
    """Return bin, choice and evidence, of those read (trials, ...), at each threshold."""
    decision = first_crossing(trace, thresholds_nats, forced=False, checked=False)
    never = decision.choice < 0
    # A tick at the very end of a reading still depends on it.
    bins = np.ceil(np.where(never, 0.0, decision.time_ms) / (1000 * BIN_S) - 1e-9) - 1
    bins = np.where(never, read.shape[1] - 1, np.maximum(bins, 0)).astype(np.int64)
    return bins, decision.choice, read[np.arange(len(read)), bins]

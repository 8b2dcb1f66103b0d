"""Stop trials for fits: the threshold of OUT and a stop signal, a person's data and go process.

The difference of the evidence is X(t) = v t + W(t), as in ``passage``. The bounds are at +-a until
a time u; paths that have not reached them continue to bounds at +-b, b > a. A stop signal of A nats
lowers the threshold of OUT from theta to theta - A, so that the posterior at a decision rises from
exp(-theta) to exp(A - theta).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from scipy.special import log_ndtr, ndtr

from bgmodel.fitting.algorithms import GapModel
from bgmodel.fitting.design import design_of
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.optimum import optimum
from bgmodel.stopping.people import AFTER, slowing
from bgmodel.stopping.trials import StopTrials
from bgmodel.trials.record import Trials
from circuits.arrays import Array, Integers
from circuits.errors import InputError, require

MODES = 40
"""Modes of the density between the bounds; enough from ``EARLIEST_S`` on."""
PLACES = 60
"""Number of places between the bounds at which the density is computed."""
EARLIEST_S = 0.002
"""Shortest time between the start and the change of the bounds, s: the same is used before it."""


def threshold_nats(bound: Array, noise_nats: Array) -> Array:
    """Return the threshold of OUT that corresponds to bounds a of a diffusion, sqrt(s), in nats.

    ``theta = ln(1 + exp(-n a))``; n is the standard deviation of log odds after one second.
    """
    with np.errstate(invalid="ignore"):  # NaN where the go process is unknown
        return np.asarray(np.logaddexp(0, -np.asarray(noise_nats) * bound))


def raised_bound(bound: Array, noise_nats: Array, stop_nats: float) -> Array:
    """Return the bound while a stop signal of some nats is on, sqrt(s); infinite if it blocks."""
    left = threshold_nats(bound, noise_nats) - stop_nats
    with np.errstate(divide="ignore", invalid="ignore"):
        raised = -np.log(np.expm1(left)) / noise_nats
    return np.asarray(np.where(left > 0, raised, np.inf))


def crossed_later(
    drift: float, bound: float, raised: float, since_s: Array, left_s: Array
) -> Array:
    """Return the probability of reaching raised bounds b after missing a until u, ``since_s``.

    The density at u is a sum over modes; paths that would reach both bounds in ``left_s`` are
    counted twice.
    """
    if not np.isfinite(raised):
        return np.zeros(len(since_s))
    places = bound * (2 * np.arange(PLACES) + 1 - PLACES) / PLACES
    wave = (2 * np.arange(MODES) + 1) * np.pi / (2 * bound)
    u = np.maximum(since_s, EARLIEST_S)[:, None]
    decay = np.exp(-(wave**2 - wave[0] ** 2) * u / 2)
    density = np.maximum(decay @ np.cos(wave[:, None] * places), 0) * np.exp(drift * places)
    w = np.maximum(left_s, 1e-9)[:, None]
    reached = _one_bound(raised - places, drift, w) + _one_bound(raised + places, -drift, w)
    mean = (density * np.minimum(reached, 1)).sum(axis=1) / density.sum(axis=1)
    return np.where(left_s > 0, mean, 0.0)


def _one_bound(distance: Array, drift: float, time_s: Array) -> Array:
    root = np.sqrt(time_s)
    back = np.exp(2 * drift * distance + log_ndtr(-(distance + drift * time_s) / root))
    return np.asarray(ndtr((drift * time_s - distance) / root) + back)


KEPT = 1024
"""Number of people whose layout is kept."""
FEWEST_GO = 10
"""Fewest go responses of a person in a fit."""
LAPSE = 0.02
"""Share of lapses in fits of the go process, which is not fitted."""
GO = ("sensitivity", "bound", "t0_s", "t0_sd_s")
"""Parameters of the go process: a diffusion between constant bounds (``GapModel``)."""


@dataclass(frozen=True, eq=False)
class StopData:
    """The stop trials of one person, and the go times that race with them."""

    go_ms: Array  # (go trials,), without the slowing after stop trials; NaN without a response
    go_response: Integers  # (go trials,)
    slower_ms: Array  # (trials,), by how much go responses are slower after such a trial as before
    stop: Integers  # (stop trials,), their places
    ssd_ms: Array  # (stop trials,)
    rt_ms: Array  # (stop trials,), NaN without a response
    end_ms: float  # the deadline, or the longest time of a response or, by 1 ms, of a signal

    @cached_property
    def times_ms(self) -> Array:
        """Times of go responses, sorted, ms."""
        return np.sort(self.go_ms[~np.isnan(self.go_ms)])

    @property
    def responded(self) -> float:
        """Share of go trials with a response."""
        return len(self.times_ms) / len(self.go_ms)

    @cached_property
    def shown_ms(self) -> Array:
        """Delay of each stop trial, earlier by the slowing of its go process, ms."""
        return np.asarray(self.ssd_ms - self.slower_ms[self.stop])

    @cached_property
    def alike(self) -> tuple[Integers, Integers]:
        """One stop trial of each delay after slowing, and which of them each trial is like."""
        _, first, which = np.unique(self.shown_ms, return_index=True, return_inverse=True)
        return first, which


@lru_cache(maxsize=KEPT)
def laid(trials: Trials, slowing_ms: tuple[float, float] | None = None) -> StopData:
    """Lay out one person's trials, in the order in which they were run.

    ``slowing_ms`` is how much slower go responses are after failed and successful stops; by default
    the person's own slowing.
    """
    one = StopTrials.of(trials)
    go, stop = ~one.stop, np.flatnonzero(one.stop)
    enough = len(stop) and (go & one.responded).sum() >= FEWEST_GO
    must = f"must be given in some trials, and {FEWEST_GO} go trials must have a response"
    require(enough, "ssd", must, trials.people())
    if slowing_ms is None:
        known = slowing(one)
        slowings = (known[f"after_{name.replace(' ', '_')}_ms"] for name in AFTER)
        slowing_ms = tuple(np.nan_to_num(list(slowings)).tolist())
    before = np.append("", one.outcome[:-1])
    slower = np.select([before == name for name in AFTER], slowing_ms)
    end_ms = one.deadline_ms or max(float(np.nanmax(one.rt_ms)), float(np.nanmax(one.ssd_ms)) + 1)
    return StopData((one.rt_ms - slower)[go], trials.response[go].astype(np.int64), slower, stop,
                    one.ssd_ms[stop], one.rt_ms[stop], end_ms)  # fmt: skip


def go_process(trials: Trials) -> dict[str, float]:
    """Fit a diffusion between constant bounds to one person's go trials: ``GO``, NaN if unknown."""
    unknown = dict.fromkeys(GO, np.nan)
    one = StopTrials.of(trials)
    go = ~one.stop & one.responded
    if one.correct is None or go.sum() < FEWEST_GO:
        return unknown
    try:
        design = design_of(trials.where(go))
    except InputError:
        return unknown
    fitted = optimum(likelihood_of(GapModel(), design, fixed={"lapse": LAPSE})).values
    return {name: fitted[name] for name in GO}

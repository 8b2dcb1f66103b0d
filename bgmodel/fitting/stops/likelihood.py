"""The likelihood of stop trials in closed form, for a stop process that participants share.

A stop signal that is triggered adds c(t) to OUT. Above the threshold it blocks every response that
has not been made by then, so that

    p(respond | SSD) = f R + (1 - f) E[F(SSD + SSRT)],

where SSD is the stop-signal delay, F the distribution of the participant's go times, R the
proportion of go trials with a response, f the probability of a trigger failure, and SSRT the time
from the signal to its effect, normally distributed. Only F of the data is needed, with no model of
the go process. Below the threshold a stop signal of A nats raises the criterion: those that have
not responded may do so later, with a probability that follows from the go process as a diffusion
(``raised``). Participants may differ in SSRT (normal) and f (logit-normal); the likelihood of a
participant's trials is integrated over both.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd
from scipy import optimize, special
from scipy.ndimage import gaussian_filter1d

from bgmodel.fitting.exact.raised import crossed_later, raised_bound
from bgmodel.fitting.stops.data import EARLIEST_MS, STEP_MS, StopData
from bgmodel.fitting.stops.model import StopModel
from bgmodel.support.arrays import Array

SSRT_NODES, FAILURE_NODES = 11, 7
"""Gauss-Hermite nodes for differences between participants."""
FINE_MS, FINE_SD, MOST_NODES, FINE_FAILURES = 5.0, 4.0, 321, 25
"""Fine nodes, for participants of many trials, whose likelihoods are narrow: distance of those of
SSRT, standard deviations on either side, and their largest number; and those of failures."""
TINY = 1e-9
"""Lower limit of probabilities before their logarithm is taken."""
CHANGE = 1e-3
"""Step of numerical derivatives in the coordinates of the search."""


@dataclass(frozen=True)
class StopValues:
    """Parameters of a stop process.

    Parameters
    ----------
    ssrt_ms : float
        Stop-signal reaction time, mean over participants: afferent, circuit and motor delays.
    ssrt_people_sd_ms, ssrt_trial_sd_ms : float
        Its standard deviation between participants and, within each, between trials.
    failures : float
        Probability of a trigger failure, of the median participant.
    failures_people_sd : float
        Standard deviation of its logit between participants.
    strength_nats : float
        A, the strength of the stop signal; infinite blocks at once.
    """

    ssrt_ms: float = 200.0
    ssrt_people_sd_ms: float = 40.0
    ssrt_trial_sd_ms: float = 50.0
    failures: float = 0.1
    failures_people_sd: float = 0.7
    strength_nats: float = np.inf

    def coordinates(self, spread: bool) -> Array:
        """Return the values as the search moves them: in units of 100 ms, logarithms, a logit."""
        shared = [self.ssrt_ms / 100, np.log(self.ssrt_trial_sd_ms), special.logit(self.failures)]
        if spread:
            shared += [np.log(self.ssrt_people_sd_ms), np.log(self.failures_people_sd)]
        return np.array(shared)

    def at(self, coordinates: Array) -> StopValues:
        """Return the values at coordinates; without spread, participants do not differ."""
        x = coordinates
        spread = np.exp(x[3:]) if len(x) > 3 else (0.0, 0.0)
        return replace(
            self, ssrt_ms=100 * float(x[0]), ssrt_trial_sd_ms=float(np.exp(x[1])),
            failures=float(special.expit(x[2])), ssrt_people_sd_ms=float(spread[0]),
            failures_people_sd=float(spread[1]),
        )  # fmt: skip


COORDINATES = (
    "ssrt_ms", "ssrt_trial_sd_ms", "failures", "ssrt_people_sd_ms", "failures_people_sd",
)  # fmt: skip
"""Names of the coordinates; the last two only if participants differ."""
BOUNDS = ((-1.0, 8.0), (np.log(5.0), np.log(300.0)), (-7.0, 3.0), (np.log(2.0), np.log(200.0)),
          (np.log(0.05), np.log(4.0)))  # fmt: skip
"""Ranges of the coordinates."""


@dataclass(frozen=True)
class StopLikelihood:
    """The likelihood of the outcomes of stop trials.

    Parameters
    ----------
    data : StopData
        The trials.
    model : StopModel
        The test or a circuit.
    go : DataFrame
        The go process of each participant (``go_processes``).
    times : bool
        Whether the times of failed stops are fitted too. At a time t, the density of a failed stop
        is that of a go response times f + (1 - f) P(SSD + SSRT > t); the density of the go response
        does not depend on the stop process. This holds for stop signals that block.
    fine : bool
        Whether nodes are ``FINE_MS`` apart.
    """

    data: StopData
    model: StopModel
    go: pd.DataFrame
    times: bool = False
    fine: bool = False

    @cached_property
    def thresholds(self) -> Array:
        """Threshold of OUT of each participant, (people,), nats; NaN if unknown."""
        return self.model.threshold(self.go["sensitivity"].to_numpy(), self.go["bound"].to_numpy())

    def latency_ms(self, strength_nats: float) -> Array:
        """Return the time from a stop signal to its effect, (people,), ms."""
        return self.model.latency_ms(self.thresholds, strength_nats)

    def responses(self, strength_nats: float) -> Array:
        """Return p(respond) over the time of a stop's effect, (people, times).

        It is the distribution of go times if the stop blocks. If it does not, some respond later.
        """
        below, share = self.data.go_below, self.data.responded[:, None]
        later = np.zeros_like(below)
        for number in np.flatnonzero(self.thresholds > strength_nats):
            later[number] = self._later(number, strength_nats)
        return np.asarray(below + (share - below) * later)

    def _later(self, number: int, strength_nats: float) -> Array:
        """Return the probability of a response after the stop's effect, by its time, (times,)."""
        go = self.go.iloc[number]
        noise = self.model.noise(np.array([go["sensitivity"]]))
        raised = float(raised_bound(np.array([go["bound"]]), noise, strength_nats)[0])
        at_s, end_s = self.data.grid_ms / 1000, self.data.deadline_ms / 1000
        return crossed_later(
            float(go["sensitivity"]), float(go["bound"]), raised, at_s - go["t0_s"], end_s - at_s
        )

    def p_respond(self, values: StopValues, responses: Array | None = None) -> Array:
        """Return p(respond) of each trial, (trials, SSRT nodes, failure nodes).

        Parameters
        ----------
        values : StopValues
            The parameters.
        responses : array, optional
            ``responses(values.strength_nats)``, if computed before.
        """
        data = self.data
        table = self.responses(values.strength_nats) if responses is None else responses
        smooth = gaussian_filter1d(table, values.ssrt_trial_sd_ms / STEP_MS, axis=1, mode="nearest")
        effect = self.effect_ms(values) - data.slower_ms[:, None]
        place = np.clip((effect - EARLIEST_MS) / STEP_MS, 0, table.shape[1] - 1.001)
        low = place.astype(np.int64)
        who = data.person[:, None]
        part = place - low
        stopped = (1 - part) * smooth[who, low] + part * smooth[who, low + 1]
        failures = self.failures(values)
        return np.asarray(
            failures * data.responded[data.person][:, None, None]
            + (1 - failures) * stopped[:, :, None]
        )

    def effect_ms(self, values: StopValues) -> Array:
        """Return the mean time of the stop's effect in each trial, (trials, SSRT nodes), ms."""
        nodes = values.ssrt_ms + values.ssrt_people_sd_ms * self.ssrt_nodes(values)[0]
        after = self.data.ssd_ms + self.latency_ms(values.strength_nats)[self.data.person]
        return np.asarray(after[:, None] + nodes)

    def by_trial(self, values: StopValues, responses: Array | None = None) -> Array:
        """Return log likelihoods (trials, SSRT nodes, failure nodes)."""
        p = np.clip(self.p_respond(values, responses), TINY, 1 - TINY)
        failed = np.log(np.clip(self._unstopped(values), TINY, 1) if self.times else p)
        return np.where(self.data.failed[:, None, None], failed, np.log1p(-p))

    def by_node(self, values: StopValues, responses: Array | None = None) -> Array:
        """Return log likelihoods (people, SSRT nodes, failure nodes), weights included."""
        log = self.by_trial(values, responses)
        total = np.zeros((len(self.data.names), *log.shape[1:]))
        np.add.at(total, self.data.person, log)
        weights = self.ssrt_nodes(values)[1][:, None] * hermite(self._failure_nodes)[1]
        return np.asarray(total + np.log(weights))

    def ssrt_nodes(self, values: StopValues) -> tuple[Array, Array]:
        """Return places, in standard deviations between participants, and weights of nodes."""
        if not self.fine:
            return hermite(SSRT_NODES)
        count = 2 * FINE_SD * values.ssrt_people_sd_ms / FINE_MS
        places = np.linspace(-FINE_SD, FINE_SD, int(np.clip(np.ceil(count) + 1, 9, MOST_NODES)))
        weights = np.exp(-(places**2) / 2)
        return places, weights / weights.sum()

    @property
    def _failure_nodes(self) -> int:
        return FINE_FAILURES if self.fine else FAILURE_NODES

    def failures(self, values: StopValues) -> Array:
        """Return the probabilities of a trigger failure at the nodes, (failure nodes,)."""
        spread = values.failures_people_sd * hermite(self._failure_nodes)[0]
        return np.asarray(special.expit(special.logit(values.failures) + spread))

    def _unstopped(self, values: StopValues) -> Array:
        """Return the probability that nothing stops a response by its time, as ``p_respond``."""
        later = (self.effect_ms(values) - self.data.rt_ms[:, None]) / values.ssrt_trial_sd_ms
        failures = self.failures(values)
        return np.asarray(failures + (1 - failures) * special.ndtr(later)[:, :, None])

    def each(self, values: StopValues, responses: Array | None = None) -> Array:
        """Return the log likelihood of each participant's trials, (people,), nats."""
        return np.asarray(special.logsumexp(self.by_node(values, responses), axis=(1, 2)))


def hermite(nodes: int) -> tuple[Array, Array]:
    """Return nodes and weights for expectations over a standard normal distribution."""
    places, weights = special.roots_hermitenorm(nodes)
    return places, weights / weights.sum()


def maximum(
    likelihood: StopLikelihood, start: StopValues, spread: bool
) -> tuple[StopValues, float]:
    """Return the values with the greatest likelihood at the strength of a start, and its log."""
    responses = likelihood.responses(start.strength_nats)

    def minus(x: Array) -> float:
        return -float(likelihood.each(start.at(x), responses).sum())

    first = start.coordinates(spread)
    bounds = BOUNDS[: len(first)]
    low, high = np.array(bounds).T
    found = optimize.minimize(
        minus, np.clip(first, low, high), method="L-BFGS-B", bounds=bounds,
        options={"eps": CHANGE, "ftol": 1e-7},
    )  # fmt: skip
    return start.at(found.x), -float(found.fun)


def errors(likelihood: StopLikelihood, values: StopValues, spread: bool) -> dict[str, float]:
    """Return standard errors of the parameters, from the scores of participants.

    The information is the sum over participants, or over the trials of a single one, of the outer
    products of their scores (Berndt et al. 1974); NaN if it cannot be inverted.
    """
    x = values.coordinates(spread)
    responses = likelihood.responses(values.strength_nats)
    score, slope = [], []

    def each(at: StopValues) -> Array:
        if len(likelihood.data.names) > 1:
            return likelihood.each(at, responses)
        return likelihood.by_trial(at, responses)[:, 0, 0]  # of one participant all nodes are alike

    for k in range(len(x)):
        up, down = (x + sign * CHANGE * (np.arange(len(x)) == k) for sign in (1, -1))
        above, below = values.at(up), values.at(down)
        difference = each(above) - each(below)
        score.append(difference / (2 * CHANGE))
        slope.append((_vector(above) - _vector(below)) / (2 * CHANGE))
    information = np.array(score) @ np.array(score).T
    known = np.linalg.matrix_rank(information) == len(x)  # not with fewer participants than numbers
    covariance = np.linalg.inv(information) if known else np.full_like(information, np.nan)
    change = np.array(slope).T
    error = np.sqrt(np.diag(change @ covariance @ change.T))
    named = dict(zip(PARAMETERS, error.tolist(), strict=True))
    return {name: value for name, value in named.items() if spread or "people" not in name}


PARAMETERS = tuple(name for name in asdict(StopValues()) if name != "strength_nats")


def _vector(values: StopValues) -> Array:
    return np.array([getattr(values, name) for name in PARAMETERS])

"""Stop trials in closed form, as a model of trials.

A stop signal that is triggered adds c(t) to OUT. Above the threshold it blocks every response that
has not been made by then, so that

    p(respond | SSD) = f R + (1 - f) E[F(SSD + SSRT)],

where SSD is the stop-signal delay, F the distribution of the person's go times, R the share of go
trials with a response, f the probability of a trigger failure, and SSRT the time from the signal to
its effect, normally distributed. Only F of the data is needed, with no model of the go process.
Below the threshold a stop signal of A nats raises the criterion: those that have not responded may
do so later, with a probability that follows from the go process as a diffusion (``raised``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import ndtr

from bgmodel.fitting.design import design_of
from bgmodel.fitting.formulas import Formula
from bgmodel.fitting.likelihood import (
    REPLICAS,
    REPLICAS_SEED,
    Peak,
    TrialLikelihood,
    likelihood_of,
)
from bgmodel.fitting.optimum import optimum
from bgmodel.fitting.parameters import Parameter
from bgmodel.fitting.responses import EVERY_TIME
from bgmodel.fitting.stop_process import (
    KEPT,
    TEST,
    StopModel,
    crossed_later,
    go_process,
    laid,
    raised_bound,
    stop_model,
)
from bgmodel.stopping.inputs import MOST_NATS
from bgmodel.stopping.trials import StopTrials, of_trend
from bgmodel.support.seeds import stream
from bgmodel.trials.record import Trials
from circuits.arrays import Array, Integers
from circuits.circuit import Circuit
from circuits.declaration.table_writer import identity

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

SIGNAL = "signal"
"""Condition of a fit that tells go from stop trials."""
STRENGTH = "strength_nats"
TINY = 1e-9
"""Lower limit of probabilities before their logarithm is taken."""
STEP_MS, EARLIEST_MS, BEYOND_MS = 5.0, -300.0, 600.0
"""Resolution of the times at which responses to a weak signal are tabulated, their beginning, and
how far they extend beyond the end of a trial."""
PARAMETERS = (
    Parameter("ssrt_ms", -100.0, 800.0, 200.0, "stop-signal reaction time, mean over trials"),
    Parameter(
        "ssrt_sd_ms", 5.0, 300.0, 50.0, "its standard deviation between trials", scale="log",
        prior=(50.0, 0.7), shared=True,
    ),
    Parameter(
        "failures", 0.001, 0.95, 0.1, "probability of a trigger failure", scale="logit",
        prior=(0.1, 1.2),
    ),
    Parameter(STRENGTH, 0.0, MOST_NATS, MOST_NATS, "strength of the stop signal", free=False),
)  # fmt: skip
"""Parameters of a stop process; the largest strength blocks every response. Two have weak priors,
because few stop trials leave them open: 95 % of people within 13 to 197 ms and 0.01 to 0.54."""


@dataclass(frozen=True, eq=False)
class StopRace:
    """A race between one person's go times, which are given, and a stop process; see the module."""

    process: StopModel = TEST
    # The person's go process (``go_process``), for signals that do not block and the latency of a
    # circuit. Unknown by default: every signal blocks, without latency.
    go: Mapping[str, float] = field(default_factory=dict)
    slowing_ms: tuple[float, float] | None = None  # as for ``laid``
    parameters = PARAMETERS
    stacks = True

    @property
    def name(self) -> str:
        """Name of the stop process."""
        return self.process.name

    def identity(self) -> dict[str, Any]:
        """Return all that its predictions depend on; the go process follows from the trials."""
        about = {"model": self.name, "noise_nats": self.process.noise_nats}
        circuit = self.process.circuit
        return about if circuit is None else about | {"circuit": identity(circuit)}

    @cached_property
    def threshold(self) -> float:
        """The person's threshold of OUT, nats; NaN if unknown."""
        return self.process.threshold(*(self.go.get(n, np.nan) for n in ("sensitivity", "bound")))

    def latency_ms(self, strength_nats: Array) -> Array:
        """Return the time from a stop signal to its effect, ms, in the shape of strengths."""
        latencies_ms = np.zeros(strength_nats.shape)
        for strength in set(strength_nats.ravel().tolist()):
            latency = self.process.latency_ms(self.threshold, strength)
            latencies_ms[strength_nats == strength] = latency
        return latencies_ms

    def p_respond(self, trials: Trials, values: Mapping[str, Array]) -> Array:
        """Return the probability of a response in each stop trial, (..., stop trials)."""
        data = laid(trials, self.slowing_ms)
        stops = {name: each[..., data.stop] for name, each in values.items()}
        first: Integers = np.arange(len(data.stop))
        back = first
        if all((each == each[..., :1]).all() for each in stops.values()):
            first, back = data.alike
        stops = {name: each[..., first] for name, each in stops.items()}
        effect = data.shown_ms[first] + stops["ssrt_ms"] + self.latency_ms(stops[STRENGTH])
        share = np.empty(effect.shape)
        for strength in set(stops[STRENGTH].ravel().tolist()):
            here = stops[STRENGTH] == strength
            times_ms, weights = responses(self, trials, strength)
            away = effect[here][:, None] - times_ms
            share[here] = ndtr(away / stops["ssrt_sd_ms"][here][:, None]) @ weights
        probability = stops["failures"] * data.responded + (1 - stops["failures"]) * share
        return np.asarray(probability[..., back])

    def log_density(self, trials: Trials, values: Mapping[str, Array]) -> Array:
        """Return log probabilities of outcomes, 0 in go trials, (..., trials)."""
        data = laid(trials, self.slowing_ms)
        p, failed = self.p_respond(trials, values), ~np.isnan(data.rt_ms)
        logs = np.zeros((*p.shape[:-1], trials.trials))
        logs[..., data.stop] = np.log(np.maximum(np.where(failed, p, 1 - p), TINY))
        return logs

    def simulate(
        self, trials: Trials, values: Mapping[str, Array], rng: np.random.Generator
    ) -> Trials:
        """Return new trials with the same signals; go times are drawn from the person's own."""
        data = laid(trials, self.slowing_ms)
        drawn = rng.integers(len(data.go_ms), size=trials.trials)
        go_ms, response = data.go_ms[drawn] + data.slower_ms, data.go_response[drawn]
        rt_ms = np.where(np.isnan(go_ms), np.inf, np.maximum(go_ms, 1.0))
        stops = {name: each[data.stop] for name, each in values.items()}
        ssrt = stops["ssrt_ms"] + stops["ssrt_sd_ms"] * rng.standard_normal(len(data.stop))
        effect = data.ssd_ms + ssrt + self.latency_ms(stops[STRENGTH])
        stopped = (rt_ms[data.stop] > effect) & (rng.random(len(data.stop)) >= stops["failures"])
        weak = stopped & np.isfinite(rt_ms[data.stop]) & (stops[STRENGTH] < self.threshold)
        rt_ms[data.stop[stopped]] = np.inf
        for k in np.flatnonzero(weak):
            place = data.stop[k]
            left_ms = np.arange(0.0, data.end_ms - effect[k] + data.slower_ms[place], STEP_MS)
            since_ms = np.full(len(left_ms), effect[k] - data.slower_ms[place])
            chance = self.later(stops[STRENGTH][k], since_ms, left_ms)
            beyond = np.searchsorted(chance, rng.random())
            if beyond < len(left_ms):
                rt_ms[place] = effect[k] + left_ms[beyond]
        made = np.isfinite(rt_ms)
        coded = np.where(made, np.where(response < 0, 1, response), -1).astype(np.int8)
        return replace(trials, rt_s=np.where(made, rt_ms / 1000, np.nan), response=coded)

    def later(self, strength_nats: float, since_ms: Array, left_ms: Array) -> Array:
        """Return the probability of a response after the effect of a weak signal, (times,)."""
        go = self.go
        noise = np.array([self.process.noise(go["sensitivity"])])
        raised = float(raised_bound(np.array([go["bound"]]), noise, strength_nats)[0])
        since_s, left_s = since_ms / 1000 - go["t0_s"], left_ms / 1000
        return crossed_later(go["sensitivity"], go["bound"], raised, since_s, left_s)


@lru_cache(maxsize=KEPT)
def responses(race: StopRace, trials: Trials, strength_nats: float) -> tuple[Array, Array]:
    """Return p(respond) over the time of a signal's effect, as steps: times, ms, and sizes."""
    data = laid(trials, race.slowing_ms)
    times, share = data.times_ms, data.responded
    if not race.threshold > strength_nats:
        return times, np.full(len(times), share / len(times))
    at = np.asarray(np.arange(EARLIEST_MS, data.end_ms + BEYOND_MS, STEP_MS), np.float64)
    below = np.searchsorted(times, at, side="right") / len(times) * share
    after = race.later(strength_nats, at, data.end_ms - at)
    return at - STEP_MS / 2, np.diff(below + (share - below) * after, prepend=0.0)


@dataclass(frozen=True)
class StopLikelihood(TrialLikelihood):
    """The likelihood of one person's stop trials; see ``likelihood``."""

    model: StopRace

    def cautions(self) -> list[str]:
        """Return a warning of a trend of go times, with the optima with and without it."""

        def ssrt_ms(trials: StopTrials) -> float:
            rt_s, ssd_s = trials.rt_ms / 1000, trials.ssd_ms / 1000
            end_s = None if trials.deadline_ms is None else trials.deadline_ms / 1000
            choices = replace(self.trials, rt_s=rt_s, ssd_s=ssd_s, deadline_s=end_s)
            other = replace(self, design=replace(self.design, choices=choices))
            return float(other.values(optimum(other).vector)["ssrt_ms"].mean())

        return of_trend(StopTrials.of(self.trials), ssrt_ms)

    def draw(
        self, cells: Mapping[str, pd.DataFrame], peaks: Mapping[str, Peak], title: str
    ) -> Figure:
        """Draw the inhibition function and times of responses, data and models."""
        from bgmodel.stopping.estimates import draw

        models = {}
        for name, (likelihood, vector) in peaks.items():
            seeds = (stream(REPLICAS_SEED, "replica", k) for k in range(REPLICAS))
            models[name] = [StopTrials.of(likelihood.simulated(vector, rng)) for rng in seeds]
        return draw(StopTrials.of(self.trials), models, title)


def likelihood(
    model: StopRace | StopModel | Circuit | str,
    trials: Trials,
    *,
    free: list[str] | None = None,
    fixed: dict[str, float] | None = None,
    vary: dict[str, str] | None = None,
    formulas: Sequence[Formula] = (),
) -> StopLikelihood:
    """Return the likelihood of one person's stop trials, in the order in which they were run.

    The go process is fitted for a circuit, and for strengths other than the largest.
    """
    race = model if isinstance(model, StopRace) else StopRace(stop_model(model))
    weak = STRENGTH in {*(free or ()), *(vary or ()), *(each.parameter for each in formulas)}
    weak = weak or (fixed or {}).get(STRENGTH, MOST_NATS) < MOST_NATS
    if not race.go and (weak or race.process.time_ms is not None):
        race = replace(race, go=go_process(trials))
    data = laid(trials, race.slowing_ms)
    signal = np.where(np.isin(np.arange(trials.trials), data.stop), "stop", "go")
    conditions = trials.conditions.assign(**{SIGNAL: signal})
    coded = replace(trials, strength=None, conditions=conditions, deadline_s=data.end_ms / 1000)
    by = {column.partition("/")[0] for column in (vary or {}).values()}
    by = by.union(*(each.columns for each in formulas))
    design = design_of(coded, [SIGNAL, *sorted(by)], rt_window=EVERY_TIME)
    base = likelihood_of(race, design, free=free, fixed=fixed, vary=vary, formulas=formulas)
    return StopLikelihood(race, design, base.freedom, design.observed.cell)

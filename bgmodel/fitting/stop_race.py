"""Stop trials in closed form, as a model of trials.

A stop signal that is triggered adds c(t) to OUT. Above the threshold it blocks every response that
has not been made by then, so that

    p(respond | SSD) = f R + (1 - f) E[F(SSD + SSRT)],

where SSD is the stop-signal delay, F the distribution of the person's go times, R the share of go
trials with a response, f the probability of a trigger failure, and SSRT the time from the signal to
its effect, normally distributed. Only F of the data is needed, with no model of the go process.
Below the threshold a stop signal of A nats raises the criterion: those that have not responded may
do so later, with a probability that follows from the go process as a diffusion (``later``).

The test and a circuit have OUT_stop(t) = OUT_go(t) + c(t - SSD - delay). They differ in the
threshold of OUT that a person's go process implies, and in c: a step in the test, and filtered in a
circuit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import ndtr

from bgmodel.fitting.algorithms import CONSTANT, GAPS
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
    crossed_later,
    go_process,
    laid,
    raised_bound,
    threshold_nats,
)
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.stopping.inputs import MOST_NATS, StopSignal, step_response
from bgmodel.stopping.trials import StopTrials, of_trend
from bgmodel.support.seeds import stream
from bgmodel.trials.record import Trials
from circuits.anatomy import checked_circuit
from circuits.arrays import Array, Integers
from circuits.circuit import Circuit
from circuits.declaration.table_writer import identity
from circuits.errors import InputError

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

SIGNAL = "signal"
"""Condition of a fit that tells go from stop trials."""
STRENGTH = "strength_nats"
NOISE_NATS = 2.0
"""Noise of the evidence in a circuit after one second, nats, as in ``FitSettings``."""
LASTING_MS = 1000.0
"""Time for which a circuit's response to a stop signal is computed."""
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

    name: str = CONSTANT.name  # of the test, or of a circuit
    # Standard deviation of the log odds after one second; that of the test is twice the drift.
    noise_nats: float | None = None
    time_ms: Array | None = None  # (ticks,)
    added: Array | None = None  # (ticks,), c as a proportion of the strength; by default a step
    circuit: Circuit | None = None  # the circuit that responds so
    # The person's go process (``go_process``), for signals that do not block and the latency of a
    # circuit. Unknown by default: every signal blocks, without latency.
    go: Mapping[str, float] = field(default_factory=dict)
    slowing_ms: tuple[float, float] | None = None  # as for ``laid``
    parameters = PARAMETERS
    stacks = True

    def identity(self) -> dict[str, Any]:
        """Return all that its predictions depend on; the go process follows from the trials."""
        about = {"model": self.name, "noise_nats": self.noise_nats}
        return about if self.circuit is None else about | {"circuit": identity(self.circuit)}

    @property
    def noise(self) -> float:
        """Noise of the person's log odds, nats per root second; NaN if unknown."""
        of_test = 2 * self.go.get("sensitivity", np.nan)
        return of_test if self.noise_nats is None else self.noise_nats

    @cached_property
    def threshold(self) -> float:
        """The person's threshold of OUT, nats; NaN if unknown."""
        bound = np.asarray(self.go.get("bound", np.nan))
        return float(threshold_nats(bound, np.asarray(self.noise)))

    def latency_ms(self, strength_nats: Array) -> Array:
        """Return the time from a stop signal to its effect, ms, in the shape of strengths.

        That is when c reaches the threshold, or half of a weaker signal; 0 for a step.
        """
        if self.time_ms is None or self.added is None:
            return np.zeros(strength_nats.shape)
        known = float(np.nan_to_num(self.threshold))
        share = np.full(strength_nats.shape, 0.5)
        np.divide(known, strength_nats, out=share, where=known < strength_nats)
        rising = np.maximum.accumulate(np.append(0.0, self.added))
        latencies_ms = np.interp(share, rising, np.append(0.0, self.time_ms))
        return np.where(strength_nats > 0, latencies_ms, 0.0)

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
        noise = np.array([self.noise])
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


def stop_model(model: str | Circuit | StopRace, noise_nats: float = NOISE_NATS) -> StopRace:
    """Return the race with ``constant_gap``, the test, or with a circuit of two channels.

    That of a circuit scales its response to 1 nat in STN with the strength.
    """
    if isinstance(model, StopRace):
        return model
    if isinstance(model, str) and model in GAPS:
        must = f"must be of {CONSTANT.name}, or circuits, for stop signals"
        if model != CONSTANT.name:
            raise InputError.of("models", must, model)
        return StopRace()
    table = checked_circuit(model, 2)
    time_ms, added = step_response(BasalGanglia(table), StopSignal(), time_ms=LASTING_MS)
    return StopRace(table.name, noise_nats, time_ms, added, table)


def likelihood(
    model: StopRace | Circuit | str,
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
    race = stop_model(model)
    weak = STRENGTH in {*(free or ()), *(vary or ()), *(each.parameter for each in formulas)}
    weak = weak or (fixed or {}).get(STRENGTH, MOST_NATS) < MOST_NATS
    if not race.go and (weak or race.time_ms is not None):
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

"""Likelihood of choices and response times, given the readings of each trial."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from bgmodel.evidence import Evidence
from bgmodel.fitting.design import Design
from bgmodel.fitting.known.hazard import answered, decisions, delayed
from bgmodel.fitting.known.known_circuit import KnownCircuit, Simulated
from bgmodel.fitting.known.models import LEAK, Exact, ExactModel, Values, read, runs_of_cues
from bgmodel.fitting.known.trials import KnownTrials, responding, waiting
from bgmodel.fitting.likelihood import RESPONSES, Likelihood, Peak
from bgmodel.fitting.parameters import RESPONSE, Parameter, ParameterSpace
from bgmodel.fitting.responses import TINY
from bgmodel.fitting.settings import settings_of
from bgmodel.support.seeds import stream
from bgmodel.trials.record import Trials
from bgmodel.trials.timed_readings import Readings
from circuits.arrays import Array, Integers
from circuits.errors import InputError

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

KnownModel = ExactModel | KnownCircuit
"""A model of decisions on known evidence."""
RUN = Parameter("run_effect", -2.0, 2.0, 0.0, "OUT per further cue of a run, nats", free=False)
URGENCY = Parameter("urgency", 0.0, 20.0, 0.0, "rise of the threshold on OUT, 1/s", free=False)
BIAS = "bias_"
"""Begins the names of parameters that shift the threshold of one alternative."""
MOST_BIAS = 2.0
CACHED = 16
"""Number of points at which decisions are kept: derivatives by t0_s, t0_sd_s and lapse need no
others than those of the point itself."""
T0_SHARES, NOISES = (0.3, 0.7), (0.1, 0.4)
"""Starts have these shares of the fastest response after a first reading as non-decision time, and
these shares of the spread of OUT at decisions as noise."""


@dataclass(frozen=True)
class KnownLikelihood(Likelihood):
    """The likelihood of trials with known evidence; a lapse is uniform up to the latest response.

    A trial without a response is one without a decision.
    """

    model: KnownModel
    trials: KnownTrials
    outputs: Exact | Simulated
    cell: Integers  # (all trials,), the cell of each
    kept: Integers | None = None  # Which trials count; all by default.
    _decided: dict[tuple[bytes, ...], tuple[Array, Array]] = field(
        default_factory=dict, repr=False, compare=False
    )
    sized: ClassVar[tuple[str, ...]] = ("gain", "threshold", "noise")

    @cached_property
    def _more_cues(self) -> Array:
        """How many cues of a run come after its first, (seen readings, alternatives)."""
        values, _ = read(self.trials)
        return np.maximum(runs_of_cues(values)[self.trials.seen_places] - 1.0, 0.0)

    def values(self, vector: Array) -> dict[str, Array]:
        """Return each parameter in every trial, (all trials,)."""
        return {name: each[self.cell] for name, each in self.freedom.values(vector).items()}

    def _spread(self, values: Values) -> dict[str, Array]:
        """Return parameters in every trial from these or from numbers."""
        return {name: each + np.zeros(self.trials.trials) for name, each in values.items()}

    def decisions(self, values: Values) -> tuple[Array, Array]:
        """Return the probability of a decision at each reading, and of none; see ``hazard``."""
        each, trial = self._spread(values), self.trials.seen_places[0]
        key = tuple(value.tobytes() for name, value in each.items() if name not in RESPONSES)
        if key in self._decided:
            return self._decided[key]
        while len(self._decided) >= CACHED:
            del self._decided[next(iter(self._decided))]
        out = self.outputs.out(each)
        if each[RUN.name].any():
            out = out - each[RUN.name][trial, None] * self._more_cues
        level = self.model.sign * each["threshold"][trial]
        level = level + each[URGENCY.name][trial] * self.trials.seen_s
        bias = [each[f"{BIAS}{name}"][trial] for name in self.trials.names[1:]]
        levels = level[:, None] + np.column_stack([np.zeros(len(level)), *bias])
        self._decided[key] = decisions(
            np.ascontiguousarray(out), levels, each["noise"], self.trials.offsets, self.trials.ends
        )
        return self._decided[key]

    def responses(self, values: Values) -> tuple[Array, Array]:
        """Return the density at each response time, 1/s, and the probability of none."""
        decided, left = self.decisions(values)
        trials, rt_s, each = self.trials, self.trials.rt_s, self._spread(values)
        lapse = each["lapse"][:, None]
        if not trials.timed:
            made = np.zeros((trials.trials, trials.alternatives))
            np.add.at(made, trials.seen_places[0], decided)
            return (1 - lapse) * made + lapse / trials.alternatives, (1 - lapse[:, 0]) * left
        density = (1 - lapse) * delayed(
            decided, trials.seen_s, rt_s, trials.offsets, each["t0_s"], each["t0_sd_s"]
        )
        density += lapse / (trials.alternatives * trials.span_s)
        return np.where(np.isfinite(rt_s)[:, None], density, 0.0), (1 - lapse[:, 0]) * left

    def answered(self, values: Values, by_s: Array) -> Array:
        """Return the probability of each response by times (trials, times)."""
        trials, each = self.trials, self._spread(values)
        share = each["lapse"][:, None, None]
        lapsed = np.clip(by_s / trials.span_s, 0.0, 1.0) / trials.alternatives
        probability = answered(
            self.decisions(values)[0], trials.seen_s, by_s, trials.offsets,
            each["t0_s"], each["t0_sd_s"],
        )  # fmt: skip
        return np.asarray((1 - share) * probability + share * lapsed[:, :, None])

    def each(self, vector: Array) -> Array:
        """Return the log likelihood of each trial, nats (of densities in 1/s)."""
        density, none = self.responses(self.values(vector))
        choice = self.trials.choice
        chosen = density[np.arange(len(choice)), np.maximum(choice, 0)]
        logs = np.log(np.maximum(np.where(choice < 0, none, chosen), TINY))
        return np.asarray(logs if self.kept is None else logs[self.kept])

    def unbiased(self, vector: Array) -> Array:
        """Return ``each``, corrected for the number of runs (jackknife; Quenouille 1956)."""
        biased, parts = self.each(vector), [one.each(vector) for one in self.without_parts()]
        return biased + (len(parts) - 1) * (biased - np.mean(parts, axis=0)) if parts else biased

    def density(self, vector: Array) -> Array:
        """Return the predicted density of responses (cells, 2, bins), 1/s.

        In each bin the trials that still run have a probability of each response; the product of
        those of none is the share that runs (as Kaplan & Meier 1958): later readings may be
        unknown.
        """
        trials, grid = self.trials, self.design.grid
        kept = np.arange(trials.trials) if self.kept is None else self.kept
        cells = [kept[self.cell[kept] == cell] for cell in range(self.design.cells)]
        if not trials.timed:
            right = trials.favoured(trials.until_s[:, None])
            every = self.responses(self.values(vector))[0]
            alone = np.zeros((len(cells), 2, grid.bins))
            for cell, some in enumerate(cells):
                share = np.take_along_axis(every, right, axis=1)[some].mean()
                alone[cell, :, 0] = [every[some].sum(axis=1).mean() - share, share]
            return alone / grid.width_s
        edges_s = np.tile(grid.width_s * np.arange(grid.bins + 1), (trials.trials, 1))
        by = self.answered(self.values(vector), edges_s)
        stays = np.maximum(1 - by[:, :-1].sum(axis=2, keepdims=True), TINY)
        share = np.clip(np.diff(by, axis=1) / stays, 0.0, 1.0)
        favoured = trials.favoured(edges_s[:, 1:])[:, :, None]
        right = np.take_along_axis(share, favoured, axis=2)[:, :, 0]
        both = np.array([share.sum(axis=2) - right, right])
        running = trials.until_s[:, None] >= edges_s[:, :-1]
        ended = [(both[:, some] * running[some]).sum(axis=1) for some in cells]
        hazard = (
            np.array(ended) / np.maximum([running[some].sum(axis=0) for some in cells], 1)[:, None]
        )
        left = np.pad(1 - hazard.sum(axis=1), ((0, 0), (1, 0)), constant_values=1.0)
        left = np.cumprod(left[:, :-1], axis=1)
        return np.asarray(left[:, None] * hazard / grid.width_s)

    def observed(self, values: Values, rng: np.random.Generator) -> KnownTrials:
        """Return these trials, which have no responses, with choices and times."""
        blank = self.trials
        decided = np.zeros(blank.log_likelihood.shape)
        decided[blank.seen_places] = self.decisions(values)[0]
        flat = np.cumsum(decided.reshape(len(decided), -1), axis=1)
        at = (flat < rng.random(len(flat))[:, None]).sum(axis=1)
        none = at >= flat.shape[1]
        reading, choice = np.divmod(np.minimum(at, flat.shape[1] - 1), blank.alternatives)
        when = np.where(none, np.nan, blank.time_s[np.arange(len(at)), reading])
        return responding(blank, np.where(none, -1, choice), when, values, rng)

    def simulated(self, vector: Array, rng: np.random.Generator) -> Trials:
        """Return all trials of the person with new responses and times."""
        trials = self.design.choices
        if trials is None or trials.readings is None:
            raise InputError("trials are simulated for a design with its choices", "design")
        blank = waiting(trials.readings, trials.readings.forced)
        likelihood = OnTrials(self.model, blank).likelihood(self.design, self.freedom)
        made = likelihood.observed(self.values(vector), rng)
        if not trials.timed:
            made = replace(made, rt_s=np.full(made.trials, np.nan))
        readings = replace(trials.readings, choice=made.choice)
        response = made.design.observed.response.astype(np.int8)
        return replace(trials, rt_s=made.rt_s, response=response, readings=readings)

    def part(self, trials: Array | Integers) -> Self:
        """Return the likelihood of a subset of the trials; lapses last as long as in all."""
        kept = np.arange(self.trials.trials) if self.kept is None else self.kept
        return replace(self, design=self.design.part(trials), kept=kept[trials])

    def chosen(self, vector: Array) -> Array:
        """Return probabilities of alternatives given the response time, NaN without a response."""
        density, _ = self.responses(self.values(vector))
        with np.errstate(invalid="ignore"):
            return np.asarray(density / density.sum(axis=1, keepdims=True))

    def without_parts(self) -> list[Self]:
        """Return the likelihood without each part of the simulated runs in turn."""
        return [replace(self, outputs=each, _decided={}) for each in self.outputs.parts()]

    def starts(self) -> list[Array]:
        """Return starts for two non-decision times and two noises, at the data's level."""
        # Readings may begin long after the clock's zero.
        since_s = (self.trials.rt_s - self.trials.time_s[:, 0])[self.trials.seen > 0]
        fastest = float(np.nanquantile(since_s, 0.05)) if self.trials.timed else 0.0
        starts = []
        for share in T0_SHARES:
            t0_s = share * fastest
            level, spread = self._at_decisions(self.values(self.freedom.start), t0_s)
            for noise in NOISES:
                guesses = {"t0_s": t0_s, "threshold": level, "noise": noise * spread}
                starts.append(self.freedom.started(guesses))
        return starts

    def _at_decisions(self, values: Values, t0_s: float) -> tuple[float, float]:
        """Return the median level of chosen alternatives when they decided, and half its spread."""
        trials, out = self.trials, self.outputs.out(values).mean(axis=0)
        some = np.flatnonzero((trials.choice >= 0) & (trials.seen > 0))
        before = trials.time_s[some] <= (trials.until_s[some] - t0_s)[:, None]
        at = np.clip(before.sum(axis=1), 1, trials.seen[some]) - 1
        chosen = out[trials.offsets[some] + at, trials.choice[some]]
        lower, middle, upper = np.quantile(chosen, [0.25, 0.5, 0.75])
        return self.model.sign * float(middle), max(float(upper - lower) / 2, 1e-3)

    def draw(
        self, cells: Mapping[str, pd.DataFrame], peaks: Mapping[str, Peak], title: str
    ) -> Figure:
        """Draw hazards per reading and psychophysical kernels, data and models."""
        from bgmodel.fitting.known.kernels import draw_known

        return draw_known(peaks, title)


@dataclass(frozen=True)
class OnTrials:
    """A model of decisions on some trials; see ``fitting.likelihood.OwnModel``."""

    model: KnownModel
    trials: KnownTrials

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters of the model, and those that all models share.

        Biases, of all but the first alternative, are added to its threshold, and free if there are
        two.
        """
        of_model, count = self.model.parameters(self.trials.alternatives), self.trials.alternatives
        most = min(MOST_BIAS, next(each.high for each in of_model if each.name == "threshold"))
        bias = Parameter(BIAS, -most, most, 0.0, "added to its threshold", free=count == 2)
        biases = (replace(bias, name=f"{BIAS}{name}") for name in self.trials.names[1:])
        return (*of_model, URGENCY, RUN, *biases, *RESPONSE)

    def likelihood(self, design: Design, freedom: ParameterSpace) -> KnownLikelihood:
        """Return the likelihood of the trials; a circuit is simulated here."""
        varied = {each.parameter.name for each in freedom.moved}
        fixed = {name: value for name, value in freedom.held.items() if name not in varied}
        outputs, cell = self.model.on(self.trials, fixed), design.observed.cell
        return KnownLikelihood(self.model, design, freedom, self.trials, outputs, cell)


def known_likelihood(
    model: KnownModel,
    trials: KnownTrials,
    *,
    free: Sequence[str] = (),
    fixed: Mapping[str, float] | None = None,
) -> KnownLikelihood:
    """Return the likelihood of trials under a model; a circuit is simulated here."""
    asked, made = settings_of(free=list(free), fix=fixed), OnTrials(model, trials)
    asked.check_parameters({model.name: made})
    likelihood = asked.likelihood(trials.design, made)
    assert isinstance(likelihood, KnownLikelihood)
    return likelihood


def readings_from(evidence: Evidence, names: tuple[str, ...] | None = None) -> Readings:
    """Return the readings of some evidence; reading k comes at ``onset_ms + k step_ms``."""
    steps = np.arange(evidence.steps)
    time_s = (evidence.onset_ms + evidence.step_ms * (steps + 1.0)) / 1000
    return Readings(
        [("", str(k)) for k in range(evidence.trials)],
        np.asarray(evidence.log_likelihood, dtype=np.float64),
        np.where(steps < evidence.readings[:, None], time_s, np.inf),
        np.asarray(evidence.readings),
        names or tuple(str(k) for k in range(evidence.hypotheses)),
    )


def observed(
    model: KnownModel, readings: Readings, values: Mapping[str, float], seed: int
) -> KnownTrials:
    """Return choices and response times of a model; by default there are no lapses."""
    blank, rng = waiting(readings), stream(seed, "known evidence", model.name)
    likelihood = known_likelihood(model, blank)
    every = {each.name: each.start for each in likelihood.freedom.parameters}
    return likelihood.observed(every | {LEAK.name: 0.0, "lapse": 0.0, **values}, rng)

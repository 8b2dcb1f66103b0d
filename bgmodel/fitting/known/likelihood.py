"""Likelihood of choices and response times, given the readings of each trial."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from bgmodel.fitting.exact.responses import TINY
from bgmodel.fitting.known.accumulation import runs_of_cues
from bgmodel.fitting.known.models import KnownModel, Outputs, Values, read
from bgmodel.fitting.known.trials import KnownTrials
from bgmodel.fitting.parameters import RESPONSE, Parameter, ParameterSpace, freedom
from bgmodel.support.arrays import Array

RUN = Parameter("run_effect", -2.0, 2.0, 0.0, "OUT per further cue of a run, nats", free=False)
URGENCY = Parameter("urgency", 0.0, 20.0, 0.0, "rise of the threshold on OUT, 1/s", free=False)
BIAS = "bias_"
"""Begins the names of parameters that shift the threshold of one alternative."""
MOST_BIAS = 2.0
CACHED = 16
"""Number of points at which decisions are kept: derivatives by t0_s, t0_sd_s and lapse need no
others than those of the point itself."""
RESPONSES = tuple(each.name for each in RESPONSE)


def parameters_of(model: KnownModel, trials: KnownTrials) -> tuple[Parameter, ...]:
    """Return all parameters of a model on some trials.

    Its own; ``urgency``, by which the threshold on OUT rises per second, so that less evidence is
    required; ``run_effect``, by which OUT of an alternative falls with each cue of a run after the
    first; a bias of each alternative but the first, added to its threshold (for two alternatives
    the same as a start nearer one bound), free if there are two; and those of responses.
    """
    own = model.parameters(trials.alternatives)
    wide = next(each.high for each in own if each.name == "threshold")
    most = min(MOST_BIAS, wide)
    free = trials.alternatives == 2
    bias = tuple(
        Parameter(f"{BIAS}{name}", -most, most, 0.0, "added to its threshold", free=free)
        for name in trials.names[1:]
    )
    return (*own, URGENCY, RUN, *bias, *RESPONSE)


@dataclass(frozen=True)
class KnownLikelihood:
    """The likelihood of trials with known evidence under a model.

    A decision at reading k has the probability of ``hazard``. The non-decision time is Gaussian, a
    lapse is any response at any time up to the latest response. A trial without a response is one
    without a decision.

    Parameters
    ----------
    model : KnownModel
        The model.
    trials : KnownTrials
        The data.
    freedom : ParameterSpace
        Free parameters, the same in all trials.
    outputs : Outputs
        OUT of the model on these trials.
    """

    model: KnownModel
    trials: KnownTrials
    freedom: ParameterSpace
    outputs: Outputs
    _kept: dict[tuple[float, ...], tuple[Array, Array]] = field(default_factory=dict, repr=False)

    @cached_property
    def _more_cues(self) -> Array:
        """How many cues of a run come after its first, (seen readings, alternatives)."""
        values, _ = read(self.trials)
        return np.maximum(runs_of_cues(values)[self.trials.seen_places] - 1.0, 0.0)

    def values(self, vector: Array) -> dict[str, float]:
        """Return all parameters by name from the free ones."""
        found = self.freedom.values(vector)
        return {name: float(each[0]) for name, each in found.items()}

    def decisions(self, values: Values) -> tuple[Array, Array]:
        """Return the probability of a decision at each reading, and of none.

        Shapes as for ``hazard.decisions``: (seen readings, alternatives) and (trials,).
        """
        key = tuple(value for name, value in values.items() if name not in RESPONSES)
        if key not in self._kept:
            while len(self._kept) >= CACHED:
                del self._kept[next(iter(self._kept))]
            self._kept[key] = self._decisions(values)
        return self._kept[key]

    def _decisions(self, values: Values) -> tuple[Array, Array]:
        """Compute ``decisions``."""
        # Importing Numba takes most of a second: only when it is used.
        from bgmodel.fitting.known.hazard import decisions

        out = self.outputs.out(values)
        if values[RUN.name]:
            out = out - values[RUN.name] * self._more_cues
        level = self.model.sign * values["threshold"] + values[URGENCY.name] * self.trials.seen_s
        bias = [0.0, *(values[f"{BIAS}{name}"] for name in self.trials.names[1:])]
        return decisions(
            np.ascontiguousarray(out), level, np.array(bias), values["noise"],
            self.trials.offsets, self.trials.ends,
        )  # fmt: skip

    def density(self, values: Values) -> tuple[Array, Array]:
        """Return the density of a response at its time, and the probability of none.

        Returns
        -------
        density : array (trials, alternatives), 1/s
            For each alternative at the trial's response time; 0 in trials without a response.
        none : array (trials,)
        """
        from bgmodel.fitting.known.hazard import delayed

        decided, left = self.decisions(values)
        trials, rt_s = self.trials, self.trials.rt_s
        found = (1 - values["lapse"]) * delayed(
            decided, trials.seen_s, rt_s, trials.offsets, values["t0_s"], values["t0_sd_s"]
        )
        found += values["lapse"] / (trials.alternatives * trials.span_s)
        answered = np.isfinite(rt_s)
        return np.where(answered[:, None], found, 0.0), (1 - values["lapse"]) * left

    def each(self, vector: Array) -> Array:
        """Return the log likelihood of each trial, nats (of densities in 1/s)."""
        density, none = self.density(self.values(vector))
        choice = self.trials.choice
        chosen = density[np.arange(len(choice)), np.maximum(choice, 0)]
        return np.asarray(np.log(np.maximum(np.where(choice < 0, none, chosen), TINY)))

    def __call__(self, vector: Array) -> float:
        """Return the log likelihood of all trials, nats; -inf outside the bounds."""
        inside = (vector >= self.freedom.low) & (vector <= self.freedom.high)
        return float(self.each(vector).sum()) if inside.all() else -np.inf

    def chosen(self, vector: Array) -> Array:
        """Return the probability of each alternative given the time of the response.

        Returns
        -------
        array (trials, alternatives)
            NaN in trials without a response.
        """
        density, _ = self.density(self.values(vector))
        total = density.sum(axis=1, keepdims=True)
        shares = np.where(total > 0, density / np.where(total > 0, total, 1.0), np.nan)
        return np.asarray(shares)

    def without_parts(self) -> list[KnownLikelihood]:
        """Return the likelihood without each simulated run in turn."""
        return [replace(self, outputs=each, _kept={}) for each in self.outputs.parts()]


def known_likelihood(
    model: KnownModel,
    trials: KnownTrials,
    *,
    free: Sequence[str] = (),
    fixed: Mapping[str, float] | None = None,
) -> KnownLikelihood:
    """Return the likelihood of trials under a model; a circuit is simulated here.

    Parameters
    ----------
    model : KnownModel
        The model.
    trials : KnownTrials
        The data.
    free : sequence of str
        Parameters to fit; with a plus, in addition to the default ones.
    fixed : dict of str to float, optional
        Fixed parameters and their values.

    Raises
    ------
    ValueError
        For an unknown parameter, or a value out of its range.
    """
    known = parameters_of(model, trials)
    named = [name.removeprefix("+") for name in free]
    default = [p.name for p in known if p.free and p.name not in (fixed or {})]
    added = bool(free) and free[0].startswith("+")
    chosen = list(dict.fromkeys([*default, *named])) if added or not free else named
    space = freedom(known, {}, 1, free=chosen, fixed=fixed)
    return KnownLikelihood(model, trials, space, model.on(trials, space.held))

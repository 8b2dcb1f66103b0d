"""Features: readings as the activity of a population of sensory units, with the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from bgmodel.evidence import Evidence
from bgmodel.support.checks import (
    check_inside,
    check_positive,
    known_truth,
    one_per_trial,
    reals,
    whole,
)
from bgmodel.support.saved import Facts
from bgmodel.support.seeds import generator
from circuits.arrays import Array, Integers, Reals
from circuits.errors import DataWarning, InputError, quiet, require


@dataclass(frozen=True, repr=False)
class Features(Facts):
    """Activity of sensory units at every reading, with the truth."""

    values: Reals  # (trials, steps, units), phi(x); 0 after a trial's last reading
    truth: Integers  # (trials,), index of the true hypothesis
    names: tuple[str, ...]
    step_ms: float = 50.0
    lengths: Integers | None = None  # (trials,), readings of each trial; all if None
    log_likelihood: Reals | None = None  # (trials, steps, hypotheses), nats; learners never see it
    removed: Array | None = None  # (units,), mean activity that was subtracted

    def __post_init__(self) -> None:
        values = reals("values", self.values)
        fits = values.ndim == 3 and 0 not in values.shape and bool(np.isfinite(values).all())
        must = "must be finite, of shape (trials, steps, units), none of them 0"
        require(fits, "values", must, values.shape)
        require(len(self.names) >= 2, "names", "must be of two hypotheses or more", self.names)
        truth = np.asarray(known_truth(self.truth))
        require(truth.shape == values.shape[:1], "truth", "must be one per trial", truth.shape)
        check_inside("truth", truth, 0, len(self.names) - 1)
        check_positive(step_ms=self.step_ms)
        self._check_lengths(values)
        exact = self.log_likelihood
        shape = (*values.shape[:2], len(self.names))
        if exact is not None:
            fits = np.shape(exact) == shape
            require(fits, "log_likelihood", f"must be {shape}", np.shape(exact))
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "truth", truth)

    def _check_lengths(self, values: Reals) -> None:
        if self.lengths is None:
            return
        lengths = one_per_trial("lengths", self.lengths, len(values))
        check_inside("lengths", lengths, 1, values.shape[1])
        if values[np.arange(values.shape[1]) >= lengths[:, None]].any():
            raise InputError("features after the last reading of a trial must be 0", "lengths")

    def facts(self) -> dict[str, str]:
        """Return trials, readings, units, hypotheses and whether exact likelihoods are known."""
        exact = "unknown" if self.log_likelihood is None else "known"
        return {
            "trials": f"{self.trials}",
            "readings": f"{self.steps}" if self.lengths is None else f"up to {self.steps}",
            "units": f"{self.units}",
            "hypotheses": " ".join(self.names),
            "step_ms": f"{self.step_ms:g}",
            "exact likelihoods": exact,
        }

    @property
    def trials(self) -> int:
        """Number of trials."""
        return int(self.values.shape[0])

    @property
    def steps(self) -> int:
        """Number of readings of the longest trial."""
        return int(self.values.shape[1])

    @property
    def units(self) -> int:
        """Number of sensory units, K."""
        return int(self.values.shape[2])

    @property
    def hypotheses(self) -> int:
        """Number of hypotheses, N."""
        return len(self.names)

    @property
    def readings(self) -> Integers:
        """Number of readings of each trial, (trials,)."""
        return np.full(self.trials, self.steps) if self.lengths is None else self.lengths

    @property
    def exact(self) -> Evidence:
        """Evidence of the exact log-likelihoods; ValueError if they are unknown."""
        if self.log_likelihood is None:
            raise InputError(
                "the exact likelihoods of these features are unknown: a table needs the columns "
                "ll_<hypothesis> for a comparison with them",
                "log_likelihood",
            )
        return self.evidence(self.log_likelihood)

    def evidence(self, log_likelihood: Reals) -> Evidence:
        """Return log-likelihoods of these readings (trials, steps, hypotheses) as evidence."""
        mean = float(log_likelihood.sum() / (self.readings.sum() * self.hypotheses))
        # Learned ones have an arbitrary common term: within 0..1 they are no probabilities.
        with quiet(DataWarning):
            return Evidence(
                log_likelihood, self.truth, step_ms=self.step_ms, lengths=self.lengths,
                baseline=mean,
            )  # fmt: skip

    def draw(self, trials: int, *, rng: np.random.Generator | int) -> Features:
        """Draw whole trials with replacement, so that a table can teach any number of trials."""
        index = generator(rng).integers(self.trials, size=whole("trials", trials, 1))
        of_trials = ("values", "truth", "lengths", "log_likelihood")
        known = {name: each for name in of_trials if (each := getattr(self, name)) is not None}
        return replace(self, **{name: each[index] for name, each in known.items()})


def check_learnable(features: Features) -> None:
    """Raise ValueError if a hypothesis is never true, or a unit is never active."""
    counts = np.bincount(features.truth, minlength=features.hypotheses)
    if not counts.all():
        name = features.names[int(np.argmin(counts))]
        raise InputError(
            f"no trial belongs to the hypothesis {name!r}: reward cannot teach what speaks for it; "
            "add trials or leave the hypothesis out",
            "truth",
        )
    active = features.values.any(axis=(0, 1))
    if not active.all():
        silent = np.flatnonzero(~active)
        raise InputError(
            f"{len(silent)} of {features.units} units are 0 in every reading, the first is unit "
            f"{silent[0]}: their weights cannot be learned; leave them out",
            "values",
        )


def soft_histogram(
    reading: npt.ArrayLike, centres: npt.ArrayLike, period: float | None = None
) -> Array:
    """Return the activity of units with triangular tuning curves, (..., units).

    At most two neighbouring units are active at a time, and activities sum to 1. A reading beyond
    the outer ``centres``, which increase, activates the outermost unit alone; with a ``period``,
    the last unit is a neighbour of the first.
    """
    middle = np.asarray(centres, dtype=np.float64)
    x = np.asarray(reading, dtype=np.float64)
    units = len(middle)
    rising = middle.ndim == 1 and units >= 2 and bool((np.diff(middle) > 0).all())
    require(rising, "centres", "must be two or more increasing numbers", middle)
    if period is not None:
        span = middle[-1] - middle[0]
        require(period > span, "period", f"must exceed the span of centres, {span:g}", period)
        middle = np.append(middle, middle[0] + period)
        x = middle[0] + np.mod(x - middle[0], period)
    left = np.clip(np.searchsorted(middle, x, side="right") - 1, 0, len(middle) - 2)
    share = np.clip((x - middle[left]) / (middle[left + 1] - middle[left]), 0.0, 1.0)
    activity = np.zeros((*x.shape, units))
    np.put_along_axis(activity, left[..., None], (1 - share)[..., None], axis=-1)
    right = ((left + 1) % units)[..., None]
    more = np.take_along_axis(activity, right, axis=-1) + share[..., None]
    np.put_along_axis(activity, right, more, axis=-1)
    return activity


def even_centres(readings: Sequence[npt.ArrayLike], units: int) -> Array:
    """Return centres at which each unit is active equally often: quantiles (Laughlin 1981)."""
    every = np.concatenate([np.ravel(np.asarray(part, dtype=np.float64)) for part in readings])
    shares = (np.arange(whole("units", units, 2)) + 0.5) / units
    centres = np.quantile(every, shares)
    must = f"must differ enough for {units} units"
    require((np.diff(centres) > 0).all(), "readings", must, every)
    return np.asarray(centres)

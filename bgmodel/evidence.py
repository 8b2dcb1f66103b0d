"""Evidence: the input of every integrator, abstract or neural."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from bgmodel.plausibility import warn_of_confounds, warn_of_readings
from bgmodel.support.checks import (
    check_inside,
    check_positive,
    check_range,
    is_number,
    known_truth,
    one_per_trial,
    reals,
)
from bgmodel.support.saved import Facts
from circuits.arrays import Array, Integers, Reals
from circuits.errors import DataWarning, InputError, require

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_NATS = 1e6
"""Beyond this, sums of log-likelihoods lose the differences between hypotheses to rounding."""
MOST_MS = 1e9
"""Longest reading or foreperiod, ms: longer times would be rounded."""


@dataclass(frozen=True, repr=False)
class Evidence(Facts):
    """Log-likelihoods of every reading under every hypothesis, with the truth.

    Parameters
    ----------
    log_likelihood : array (trials, steps, hypotheses), nats
        ``log p(reading | hypothesis)``, up to a constant shared by the hypotheses of a reading.
    truth : array (trials,), int, or None
        Index of the hypothesis that made each trial's readings; None if unknown.
    prior : array (hypotheses,), optional
        Prior probabilities; equal if omitted.
    onset_ms : float
        Foreperiod: the time from the start of a trial to the onset of evidence, ms.
        Reading ``k`` (k = 1, 2, ...) arrives at ``onset_ms + k * step_ms``.
    step_ms : float
        Time between readings, ms.
    lengths : array (trials,), int, optional
        Number of readings of each trial; all of them if omitted. Entries after the last reading
        of a trial must be 0; they carry no information, and no decision is made there.
    numbers : array (trials,), int, optional
        Number of each trial, used to break ties; 0, 1, 2, ... if omitted.
    baseline : float, nats, optional
        Constant subtracted from every reading if each channel of a circuit gets its own
        evidence, for instance the mean over all readings and hypotheses (``mean_reading``). It
        is the same for all hypotheses, otherwise it would itself be evidence, and must not
        depend on the reading. Tests do not need a baseline.
    expectancy_nats : array (trials, foreperiod steps), nats, optional
        Input common to all hypotheses before the onset, one value per ``step_ms`` of the
        foreperiod; the last one persists. It carries no information about the truth, and tests
        ignore it; it reaches a circuit in which each channel gets its own evidence.
    inputs_nats : array (trials, times, inputs), nats, optional
        Further inputs of a circuit, such as a stop signal, one column for each of its
        ``more_inputs``. Times run from the onset to the end of the trial, which is a step after the
        last reading: m (1 + steps) of them for m values per step. Tests ignore them.

    Raises
    ------
    ValueError
        On wrong shapes, an empty set, fewer than two hypotheses, values that are not finite or
        too large, a truth outside the hypotheses, a prior that does not sum to 1, times that make
        no sense, readings after the last of a trial, or an expectancy that does not fill the
        foreperiod.

    Warns
    -----
    UserWarning
        If the values look like probabilities or like running sums, trials seem to be padded and
        there are no ``lengths``, or an input comes in none or in all of the trials with one truth.
    """

    log_likelihood: Reals
    truth: Integers | None = None
    prior: Array = None  # type: ignore[assignment]
    onset_ms: float = 0.0
    step_ms: float = 1.0
    lengths: Integers | None = None
    numbers: Integers | None = None
    baseline: float | None = None
    expectancy_nats: Array | None = None
    inputs_nats: Array | None = None

    def __post_init__(self) -> None:
        """Check all fields once, so that later code need not."""
        values = reals("log_likelihood", self.log_likelihood)
        require(
            values.ndim == 3 and 0 not in values.shape and (values.shape[2] >= 2),
            "log_likelihood",
            "must have shape (trials, steps, hypotheses) with at least one trial, "
            "one step and two hypotheses",
            values.shape,
        )
        finite = np.isfinite(values)
        if not finite.all():
            trial, step, hypothesis = np.argwhere(~finite)[0]
            raise InputError(
                f"log_likelihood must be finite, got {values[trial, step, hypothesis]} at trial "
                f"{trial}, step {step}, hypothesis {hypothesis} ({(~finite).sum()} such values)",
                "log_likelihood",
            )
        if max(values.max(), -values.min()) > MOST_NATS:
            raise InputError(
                f"log_likelihood must be within +-{MOST_NATS:.0e} nats, got {values.min():.3g} to "
                f"{values.max():.3g}: subtract the part common to the hypotheses of a reading",
                "log_likelihood",
            )
        object.__setattr__(self, "log_likelihood", values)
        object.__setattr__(self, "truth", _truth(self.truth, values.shape))
        object.__setattr__(self, "prior", checked_prior(self.prior, values.shape[2]))
        object.__setattr__(self, "lengths", _checked_lengths(self.lengths, values))
        object.__setattr__(self, "numbers", _of_trials("numbers", self.numbers, values))
        object.__setattr__(self, "baseline", _checked_baseline(self.baseline))
        check_range(0, MOST_MS, onset_ms=self.onset_ms, step_ms=self.step_ms)
        check_positive(step_ms=self.step_ms)
        if self.step_ms < 1:
            DataWarning.warn(
                f"step_ms, the time between readings in ms, is {self.step_ms:g}: is it in seconds?"
            )
        if self.expectancy_nats is not None:
            steps = whole_steps(self.onset_ms, self.step_ms)
            expected = _checked_expectancy(self.expectancy_nats, (len(values), steps))
            object.__setattr__(self, "expectancy_nats", expected)
        if self.inputs_nats is not None:
            inputs = _checked_inputs(self.inputs_nats, len(values), values.shape[1] + 1)
            object.__setattr__(self, "inputs_nats", inputs)
            if self.truth is not None:
                warn_of_confounds(inputs, self.truth)
        warn_of_readings(values, self.lengths)

    def facts(self) -> dict[str, str]:
        """Return shape, clock, truth and the mean evidence for it."""
        facts = {
            "trials": f"{self.trials}",
            "readings": f"{self.steps}" if self.lengths is None else f"up to {self.steps}",
            "hypotheses": f"{self.hypotheses}",
            "step_ms": f"{self.step_ms:g}",
        }
        if self.onset_ms:
            facts["onset_ms"] = f"{self.onset_ms:g}"
        if self.expectancy_nats is not None:
            facts["expectancy_nats"] = f"up to {self.expectancy_nats.max():.3g}"
        if np.ptp(self.prior):
            facts["prior"] = " ".join(f"{p:.3g}" for p in self.prior)
        if self.truth is None:
            return facts | {"truth": "unknown"}
        true = self.log_likelihood[np.arange(self.trials), :, self.truth]
        others = (self.log_likelihood.sum(axis=2) - true) / (self.hypotheses - 1)
        mean = float((true - others).sum() / self.readings.sum())
        return facts | {"truth": f"known, favoured by {mean:.3g} nats per reading"}

    def plot(self, trial: int = 0, ax: Axes | None = None) -> Figure:
        """Draw the posterior of each hypothesis after every reading of one trial.

        The line of the true hypothesis is thick.

        Parameters
        ----------
        trial : int
            Position of the trial.
        ax : Axes, optional
            Axes to draw on; by default those of a new figure.

        Returns
        -------
        Figure
            One panel.

        Raises
        ------
        ValueError
            If there is no such trial.
        """
        from bgmodel.plots import posteriors

        require(trial in range(self.trials), "trial", f"must be within 0..{self.trials - 1}", trial)
        readings = int(self.readings[trial]) + 1
        time_ms = self.step_ms * np.arange(readings)
        truth = None if self.truth is None else int(self.truth[trial])
        return posteriors(time_ms, self.posterior[trial, :readings], truth, ax)

    @property
    def foreperiod_steps(self) -> int:
        """Number of steps of the foreperiod that carry expectancy."""
        return 0 if self.expectancy_nats is None else int(self.expectancy_nats.shape[1])

    @property
    def trials(self) -> int:
        """Number of trials."""
        return int(self.log_likelihood.shape[0])

    @property
    def steps(self) -> int:
        """Number of readings of the longest trial, T_max."""
        return int(self.log_likelihood.shape[1])

    @property
    def hypotheses(self) -> int:
        """Number of hypotheses."""
        return int(self.log_likelihood.shape[2])

    @property
    def readings(self) -> Integers:
        """Number of readings of each trial, (trials,)."""
        return np.full(self.trials, self.steps) if self.lengths is None else self.lengths

    @property
    def trial_numbers(self) -> Integers:
        """Number of each trial, (trials,)."""
        return np.arange(self.trials) if self.numbers is None else self.numbers

    @property
    def totals(self) -> Array:
        """Log prior plus all readings so far, (trials, 1 + steps, hypotheses) nats."""
        total = np.empty((self.trials, self.steps + 1, self.hypotheses))
        total[:, 0] = np.log(self.prior)
        total[:, 1:] = self.log_likelihood
        return np.cumsum(total, axis=1, out=total)

    @property
    def own_totals(self) -> Array:
        """Input of each channel from its own evidence, (trials, 1 + steps, hypotheses) nats.

        The totals minus constants known before the trial: the baseline for each reading so far, and
        the mean of the log prior. No information is shared between channels.

        Raises
        ------
        ValueError
            Without a baseline; the message suggests one.
        """
        if self.baseline is None:
            raise InputError(
                "this evidence has no baseline, the constant subtracted from readings where "
                "each channel gets its own: give one, nats per reading, such as the mean of all "
                f"readings, Evidence(..., baseline={self.mean_reading:.3g})",
                "baseline",
            )
        totals = self.totals
        totals -= np.log(self.prior).mean()
        if self.baseline:
            read = np.minimum(np.arange(self.steps + 1), self.readings[:, None])
            totals -= self.baseline * read[:, :, None]
        return totals

    @property
    def mean_reading(self) -> float:
        """Mean log-likelihood over all readings and hypotheses, nats."""
        total = self.log_likelihood.sum(dtype=np.float64)
        return float(total / (self.readings.sum() * self.hypotheses))

    @cached_property
    def posterior(self) -> Array:
        """Probability of each hypothesis given all readings so far, shaped as ``totals``."""
        return np.exp(-minus_log_softmax(self.totals))

    def __getitem__(self, trials: int | slice | npt.ArrayLike) -> Evidence:
        """Return the evidence of some trials: a number, a slice, a mask or indices.

        Raises
        ------
        IndexError
            If they are not among the trials.
        ValueError
            If none is chosen.
        """
        chosen: Any = self._among(trials)
        part = object.__new__(Evidence)  # already checked
        of_trials = (
            "log_likelihood", "truth", "lengths", "numbers", "expectancy_nats", "inputs_nats",
        )  # fmt: skip
        for name in (field.name for field in fields(self)):
            value = self.trial_numbers if name == "numbers" else getattr(self, name)
            value = value[chosen] if name in of_trials and value is not None else value
            object.__setattr__(part, name, value)
        return part

    def _among(self, trials: Any) -> Any:
        """Return a slice or an index (N,) of one trial or more."""
        try:
            chosen = np.arange(self.trials)[trials]
            if chosen.ndim == 0:
                trials, chosen = slice(int(chosen), int(chosen) + 1), chosen[None]
            if chosen.ndim > 1:
                raise IndexError(f"an index of {chosen.ndim} dimensions")
        except IndexError as error:
            raise IndexError(
                f"trials must be a number, a slice, a mask or numbers in 0..{self.trials - 1}: "
                f"{error}"
            ) from None
        if not chosen.size:
            raise InputError(f"evidence needs at least one trial, got 0 of {self.trials}", "trials")
        return trials


def needed_truth(evidence: Evidence) -> Integers:
    """Return the truth of each trial (trials,); ValueError where it is not known."""
    return known_truth(evidence.truth)


def check_evidence(evidence: Evidence) -> Evidence:
    """Return the evidence; ValueError for anything else, such as a bare array."""
    if isinstance(evidence, Evidence):
        return evidence
    hint = "Evidence(log_likelihood) makes one from nats (trials, steps, hypotheses), "
    hint += "read_evidence one from a table"
    if isinstance(getattr(evidence, "evidence", None), Evidence):
        hint = "give its .evidence"
    what = type(evidence).__name__
    raise InputError(f"evidence must be an Evidence, got {what}: {hint}", "evidence")


def minus_log_softmax(y: Array) -> Array:
    """Return ``-y_i + ln sum_j exp y_j`` (..., N): -ln P of unnormalised log posteriors."""
    # A loop over channels: numpy reduces a short last axis ten times slower.
    channels = range(y.shape[-1])
    top = y[..., 0].copy()
    for i in channels:
        np.maximum(top, y[..., i], out=top)
    y = y - top[..., None]
    total = np.zeros_like(top)
    for i in channels:
        total += np.exp(y[..., i])
    return np.log(total)[..., None] - y


def whole_steps(foreperiod_ms: float, step_ms: float) -> int:
    """Return the number of steps of a foreperiod; ValueError unless it is a positive integer."""
    known = is_number(foreperiod_ms) and np.isfinite(foreperiod_ms)
    steps = round(foreperiod_ms / step_ms) if known else 0
    if steps < 1 or abs(steps * step_ms - foreperiod_ms) > 1e-9 * step_ms:
        must = f"must be one or more whole steps of {step_ms:g} ms if something is expected"
        raise InputError.of("foreperiod_ms", must, foreperiod_ms)
    return steps


def checked_prior(prior: npt.ArrayLike | None, hypotheses: int) -> Array:
    """Return a prior as an array (hypotheses,), equal if ``None``; ValueError if it is invalid."""
    if prior is None:
        return np.full(hypotheses, 1.0 / hypotheses)
    values = np.asarray(reals("prior", prior), dtype=np.float64)
    if values.shape != (hypotheses,) or not (values > 0).all():
        raise InputError.of("prior", f"must hold {hypotheses} probabilities > 0", values)
    total = values.sum()
    require(abs(total - 1) <= 1e-9, "prior", f"must sum to 1, not to {total:.12g}", values)
    return values


def _checked_baseline(baseline: npt.ArrayLike | None) -> float | None:
    if baseline is None:
        return None
    value = np.asarray(reals("baseline", baseline), dtype=np.float64)
    require(
        not value.shape and np.isfinite(value),
        "baseline",
        "must be one finite number for all hypotheses, nats (a different one for each "
        "would itself be evidence)",
        value,
    )
    return float(value)


def _checked_inputs(inputs: npt.ArrayLike, trials: int, steps: int) -> Array:
    values = np.asarray(reals("inputs_nats", inputs), dtype=np.float64)
    fits = values.ndim == 3 and len(values) == trials and values.shape[1] and values.shape[2]
    must = f"must be ({trials}, m x {steps}, inputs), finite nats"
    fits = fits and values.shape[1] % steps == 0 and np.isfinite(values).all()
    require(fits, "inputs_nats", must, values.shape)
    return values


def _checked_expectancy(expectancy: npt.ArrayLike, shape: tuple[int, int]) -> Array:
    values = np.asarray(reals("expectancy_nats", expectancy), dtype=np.float64)
    require(
        values.shape == shape and np.isfinite(values).all(),
        "expectancy_nats",
        f"must hold finite nats (trials, steps of the foreperiod), {shape}",
        values.shape,
    )
    return values


def _of_trials(name: str, values: npt.ArrayLike | None, log_likelihood: Reals) -> Integers | None:
    return None if values is None else one_per_trial(name, values, len(log_likelihood))


def _checked_lengths(lengths: npt.ArrayLike | None, log_likelihood: Reals) -> Integers | None:
    steps = log_likelihood.shape[1]
    values = _of_trials("lengths", lengths, log_likelihood)
    if values is None:
        return None
    check_inside("lengths", values, 1, steps)
    if (values < steps).any() and log_likelihood[np.arange(steps) >= values[:, None]].any():
        raise InputError("entries after the last reading of a trial must be 0", "lengths")
    return values


def _truth(truth: npt.ArrayLike | None, shape: tuple[int, ...]) -> Integers | None:
    if truth is None:
        return None
    values = one_per_trial("truth", truth, shape[0])
    check_inside("truth", values, 0, shape[2] - 1)
    return values

"""Evidence: what every integrator, abstract or neural, is given."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from bgmodel.readings import warn_of_readings
from bgmodel.support.arrays import Array, Integers, Reals
from bgmodel.support.checks import (
    check_finite,
    check_inside,
    check_positive,
    check_range,
    checked_truth,
    is_number,
    known_truth,
    one_per_trial,
    reals,
    whole,
)
from bgmodel.support.memory import check_evidence_memory
from bgmodel.support.reprs import Facts
from bgmodel.support.seeds import generator
from circuits.errors import InputError, require

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_NATS = 1e6
"""Beyond, sums of log-likelihoods lose what tells hypotheses apart."""
MOST_MS = 1e9
"""Longest time of a reading or of a foreperiod: with more, times would be rounded."""


@dataclass(frozen=True, repr=False)
class Evidence(Facts):
    """Log-likelihoods of every reading under every hypothesis, with the truth.

    Parameters
    ----------
    log_likelihood : array (trials, steps, hypotheses), nats
        ``log p(reading | hypothesis)``, up to a constant shared by the hypotheses of a reading.
    truth : array (trials,), int, or None
        Index of the hypothesis that made each trial's readings; None where nobody knows.
    prior : array (hypotheses,), optional
        Prior probabilities; equal if left out.
    onset_ms : float
        Foreperiod: the time from the start of a trial to the onset of evidence, ms.
        Reading ``k`` (k = 1, 2, ...) arrives at ``onset_ms + k * step_ms``.
    step_ms : float
        Time between readings, ms.
    lengths : array (trials,), int, optional
        Number of readings of each trial; all of them if left out. Readings after the last of a
        trial must be 0: they say nothing, and no decision is made there.
    numbers : array (trials,), int, optional
        Number of each trial, which decides its ties; 0, 1, 2, ... if left out.
    baseline : float, nats, optional
        Constant taken from every reading where each channel of a circuit gets its own evidence:
        what a reading says on the whole, for instance the mean over all readings and hypotheses
        (``mean_reading``). One for all hypotheses, or it would be evidence between them; it must
        not depend on the reading. Tests don't need one.
    expectancy_nats : array (trials, foreperiod steps), nats, optional
        What all hypotheses have in common before the onset, one value per ``step_ms`` of the
        foreperiod; the last one stays on. It says nothing about which is true, and a test does not
        hear it; channels of a circuit that get their own evidence do.

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
        If the values look like probabilities or like running sums.
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

    def __post_init__(self) -> None:
        """Check once, here, so that nothing downstream has to."""
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
                f"log_likelihood must lie within +-{MOST_NATS:.0e} nats, got {values.min():.3g} to "
                f"{values.max():.3g}: take off what the hypotheses of a reading share",
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
        if self.expectancy_nats is not None:
            steps = whole_steps(self.onset_ms, self.step_ms)
            expected = _checked_expectancy(self.expectancy_nats, (len(values), steps))
            object.__setattr__(self, "expectancy_nats", expected)
        warn_of_readings(values, self.lengths)

    def facts(self) -> dict[str, str]:
        """Return shape, clock, truth and the mean evidence for it."""
        found = {
            "trials": f"{self.trials}",
            "readings": f"{self.steps}" if self.lengths is None else f"up to {self.steps}",
            "hypotheses": f"{self.hypotheses}",
            "step_ms": f"{self.step_ms:g}",
        }
        if self.onset_ms:
            found["onset_ms"] = f"{self.onset_ms:g}"
        if self.expectancy_nats is not None:
            found["expectancy_nats"] = f"up to {self.expectancy_nats.max():.3g}"
        if np.ptp(self.prior):
            found["prior"] = " ".join(f"{p:.3g}" for p in self.prior)
        if self.truth is None:
            return found | {"truth": "unknown"}
        true = self.log_likelihood[np.arange(self.trials), :, self.truth]
        others = (self.log_likelihood.sum(axis=2) - true) / (self.hypotheses - 1)
        mean = float((true - others).sum() / self.readings.sum())
        return found | {"truth": f"known, favoured by {mean:.3g} nats per reading"}

    def plot(self, trial: int = 0, ax: Axes | None = None) -> Axes:
        """Draw the posterior of each hypothesis after every reading of one trial.

        Parameters
        ----------
        trial : int
            Position of the trial.
        ax : Axes, optional
            Drawn on and returned; that of a new figure unless given.

        Raises
        ------
        ValueError
            If there is no such trial.
        """
        from bgmodel.plots import posteriors

        require(trial in range(self.trials), "trial", f"must lie in 0..{self.trials - 1}", trial)
        readings = int(self.readings[trial]) + 1
        time_ms = self.step_ms * np.arange(readings)
        truth = None if self.truth is None else int(self.truth[trial])
        return posteriors(time_ms, self.posterior[trial, :readings], truth, ax)

    @property
    def foreperiod_steps(self) -> int:
        """Number of steps before the onset in which something is expected."""
        return 0 if self.expectancy_nats is None else int(self.expectancy_nats.shape[1])

    @property
    def trials(self) -> int:
        """Number of trials."""
        return int(self.log_likelihood.shape[0])

    @property
    def steps(self) -> int:
        """Number of readings that the longest trial holds, T_max."""
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
        """What each channel is told by itself, (trials, 1 + steps, hypotheses) nats.

        The totals less constants that are known before a trial: the baseline for each reading so
        far, and the mean of the log prior. Nothing here looks across channels.

        Raises
        ------
        ValueError
            Without a baseline, with what one could be.
        """
        if self.baseline is None:
            raise InputError(
                "this evidence has no baseline, the constant that each channel takes from its "
                "readings where it gets its own: give one, nats a reading, such as the mean of all "
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
        """Mean over all readings and hypotheses of what a reading says, nats."""
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
        part = object.__new__(Evidence)  # checked already
        of_trials = ("log_likelihood", "truth", "lengths", "numbers", "expectancy_nats")
        for name in (field.name for field in fields(self)):
            value = self.trial_numbers if name == "numbers" else getattr(self, name)
            value = value[chosen] if name in of_trials and value is not None else value
            object.__setattr__(part, name, value)
        return part

    def _among(self, trials: Any) -> Any:
        """Return a slice or an index (N,) of one trial or more."""
        try:
            found = np.arange(self.trials)[trials]
            if found.ndim == 0:
                trials, found = slice(int(found), int(found) + 1), found[None]
            if found.ndim > 1:
                raise IndexError(f"an index of {found.ndim} dimensions")
        except IndexError as error:
            raise IndexError(
                f"trials must be a number, a slice, a mask or numbers in 0..{self.trials - 1}: "
                f"{error}"
            ) from None
        if not found.size:
            raise InputError(f"evidence needs a trial or more, got none of {self.trials}", "trials")
        return trials


def needed_truth(evidence: Evidence) -> Integers:
    """Return the truth of each trial (trials,); ValueError where it is not known."""
    return known_truth(evidence.truth)


def check_evidence(given: Evidence) -> Evidence:
    """Return evidence as it is; ValueError for anything else, as a bare array."""
    if isinstance(given, Evidence):
        return given
    hint = "Evidence(log_likelihood) makes one from nats (trials, steps, hypotheses)"
    if isinstance(getattr(given, "evidence", None), Evidence):
        hint = "give its .evidence"
    what = type(given).__name__
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


def gaussian_evidence(
    trials: int,
    *,
    d_prime: float = 0.5,
    channels: int = 2,
    t_max: int = 40,
    step_ms: float = 50.0,
    conflict: float = 0.0,
    seed: np.random.Generator | int,
) -> Evidence:
    """Draw Gaussian evidence, as the terminal's task "gaussian" does.

    Parameters
    ----------
    trials : int
        Number of trials. Truth is balanced: trial ``k`` belongs to hypothesis ``k mod N``.
    d_prime : float
        What one reading tells of two hypotheses: their separation over the standard deviation of
        the difference of their channels, > 0.
    channels : int
        Number of hypotheses, N.
    t_max : int
        Readings in a trial.
    step_ms : float
        Time between readings, ms.
    conflict : float
        How far one competitor rises towards the truth: 0 no further than the others, 1 level. The
        likelihoods do not know of it.
    seed : int or numpy.random.Generator
        The source of all random numbers.

    Raises
    ------
    ValueError
        For a number out of its range, by its name.
    """
    check_positive(d_prime=d_prime)
    return separated_evidence(
        trials,
        whole("t_max", t_max, 1),
        d_prime / np.sqrt(2),
        rng=generator(seed, "seed"),
        hypotheses=whole("channels", channels, 2),
        step_ms=step_ms,
        conflict=conflict,
    )


def separated_evidence(
    trials: int,
    steps: int,
    separation: float,
    *,
    rng: np.random.Generator | int,
    hypotheses: int = 2,
    step_ms: float = 1.0,
    conflict: float = 0.0,
) -> Evidence:
    """Draw the classic Gaussian problem: the true channel has mean ``separation``, the others 0.

    Each reading holds one unit-variance sample a channel, and ``log p(reading | H_i)`` is
    ``separation * x_i`` up to a shared constant (Bogacz & Gurney 2007, with g* = separation).
    For two hypotheses the log-likelihood ratio has mean ``+-separation**2`` and variance
    ``2 separation**2``, so one reading tells two alternatives apart with ``d' = sqrt(2)
    separation``.

    Parameters
    ----------
    trials, steps, hypotheses : int
        Shape of the result.  Truth is balanced: trial ``k`` belongs to hypothesis ``k mod N``.
    separation : float
        (mu+ - mu-) / sigma of one channel, > 0.
    rng : numpy.random.Generator or int
        The source of every random number, or a seed: ``stream(seed)`` is taken then.
    step_ms : float
        Time between readings, ms.
    conflict : float
        Mean of one competitor, the channel after the true one, as a fraction of the true one's. The
        likelihoods do not know of it: they stay those of the problem without a competitor, so what
        they say is then too sure. What all channels share changes nothing and is left out.
    """
    trials, steps = whole("trials", trials, 1), whole("steps", steps, 1)
    hypotheses = whole("hypotheses", hypotheses, 2)
    check_positive(separation=separation)
    check_finite(conflict=conflict)
    check_evidence_memory(trials, steps, hypotheses)
    rng = generator(rng)
    truth = np.arange(trials) % hypotheses
    samples = rng.standard_normal((trials, steps, hypotheses))
    samples[np.arange(trials), :, truth] += separation
    samples[np.arange(trials), :, (truth + 1) % hypotheses] += conflict * separation
    return Evidence(separation * samples, truth, step_ms=step_ms, baseline=0.0)


def expecting(
    evidence: Evidence, most_nats: float, foreperiod_ms: float, *, rng: np.random.Generator | int
) -> Evidence:
    """Return evidence with a foreperiod over which expectancy rises in a straight line.

    By the onset it comes to R nats, drawn anew for each trial, evenly from 0 to ``most_nats``.

    Parameters
    ----------
    evidence : Evidence
        What follows the foreperiod.
    most_nats : float
        Highest R, in nats of evidence.
    foreperiod_ms : float
        Length of the foreperiod, a multiple of the evidence's ``step_ms``.
    rng : numpy.random.Generator or int
        The source of every R, or a seed.

    Raises
    ------
    ValueError
        If ``most_nats`` is negative, or the foreperiod is not made of whole steps.
    """
    check_evidence(evidence)
    check_range(0, np.inf, most_nats=most_nats)
    steps = whole_steps(foreperiod_ms, evidence.step_ms)
    top = generator(rng).uniform(0, most_nats, evidence.trials)
    ramp = top[:, None] * np.arange(1, steps + 1) / steps
    return replace(evidence, onset_ms=foreperiod_ms, expectancy_nats=ramp)


def whole_steps(foreperiod_ms: float, step_ms: float) -> int:
    """Return the number of steps of a foreperiod; ValueError unless they are one or more."""
    known = is_number(foreperiod_ms) and np.isfinite(foreperiod_ms)
    steps = round(foreperiod_ms / step_ms) if known else 0
    if steps < 1 or abs(steps * step_ms - foreperiod_ms) > 1e-9 * step_ms:
        must = f"must be one or more whole steps of {step_ms:g} ms, of an expectancy"
        raise InputError.of("foreperiod_ms", must, foreperiod_ms)
    return steps


def checked_prior(prior: npt.ArrayLike | None, hypotheses: int) -> Array:
    """Return a prior as an array (hypotheses,), equal if ``None``; ValueError if it is none."""
    if prior is None:
        return np.full(hypotheses, 1.0 / hypotheses)
    values = np.asarray(reals("prior", prior), dtype=np.float64)
    if values.shape != (hypotheses,) or not (values > 0).all():
        raise InputError.of("prior", f"must hold {hypotheses} probabilities > 0", values)
    total = values.sum()
    require(abs(total - 1) <= 1e-9, "prior", f"must sum to 1, and not to {total:.12g}", values)
    return values


def _checked_baseline(baseline: npt.ArrayLike | None) -> float | None:
    if baseline is None:
        return None
    value = np.asarray(reals("baseline", baseline), dtype=np.float64)
    require(
        not value.shape and np.isfinite(value),
        "baseline",
        "must be one finite number for all hypotheses, nats (another for each "
        "would be evidence between them)",
        value,
    )
    return float(value)


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
        raise InputError("readings after the last of a trial must be 0, got others", "lengths")
    return values


def _truth(truth: npt.ArrayLike | None, shape: tuple[int, ...]) -> Integers | None:
    return None if truth is None else checked_truth(truth, shape[0], shape[2])

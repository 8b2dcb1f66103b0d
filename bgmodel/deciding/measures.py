"""Behavioural measures of decisions at one threshold, as reported by experiments.

Each behavioural measure is written in terms of weights of trials, so that one call gives its value
and its bootstrap resamples, as in ``bgmodel.comparison.matched``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from bgmodel.deciding.calibration import against_evidence
from bgmodel.deciding.decision import UNDECIDED, Decision
from circuits.arrays import Array, Truths

DIFFUSION_S = 0.1
"""Noise of the diffusion, s: the scale in which EZ parameters are stated."""

LEAST_VARIANCE = 1e-9
"""Variance of times, s^2, below which it is rounding error and gives no drift."""

CUT_OFF = 0.01
"""Largest share of trials cut off by the deadline for which EZ parameters are reported: the missing
trials are the slow ones. In simulated diffusions, a share of 0.01 made the drift 6 to 7 % too large
and the boundary separation 6 % too small; 0.05 made them 18 and 15 % wrong."""

MEASURES = {
    "accuracy": "proportion correct of decided trials",
    "choice_0": "share of decided trials that choose the first alternative (channel 0)",
    "mean_ms": "mean decision time from the onset of evidence, ms",
    "median_ms": "median decision time, ms",
    "accuracy_all": "proportion correct of all trials, missed ones counted as errors",
    "accuracy_best": "proportion correct of all trials, missed ones counted as correct",
    "mean_all_ms": "mean time of all trials, missed ones counted at the deadline, ms",
    "premature": "share of trials decided before the first reading",
    "anticipatory": "share of foreperiods without evidence that end in a response",
    "missed": "share of trials not decided in time",
    "decided": "number of trials decided in time",
    "mean_posterior": "mean posterior of the chosen alternative at the decision",
    "drift": "drift by EZ-diffusion, 1/s (noise s = 0.1 per root second); two alternatives",
    "boundary_separation": "its boundary separation, dimensionless (s = 0.1)",
    "non_decision_ms": "its non-decision time, ms",
}
"""Every measure, with its unit."""
OF_STOP = {
    "p_respond": "share of stop trials with a response",
    "ssrt_ms": "stop-signal reaction time by integration, ms: the quantile of the go times at "
    "p_respond, minus the delay, averaged over delays with a p_respond of 0.25 to 0.75",
    "failed_minus_go_ms": "mean time of failed stops minus that of go trials, ms",
}
"""Measures of a task with stop signals; there ``MEASURES`` are those of its go trials."""
P_RANGE = (0.25, 0.75)
"""Probability of responding on stop trials within which the consensus guide (Verbruggen et al.
2019) accepts an estimate of the stop-signal reaction time."""
OF_DIFFUSION = ("drift", "boundary_separation", "non_decision_ms")
"""Measures estimated by EZ-diffusion."""
NO_DIFFUSION = (
    "no diffusion that starts half-way between its bounds produces these choices and times (its "
    "non-decision time would be below 0, or its times do not vary); check choice_0 for a bias "
    "to one side"
)
"""Why they are not reported although the deadline cuts off few trials."""
OF_DECIDED = ("accuracy", "choice_0", "mean_ms", "median_ms", "mean_posterior", *OF_DIFFUSION)
"""Measures of the trials decided in time only."""
COUNTED = {"accuracy": ("accuracy_all", "accuracy_best"), "mean_ms": ("mean_all_ms",)}
"""For measures of decided trials, the measures of all trials that bound them: for accuracy both
ends of the range; for times the lower one, since missed trials take at least until the deadline."""
OF_ALL = tuple(name for names in COUNTED.values() for name in names)
SHARES = (
    *("accuracy", "choice_0", "accuracy_all", "accuracy_best"),
    *("premature", "anticipatory", "missed", "mean_posterior", "p_respond"),
)
"""Measures between 0 and 1."""


@dataclass(frozen=True)
class Behaviour:
    """Decisions of one circuit at one threshold, and its anticipatory responses."""

    decision: Decision  # with truth; trials forced by the deadline are missed
    posterior: Array  # (trials,), of the choice, by the readings up to it
    anticipatory: Truths  # (trials,), a separate foreperiod ended in a response
    hypotheses: int
    ssd_ms: Array | None = None  # (trials,), stop-signal delays; NaN in go trials

    @property
    def go(self) -> Truths:
        """Which trials have no stop signal, (trials,)."""
        return np.isnan(self.ssd_ms) if self.ssd_ms is not None else ~np.zeros_like(self.missed)

    @property
    def missed(self) -> Truths:
        """Which trials have no response in time, (trials,)."""
        return self.decision.forced

    def columns(self) -> dict[str, Array | Truths]:
        """Return the columns that a table of trials has besides the decisions."""
        added = {} if self.ssd_ms is None else {"ssd_ms": self.ssd_ms}
        return {"anticipatory": self.anticipatory, **added}

    def in_time(self) -> Decision:
        """Return the decisions, with missed trials undecided."""
        return replace(unforced(self.decision), deadline_ms=self.decision.time_ms, truth=None)

    def measures(self, weights: Array) -> dict[str, Array]:
        """Return every one of ``MEASURES``, (B,) each, for weights (B, trials).

        With stop signals, these are of go trials, and those of ``OF_STOP`` are added. NaN if no
        trial that counts has a weight. The mean posterior is computed from the
        likelihoods as given; times, accuracy and mean posterior are those of trials decided in
        time. Diffusion parameters are NaN with more than two alternatives, if the deadline cuts off
        more than ``CUT_OFF`` of all trials, and if the non-decision time of all trials, equally
        weighted, is below 0.
        """
        stopping = {} if self.ssd_ms is None else self._stopping(self.ssd_ms, weights)
        weights = weights * self.go
        missed, time_ms = self.missed, self.decision.time_ms
        correct = self.decision.choice == self.decision.truth
        everyone = np.ones_like(missed)
        measures = {
            "accuracy": mean(correct, ~missed, weights),
            "choice_0": mean(self.decision.choice == 0, ~missed, weights),
            "mean_ms": mean(time_ms, ~missed, weights),
            "median_ms": median(time_ms, ~missed, weights),
            "accuracy_all": mean(correct & ~missed, everyone, weights),
            "accuracy_best": mean(correct | missed, everyone, weights),
            "mean_all_ms": mean(time_ms, everyone, weights),
            "premature": mean(self.decision.premature, everyone, weights),
            "anticipatory": mean(self.anticipatory, everyone, weights),
            "missed": mean(missed, everyone, weights),
            "decided": weights @ ~missed,
            "mean_posterior": mean(self.posterior, ~missed, weights),
        }
        # A diffusion has two boundaries.
        of_two = self.hypotheses == 2 and missed[self.go].mean() <= CUT_OFF
        if (
            not of_two
            or self._diffusion(self.go[None].astype(np.float64))["non_decision_ms"][0] < 0
        ):
            measures |= {name: np.full(len(weights), np.nan) for name in OF_DIFFUSION}
        else:
            measures |= self._diffusion(weights)
        return measures | stopping

    def against_evidence(self) -> str:
        """Return a warning if decisions in time go against the evidence, or an empty string."""
        return against_evidence(self.posterior[self.go & ~self.missed], self.hypotheses)

    def _stopping(self, ssd_ms: Array, weights: Array) -> dict[str, Array]:
        """Return the measures ``OF_STOP``."""
        responded, time_ms = ~self.missed, self.decision.time_ms
        failed = ~self.go & responded
        go_ms = mean(time_ms, self.go & responded, weights)
        total, sums = np.zeros(len(weights)), np.zeros(len(weights))
        for delay in np.unique(ssd_ms[~self.go]):
            here = ssd_ms == delay
            if P_RANGE[0] <= responded[here].mean() <= P_RANGE[1]:
                count = weights @ here
                p = mean(responded, here, weights)
                sums += np.nan_to_num(count * (self._quantile_of_go(p, weights) - delay))
                total += count
        ssrt_ms = np.full(len(weights), np.nan)
        np.divide(sums, total, out=ssrt_ms, where=total > 0)
        return {
            "p_respond": mean(responded, ~self.go, weights),
            "ssrt_ms": ssrt_ms,
            "failed_minus_go_ms": mean(time_ms, failed, weights) - go_ms,
        }

    def _quantile_of_go(self, p: Array, weights: Array) -> Array:
        """Return the n-th shortest go time, n = p times their number; omissions are the longest."""
        go_ms = np.where(self.missed, np.inf, self.decision.time_ms)[self.go]
        go_ms[np.isinf(go_ms)] = go_ms[np.isfinite(go_ms)].max(initial=0.0)
        order = np.argsort(go_ms, kind="stable")
        up_to = np.cumsum(weights[:, self.go][:, order], axis=1)
        # A little less, for rounding: p is a ratio of the same weights.
        below = up_to < (p * up_to[:, -1])[:, None] - 1e-9
        return np.asarray(go_ms[order][np.minimum(below.sum(axis=1), len(order) - 1)])

    def _diffusion(self, weights: Array) -> dict[str, Array]:
        """Return the measures ``OF_DIFFUSION``, unchecked."""
        decided, time_ms = ~self.decision.forced, self.decision.time_ms
        right = decided & (self.decision.choice == self.decision.truth)
        accuracy, mean_s = mean(right, decided, weights), mean(time_ms, right, weights) / 1e3
        variance = mean((time_ms / 1e3) ** 2, right, weights) - mean_s**2
        drift, bound, other_s = ez_diffusion(accuracy, mean_s, variance, weights @ decided)
        return dict(zip(OF_DIFFUSION, (drift, bound, 1e3 * other_s), strict=True))


def unforced(decision: Decision) -> Decision:
    """Return decisions with those undecided that the deadline made."""
    missed = decision.forced
    return replace(
        decision,
        choice=np.where(missed, UNDECIDED, decision.choice),
        time_ms=np.where(missed, np.nan, decision.time_ms),
        forced=np.zeros_like(missed),
    )


def mean(values: npt.ArrayLike, among: Truths, weights: Array) -> Array:
    """Return the mean of values (trials,) over a subset of trials, (B,); NaN if it is empty."""
    total = weights @ among
    sums = weights @ np.where(among, values, 0)
    means = np.full(len(weights), np.nan)
    np.divide(sums, total, out=means, where=total > 0)
    return means


def median(values: npt.ArrayLike, among: Truths, weights: Array) -> Array:
    """Return the median of values (trials,) over a subset of trials, (B,); NaN if it is empty."""
    chosen = np.asarray(values)[among]
    if not len(chosen):
        return np.full(len(weights), np.nan)
    order = np.argsort(chosen, kind="stable")
    chosen, up_to = chosen[order], np.cumsum(weights[:, among][:, order], axis=1)
    half = up_to[:, -1:] / 2
    last = len(chosen) - 1
    # The middle value, or the mean of the two middle values.
    low = np.minimum((up_to < half).sum(axis=1), last)
    high = np.minimum((up_to <= half).sum(axis=1), last)
    return np.where(half[:, 0] > 0, (chosen[low] + chosen[high]) / 2, np.nan)


def ez_diffusion(
    accuracy: npt.ArrayLike, mean_s: npt.ArrayLike, variance: npt.ArrayLike, trials: npt.ArrayLike
) -> tuple[Array, Array, Array]:
    """Return drift, boundary separation and non-decision time (s) of EZ-diffusion.

    Mean and variance (s, s^2) are those of correct responses. Wagenmakers, van der Maas & Grasman
    2007, equations 5 and 7 to 9, with l = logit P and s = 0.1:
    ``v = sign(P - 1/2) s (l (P^2 l - P l + P - 1/2) / VRT)^(1/4)``, ``a = s^2 l / v``,
    ``Ter = MRT - (a / 2 v) (1 - e^y) / (1 + e^y)``, ``y = -v a / s^2``. The starting point is
    half-way between the boundaries and no parameter varies between trials. The distribution
    includes late decisions: if many trials are cut off, the variance is too small and the drift too
    large. A P of 1, 0 or 1/2 is moved by half a trial, as they advise for 1.
    """
    p, mean_s, variance, half = np.broadcast_arrays(
        *(np.asarray(x, dtype=np.float64) for x in (accuracy, mean_s, variance, trials))
    )
    half = 0.5 / np.maximum(half, 1)
    p = np.clip(p, half, 1 - half)
    p = np.where(np.abs(p - 0.5) < half / 2, 0.5 + half, p)
    with np.errstate(invalid="ignore", divide="ignore"):
        odds = np.log(p / (1 - p))
        power = odds * (p**2 * odds - p * odds + p - 0.5) / variance
        drift = (
            np.sign(p - 0.5)
            * DIFFUSION_S
            * np.where(variance > LEAST_VARIANCE, power, np.nan) ** 0.25
        )
        bound = DIFFUSION_S**2 * odds / drift
        y = -drift * bound / DIFFUSION_S**2
        time_s = bound / (2 * drift) * (1 - np.exp(y)) / (1 + np.exp(y))
    return drift, bound, mean_s - time_s

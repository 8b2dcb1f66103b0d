"""Learned weights: as evidence, against exact likelihoods, and against counts with the truth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bgmodel.deciding.tradeoff import curve, time_at, tradeoff
from bgmodel.evidence import Evidence, needed_truth
from bgmodel.integrators.at_thresholds import CIRCUIT, decide_at_thresholds
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import deciding_thresholds
from bgmodel.integrators.sprt import Msprt
from bgmodel.learning.features import Features
from bgmodel.support.checks import check_positive, check_range, is_whole
from bgmodel.support.saved import Facts, span
from circuits.arrays import Array, Integers, Reals, Truths
from circuits.errors import InputError, require

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DRAWN = 1000
"""Most readings in a plot."""


@dataclass(frozen=True)
class WeightCourse:
    """The course of learning."""

    kept: Integers  # (times,), trials after which weights were kept
    weights: Array  # (runs, times, hypotheses, units)
    correct: Truths  # (runs, trials)
    readings: Array  # (runs, trials), before the choice
    confidence: Array  # (runs, trials), posterior of the choice by the weights then
    final: Array  # (runs, hypotheses, units), mean over the last trials


@dataclass(frozen=True)
class Calibration:
    """Learned against exact log-likelihood ratios of single readings, one value per run."""

    slope: Array  # (runs,), nats per exact nat, least squares; 1 is calibrated
    r: Array  # (runs,), correlation with the exact ratios


@dataclass(frozen=True, repr=False)
class LearnedWeights(Facts):
    """Weights of several runs, from sensory units to channels."""

    weights: Array  # (runs, hypotheses, units), nats per unit of activity
    names: tuple[str, ...]
    # Nats of drive per nat of evidence in learning: a calibrated drive is gain * weights @ phi.
    gain: float = 1.0
    course: WeightCourse | None = None

    def __post_init__(self) -> None:
        fits = self.weights.ndim == 3 and self.weights.shape[1] == len(self.names)
        must = f"must be of shape (runs, {len(self.names)}, units)"
        require(fits, "weights", must, self.weights.shape)
        check_positive(gain=self.gain)

    def facts(self) -> dict[str, str]:
        """Return runs, hypotheses, units and the range of weights."""
        facts = {
            "runs": f"{self.runs}",
            "hypotheses": " ".join(self.names),
            "units": f"{self.weights.shape[2]}",
            "weights": span(self.weights),
        }
        if self.course is not None:
            facts["trials"] = f"{self.course.correct.shape[1]}"
        return facts

    @property
    def runs(self) -> int:
        """Number of runs."""
        return len(self.weights)

    def after(self, trials: int, averaged: float = 0.0) -> LearnedWeights:
        """Return the weights kept last within some trials, or their mean over a last share."""
        course = self.course
        if course is None:
            raise InputError.of("trials", "must be one at which weights were kept", trials)
        check_range(course.kept[0], course.kept[-1], trials=trials)
        check_range(0, 1, averaged=averaged)
        last = int(np.searchsorted(course.kept, trials, side="right"))
        first = int(np.searchsorted(course.kept, (1 - averaged) * trials, side="right"))
        kept = course.weights[:, min(first, last - 1) : last]
        return replace(self, weights=kept.mean(axis=1))

    def log_likelihoods(self, features: Features, run: int = 0) -> Array:
        """Return learned log-likelihoods (trials, steps, hypotheses) up to a common term, nats."""
        self._check_fits(features)
        inside = is_whole(run) and 0 <= run < self.runs
        require(inside, "run", f"must be 0..{self.runs - 1}", run)
        return np.asarray(features.values @ self.weights[int(run)].T)

    def to_evidence(self, features: Features, run: int = 0) -> Evidence:
        """Return the learned drive of one run as evidence, for a test or a circuit.

        D1 and STN of a circuit both receive it, as they receive any evidence.
        """
        return features.evidence(self.log_likelihoods(features, run))

    def calibration(self, features: Features) -> Calibration:
        """Compare learned with exact log-likelihood ratios on held-out readings.

        Each ratio is a hypothesis's log-likelihood minus the mean over hypotheses.
        """
        read = np.arange(features.steps) < features.readings[:, None]
        exact = _centred(features.exact.log_likelihood[read])
        slope, r = np.empty(self.runs), np.empty(self.runs)
        for run in range(self.runs):
            learned = _centred(self.gain * self.log_likelihoods(features, run)[read])
            both = (learned * exact).mean()
            with np.errstate(invalid="ignore"):  # uninformative readings have no slope
                slope[run] = both / (exact**2).mean()
            r[run] = both / np.sqrt(max((exact**2).mean() * (learned**2).mean(), 1e-300))
        return Calibration(slope, r)

    def relative_time(self, features: Features, accuracy: float = 0.9) -> Array:
        """Return mean decision times at equal accuracy relative to the exact likelihoods, (runs,).

        Both are those of the MSPRT on the same held-out readings; NaN if weights never reach the
        accuracy.
        """
        exact = time_at_accuracy(features.exact, accuracy)
        drives = [self.to_evidence(features, run) for run in range(self.runs)]
        times = [time_at_accuracy(drive, accuracy) for drive in drives]
        return np.array(times) / exact

    def plot(self, features: Features, run: int = 0, ax: Axes | None = None) -> Figure:
        """Draw learned against exact log-likelihoods of held-out readings, ``DRAWN`` at most.

        Each hypothesis is compared with the mean over hypotheses.
        """
        from bgmodel.plots import learned_ratios

        read = np.arange(features.steps) < features.readings[:, None]
        exact = _centred(features.exact.log_likelihood[read])[:DRAWN]
        learned = _centred(self.gain * self.log_likelihoods(features, run)[read])[:DRAWN]
        return learned_ratios(exact, learned, ax)

    def to_dataframe(self) -> pd.DataFrame:
        """Return the weights as a table: run, hypothesis, unit, weight."""
        import pandas as pd

        runs, _, units = self.weights.shape
        index = pd.MultiIndex.from_product(
            [range(runs), self.names, range(units)], names=["run", "hypothesis", "unit"]
        )
        return pd.DataFrame({"weight": self.weights.ravel()}, index=index).reset_index()

    def _check_fits(self, features: Features) -> None:
        must = f"must have {self.weights.shape[2]} units and the hypotheses {self.names}"
        fits = features.units == self.weights.shape[2] and features.names == self.names
        require(fits, "features", must, f"{features.units} units, {features.names}")


def counted_weights(features: Features, readings: int | None = None) -> LearnedWeights:
    """Return weights from counts with the truth known, for comparison with those from reward.

    ``w_ik`` is the logarithm of the mean activity of unit k under hypothesis i, with half a unit of
    activity added to each sum. This gives the log-likelihoods of a histogram, or of Poisson cells
    whose mean summed activity is the same under all hypotheses.
    """
    raw = features.values if features.removed is None else features.values + features.removed
    read = np.arange(features.steps) < features.readings[:, None]
    values, truth = raw[read], np.repeat(features.truth, features.readings)
    if readings is not None:
        # Readings of different trials: those of one trial share their truth.
        order = np.argsort(np.tile(np.arange(features.steps), features.trials)[read.ravel()],
                           kind="stable")[:readings]  # fmt: skip
        values, truth = values[order], truth[order]
    rows = []
    for i, name in enumerate(features.names):
        some = values[truth == i]
        if not len(some):
            raise InputError(f"no reading belongs to the hypothesis {name!r}", "readings")
        rows.append(np.log((some.sum(axis=0) + 0.5) / len(some)))
    return LearnedWeights(np.array(rows)[None], features.names)


def time_at_accuracy(evidence: Evidence, accuracy: float) -> float:
    """Return the mean decision time of the MSPRT at a proportion correct, ms; NaN if never."""
    # Leads of 0.001 to 20 nats over the others: weights that are not calibrated need a wide range.
    lead = np.geomspace(1e-3, 20.0, 300)
    thresholds = np.log1p((evidence.hypotheses - 1) * np.exp(-lead))
    swept = tradeoff(Msprt().run(evidence), evidence, thresholds)
    # The proportion correct, because learned posteriors need not be calibrated.
    right = (swept.choice == evidence.truth).astype(np.float64)
    curves = curve(replace(swept, posterior=right), np.ones((1, evidence.trials)))
    return float(time_at([accuracy], curves)[0, 0])


def circuit_time_at_accuracy(model: BasalGanglia, evidence: Evidence, accuracy: float) -> float:
    """Return the mean decision time of a circuit at a proportion correct, ms.

    The threshold is set accordingly; NaN if no threshold that the circuit can use reaches it.
    """
    truth = needed_truth(evidence)
    low = model.circuit.readable_nats[0]
    levels = deciding_thresholds(model.circuit, np.geomspace(low, np.log(evidence.hypotheses), 60))
    swept = decide_at_thresholds(model, evidence, levels, decoder_tau_ms=None)[CIRCUIT]
    right = (swept.choice == truth).astype(np.float64)
    curves = curve(replace(swept, posterior=right), np.ones((1, evidence.trials)))
    return float(time_at([accuracy], curves)[0, 0])


def _centred(ratios: Reals) -> Array:
    return np.asarray(ratios - ratios.mean(axis=-1, keepdims=True))

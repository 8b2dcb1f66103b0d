"""Compare a circuit with the MSPRT, trial by trial."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.bootstrap import RESAMPLES, check_resamples, check_trials, resampled
from bgmodel.comparison.edited import check_edit_of
from bgmodel.comparison.matched import (
    ACCURACIES,
    MINUS_INTACT,
    OTHER_NOISE,
    checked_accuracies,
    matched_measures,
    paired,
    warn_of_missed,
)
from bgmodel.comparison.page import draw
from bgmodel.comparison.thresholds import (
    MSPRT,
    references,
    tuned_thresholds,
    unreached,
    without_accuracies,
)
from bgmodel.deciding.tradeoff import Tradeoff, tradeoff
from bgmodel.evidence import Evidence, check_evidence
from bgmodel.integrators.at_thresholds import (
    CIRCUIT,
    HIGHEST,
    LOWEST,
    decide_at_thresholds,
    refined,
)
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.baselines import BASELINES, baselines_on
from bgmodel.support.checks import check_flag
from bgmodel.support.saved import Facts
from bgmodel.support.seeds import stream
from bgmodel.support.tables import Readable
from circuits.anatomy import checked_circuit
from circuits.arrays import Array
from circuits.circuit import Circuit
from circuits.errors import DataWarning, InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUMMARY = ("agreement", "agreement_chance", "pearson_r", "extra_ms", "accuracy_gap")
"""Measures of ``Comparison.summary``."""


def with_other_noise(model: BasalGanglia, evidence: Evidence, swept: Tradeoff) -> Tradeoff:
    """Return a circuit's decisions with noise of another seed, or ``swept`` if it has no noise."""
    if not model.engine.noisy:
        return swept
    seed = int(stream(model.seed or 0, OTHER_NOISE).integers(2**31))
    again = replace(model, seed=seed)
    return decide_at_thresholds(again, evidence, swept.settings, decoder_tau_ms=None)[CIRCUIT]


@dataclass(frozen=True, repr=False)
class Comparison(Facts):
    """A circuit, baseline models and the MSPRT on the same evidence.

    Parameters
    ----------
    model : BasalGanglia
        The circuit, at the gain that the evidence was run with.
    trials : int
        Number of trials.
    table : DataFrame
        One row per model, reference, accuracy and measure: the columns of ``matched_measures``
        plus model and reference.
    curves : DataFrame
        Speed-accuracy tradeoff: model, threshold, accuracy (expected), low, high (its pointwise
        95 % interval, the same bootstrap), mean_ms, one row per model and threshold.
    pairs : DataFrame
        Choices and times of the circuit and of the first reference, trial by trial, at each
        accuracy that is reached, with the columns of ``paired``.
    """

    model: BasalGanglia
    trials: int
    table: pd.DataFrame
    curves: pd.DataFrame
    pairs: pd.DataFrame

    def facts(self) -> dict[str, str]:
        """Return the circuit, and agreement and extra time at each accuracy."""
        texts = {
            "circuit": self.model.circuit.name,
            "engine": self.model.engine.id,
            "gain": f"{self.model.gain:g}",
            "trials": f"{self.trials}",
        }
        for row in self.summary().query("model == @CIRCUIT").itertuples():
            text = f"agreement {row.agreement:.3f}, extra time {row.extra_ms:.0f} ms"
            texts[f"{row.reference} at {row.accuracy:g}"] = text
        return texts

    def summary(self) -> pd.DataFrame:
        """Return the main measures, one row per reference, model and accuracy."""
        rows = self.table[self.table["measure"].isin(SUMMARY)]
        by = ["reference", "model", "accuracy"]
        wide = rows.pivot(index=by, columns="measure", values="value").reset_index()
        order = rows[by].drop_duplicates().merge(wide, on=by)
        return Readable(order[[*by, *(name for name in SUMMARY if name in order)]].round(3))

    def to_dataframe(self) -> pd.DataFrame:
        """Return ``table``."""
        return self.table

    def plot(self) -> Figure:
        """Draw the speed-accuracy trade-off, decision times trial by trial, and agreement.

        Panel a: expected accuracy over mean decision time, one line per model, with pointwise 95 %
        intervals (bootstrap over trials). Panel b: decision times of the circuit over those of
        the first reference, with thresholds matched at the lowest accuracy that is reached; one
        point per trial, or their density if there are more than 2000. Panel c: share of trials
        with the same choice at each accuracy, and by chance, with 95 % intervals.
        """
        return draw(self.curves, self.pairs, self.table, 1 / self.model.circuit.channels)


def compare(
    model: BasalGanglia | Circuit | str,
    evidence: Evidence,
    *,
    seed: int | None = None,
    baselines: Sequence[str] | str = (),
    accuracies: Sequence[float] | float = ACCURACIES,
    resamples: int = RESAMPLES,
    intact: Circuit | str | None = None,
    noise_ceiling: bool = False,
    groups: npt.ArrayLike | None = None,
) -> Comparison:
    """Compare a circuit, a decoder of its input and baseline models with the MSPRT.

    Parameters
    ----------
    model : BasalGanglia, Circuit or str
        The circuit with its engine, gain and noise; a circuit, a name or a .toml file runs on the
        population engine.
    evidence : Evidence
        Readings of all trials, at least 100.
    seed : int, optional
        Seed of the bootstrap and, if ``model`` is not a BasalGanglia, of its noise; by default that
        of the model.
    baselines : sequence of str
        Names in ``BASELINES`` of models to include. "race" and "LCA" need evidence in which zero
        means no evidence, such as that of ``gaussian_evidence``.
    accuracies : sequence of float
        Expected accuracies at which thresholds are matched.
    resamples : int
        Number of bootstrap resamples.
    groups : array (trials,), optional
        Group of each trial, such as its fold of taps, for a bootstrap over groups.
    intact : Circuit or str, optional
        The circuit before its edits. It is run on the same evidence with the same noise, and rows
        of the model ``MINUS_INTACT`` hold the measures of the edited circuit minus those of the
        intact one, with the interval of the difference.
    noise_ceiling : bool
        Whether to run the circuit again with noise of another seed: rows of the reference
        ``OTHER_NOISE`` compare the two runs, which gives the highest agreement to be expected, and
        ``r_noise_corrected`` is computed. A circuit without noise is not run again.

    Returns
    -------
    Comparison
        Baseline models have no latency to subtract, and are compared only with the MSPRT at full
        gain.

    Raises
    ------
    ValueError
        If there are too few trials, a name is unknown, the circuit would decide without evidence,
        or it is not an edit of ``intact``.

    Warns
    -----
    UserWarning
        If the circuit does not reach one of the accuracies at any threshold that is within the
        range of its read-out and not crossed by noise at rest; its measures are then NaN at that
        accuracy. If the readings do not suffice for an accuracy, or a baseline model does not reach
        it. If posteriors at the decision are not calibrated.
    """
    baselines = _checked(evidence, baselines)
    if not isinstance(model, BasalGanglia):
        circuit = checked_circuit(model, evidence.hypotheses)
        model = BasalGanglia(circuit, "population", seed=0 if seed is None else seed)
    model = model.adapted_to(evidence)
    seed = (model.seed or 0) if seed is None else seed
    accuracies = checked_accuracies(accuracies, evidence.hypotheses)
    check_resamples(resamples, groups)
    check_flag("noise_ceiling", noise_ceiling)
    if intact is not None:
        intact = checked_circuit(intact, evidence.hypotheses)
        check_edit_of(intact, model.circuit, "circuit")
        if intact == model.circuit:
            raise InputError(f"intact must differ: no edit changed {intact.name}", "intact")
    model.warn_beyond_range(evidence)
    tests, allowed = references(model, evidence, accuracies)
    first = next(iter(tests))
    span = {"highest": max(HIGHEST, *accuracies), "lowest": min(LOWEST, *accuracies)}
    tradeoffs = decide_at_thresholds(model, evidence, tuned_thresholds(model, tests[first], **span))
    tradeoffs[CIRCUIT] = refined(model, evidence, tradeoffs[CIRCUIT], allowed)
    lost = unreached(
        model, tradeoffs[CIRCUIT], tests[first], allowed, name=model.circuit.name, before=intact
    )
    shared = [accuracy for accuracy in allowed if accuracy not in lost]
    for name, decided in tradeoffs.items():
        shared = warn_of_missed(model.circuit.name if name == CIRCUIT else name, decided, shared)
    pairs = [(name, reference) for reference in tests for name in tradeoffs]
    again = with_other_noise(model, evidence, tradeoffs[CIRCUIT]) if noise_ceiling else None
    if again is not None:
        tests[OTHER_NOISE] = again
        pairs.append((CIRCUIT, OTHER_NOISE))
    for name in baselines:
        trace = BASELINES[name]().run(evidence)
        tradeoffs[name] = tradeoff(trace, evidence, accuracies=accuracies)
        warn_of_missed(name, tradeoffs[name], allowed)
        pairs.append((name, MSPRT))
    weights = resampled(evidence.trials, resamples, stream(seed, "bootstrap"), groups)
    curves = _curves(tests | tradeoffs, weights)
    before = None
    if intact is not None:
        unedited = replace(model, circuit=intact)
        levels = tuned_thresholds(unedited, tests[first], **span)
        before = decide_at_thresholds(unedited, evidence, levels, decoder_tau_ms=None)[CIRCUIT]
        before = refined(unedited, evidence, before, shared)
        warn_of_missed(f"{intact.name} before its edits", before, shared)
        tradeoffs[MINUS_INTACT] = tradeoffs[CIRCUIT]
        pairs.append((MINUS_INTACT, first))
    parts = []
    for name, reference in pairs:
        late = name not in BASELINES and reference != OTHER_NOISE
        table = matched_measures(
            tests[reference],
            tradeoffs[name],
            rng=stream(seed, "bootstrap"),
            truth=evidence.truth,
            minus=before if name == MINUS_INTACT else None,
            again=again if name == CIRCUIT and reference != OTHER_NOISE else None,
            latency_ms=None if late else 0.0,
            accuracies=accuracies,
            resamples=resamples,
            groups=groups,
        )
        of_circuit = name in (CIRCUIT, MINUS_INTACT)
        table = without_accuracies(table, lost) if of_circuit else table
        parts.append(table.assign(model=name, reference=reference))
    measures = pd.concat(parts, ignore_index=True)
    choices = paired(tests[first], tradeoffs[CIRCUIT], _reached(measures, first))
    return Comparison(model, evidence.trials, measures, curves, choices)


def _reached(table: pd.DataFrame, reference: str) -> list[float]:
    """Return the accuracies at which the circuit is compared with a reference."""
    of = (table["model"] == CIRCUIT) & (table["reference"] == reference)
    known = table[of & (table["measure"] == "agreement") & table["value"].notna()]
    return [float(accuracy) for accuracy in known["accuracy"]]


def _checked(evidence: Evidence, baselines: Sequence[str] | str) -> Sequence[str]:
    """Return the names of baseline models; ValueError if they or the evidence do not fit."""
    check_trials(check_evidence(evidence).trials)
    copies = evidence.trials - len(np.unique(evidence.trial_numbers))
    if copies:
        DataWarning.warn(
            f"{copies} of {evidence.trials} trials are copies of others: intervals count each as "
            "an independent trial"
        )
    baselines = [baselines] if isinstance(baselines, str) else baselines
    if not isinstance(baselines, (list, tuple)) or not all(
        name in list(BASELINES) for name in baselines
    ):
        raise InputError.of("baselines", f"must be among {', '.join(BASELINES)}", baselines)
    for name in baselines:
        if evidence.baseline and name not in baselines_on(zero_is_nothing=False):
            needs = "needs evidence in which zero means no evidence"
            conflict = f"{name} {needs}, but readings have a mean of {evidence.baseline:.3g} nats"
            raise InputError(conflict, "baselines")
    return baselines


def _curves(models: Mapping[str, Tradeoff], weights: Array) -> pd.DataFrame:
    """Return expected accuracy with its interval, and mean time, at every threshold."""
    share = weights / weights.sum(axis=1, keepdims=True)
    parts = []
    for name, swept in models.items():
        if name != OTHER_NOISE:
            low, high = np.quantile(share[1:] @ swept.posterior.T, [0.025, 0.975], axis=0)
            columns = {
                "threshold": swept.settings,
                "accuracy": swept.posterior.mean(axis=1),
                "low": low,
                "high": high,
                "mean_ms": swept.time_ms.mean(axis=1),
            }
            parts.append(pd.DataFrame(columns).assign(model=name))
    return pd.concat(parts, ignore_index=True)[["model", *columns]]

"""Circuits and edited circuits held against the MSPRT, its decoder and its rivals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.comparison.compare import (
    ACCURACIES,
    MARGIN,
    MINUS_INTACT,
    RESAMPLES,
    Tradeoff,
    check_trials,
    compare,
    tradeoff,
)
from bgmodel.comparison.decoder import decoded
from bgmodel.comparison.steady import out_shift
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import (
    ROUNDING_NATS,
    BasalGanglia,
    deciding_thresholds,
    rest_out,
)
from bgmodel.integrators.rivals import RIVALS
from bgmodel.integrators.sprt import Msprt
from bgmodel.progress import advance
from bgmodel.seeds import stream
from circuits.engines import NOISY
from circuits.spec import NATS, Circuit

CIRCUIT, DECODER = "circuit", "cortical decoder"
MSPRT_AT_GAIN, MSPRT = "MSPRT at its gain", "MSPRT"
DECODER_TAU_MS = 20.0
THRESHOLDS = 120
LOWEST_NATS = 1e-3
HIGHEST = 0.98
BELOW_NATS = 0.04
"""How far below the lowest threshold a trial is dropped: mostly its decoder is there by then."""


def references(model: BasalGanglia, evidence: Evidence) -> dict[str, Tradeoff]:
    """Return the tests that a circuit is held to: without nats no MSPRT has its gain."""
    found = msprt_tradeoffs(evidence, model.gain)
    return found if model.circuit.unit == NATS else {MSPRT: found[MSPRT]}


def sample_ms(step_ms: float) -> float:
    """Return the time between samples of OUT: 1 ms, or a fiftieth of slow readings."""
    return step_ms / 50 if step_ms >= 100 and step_ms % 50 == 0 else 1.0


def msprt_tradeoffs(evidence: Evidence, gain: float) -> dict[str, Tradeoff]:
    """Return the two references: the MSPRT at the circuit's gain, and the full one."""
    return {
        MSPRT_AT_GAIN: tradeoff(Msprt(gain).run(evidence), evidence),
        MSPRT: tradeoff(Msprt().run(evidence), evidence),
    }


def thresholds_about(test: Tradeoff, highest: float = HIGHEST) -> npt.NDArray[np.float64]:
    """Return thresholds for a circuit, nats, around the test's at accuracies from .80 to highest.

    A circuit's OUT follows the test's with a delay: its thresholds lie near, mostly below.
    """
    low, high = 0.7 * test.setting(highest), 1.3 * test.setting(0.80)
    # Where the evidence is strong enough, the test's reaches 0.
    return np.geomspace(max(high, 2 * LOWEST_NATS), max(low, LOWEST_NATS), THRESHOLDS)


def thresholds_of(
    circuit: Circuit, test: Tradeoff, highest: float = HIGHEST
) -> npt.NDArray[np.float64]:
    """Return those of ``thresholds_about`` that a circuit reads, and is not past without evidence.

    Without nats they lie evenly from OUT at rest down to the lowest that is read.

    Raises
    ------
    ValueError
        If there is none: the circuit would decide without evidence at each.
    """
    if circuit.unit != NATS:
        lowest = max(circuit.readable_nats[0], _silent(circuit))
        return np.linspace(rest_out(circuit), lowest, THRESHOLDS + 2)[1:-1]
    about = thresholds_about(test, highest)
    found = deciding_thresholds(circuit, about)
    if not found.size:
        raise ValueError(
            f"{circuit.name} rests at OUT = {rest_out(circuit):.2f} and reads none below "
            f"{circuit.readable_nats[0]:.2f}: at all thresholds, {about.min():.2f} to "
            f"{about.max():.2f} nats, it would decide without evidence, or never"
        )
    return found


def decide_at_thresholds(
    model: BasalGanglia,
    evidence: Evidence,
    thresholds: npt.ArrayLike,
    *,
    decoder_tau_ms: float | None = DECODER_TAU_MS,
) -> dict[str, Tradeoff]:
    """Return the decisions of a circuit and, if it has noise, of a decoder of its input.

    Parameters
    ----------
    model : BasalGanglia
        The circuit, its engine and its noise.
    evidence : Evidence
        What it is given.
    thresholds : array (K,), nats
        As from ``thresholds_about``.
    decoder_tau_ms : float, optional
        How long the decoder counts; None for no decoder.

    Notes
    -----
    Where the engine can, a trial is dropped once its OUT is a little below the lowest threshold. If
    the decoder has not crossed all thresholds by then, the trial is run again, to its end.
    """
    in_nats = model.circuit.unit == NATS
    decodes = in_nats and model.engine in NOISY and decoder_tau_ms is not None
    whole, lowest = model, float(np.min(thresholds))
    model = model.until(lowest - (BELOW_NATS if decodes else ROUNDING_NATS), rates=decodes)
    found: dict[str, Tradeoff] = {}
    first = 0
    for part, activity, trace in model.batches(evidence):
        traces = {CIRCUIT: trace}
        if decodes and decoder_tau_ms is not None:
            again = partial(whole.one_trial, part, first)
            traces[DECODER] = decoded(activity, trace, lowest, again, decoder_tau_ms)
        for name, trace in traces.items():
            new = tradeoff(trace, part, thresholds)
            found[name] = found[name] + new if name in found else new
        first += part.trials
        advance(part.trials)
    return found


def compare_with_msprt(
    model: BasalGanglia,
    evidence: Evidence,
    *,
    seed: int,
    rivals: Sequence[str] | None = None,
    accuracies: Sequence[float] = ACCURACIES,
    resamples: int = RESAMPLES,
    intact: Circuit | None = None,
) -> pd.DataFrame:
    """Compare a circuit, its decoder and the rivals with the MSPRT, decision by decision.

    Parameters
    ----------
    model : BasalGanglia
        The circuit.
    evidence : Evidence
        What all are given.
    seed : int
        Of the bootstrap.
    rivals : names, optional
        Which of ``RIVALS``, as from ``rivals_on``; all if left out.
    accuracies, resamples :
        As in ``comparison.compare``.
    intact : Circuit, optional
        The circuit before it was edited. It decides on the same evidence with the same noise, and
        rows of the model ``MINUS_INTACT`` hold the edited circuit's measures minus its own, with
        the interval of the difference.

    Returns
    -------
    DataFrame
        The columns of ``comparison.compare``, and model and reference. Rivals are abstract, with
        no latency to take off, and are held to the full MSPRT alone.

    Raises
    ------
    ValueError
        If there are too few trials, or a circuit would decide without evidence.
    """
    check_trials(evidence.trials)
    model.warn_beyond_range(evidence)
    tests = references(model, evidence)
    found = decide_at_thresholds(
        model, evidence, thresholds_of(model.circuit, next(iter(tests.values())))
    )
    _warn_of_noise(model, found[CIRCUIT], accuracies)
    pairs = [(name, reference) for reference in tests for name in found]
    for name in RIVALS if rivals is None else rivals:
        found[name] = tradeoff(RIVALS[name]().run(evidence), evidence)
        pairs.append((name, MSPRT))
    before = None
    if intact is not None:
        levels = thresholds_of(intact, next(iter(tests.values())))
        whole = replace(model, circuit=intact)
        before = decide_at_thresholds(whole, evidence, levels, decoder_tau_ms=None)[CIRCUIT]
        found[MINUS_INTACT] = found[CIRCUIT]
        pairs.append((MINUS_INTACT, next(iter(tests))))
    parts = []
    for name, reference in pairs:
        table = compare(
            tests[reference],
            found[name],
            rng=stream(seed, "bootstrap"),
            truth=evidence.truth,
            minus=before if name == MINUS_INTACT else None,
            latency_ms=0.0 if name in RIVALS else None,
            accuracies=accuracies,
            resamples=resamples,
        )
        parts.append(table.assign(model=name, reference=reference))
    return pd.concat(parts, ignore_index=True)


def compare_edits(
    model: BasalGanglia,
    edited: Mapping[str, Circuit],
    evidence: Evidence,
    *,
    seed: int,
    accuracies: Sequence[float] = ACCURACIES,
    resamples: int = RESAMPLES,
    highest: float = HIGHEST,
) -> pd.DataFrame:
    """Compare edited circuits with the MSPRT, and with the circuit as it is, on the same evidence.

    Parameters
    ----------
    model : BasalGanglia
        The circuit as it is.
    edited : mapping from names to circuits
        What is changed; noise and evidence are the same.
    evidence : Evidence
        What all are given.
    highest : float
        Accuracy up to which thresholds are tried: a lower one takes less time.

    Returns
    -------
    DataFrame
        The columns of ``comparison.compare``, and variant and kind: "value", against the MSPRT at
        the circuit's gain, thresholds tuned anew to equal accuracy; "change", that minus the
        circuit's as it is; "fixed", at the circuit's own threshold (accuracy, expected_accuracy,
        mean_ms, premature, forced and without_evidence, 1 where most trials decide before their
        first reading; without intervals).
    """
    check_trials(evidence.trials)
    model.warn_beyond_range(evidence)
    test = next(iter(references(model, evidence).values()))
    levels = thresholds_of(model.circuit, test, highest)
    intact = decide_at_thresholds(model, evidence, levels, decoder_tau_ms=None)[CIRCUIT]
    _warn_of_noise(model, intact, accuracies)
    parts = []
    for name, circuit in {"intact": model.circuit, **edited}.items():
        same = name == "intact"
        changed = replace(model, circuit=circuit)
        # Where the edit takes OUT, and where it was: for thresholds tuned anew and for the old.
        both = np.union1d(levels, levels + _moved(model.circuit, circuit, levels))
        both = both[both > _silent(circuit)]
        found = (
            intact
            if same
            else decide_at_thresholds(changed, evidence, both, decoder_tau_ms=None)[CIRCUIT]
        )
        for kind, minus in (("value", None), ("change", intact)):
            table = compare(
                test,
                found,
                rng=stream(seed, "bootstrap"),
                truth=evidence.truth,
                minus=minus,
                accuracies=accuracies,
                resamples=resamples,
            )
            parts.append(table.assign(variant=name, kind=kind))
        fixed = _at_threshold_of(intact, found, evidence, accuracies)
        parts.append(fixed.assign(variant=name, kind="fixed"))
    return pd.concat(parts, ignore_index=True)


def _warn_of_noise(model: BasalGanglia, found: Tradeoff, accuracies: Sequence[float]) -> None:
    """Warn if noise alone crosses the highest of the thresholds that are compared."""
    model.warn_of_noise(max(found.setting(accuracy) for accuracy in accuracies))


def _moved(
    before: Circuit, after: Circuit, levels: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Return the shift of OUT by an edit at each level; 0 where it is not known."""
    known = before.unit == NATS
    return np.nan_to_num(out_shift(before, after, levels)) if known else np.zeros_like(levels)


def _silent(circuit: Circuit) -> float:
    """Return the OUT of a read-out that does not fire, nats: no threshold below is ever met."""
    readout = circuit.population(circuit.readout)
    return -readout.baseline_hz / readout.gain_hz_per_nat


def _at_threshold_of(
    intact: Tradeoff, found: Tradeoff, evidence: Evidence, accuracies: Sequence[float]
) -> pd.DataFrame:
    rows = []
    for accuracy in accuracies:
        k = int(np.flatnonzero(found.settings == intact.setting(accuracy))[0])
        values = {
            "expected_accuracy": found.posterior[k].mean(),
            "mean_ms": found.time_ms[k].mean(),
            "premature": found.premature[k].mean(),
            "forced": found.forced[k].mean(),
            "without_evidence": found.without_evidence[k],
        }
        # At its own threshold the circuit as it is must have the accuracy that is named.
        at = intact.posterior[intact.settings == intact.setting(accuracy)].mean()
        reached = abs(at - accuracy) <= MARGIN
        if evidence.truth is not None:
            values["accuracy"] = (found.choice[k] == evidence.truth).mean()
        rows += [(accuracy, m, float(v) if reached else np.nan) for m, v in values.items()]
    return pd.DataFrame(rows, columns=["accuracy", "measure", "value"])


def at_rest(circuit: Circuit, *, seed: int, trials: int = 4, seconds: int = 5) -> pd.DataFrame:
    """Run a circuit of spiking cells without evidence.

    Returns
    -------
    DataFrame
        One row a nucleus: nucleus, rate_hz, and interval_cv, the coefficient of variation of a
        cell's inter-spike intervals, mean over cells with ten or more in a trial (NaN without).
    """
    names = tuple(row.name for row in circuit.populations if row.spiking)
    model = BasalGanglia(circuit, "ensemble", seed=seed, options={"spikes": names})
    # The first second is left out: the circuit settles.
    found = model.run_drive(np.zeros((trials, seconds + 1, circuit.channels)), step_ms=1000.0)
    rows = []
    for name, spikes in (found.spikes or {}).items():
        late = spikes.query("time_ms >= 1000")
        size = trials * circuit.population(name).neurons * found.rates_hz[name].shape[2]
        ordered = late.sort_values(["trial", "channel", "neuron", "time_ms"])
        cells = ordered.groupby(["trial", "channel", "neuron"])["time_ms"]
        intervals = cells.diff().groupby([ordered[k] for k in ("trial", "channel", "neuron")])
        known = intervals.agg(["count", "mean", "std"]).query("count >= 10")
        cv = float((known["std"] / known["mean"]).mean())
        rows.append({"nucleus": name, "rate_hz": len(late) / (size * seconds), "interval_cv": cv})
    return pd.DataFrame(rows)

"""Circuits and edited circuits held against the MSPRT, its decoder and its rivals."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.bootstrap import RESAMPLES, check_resamples, check_trials
from bgmodel.comparison.cautions import (
    listed,
    warn_of_ceiling,
    warn_of_own_ceiling,
)
from bgmodel.comparison.compare import (
    ACCURACIES,
    MINUS_INTACT,
    MOST_FORCED,
    OTHER_NOISE,
    checked_accuracies,
    compare,
)
from bgmodel.deciding.calibration import warn_of_calibration
from bgmodel.deciding.tradeoff import Tradeoff, curve, margin, tradeoff
from bgmodel.evidence import Evidence, check_evidence
from bgmodel.integrators.basal_ganglia import (
    NOISE_SHARE,
    BasalGanglia,
    deciding_thresholds,
    rest_out,
)
from bgmodel.integrators.deciding import (
    CIRCUIT,
    HIGHEST,
    LOWEST,
    decide_at_thresholds,
    is_noisy,
    silent_nats,
    thresholds_of,
    without_noise_alone,
)
from bgmodel.integrators.rivals import RIVALS
from bgmodel.integrators.sprt import Msprt
from bgmodel.integrators.steady import out_shift
from bgmodel.support.seeds import stream
from circuits.declaration.spec import NATS, Circuit
from circuits.engines import Ensemble

INTACT, AS_EDITED = "intact", "as edited"
MSPRT_AT_GAIN, MSPRT = "MSPRT at its gain", "MSPRT"


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


def with_other_noise(model: BasalGanglia, evidence: Evidence, found: Tradeoff) -> Tradeoff:
    """Return the decisions of a circuit with noise of another seed: the same, if it has none.

    Parameters
    ----------
    model, evidence :
        The circuit, and what it was given.
    found : Tradeoff
        What it decided.
    """
    if not is_noisy(model):
        return found
    seed = int(stream(model.seed or 0, OTHER_NOISE).integers(2**31))
    again = replace(model, seed=seed)
    return decide_at_thresholds(again, evidence, found.settings, decoder_tau_ms=None)[CIRCUIT]


def compare_with_msprt(
    model: BasalGanglia,
    evidence: Evidence,
    *,
    seed: int,
    rivals: Sequence[str] | None = None,
    accuracies: Sequence[float] | float = ACCURACIES,
    resamples: int = RESAMPLES,
    intact: Circuit | None = None,
    ceiling: bool = False,
    groups: npt.ArrayLike | None = None,
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
    accuracies, resamples, groups :
        As in ``comparison.compare``.
    intact : Circuit, optional
        The circuit before it was edited. It decides on the same evidence with the same noise, and
        rows of the model ``MINUS_INTACT`` hold the edited circuit's measures minus its own, with
        the interval of the difference.
    ceiling : bool
        Whether the circuit decides a second time, with noise of another seed: rows of the reference
        ``OTHER_NOISE`` hold it to itself, and ``pearson_r_of_ceiling`` is known. Without noise it
        is not run: it would decide the same.

    Returns
    -------
    DataFrame
        The columns of ``comparison.compare``, and model and reference. Rivals are abstract, with
        no latency to take off, and are held to the full MSPRT alone.

    Raises
    ------
    ValueError
        If there are too few trials, a circuit would decide without evidence, or it is no edit of
        the intact one.

    Warns
    -----
    UserWarning
        If the circuit does not reach an accuracy at a threshold that its OUT reads, and that noise
        at rest does not cross: all measures are NaN there. If the readings, or a rival, do not
        reach one. If posteriors at the decision are not the share of right choices.
    """
    check_trials(check_evidence(evidence).trials)
    accuracies = checked_accuracies(accuracies, evidence.hypotheses)
    check_resamples(resamples, groups)
    if intact is not None:
        check_edit_of(intact, model.circuit, "circuit")
    if intact == model.circuit:
        raise ValueError(f"{intact.name} equals the intact circuit: no edit changed anything")
    model.warn_beyond_range(evidence)
    allowed = warn_of_ceiling(evidence, accuracies)
    tests = references(model, evidence)
    _warn_of_calibration(tests[MSPRT], evidence, accuracies)
    first = next(iter(tests))
    span = {"highest": max(HIGHEST, *accuracies), "lowest": min(LOWEST, *accuracies)}
    found = decide_at_thresholds(model, evidence, _tuned(model, tests[first], **span))
    lost = _refused(
        model, found[CIRCUIT], tests[first], accuracies, name=model.circuit.name, before=intact
    )
    warn_of_own_ceiling(model.circuit.name, found[CIRCUIT], [a for a in allowed if a not in lost])
    pairs = [(name, reference) for reference in tests for name in found]
    again = with_other_noise(model, evidence, found[CIRCUIT]) if ceiling else None
    if again is not None:
        tests[OTHER_NOISE] = again
        pairs.append((CIRCUIT, OTHER_NOISE))
    for name in RIVALS if rivals is None else rivals:
        found[name] = tradeoff(RIVALS[name]().run(evidence), evidence)
        warn_of_own_ceiling(name, found[name], allowed)
        pairs.append((name, MSPRT))
    before = None
    if intact is not None:
        unedited = replace(model, circuit=intact)
        levels = _tuned(unedited, tests[first], **span)
        before = decide_at_thresholds(unedited, evidence, levels, decoder_tau_ms=None)[CIRCUIT]
        found[MINUS_INTACT] = found[CIRCUIT]
        pairs.append((MINUS_INTACT, first))
    parts = []
    for name, reference in pairs:
        late = name not in RIVALS and reference != OTHER_NOISE
        table = compare(
            tests[reference],
            found[name],
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
        table = _blank(table, lost) if of_circuit else table
        parts.append(table.assign(model=name, reference=reference))
    return pd.concat(parts, ignore_index=True)


def compare_edits(
    model: BasalGanglia,
    edited: Mapping[str, Circuit],
    evidence: Evidence,
    *,
    seed: int,
    accuracies: Sequence[float] | float = ACCURACIES,
    resamples: int = RESAMPLES,
    highest: float = HIGHEST,
    groups: npt.ArrayLike | None = None,
    before: str = INTACT,
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
    accuracies, resamples, groups :
        As in ``comparison.compare``.
    highest : float
        Accuracy up to which thresholds are tried: a lower one takes less time.
    before : str
        What the circuit as it is, ``model``, is called: it may be edited itself.

    Returns
    -------
    DataFrame
        The columns of ``comparison.compare``, and variant and kind: "value", against the MSPRT at
        the circuit's gain, thresholds tuned anew to equal accuracy; "change", that minus the
        circuit's as it is; "fixed", at the circuit's own threshold (accuracy, expected_accuracy,
        mean_ms, premature, forced and without_evidence, 1 where most trials decide before their
        first reading; without intervals).

    Raises
    ------
    ValueError
        As ``compare_with_msprt``, or if what is edited is no mapping of circuits, each an edit of
        the model's.

    Warns
    -----
    UserWarning
        As ``compare_with_msprt``, for the circuit as it is and for each that is edited. If an
        edited circuit is the circuit as it is.
    """
    check_trials(check_evidence(evidence).trials)
    accuracies = checked_accuracies(accuracies, evidence.hypotheses)
    check_resamples(resamples, groups)
    if not isinstance(edited, Mapping):
        raise ValueError(f'edited must be a dict such as {{"STN": circuit}}, got {edited!r}')
    for name, circuit in edited.items():
        check_edit_of(model.circuit, circuit, f"edited[{name!r}]")
    if alike := [name for name, circuit in edited.items() if circuit == model.circuit]:
        warnings.warn(
            f"{', '.join(alike)}: the edit changes nothing in this circuit",
            stacklevel=2,
        )
    model.warn_beyond_range(evidence)
    warn_of_ceiling(evidence, accuracies)
    tests = references(model, evidence)
    _warn_of_calibration(tests[MSPRT], evidence, accuracies)
    test = next(iter(tests.values()))
    lowest = min(LOWEST, *accuracies)
    levels = _tuned(model, test, max(highest, *accuracies), lowest)
    intact = decide_at_thresholds(model, evidence, levels, decoder_tau_ms=None)[CIRCUIT]
    parts, lost = [], list(accuracies)
    for name, circuit in {before: model.circuit, **edited}.items():
        changed = replace(model, circuit=circuit)
        found = tuned = intact
        if name != before:
            # Where the edit takes OUT, and where it was: for thresholds tuned anew and for the old.
            both = np.union1d(levels, levels + _moved(model.circuit, circuit, levels))
            both = both[both > silent_nats(circuit)]
            found = decide_at_thresholds(changed, evidence, both, decoder_tau_ms=None)[CIRCUIT]
            tuned = found.at(np.isin(found.settings, _decided_by_evidence(changed, both)))
        called = name if name in edited else circuit.name
        refused = _refused(changed, tuned, test, accuracies, name=called, before=model.circuit)
        # What the circuit as it is does not reach has no threshold and no change.
        lost = refused if circuit is model.circuit else lost
        for kind, minus in (("value", None), ("change", intact)):
            # Without a threshold at which it decides by evidence nothing is known.
            table = compare(
                test,
                tuned if tuned.settings.size else intact,
                rng=stream(seed, "bootstrap"),
                truth=evidence.truth,
                minus=minus,
                accuracies=accuracies,
                resamples=resamples,
                groups=groups,
            )
            if not tuned.settings.size:
                table = table.assign(value=np.nan, low=np.nan, high=np.nan)
            gone = {*refused, *(lost if minus is not None else [])}
            parts.append(_blank(table, gone).assign(variant=name, kind=kind))
        fixed = _blank(_at_threshold_of(intact, found, evidence, accuracies), lost)
        parts.append(fixed.assign(variant=name, kind="fixed"))
    return pd.concat(parts, ignore_index=True)


def check_edit_of(before: Circuit, after: Circuit, what: str) -> None:
    """Raise ValueError unless one circuit can be an edit of another.

    An edit leaves the name, the channels, the unit, the input and the read-out of a circuit, and
    takes no row away. The reference of a change would be another circuit otherwise.

    Parameters
    ----------
    before, after : Circuit
        The circuit before and after it was edited.
    what : str
        The argument that holds the second.
    """
    for circuit in (before, after):
        if not isinstance(circuit, Circuit):
            raise ValueError(f"{what} must be a Circuit, edited from a Circuit, got {circuit!r}")
    kept = ("name", "channels", "unit", "input", "readout")
    other = [name for name in kept if getattr(before, name) != getattr(after, name)]
    lost = [name for name in before if name not in after]
    if other or lost:
        why = f"it lacks {', '.join(lost)}" if lost else f"another {', '.join(other)}"
        raise ValueError(
            f"{what} must be edited from the circuit that it is compared with: {after.name} of "
            f"{after.channels} channels is no edit of {before.name} of {before.channels}: {why}"
        )


def _warn_of_calibration(test: Tradeoff, evidence: Evidence, accuracies: Sequence[float]) -> None:
    """Hold the test's posteriors at the most accurate of the asked thresholds to the truth."""
    if evidence.truth is not None:
        k = int(np.argmin(np.abs(test.settings - test.setting(max(accuracies)))))
        warn_of_calibration(test.posterior[k], test.choice[k] == evidence.truth)


def _tuned(
    model: BasalGanglia, test: Tradeoff, highest: float, lowest: float
) -> npt.NDArray[np.float64]:
    """Return the thresholds of a circuit at which evidence decides, and not noise at rest."""
    found = thresholds_of(model.circuit, test, highest, lowest)
    quiet = without_noise_alone(model, found)
    if not quiet.size:
        raise ValueError(
            f"at all thresholds of {model.circuit.name}, {found.min():.2f} to {found.max():.2f} "
            f"{model.circuit.unit}, noise decides: without evidence it crosses each in more than "
            f"{NOISE_SHARE:.0%} of trials within 500 ms"
        )
    return quiet


def _decided_by_evidence(
    model: BasalGanglia, thresholds: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Return those thresholds at which evidence decides, if there are any."""
    found = deciding_thresholds(model.circuit, thresholds)
    return without_noise_alone(model, found) if found.size else found


def _refused(
    model: BasalGanglia,
    found: Tradeoff,
    test: Tradeoff,
    accuracies: Sequence[float],
    *,
    name: str,
    before: Circuit | None = None,
) -> list[float]:
    """Return the accuracies at which evidence does not decide, and say in one sentence why.

    There the test decides at an OUT that the circuit does not read, or that its noise crosses at
    rest, or the circuit itself does not come near. ``before`` is the circuit before it was edited:
    an edit that moves OUT moves what stands for the test's threshold.
    """
    circuit = model.circuit
    rest = f"OUT rests at {rest_out(circuit):.2f} {circuit.unit}"
    if found.settings.size:
        low, high = found.settings.min(), found.settings.max()
        reached, known = (curve(one, np.ones((1, one.trials)))[0][0] for one in (found, test))
        at = np.array([int(np.abs(known - accuracy).argmin()) for accuracy in accuracies])
        due = test.settings[at]
        if before is not None:
            due = due + _moved(before, circuit, due)
        near = [int(np.abs(reached - accuracy).argmin()) for accuracy in accuracies]
        missed = np.abs(reached[near] - accuracies) > [margin(a) for a in accuracies]
        if circuit.unit == NATS:
            missed |= (due < low) | (due > high)
        # Where the deadline decides other thresholds help as little: a page says so elsewhere.
        late = np.maximum(found.forced[near].mean(axis=1), test.forced[at].mean(axis=1))
        missed &= late <= MOST_FORCED
        lost = [a for a, gone in zip(accuracies, missed, strict=True) if gone]
        why = (
            f"{name} would have to decide at OUT = {listed(due[missed])}, and the nearest accuracy "
            f"that it reaches is {listed(reached[near][missed])}; evidence decides in it at "
            f"thresholds of {low:.2f} to {high:.2f} ({rest}, is read from "
            f"{circuit.readable_nats[0]:.2f} on, and noise must not cross them at rest)"
        )
    else:
        lost, why = list(accuracies), f"{name} decides without evidence ({rest})"
    if lost:
        warnings.warn(f"nothing is compared at accuracy {listed(lost)}: {why}", stacklevel=3)
    return lost


def _blank(table: pd.DataFrame, lost: Iterable[float]) -> pd.DataFrame:
    """Return a table without the values at accuracies that are refused."""
    gone = table["accuracy"].isin(list(lost)).to_numpy()
    columns = [name for name in ("value", "low", "high") if name in table]
    return table.assign(**{name: table[name].mask(gone) for name in columns})


def _moved(
    before: Circuit, after: Circuit, levels: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Return the shift of OUT by an edit at each level; 0 where it is not known."""
    known = before.unit == NATS
    return np.nan_to_num(out_shift(before, after, levels)) if known else np.zeros_like(levels)


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
        reached = abs(at - accuracy) <= margin(accuracy)
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
    model = BasalGanglia(circuit, Ensemble(spikes=names), seed=seed)
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

"""Edited circuits beside the circuit before, each against the MSPRT."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.bootstrap import RESAMPLES, check_resamples, check_trials
from bgmodel.comparison.cautions import warn_of_ceiling
from bgmodel.comparison.matched import ACCURACIES, checked_accuracies, matched_measures
from bgmodel.comparison.thresholds import (
    MSPRT,
    decided_by_evidence,
    moved,
    references,
    tuned_thresholds,
    unreached,
    warn_of_calibration_of,
    without_accuracies,
)
from bgmodel.deciding.tradeoff import Tradeoff, margin
from bgmodel.evidence import Evidence, check_evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.deciding import CIRCUIT, HIGHEST, LOWEST, decide_at_thresholds, silent_nats
from bgmodel.support.seeds import stream
from circuits.circuit import Circuit
from circuits.errors import EditWarning, InputError

INTACT, AS_EDITED = "intact", "as edited"


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
        As in ``comparison.matched.matched_measures``.
    highest : float
        Accuracy up to which thresholds are tried: a lower one takes less time.
    before : str
        What the circuit as it is, ``model``, is called: it may be edited itself.

    Returns
    -------
    DataFrame
        The columns of ``comparison.matched.matched_measures``, and variant and kind: "value",
        against the MSPRT at
        the circuit's gain, thresholds tuned anew to equal accuracy; "change", that minus the
        circuit's as it is; "fixed", at the circuit's own threshold (accuracy, expected_accuracy,
        mean_ms, premature, forced and without_evidence, 1 where most trials decide before their
        first reading; without intervals).

    Raises
    ------
    ValueError
        As ``compare``, or if what is edited is no mapping of circuits, each an edit of
        the model's.

    Warns
    -----
    UserWarning
        As ``compare``, for the circuit as it is and for each that is edited. If an
        edited circuit is the circuit as it is.
    """
    check_trials(check_evidence(evidence).trials)
    accuracies = checked_accuracies(accuracies, evidence.hypotheses)
    check_resamples(resamples, groups)
    if not isinstance(edited, Mapping):
        raise InputError.of("edited", 'must be a dict such as {"STN": circuit}', edited)
    for name, circuit in edited.items():
        check_edit_of(model.circuit, circuit, f"edited[{name!r}]")
    if alike := [name for name, circuit in edited.items() if circuit == model.circuit]:
        EditWarning.warn(f"{', '.join(alike)}: the edit changes nothing in this circuit")
    model.warn_beyond_range(evidence)
    warn_of_ceiling(evidence, accuracies)
    tests = references(model, evidence)
    warn_of_calibration_of(tests[MSPRT], evidence, accuracies)
    test = next(iter(tests.values()))
    lowest = min(LOWEST, *accuracies)
    levels = tuned_thresholds(model, test, max(highest, *accuracies), lowest)
    intact = decide_at_thresholds(model, evidence, levels, decoder_tau_ms=None)[CIRCUIT]
    parts, lost = [], list(accuracies)
    for name, circuit in {before: model.circuit, **edited}.items():
        changed = replace(model, circuit=circuit)
        found = tuned = intact
        if name != before:
            # Where the edit takes OUT, and where it was: for thresholds tuned anew and for the old.
            both = np.union1d(levels, levels + moved(model.circuit, circuit, levels))
            both = both[both > silent_nats(circuit)]
            found = decide_at_thresholds(changed, evidence, both, decoder_tau_ms=None)[CIRCUIT]
            tuned = found.at(np.isin(found.settings, decided_by_evidence(changed, both)))
        called = name if name in edited else circuit.name
        refused = unreached(changed, tuned, test, accuracies, name=called, before=model.circuit)
        # What the circuit as it is does not reach has no threshold and no change.
        lost = refused if circuit is model.circuit else lost
        for kind, minus in (("value", None), ("change", intact)):
            # Without a threshold at which it decides by evidence nothing is known.
            table = matched_measures(
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
            parts.append(without_accuracies(table, gone).assign(variant=name, kind=kind))
        fixed = without_accuracies(_at_threshold_of(intact, found, evidence, accuracies), lost)
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
            raise InputError.of(what, "must be a Circuit, edited from a Circuit", circuit)
    kept = ("name", "channels", "unit", "input", "readout")
    other = [name for name in kept if getattr(before, name) != getattr(after, name)]
    lost = [name for name in before if name not in after]
    if other or lost:
        why = f"it lacks {', '.join(lost)}" if lost else f"another {', '.join(other)}"
        raise InputError(
            f"{what} must be edited from the circuit that it is compared with: {after.name} of "
            f"{after.channels} channels is no edit of {before.name} of {before.channels}: {why}",
            what,
        )


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

"""Edited circuits compared with the MSPRT and with the circuit before the edits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.bootstrap import RESAMPLES, check_resamples, check_trials
from bgmodel.comparison.matched import (
    ACCURACIES,
    checked_accuracies,
    matched_measures,
    warn_of_missed,
)
from bgmodel.comparison.thresholds import (
    decided_by_evidence,
    moved,
    references,
    tuned_thresholds,
    unreached,
    without_accuracies,
)
from bgmodel.deciding.tradeoff import Tradeoff, margin
from bgmodel.evidence import Evidence, check_evidence
from bgmodel.integrators.at_thresholds import (
    CIRCUIT,
    HIGHEST,
    LOWEST,
    decide_at_thresholds,
    refined,
    silent_nats,
)
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.support.seeds import stream
from circuits.circuit import Circuit
from circuits.errors import EditWarning, InputError

INTACT = "intact"


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
    """Compare edited circuits with the MSPRT and the unedited circuit on the same evidence.

    Noise and evidence are the same for ``model``, the circuit before the edits, named ``before`` in
    the table, and for all of ``edited``. Other arguments are as for ``matched_measures``;
    ``highest`` is the accuracy up to which thresholds are tried, and a lower one takes less time.

    The table has the columns of ``matched_measures``, and variant and kind: "value", against the
    MSPRT at the circuit's gain, thresholds matched again to equal accuracy; "change", that minus
    the value of ``model``; "fixed", at the threshold of ``model`` (accuracy, expected_accuracy,
    mean_ms, premature, forced and without_evidence, 1 if most trials decide before their first
    reading; without intervals).

    Raises and warns as ``compare``, for each circuit; ValueError if ``edited`` is not a mapping to
    circuits that are edits of the model's. Warns of an edit that changes nothing.
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
    model = model.adapted_to(evidence)
    model.warn_beyond_range(evidence)
    tests, allowed = references(model, evidence, accuracies)
    test = next(iter(tests.values()))
    lowest = min(LOWEST, *accuracies)
    levels = tuned_thresholds(model, test, max(highest, *accuracies), lowest)
    intact = decide_at_thresholds(model, evidence, levels, decoder_tau_ms=None)[CIRCUIT]
    intact = refined(model, evidence, intact, allowed)
    levels = intact.settings
    parts, lost = [], list(accuracies)
    for name, circuit in {before: model.circuit, **edited}.items():
        changed = replace(model, circuit=circuit)
        swept = tuned = intact
        if name != before:
            # Shifted by the edit, and original: for matched and for fixed thresholds.
            both = np.union1d(levels, levels + moved(model.circuit, circuit, levels))
            both = both[both > silent_nats(circuit)]
            swept = decide_at_thresholds(changed, evidence, both, decoder_tau_ms=None)[CIRCUIT]
            tuned = swept.at(np.isin(swept.settings, decided_by_evidence(changed, both)))
            tuned = refined(changed, evidence, tuned, allowed) if tuned.settings.size else tuned
        called = name if name in edited else circuit.name
        refused = unreached(changed, tuned, test, allowed, name=called, before=model.circuit)
        if tuned.settings.size:
            warn_of_missed(called, tuned, [a for a in allowed if a not in refused])
        # An accuracy that the unedited circuit does not reach has no threshold and no change.
        lost = refused if circuit is model.circuit else lost
        for kind, minus in (("value", None), ("change", intact)):
            # Without a threshold at which it decides by evidence, all values are NaN.
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
        fixed = without_accuracies(_at_threshold_of(intact, swept, evidence, accuracies), lost)
        parts.append(fixed.assign(variant=name, kind="fixed"))
    return pd.concat(parts, ignore_index=True)


def check_edit_of(before: Circuit, after: Circuit, what: str) -> None:
    """Raise ValueError unless one circuit can be an edit of another.

    An edit keeps the name, channels, unit, input and read-out of a circuit, and removes no row.
    Otherwise the reference of a change would be another circuit.
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
    intact: Tradeoff, swept: Tradeoff, evidence: Evidence, accuracies: Sequence[float]
) -> pd.DataFrame:
    rows = []
    for accuracy in accuracies:
        k = int(np.flatnonzero(swept.settings == intact.setting(accuracy))[0])
        values = {
            "expected_accuracy": swept.posterior[k].mean(),
            "mean_ms": swept.time_ms[k].mean(),
            "premature": swept.premature[k].mean(),
            "forced": swept.forced[k].mean(),
            "without_evidence": swept.without_evidence[k],
        }
        # At its threshold the unedited circuit must have the stated accuracy.
        at = intact.posterior[intact.settings == intact.setting(accuracy)].mean()
        reached = abs(at - accuracy) <= margin(accuracy)
        if evidence.truth is not None:
            values["accuracy"] = (swept.choice[k] == evidence.truth).mean()
        rows += [(accuracy, m, float(v) if reached else np.nan) for m, v in values.items()]
    return pd.DataFrame(rows, columns=["accuracy", "measure", "value"])

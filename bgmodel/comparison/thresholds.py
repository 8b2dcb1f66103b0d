"""Choice of the thresholds at which circuits and tests are compared, and its limits."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import pandas as pd

from bgmodel.comparison.cautions import listed
from bgmodel.comparison.matched import MOST_FORCED
from bgmodel.deciding.calibration import warn_of_calibration
from bgmodel.deciding.tradeoff import Tradeoff, curve, margin, tradeoff
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import NOISE_SHARE, BasalGanglia
from bgmodel.integrators.criterion import deciding_thresholds, rest_out
from bgmodel.integrators.deciding import thresholds_of, without_noise_alone
from bgmodel.integrators.sprt import Msprt
from bgmodel.integrators.steady import out_shift
from bgmodel.support.arrays import Array
from circuits.circuit import Circuit
from circuits.declaration.table import NATS
from circuits.errors import InputError, RangeWarning

MSPRT_AT_GAIN, MSPRT = "MSPRT at its gain", "MSPRT"


def references(model: BasalGanglia, evidence: Evidence) -> dict[str, Tradeoff]:
    """Return the reference tests of a circuit; without nats, only the full MSPRT."""
    found = msprt_tradeoffs(evidence, model.gain)
    return found if model.circuit.unit == NATS else {MSPRT: found[MSPRT]}


def msprt_tradeoffs(evidence: Evidence, gain: float) -> dict[str, Tradeoff]:
    """Return the two references: the MSPRT at the circuit's gain, and at full gain."""
    return {
        MSPRT_AT_GAIN: tradeoff(Msprt(gain).run(evidence), evidence),
        MSPRT: tradeoff(Msprt().run(evidence), evidence),
    }


def warn_of_calibration_of(test: Tradeoff, evidence: Evidence, accuracies: Sequence[float]) -> None:
    """Warn if the test's posteriors do not match accuracy at the highest accuracy requested."""
    if evidence.truth is not None:
        k = int(np.argmin(np.abs(test.settings - test.setting(max(accuracies)))))
        warn_of_calibration(test.posterior[k], test.choice[k] == evidence.truth)


def tuned_thresholds(model: BasalGanglia, test: Tradeoff, highest: float, lowest: float) -> Array:
    """Return the thresholds of a circuit at which evidence decides, not noise at rest."""
    found = thresholds_of(model.circuit, test, highest, lowest)
    quiet = without_noise_alone(model, found)
    if not quiet.size:
        raise InputError(
            f"at all thresholds of {model.circuit.name}, {found.min():.2f} to {found.max():.2f} "
            f"{model.circuit.unit}, noise decides: without evidence it crosses each in more than "
            f"{NOISE_SHARE:.0%} of trials within 500 ms",
            "model",
        )
    return quiet


def decided_by_evidence(model: BasalGanglia, thresholds: Array) -> Array:
    """Return the thresholds at which evidence decides, possibly none."""
    found = deciding_thresholds(model.circuit, thresholds)
    return without_noise_alone(model, found) if found.size else found


def unreached(
    model: BasalGanglia,
    found: Tradeoff,
    test: Tradeoff,
    accuracies: Sequence[float],
    *,
    name: str,
    before: Circuit | None = None,
) -> list[float]:
    """Return the accuracies at which evidence does not decide, and warn with the reason.

    There the test decides at an OUT that is outside the range of the circuit's read-out, that its
    noise crosses at rest, or that the circuit does not approach. ``before`` is the circuit before
    its edits: an edit that shifts OUT also shifts the counterpart of the test's threshold.
    """
    circuit = model.circuit
    rest = f"OUT rests at {rest_out(circuit):.2f} {circuit.unit}"
    if found.settings.size:
        low, high = found.settings.min(), found.settings.max()
        reached, known = (curve(one, np.ones((1, one.trials)))[0][0] for one in (found, test))
        at = np.array([int(np.abs(known - accuracy).argmin()) for accuracy in accuracies])
        due = test.settings[at]
        if before is not None:
            due = due + moved(before, circuit, due)
        near = [int(np.abs(reached - accuracy).argmin()) for accuracy in accuracies]
        missed = np.abs(reached[near] - accuracies) > [margin(a) for a in accuracies]
        if circuit.unit == NATS:
            missed |= (due < low) | (due > high)
        # If the deadline decides, other thresholds do not help; the page reports this elsewhere.
        late = np.maximum(found.forced[near].mean(axis=1), test.forced[at].mean(axis=1))
        missed &= late <= MOST_FORCED
        lost = [a for a, gone in zip(accuracies, missed, strict=True) if gone]
        why = (
            f"{name} would have to decide at OUT = {listed(due[missed])}, and the nearest accuracy "
            f"that it reaches is {listed(reached[near][missed])}; evidence decides at its "
            f"thresholds of {low:.2f} to {high:.2f} ({rest}, is resolved from "
            f"{circuit.readable_nats[0]:.2f} on, and noise must not cross them at rest)"
        )
    else:
        lost, why = list(accuracies), f"{name} decides without evidence ({rest})"
    if lost:
        RangeWarning.warn(f"no comparison is possible at accuracy {listed(lost)}: {why}")
    return lost


def without_accuracies(table: pd.DataFrame, lost: Iterable[float]) -> pd.DataFrame:
    """Return a table without the values at the lost accuracies."""
    gone = table["accuracy"].isin(list(lost)).to_numpy()
    columns = [name for name in ("value", "low", "high") if name in table]
    return table.assign(**{name: table[name].mask(gone) for name in columns})


def moved(before: Circuit, after: Circuit, levels: Array) -> Array:
    """Return the shift of OUT by an edit at each level; 0 if unknown."""
    known = before.unit == NATS
    return np.nan_to_num(out_shift(before, after, levels)) if known else np.zeros_like(levels)

"""Thresholds and gains at which circuits and tests are compared, and their limits."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import pandas as pd

from bgmodel.comparison.matched import MOST_FORCED, listed, warn_of_missed, warn_of_readings
from bgmodel.deciding.calibration import warn_of_calibration
from bgmodel.deciding.tradeoff import Tradeoff, curve, time_at, tradeoff
from bgmodel.evidence import Evidence
from bgmodel.integrators.at_thresholds import (
    CIRCUIT,
    HIGHEST,
    LOWEST,
    decide_at_thresholds,
    thresholds_of,
    without_noise_alone,
)
from bgmodel.integrators.basal_ganglia import NOISE_SHARE, BasalGanglia
from bgmodel.integrators.criterion import deciding_thresholds, rest_out
from bgmodel.integrators.sprt import Msprt
from bgmodel.integrators.steady import out_shift
from circuits.arrays import Array
from circuits.circuit import Circuit
from circuits.declaration.table import NATS
from circuits.engines import Engine
from circuits.errors import InputError, RangeWarning

MSPRT_AT_GAIN, MSPRT = "MSPRT at its gain", "MSPRT"


def references(
    model: BasalGanglia, evidence: Evidence, accuracies: Sequence[float]
) -> tuple[dict[str, Tradeoff], list[float]]:
    """Return the reference tests of a circuit, and the accuracies that the first of them reaches.

    Without nats the full MSPRT is the only one. Warns of the other accuracies, and if posteriors of
    the full MSPRT at the highest accuracy are not the proportion correct.
    """
    allowed = warn_of_readings(evidence, accuracies)
    tests = msprt_tradeoffs(evidence, model.gain, accuracies)
    if evidence.truth is not None:
        one = tests[MSPRT].at_accuracy(max(accuracies))
        warn_of_calibration(one.posterior[0], one.choice[0] == evidence.truth)
    if model.circuit.unit != NATS:
        del tests[MSPRT_AT_GAIN]
    first = next(iter(tests))
    return tests, warn_of_missed(f"the {first}", tests[first], allowed)


def msprt_tradeoffs(
    evidence: Evidence, gain: float, accuracies: Sequence[float] = ()
) -> dict[str, Tradeoff]:
    """Return the two references: the MSPRT at the circuit's gain, and at full gain."""
    tests = {MSPRT_AT_GAIN: Msprt(gain), MSPRT: Msprt()}
    return {
        name: tradeoff(test.run(evidence), evidence, accuracies=accuracies)
        for name, test in tests.items()
    }


def tuned_thresholds(
    model: BasalGanglia, test: Tradeoff, highest: float = HIGHEST, lowest: float = LOWEST
) -> Array:
    """Return the thresholds of a circuit at which evidence decides, not noise at rest."""
    levels = thresholds_of(model.circuit, test, highest, lowest)
    quiet = without_noise_alone(model, levels)
    if not quiet.size:
        raise InputError(
            f"at all thresholds of {model.circuit.name}, {levels.min():.2f} to {levels.max():.2f} "
            f"{model.circuit.unit}, noise decides: without evidence it crosses each in more than "
            f"{NOISE_SHARE:.0%} of trials within 500 ms",
            "model",
        )
    return quiet


def decided_by_evidence(model: BasalGanglia, thresholds: Array) -> Array:
    """Return the thresholds at which evidence decides, possibly none."""
    usable = deciding_thresholds(model.circuit, thresholds)
    return without_noise_alone(model, usable) if usable.size else usable


def unreached(
    model: BasalGanglia,
    swept: Tradeoff,
    test: Tradeoff,
    accuracies: Sequence[float],
    *,
    name: str,
    before: Circuit | None = None,
) -> list[float]:
    """Return the accuracies at which evidence does not decide, and warn with each reason.

    There the test decides at an OUT that is outside the range of the circuit's read-out, that its
    noise crosses at rest, or that the circuit does not approach. ``before`` is the circuit before
    its edits: an edit that shifts OUT also shifts the counterpart of the test's threshold.
    """
    lost: dict[str, list[float]] = {}
    for accuracy in accuracies:
        why = _out_of_range(model, swept, test, accuracy, before)
        if why:
            lost.setdefault(why, []).append(accuracy)
    for why, some in lost.items():
        RangeWarning.warn(f"no comparison is possible at accuracy {listed(some)}: {name} {why}")
    return [accuracy for some in lost.values() for accuracy in some]


def _out_of_range(
    model: BasalGanglia, swept: Tradeoff, test: Tradeoff, accuracy: float, before: Circuit | None
) -> str:
    """Return why a circuit cannot decide by evidence at an accuracy; "" if it can."""
    circuit, rest = model.circuit, rest_out(model.circuit)
    if not swept.settings.size:
        return f"decides without evidence (OUT rests at {rest:.2f} {circuit.unit})"
    mine, known = (one.at_accuracy(accuracy) for one in (swept, test))
    # If the deadline decides, other thresholds do not help: ``warn_of_missed`` reports it.
    if max(mine.forced.mean(), known.forced.mean()) > MOST_FORCED:
        return ""
    due, low, high = known.settings, swept.settings.min(), swept.settings.max()
    if before is not None:
        due = due + moved(before, circuit, due)
    if circuit.unit == NATS and not low <= due <= high:
        why = f"evidence decides at its thresholds of {low:.2f} to {high:.2f}"
        if due >= rest:
            why = f"OUT rests at {rest:.2f}"
        elif due < circuit.readable_nats[0]:
            why = f"its read-out resolves no OUT below {circuit.readable_nats[0]:.2f}"
        elif due > high and model.engine.noisy:
            why = f"noise at rest crosses thresholds above {high:.2f}"
        return f"would have to decide at an OUT of {due[0]:.3g} nats, but {why} nats"
    if swept.reaches(accuracy):
        return ""
    reached = " to ".join(f"{one:.3f}" for one in swept.reached[[0, -1]])
    return f"has {reached} at its thresholds of {low:.2f} to {high:.2f} {circuit.unit}"


def without_accuracies(table: pd.DataFrame, lost: Iterable[float]) -> pd.DataFrame:
    """Return a table without the values at the lost accuracies."""
    gone = table["accuracy"].isin(list(lost)).to_numpy()
    columns = [name for name in ("value", "low", "high") if name in table]
    return table.assign(**{name: table[name].mask(gone) for name in columns})


def moved(before: Circuit, after: Circuit, levels: Array) -> Array:
    """Return the shift of OUT by an edit at each level; 0 if unknown."""
    known = before.unit == NATS
    return np.nan_to_num(out_shift(before, after, levels)) if known else np.zeros_like(levels)


GAINS = (0.05, 0.1, 0.2, 0.4, 0.8)
"""Gains that are tried for a circuit that does not work in nats."""
ACCURACY = 0.9
"""The gain is that at which this accuracy is reached fastest."""


def swept(model: BasalGanglia, evidence: Evidence, test: Tradeoff | None = None) -> Tradeoff:
    """Return a circuit's decisions at thresholds that noise at rest hardly ever crosses."""
    test = tradeoff(Msprt(model.gain).run(evidence), evidence) if test is None else test
    levels = tuned_thresholds(model, test)
    return decide_at_thresholds(model, evidence, levels, decoder_tau_ms=None)[CIRCUIT]


def fastest_gain(
    circuit: Circuit,
    engine: Engine | str,
    evidence: Evidence,
    seed: int,
    gain: float | None = None,
) -> tuple[BasalGanglia, Tradeoff]:
    """Return a circuit at its gain, and its decisions at many thresholds.

    A circuit has its default gain, adapted to the evidence, or 1 if it is exact. One without is
    given the gain of ``GAINS`` at which it reaches ``ACCURACY`` fastest on this evidence.
    """
    known = gain is not None or circuit.default_gain is not None
    known |= (circuit.unedited or circuit).exact
    gains = (gain,) if known else GAINS
    once = np.ones((1, evidence.trials))
    tried: list[tuple[float, BasalGanglia, Tradeoff]] = []
    refused: list[ValueError] = []
    for each in gains:
        model = BasalGanglia(circuit, engine, each, seed)  # type: ignore[arg-type]
        model = model.adapted_to(evidence)
        try:
            decided = swept(model, evidence)
        except ValueError as error:
            refused.append(error)
            continue
        tried.append((float(time_at([ACCURACY], curve(decided, once))[0, 0]), model, decided))
    if not tried:
        raise refused[0]
    _, model, decided = min(tried, key=lambda one: np.inf if np.isnan(one[0]) else one[0])
    return model, decided

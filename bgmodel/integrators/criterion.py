"""The criterion of a circuit: its gain, OUT at rest, and the thresholds at which it can decide."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from bgmodel.deciding.readout import ReadOut
from circuits.arrays import Array
from circuits.declaration.table import NATS
from circuits.dynamics import loops
from circuits.dynamics.fixed_point import resting_state, wired
from circuits.engines import Algebra
from circuits.errors import InputError
from circuits.laws.family import shift_nats

if TYPE_CHECKING:
    from bgmodel.evidence import Evidence
    from circuits.circuit import Circuit


LEAST_SHIFT_NATS = 0.001
"""Smallest shift of OUT that counts as one, nats."""
LEAD_MS = 100.0
"""Time to which a circuit's largest tracked lead refers, ms."""


class DefaultGain(float):
    """A circuit's gain where none was given: the highest, which strong evidence lowers."""


class LoweredGain(float):
    """A default gain that was lowered to fit evidence; other trials of the task vary a little."""


def gain_of(circuit: Circuit, asked: float | None = None) -> float:
    """Return the given gain, or by default that of the circuit, 1 for an exact circuit."""
    gain = circuit.default_gain if asked is None else asked
    if gain is None and (circuit.unedited or circuit).exact:
        return 1.0  # the output of an exact table is -ln P at any gain
    if gain is None:
        raise InputError(
            f"{circuit.name} has no default gain: give gain=... (at the terminal --gain), the "
            f"circuit's {circuit.unit} per nat of evidence",
            "gain",
        )
    return gain


def fitting_gain(highest: float, most_nats: float, lead_nats: float) -> float:
    """Return the largest gain, up to ``highest``, at which a lead is within what a circuit tracks.

    Leads are nats per 100 ms, of drive (``most_nats``) and of evidence (``lead_nats``); an infinite
    one, of a hypothesis that is ruled out, does not lower the gain. It is rounded down to two
    digits, so that other trials of a task mostly give the same. Cortical responses adapt to the
    range of their input in the same way (Dean, Harper & McAlpine 2005; Carandini & Heeger 2012).
    """
    if not math.isfinite(lead_nats) or highest * lead_nats <= most_nats:
        return float(highest)
    exact = most_nats / lead_nats
    unit = 10.0 ** (math.floor(math.log10(exact)) - 1)
    return LoweredGain(f"{math.floor(exact / unit) * unit:.2g}")


def lead_of(evidence: Evidence) -> float:
    """Return the mean lead gained by the best-supported alternative, nats of evidence.

    The lead is relative to the mean of the other alternatives at a trial's end, per 100 ms, or per
    reading where readings are further apart.
    """
    total = evidence.log_likelihood.sum(axis=1, dtype=np.float64)
    most = total.max(axis=1)
    others = (total.sum(axis=1) - most) / (evidence.hypotheses - 1)
    per_reading = float((most - others).sum()) / int(evidence.readings.sum())
    return per_reading * max(1.0, LEAD_MS / evidence.step_ms)


def largest_lead(circuit: Circuit) -> float:
    """Return the largest lead that a circuit tracks: that before its edits, if it was edited.

    An edit of a delay makes it unknown. An edited circuit is run at the gain of the intact one.
    """
    before = circuit.unedited or circuit
    return (before if before.channels == circuit.channels else circuit).max_lead_nats


def rest_out(circuit: Circuit) -> float:
    """Return the lowest OUT at the fixed point of rest; infinity if it has none.

    Time courses of the input begin with the drive and are left out.
    """
    try:
        silence = np.zeros((1, 1, circuit.channels))
        lowest = Algebra().run(circuit.steady, silence, step_ms=1.0).output_nats.min()
    except ValueError:
        return np.inf  # Without a resting state there is nothing to compare with.
    return float(lowest)


def check_threshold(circuit: Circuit, threshold_nats: float) -> None:
    """Refuse a threshold, in the circuit's unit, that OUT is past at rest, or can never reach."""
    readout_of(circuit).check(threshold_nats)


@lru_cache(maxsize=1024)
def readout_of(circuit: Circuit) -> ReadOut:
    """Return the meaning of thresholds on a circuit's OUT: where it rests, how low it can go."""
    low, advice = circuit.readable_nats[0], off_chance(circuit)
    off = bool(advice) and circuit.unedited is None
    return ReadOut(circuit.name, low, rest_out(circuit), circuit.unit, advice=advice, off=off)


def doubts(circuit: Circuit) -> list[str]:
    """Return reasons why a circuit cannot decide by its evidence, with remedies."""
    loop = loops.loop_advice(wired(circuit.steady), resting_state(circuit.steady)[0])
    texts = (unfiltered(circuit), off_chance(circuit), loop.removeprefix(": "))
    return [f"{circuit.name}: {text}" for text in texts if text]


def acts_as(circuit: Circuit, before: Circuit | None = None) -> str:
    """Describe edits that shift OUT by the same amount everywhere; "" for others.

    ``before`` is by default the circuit before its edits. Deciding when ``-ln P + shift`` falls
    below a threshold is deciding, before the edits, at ``exp(shift)`` times the posterior.
    """
    shift = shift_nats(circuit, before)
    if shift is None or abs(shift) < LEAST_SHIFT_NATS:
        return ""
    way = "lower" if shift < 0 else "higher"
    return (
        f"acts as a criterion {way} by {abs(shift):.3g} nats: it shifts OUT by as much whatever "
        f"the evidence, so that the circuit decides at {math.exp(shift):.3g} times the posterior"
    )


def unfiltered(circuit: Circuit) -> str:
    """Return that OUT is noise, of variance rate / (n dt), for lack of a filter, or ""."""
    row = circuit.population(circuit.readout)
    if circuit.readout_tau_ms or not row.spiking:
        return ""
    noise = f"OUT without a filter is the noise of {row.neurons} cells of {row.name} in one tick"
    return f"{noise}, which depends on the engine: set readout_tau_ms, such as 30"


def off_chance(circuit: Circuit) -> str:
    """Return how to make OUT rest at chance, ln N; "" if it does, and after a lesion.

    The rate is ``baseline + gain OUT``: input raises both, and a lower baseline keeps the rate.
    """
    row, chance, rest = (
        circuit.population(circuit.readout),
        np.log(circuit.channels),
        rest_out(circuit),
    )
    near = min(abs(rest - known) for known in (chance, circuit.readable_nats[1])) < 0.05 * chance
    usual = near or circuit != circuit.unlesioned
    if usual or circuit.unit != NATS or row.transfer != "linear" or np.isinf(rest):
        return ""
    wiring, x = wired(circuit.steady), resting_state(circuit.steady)[0]
    more = chance - float(x[wiring.blocks_of(row.name)].min())
    lower = row.baseline_hz - row.gain_hz_per_nat * more
    kept = f", and {row.name}.baseline_hz {lower:.4g} to keep its rate" if lower >= 0 else ""
    return (
        f"set {row.name}.bias_nats {row.bias_nats + more:.4g}{kept}, so that OUT rests at that of "
        f"chance, ln {circuit.channels} = {chance:.2f}, not at {rest:.2f}"
    )


def deciding_thresholds(circuit: Circuit, thresholds_nats: Array) -> Array:
    """Return the thresholds that are below OUT at rest and within reach of the read-out."""
    low = circuit.readable_nats[0]
    return thresholds_nats[(thresholds_nats >= low) & (thresholds_nats < rest_out(circuit))]

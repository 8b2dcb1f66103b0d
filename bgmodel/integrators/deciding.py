"""A circuit at many thresholds: which it can reach, and its decisions at each."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
import numpy.typing as npt

from bgmodel.deciding.calibration import posterior_at
from bgmodel.deciding.decision import Decision, any_crossing
from bgmodel.deciding.measures import Behaviour
from bgmodel.deciding.tradeoff import Tradeoff, margin, tradeoff
from bgmodel.evidence import Evidence, needed_truth
from bgmodel.integrators.basal_ganglia import NOISE_SHARE, ROUNDING_NATS, BasalGanglia
from bgmodel.integrators.criterion import check_threshold, deciding_thresholds, rest_out
from bgmodel.integrators.decoder import decoded
from bgmodel.support.arrays import Array
from bgmodel.support.progress import advance
from circuits.circuit import Circuit
from circuits.declaration.table import NATS
from circuits.errors import InputError

CIRCUIT, DECODER = "circuit", "cortical decoder"
DECODER_TAU_MS = 20.0
THRESHOLDS = 120
FINER = 41
"""Thresholds between two where these are too far apart for an accuracy."""
LOWEST_NATS = 1e-3
LOWEST, HIGHEST = 0.80, 0.98
"""Default range of accuracies for which thresholds are tried."""
DROPPED = 0.3
"""Share of the lowest threshold at which trials are dropped: hardly any has to be run again then,
because its decoder is slower, and runs are a tenth longer than to the threshold itself."""


def sample_ms(step_ms: float) -> float:
    """Return the time between samples of OUT: 1 ms, or 1/50 of the interval of slow readings."""
    return step_ms / 50 if step_ms >= 100 and step_ms % 50 == 0 else 1.0


def thresholds_about(test: Tradeoff, highest: float = HIGHEST, lowest: float = LOWEST) -> Array:
    """Return thresholds for a circuit, nats, around the test's at accuracies lowest to highest.

    A circuit's OUT follows that of the test with a delay: its thresholds are close, mostly lower.
    """
    low, high = 0.7 * test.setting(highest), 1.3 * test.setting(lowest)
    # With strong enough evidence, the threshold of the test reaches 0.
    return np.geomspace(max(high, 2 * LOWEST_NATS), max(low, LOWEST_NATS), THRESHOLDS)


def thresholds_of(
    circuit: Circuit, test: Tradeoff, highest: float = HIGHEST, lowest: float = LOWEST
) -> Array:
    """Return the thresholds of ``thresholds_about`` that the circuit can use.

    Usable thresholds are below OUT at rest and within reach of the read-out. Without nats they are
    evenly spaced between these two. Raises if none is usable.
    """
    if circuit.unit != NATS:
        least = max(circuit.readable_nats[0], silent_nats(circuit))
        return np.linspace(rest_out(circuit), least, THRESHOLDS + 2)[1:-1]
    about, least = thresholds_about(test, highest, lowest), circuit.readable_nats[0]
    if about.min() < least < about.max():
        about = np.append(about[about > least], least)
    usable = deciding_thresholds(circuit, about)
    if not usable.size:
        raise InputError(
            f"{circuit.name} rests at OUT = {rest_out(circuit):.2f} and resolves no OUT below "
            f"{circuit.readable_nats[0]:.2f}: at all thresholds, {about.min():.2f} to "
            f"{about.max():.2f} nats, it would decide without evidence, or never",
            "circuit",
        )
    return usable


def without_noise_alone(model: BasalGanglia, thresholds: Array) -> Array:
    """Return the thresholds that noise at rest hardly ever crosses.

    At the others, noise decides: it crosses them within half a second without evidence in more
    than ``NOISE_SHARE`` of trials.
    """
    if not (model.engine.threaded and model.engine.noisy):
        return thresholds
    lowest = model.out_at_rest().min(axis=(1, 2))
    share = (lowest[:, None] <= thresholds).mean(axis=0)
    return np.asarray(thresholds[share <= NOISE_SHARE])


def decide_at_thresholds(
    model: BasalGanglia,
    evidence: Evidence,
    thresholds: npt.ArrayLike,
    *,
    decoder_tau_ms: float | None = DECODER_TAU_MS,
) -> dict[str, Tradeoff]:
    """Return the decisions of a circuit and, if it has noise, of a decoder of its input.

    If the engine supports it, a trial is dropped once its OUT is a little below the lowest
    threshold, (K,) nats. If the decoder has not crossed all thresholds by then, it is run again to
    its end. ``decoder_tau_ms`` of None leaves the decoder out.
    """
    if np.max(thresholds) < model.circuit.readable_nats[0]:
        # Thresholds above OUT at rest may be of interest; unreachable ones are not.
        check_threshold(model.circuit, float(np.max(thresholds)))
    model = model.adapted_to(evidence)
    in_nats = model.circuit.unit == NATS
    decodes = in_nats and model.engine.noisy and decoder_tau_ms is not None
    undropped, lowest = model, float(np.min(thresholds))
    level = DROPPED * lowest if decodes else lowest - ROUNDING_NATS
    model = model.until(level, rates=decodes)
    tradeoffs: dict[str, Tradeoff] = {}
    first = 0
    for part, activity, trace in model.batches(evidence):
        traces = {CIRCUIT: trace}
        if decodes and decoder_tau_ms is not None:
            again = partial(undropped.one_trial, part, first)
            traces[DECODER] = decoded(activity, trace, lowest, again, decoder_tau_ms)
        for name, trace in traces.items():
            new = tradeoff(trace, part, thresholds)
            tradeoffs[name] = tradeoffs[name] + new if name in tradeoffs else new
        first += part.trials
        advance(part.trials)
    return tradeoffs


def refined(
    model: BasalGanglia, evidence: Evidence, swept: Tradeoff, accuracies: Sequence[float]
) -> Tradeoff:
    """Run a circuit at more thresholds if those about an accuracy are too far apart for it."""
    finer = [swept.settings[:0]]
    for accuracy in accuracies:
        k = int(np.searchsorted(swept.reached, accuracy))
        if 0 < k < len(swept.settings):
            apart = swept.reached[k] - swept.reached[k - 1]
            between = np.linspace(swept.settings[k - 1], swept.settings[k], FINER)[1:-1]
            finer += [between] if apart > 2 * margin(accuracy) else []
    levels = np.unique(np.concatenate(finer))
    if not levels.size:
        return swept
    return swept | decide_at_thresholds(model, evidence, levels, decoder_tau_ms=None)[CIRCUIT]


def silent_nats(circuit: Circuit) -> float:
    """Return the OUT of a silent read-out, nats: lower thresholds are never reached."""
    readout = circuit.population(circuit.readout)
    return -readout.baseline_hz / readout.gain_hz_per_nat


def behaviour_of(
    model: BasalGanglia,
    evidence: Evidence,
    threshold_nats: float,
    foreperiod_ms: float,
    stopping: tuple[Decision, Array] | None = None,
) -> Behaviour:
    """Measure choices at one threshold, and anticipations in a foreperiod without evidence.

    The foreperiod is simulated separately for each trial, unless the evidence has an informative
    one: then that one counts. ``stopping`` holds the decisions in a task with stop signals and the
    stop-signal delays, (trials,) ms, NaN in go trials.
    """
    needed_truth(evidence)
    decision, ssd_ms = stopping or (model.decided(evidence, threshold_nats), None)
    posterior = posterior_at(evidence, decision.time_ms, decision.choice)
    if evidence.foreperiod_steps:
        early = decision.time_ms < 0
        return Behaviour(decision, posterior, early, evidence.hypotheses, ssd_ms)
    responded = []
    size = model.batch_of(1, foreperiod_ms)
    for first in range(0, evidence.trials, size):
        silence = np.zeros((min(size, evidence.trials - first), 1, evidence.hypotheses))
        # Separate trials: their noise is independent of that of other trials.
        waited = model.run_drive(silence, foreperiod_ms, evidence.trials + first).output_nats
        responded.append(any_crossing(waited, threshold_nats))
    early = np.concatenate(responded)
    return Behaviour(decision, posterior, early, evidence.hypotheses, ssd_ms)

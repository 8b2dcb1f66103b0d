"""A circuit at many thresholds: which it can reach, its decisions, and a decoder of its input."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bgmodel.deciding.calibration import posterior_at
from bgmodel.deciding.decision import UNDECIDED, Decision, any_crossing, first_crossing
from bgmodel.deciding.measures import Behaviour
from bgmodel.deciding.trace import Trace
from bgmodel.deciding.tradeoff import Tradeoff, margin, tradeoff
from bgmodel.evidence import Evidence, minus_log_softmax, needed_truth
from bgmodel.integrators.basal_ganglia import NOISE_SHARE, ROUNDING_NATS, BasalGanglia
from bgmodel.integrators.criterion import check_threshold, deciding_thresholds, rest_out
from bgmodel.integrators.sprt import OF_MSPRT
from bgmodel.support.processes import advance
from circuits.arrays import Array
from circuits.circuit import Circuit
from circuits.declaration.table import NATS
from circuits.errors import InputError

if TYPE_CHECKING:
    from circuits.activity import Activity


def decoded(
    activity: Activity,
    trace: Trace,
    lowest: float,
    again: Callable[[int], tuple[Activity, Trace]],
    tau_ms: float,
) -> Trace:
    """Return ``decoded_input`` for trials that were dropped once the circuit had decided.

    Trials whose decoder has not crossed the lowest threshold yet are run again: ``again`` maps the
    number of a trial to its activity and OUT, run to the end.
    """
    trace_of_decoder = decoded_input(activity, trace, tau_ms)
    dropped = np.isnan(trace.out_nats[:, -1, 0])
    decision = first_crossing(trace_of_decoder, lowest, forced=False, checked=False)
    undecided = decision.choice == UNDECIDED
    for t in np.flatnonzero(dropped & undecided).tolist():
        trace_of_decoder.out_nats[t] = decoded_input(*again(t), tau_ms).out_nats[0]
    return trace_of_decoder


def decoded_input(activity: Activity, trace: Trace, tau_ms: float = 20.0) -> Trace:
    """Return -ln softmax of a circuit's input, decoded from its spikes by an exponential filter.

    Spikes are counted through one exponential filter; the rest of the computation is exact. A
    circuit's loss relative to this decoder therefore arises within the circuit. The decoder is no
    upper limit: another filter, or knowing when readings come, may do better. The result has the
    times of ``trace``, the circuit's OUT.
    """
    # Importing scipy.signal takes half a second: only when spikes are decoded.
    from scipy.signal import lfilter

    activity.circuit.check_nats("-ln softmax of its input")
    y = activity.decoded_nats(activity.circuit.input)
    keep = np.exp(-float(activity.time_ms[0]) / tau_ms)
    # Terms common to all channels cancel: at the start none is ahead.
    seen = lfilter([1 - keep], [1, -keep], y, axis=1)
    # A dropped trial has no further spikes.
    ended = np.isnan(y[:, :, 0])
    last = np.maximum((~ended).sum(axis=1) - 1, 0)
    seen = np.where(ended[:, :, None], seen[np.arange(len(y)), last][:, None], seen)
    return replace(trace, out_nats=minus_log_softmax(seen), readout=OF_MSPRT)


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
            f"{about.max():.2f} nats, it would decide without evidence, or never; make edits "
            "smaller, or add compensate",
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

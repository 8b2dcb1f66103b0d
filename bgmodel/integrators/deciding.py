"""A circuit at many thresholds: those that it reads, and what it decides at each."""

from __future__ import annotations

from functools import partial

import numpy as np
import numpy.typing as npt

from bgmodel.deciding.calibration import posterior_at
from bgmodel.deciding.decision import any_crossing
from bgmodel.deciding.measures import Behaviour
from bgmodel.deciding.tradeoff import Tradeoff, tradeoff
from bgmodel.evidence import Evidence, needed_truth
from bgmodel.integrators.basal_ganglia import (
    BATCH,
    NOISE_SHARE,
    ROUNDING_NATS,
    BasalGanglia,
    check_threshold,
    deciding_thresholds,
    rest_out,
)
from bgmodel.integrators.decoder import decoded
from bgmodel.support.arrays import Array
from bgmodel.support.progress import advance
from circuits.circuit import Circuit
from circuits.declaration.table import NATS
from circuits.errors import InputError

CIRCUIT, DECODER = "circuit", "cortical decoder"
DECODER_TAU_MS = 20.0
THRESHOLDS = 120
LOWEST_NATS = 1e-3
LOWEST, HIGHEST = 0.80, 0.98
"""Accuracies between which thresholds are tried, unless others are asked for."""
BELOW_NATS = 0.04
"""How far below the lowest threshold a trial is dropped: mostly its decoder is there by then."""


def sample_ms(step_ms: float) -> float:
    """Return the time between samples of OUT: 1 ms, or a fiftieth of slow readings."""
    return step_ms / 50 if step_ms >= 100 and step_ms % 50 == 0 else 1.0


def thresholds_about(test: Tradeoff, highest: float = HIGHEST, lowest: float = LOWEST) -> Array:
    """Return thresholds for a circuit, nats, around the test's at accuracies lowest to highest.

    A circuit's OUT follows the test's with a delay: its thresholds lie near, mostly below.
    """
    low, high = 0.7 * test.setting(highest), 1.3 * test.setting(lowest)
    # Where the evidence is strong enough, the test's reaches 0.
    return np.geomspace(max(high, 2 * LOWEST_NATS), max(low, LOWEST_NATS), THRESHOLDS)


def thresholds_of(
    circuit: Circuit, test: Tradeoff, highest: float = HIGHEST, lowest: float = LOWEST
) -> Array:
    """Return those of ``thresholds_about`` that a circuit reads, and is not past without evidence.

    Without nats they lie evenly from OUT at rest down to the lowest that is read.

    Raises
    ------
    ValueError
        If there is none: the circuit would decide without evidence at each.
    """
    if circuit.unit != NATS:
        least = max(circuit.readable_nats[0], silent_nats(circuit))
        return np.linspace(rest_out(circuit), least, THRESHOLDS + 2)[1:-1]
    about = thresholds_about(test, highest, lowest)
    found = deciding_thresholds(circuit, about)
    if not found.size:
        raise InputError(
            f"{circuit.name} rests at OUT = {rest_out(circuit):.2f} and reads none below "
            f"{circuit.readable_nats[0]:.2f}: at all thresholds, {about.min():.2f} to "
            f"{about.max():.2f} nats, it would decide without evidence, or never",
            "circuit",
        )
    return found


def without_noise_alone(model: BasalGanglia, thresholds: Array) -> Array:
    """Return those thresholds that noise at rest hardly ever crosses.

    Above them noise decides: in more than ``NOISE_SHARE`` of trials it crosses them within half a
    second without evidence.
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

    Raises
    ------
    ValueError
        If the circuit reads no OUT as low as the highest threshold.

    Notes
    -----
    Where the engine can, a trial is dropped once its OUT is a little below the lowest threshold. If
    the decoder has not crossed all thresholds by then, the trial is run again, to its end.
    """
    if np.max(thresholds) < model.circuit.readable_nats[0]:
        # Where OUT rests may be what is asked for; what is never read is no answer.
        check_threshold(model.circuit, float(np.max(thresholds)))
    in_nats = model.circuit.unit == NATS
    decodes = in_nats and model.engine.noisy and decoder_tau_ms is not None
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


def silent_nats(circuit: Circuit) -> float:
    """Return the OUT of a read-out that does not fire, nats: no threshold below is ever met."""
    readout = circuit.population(circuit.readout)
    return -readout.baseline_hz / readout.gain_hz_per_nat


def behaviour_of(
    model: BasalGanglia, evidence: Evidence, threshold_nats: float, foreperiod_ms: float
) -> Behaviour:
    """Let a circuit decide at one threshold, and wait through a foreperiod without evidence.

    Parameters
    ----------
    model : BasalGanglia
        The circuit, its engine and its noise.
    evidence : Evidence
        What it is given; its truth must be known.
    threshold_nats : float, nats
        OUT at which it decides.
    foreperiod_ms : float, ms
        Length of the foreperiod, a run of its own beside each trial, unless the evidence has one
        in which something is expected: then that one counts.

    Returns
    -------
    Behaviour
        The decisions of all trials, and whether each foreperiod ended in a response.

    Raises
    ------
    ValueError
        If the evidence does not fit the circuit, or a run is impossible (its rates run away).
    """
    needed_truth(evidence)
    decision = model.decided(evidence, threshold_nats)
    posterior = posterior_at(evidence, decision.time_ms, decision.choice)
    if evidence.foreperiod_steps:
        return Behaviour(decision, posterior, decision.time_ms < 0, evidence.hypotheses)
    responded = []
    for first in range(0, evidence.trials, BATCH):
        silence = np.zeros((min(BATCH, evidence.trials - first), 1, evidence.hypotheses))
        # Trials of their own: their noise is no other trial's.
        waited = model.run_drive(silence, foreperiod_ms, evidence.trials + first).output_nats
        responded.append(any_crossing(waited, threshold_nats))
    return Behaviour(decision, posterior, np.concatenate(responded), evidence.hypotheses)

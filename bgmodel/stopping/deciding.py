"""A circuit in the stop-signal task: its decisions at drawn or tracked delays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bgmodel.deciding.decision import Decision
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.stopping.circuit import receiving
from bgmodel.stopping.inputs import with_onsets
from bgmodel.stopping.staircases import walk
from bgmodel.stopping.task import StopTask
from bgmodel.support.arrays import Array


def decided(
    task: StopTask, model: BasalGanglia, evidence: Evidence, level: float, rng: np.random.Generator
) -> tuple[Decision, Array]:
    """Return a circuit's decisions, and the stop-signal delays.

    Parameters
    ----------
    task : StopTask
        Stop signals, and how they reach the circuit.
    model : BasalGanglia
        The circuit, without an input for the signal.
    evidence : Evidence
        Readings of all trials; a share of them become stop trials.
    level : float, nats
        OUT at which the circuit decides.
    rng : Generator
        Draws stop trials, delays and trigger failures, the same for any circuit.

    Returns
    -------
    decision : Decision
        Decisions of all trials; trials without a response are forced by the deadline.
    ssd_ms : array (trials,), ms
        Stop-signal delays; NaN in go trials.

    Raises
    ------
    ValueError
        If a delay comes after the end, or common input is cancelled at the nucleus.
    """
    task.check_ends(evidence.step_ms * evidence.steps)
    model = receiving(model, task)
    stop = rng.random(evidence.trials) < task.share
    late = np.maximum(task.delay_sd_ms * rng.standard_normal(len(stop)), -task.delay_ms)
    late[rng.random(len(stop)) < task.failures] = np.nan

    def at(ssd_ms: Array) -> Decision:
        given = with_onsets(evidence, task.onsets(ssd_ms) + late, task)
        return model.decided(given, level)

    delays = np.asarray(task.delays_ms, float)
    if not task.staircases:
        ssd = np.where(stop, rng.choice(delays, len(stop)), np.nan)
        return at(ssd), ssd
    each = [at(np.where(stop, delay, np.nan)) for delay in delays]
    place = np.zeros(len(stop), int)
    responded = np.stack([~one.forced[stop] for one in each])
    place[stop] = walk(responded, delays, delays[_starts(len(delays), task.staircases)])
    return _chosen(each, place), np.where(stop, delays[place], np.nan)


def _starts(delays: int, staircases: int) -> list[int]:
    """Return the first delay of each staircase, spread evenly."""
    inner = np.linspace(0, delays - 1, staircases + 2)[1:-1]
    return [round(place) for place in inner]


def _chosen(each: list[Decision], place: Array) -> Decision:
    """Return the decision of each trial at its delay."""
    trial = np.arange(len(place))
    names = ("choice", "time_ms", "forced", "premature", "deadline_ms")
    found = {n: np.stack([getattr(one, n) for one in each])[place, trial] for n in names}
    return replace(each[0], **found)

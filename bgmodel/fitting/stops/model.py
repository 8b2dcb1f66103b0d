"""Stop processes for fits: the test, and a circuit by its response to a stop signal.

Both have OUT_stop(t) = OUT_go(t) + c(t - SSD - delay). They differ in the threshold of OUT that a
participant's go process implies, and in c: a step in the test, and filtered in a circuit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bgmodel.fitting.exact.gaps import CONSTANT, GAPS
from bgmodel.fitting.exact.raised import threshold_nats
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.stopping.circuit import step_response
from bgmodel.stopping.inputs import StopSignal
from bgmodel.support.arrays import Array
from circuits.anatomy import checked_circuit
from circuits.circuit import Circuit
from circuits.errors import InputError

NOISE_NATS = 2.0
"""Noise of the evidence in a circuit after one second, nats, as in ``FitSettings``."""
LASTING_MS = 1000.0
"""Time for which a circuit's response to a stop signal is computed."""


@dataclass(frozen=True, eq=False)
class StopModel:
    """How OUT responds to a stop signal of 1 nat.

    Parameters
    ----------
    name : str
        "constant_gap" for the test, or the name of a circuit.
    noise_nats : float, optional
        Standard deviation of the log odds after one second, nats. That of the test, by default, is
        twice the drift.
    time_ms, added : array (ticks,)
        c, as a proportion of the strength, and its times. By default c is a step.
    circuit : Circuit, optional
        The circuit that responds so.
    """

    name: str
    noise_nats: float | None = None
    time_ms: Array | None = None
    added: Array | None = None
    circuit: Circuit | None = None

    def noise(self, sensitivity: float) -> float:
        """Return the noise of the log odds of a participant, nats per root second."""
        return 2 * sensitivity if self.noise_nats is None else self.noise_nats

    def threshold(self, sensitivity: float, bound: float) -> float:
        """Return the threshold of OUT of a participant, nats; NaN if the go process is unknown."""
        return float(threshold_nats(np.asarray(bound), np.asarray(self.noise(sensitivity))))

    def latency_ms(self, threshold: float, strength_nats: float) -> float:
        """Return the time from a stop signal to its effect, ms.

        It is the time at which c reaches the threshold or, where the strength is less than that,
        half of the strength; 0 for a step and for an unknown threshold.
        """
        if self.time_ms is None or self.added is None or not strength_nats > 0:
            return 0.0
        known = float(np.nan_to_num(threshold))
        share = known / strength_nats if known < strength_nats else 0.5
        rising = np.maximum.accumulate(np.append(0.0, self.added))
        return float(np.interp(share, rising, np.append(0.0, self.time_ms)))


TEST = StopModel(CONSTANT.name)
"""The sequential test: a step in units of its posterior."""


def circuit_stop(circuit: str | Circuit = "macaque", noise_nats: float = NOISE_NATS) -> StopModel:
    """Return the stop process of a circuit of two channels, from its response to 1 nat in STN.

    The closed form scales this response with the strength.
    """
    table = checked_circuit(circuit, 2)
    time_ms, added = step_response(BasalGanglia(table), StopSignal(), time_ms=LASTING_MS)
    return StopModel(table.name, noise_nats, time_ms, added, table)


def stop_model(model: str | Circuit | StopModel, noise_nats: float = NOISE_NATS) -> StopModel:
    """Return the stop process of the test, ``constant_gap``, or of a circuit.

    Raises
    ------
    ValueError
        For another test, or an unknown circuit.
    """
    if isinstance(model, StopModel):
        return model
    if isinstance(model, str) and model in GAPS:
        must = f"must be of {CONSTANT.name}, or circuits, for stop signals"
        if model != CONSTANT.name:
            raise InputError.of("models", must, model)
        return TEST
    return circuit_stop(model, noise_nats)

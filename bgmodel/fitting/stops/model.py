"""Stop processes for fits: the test, and a circuit by its response to a stop signal.

Both have OUT_stop(t) = OUT_go(t) + c(t - SSD - delay). They differ in the threshold of OUT that a
participant's go process implies, and in c: a step in the test, and filtered in a circuit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bgmodel.fitting.exact.raised import threshold_nats
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.given import checked_circuit
from bgmodel.stopping.circuit import step_response
from bgmodel.stopping.inputs import StopSignal
from bgmodel.support.arrays import Array
from circuits.circuit import Circuit

NOISE_NATS = 2.0
"""Noise of the evidence in a circuit after one second, nats, as in ``FitSettings``."""
LASTING_MS = 1000.0
"""Time for which a circuit's response to a stop signal is computed."""


@dataclass(frozen=True)
class StopModel:
    """How OUT responds to a stop signal of 1 nat.

    Parameters
    ----------
    name : str
        "test", or the name of a circuit.
    noise_nats : float, optional
        Standard deviation of the log odds after one second, nats. That of the test, by default, is
        twice the drift.
    time_ms, added : array (ticks,)
        c, as a proportion of the strength, and its times. By default c is a step.
    """

    name: str
    noise_nats: float | None = None
    time_ms: Array | None = None
    added: Array | None = None

    def noise(self, sensitivity: Array) -> Array:
        """Return the noise of the log odds of each participant, (people,), nats per root second."""
        if self.noise_nats is None:
            return 2 * sensitivity
        return np.full(len(sensitivity), self.noise_nats)

    def threshold(self, sensitivity: Array, bound: Array) -> Array:
        """Return the threshold of OUT of each participant, (people,), nats."""
        return threshold_nats(bound, self.noise(sensitivity))

    def latency_ms(self, thresholds: Array, strength_nats: float) -> Array:
        """Return the time from a stop signal to its effect, (people,), ms.

        It is the time at which c reaches the threshold or, where the strength is less than that,
        half of the strength; 0 for a step, for infinite strength and for unknown thresholds.
        """
        known = np.nan_to_num(thresholds)
        if self.time_ms is None or self.added is None or not strength_nats > 0:
            return np.zeros(len(known))
        share = np.where(known < strength_nats, known / strength_nats, 0.5)
        rising = np.maximum.accumulate(np.append(0.0, self.added))
        return np.asarray(np.interp(share, rising, np.append(0.0, self.time_ms)))


TEST = StopModel("test")
"""The sequential test: a step in units of its posterior."""


def circuit_stop(circuit: str | Circuit = "macaque", noise_nats: float = NOISE_NATS) -> StopModel:
    """Return the stop process of a circuit of two channels, from its response to 1 nat in STN.

    The closed form scales this response with the strength.
    """
    table = checked_circuit(circuit, 2)
    time_ms, added = step_response(BasalGanglia(table), StopSignal(), time_ms=LASTING_MS)
    return StopModel(table.name, noise_nats, time_ms, added)

"""How recorded cells read the sum of clicks: by a line, an exponential, a step, or a circuit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from bgmodel.integrators.given import checked_circuit, identity
from bgmodel.support.arrays import Array
from circuits.circuit import Circuit
from circuits.dynamics.fixed_point import solve, wired
from circuits.errors import InputError, require

FLOOR_HZ, MOST_LOG = 1e-3, 7.0
"""Least rate of a linear reading, Hz, and largest logarithm of an exponential one."""
REACH_NATS, POINTS = 8.0, 321
"""Largest input for which a circuit is solved, on either side, and the number of inputs."""


@dataclass(frozen=True)
class Reading:
    """How a cell reads the sum of clicks.

    Parameters
    ----------
    name : str
        Its name.
    linear : bool
        Whether the rate is linear in the function of the sum (and 0 or more), or exponential.
    step : float, optional
        Clicks at which a step, a hyperbolic tangent, saturates; by default the line.
    curve : (input (points,), nats; activity (points,)), optional
        The activity of a nucleus of a circuit in place of the line.
    circuit : Circuit, optional
        The circuit of that nucleus.
    """

    name: str
    linear: bool
    step: float | None = None
    curve: tuple[Array, Array] | None = None
    circuit: Circuit | None = None

    def identity(self) -> dict[str, Any]:
        """Return all that it depends on."""
        known = {"model": self.name}
        return known if self.circuit is None else known | {"circuit": identity(self.circuit)}

    def read(self, x: Array) -> tuple[Array, Array]:
        """Return the function of the sum, and its derivative."""
        if self.curve is not None:
            at, rate = self.curve
            place = np.clip((x - at[0]) / (at[1] - at[0]), 0, len(at) - 1.001)
            below = place.astype(np.int64)
            rise = np.diff(rate)[below]
            return rate[below] + (place - below) * rise, rise / (at[1] - at[0])
        if self.step is not None:
            bent = np.tanh(x / self.step)
            return bent, (1 - bent**2) / self.step
        return x, np.ones_like(x)

    def rate(self, predictor: Array) -> tuple[Array, Array, Array | float]:
        """Return the logarithm of the rate, the rate, Hz, and the derivative of the logarithm.

        The rate is the predictor with a soft threshold at 0, or its exponential.
        """
        if not self.linear:
            log = np.minimum(predictor, MOST_LOG)
            return log, np.exp(log), 1.0
        small = np.exp(-np.abs(predictor))
        rate = np.maximum(predictor, 0) + np.log1p(small) + FLOOR_HZ
        return np.log(rate), rate, np.where(predictor > 0, 1, small) / (1 + small) / rate


READINGS = {
    each.name: each
    for each in (
        Reading("exponential", linear=False),
        Reading("step", linear=False, step=1.0),
        Reading("linear", linear=True),
    )
}
"""Readings without a circuit."""


def reading_of(name: str) -> Reading:
    """Return a reading by its name, or as the nucleus of a circuit, such as "macaque D1"."""
    if name in READINGS:
        return READINGS[name]
    circuit, _, nucleus = str(name).rpartition(" ")
    if not circuit:
        allowed = ", ".join(READINGS)
        must = f"must be {allowed}, or a circuit and a nucleus such as 'macaque D1'"
        raise InputError.of("models", must, name)
    return nucleus_reading(checked_circuit(circuit, 2), nucleus, str(name))


def nucleus_reading(circuit: Circuit, nucleus: str, name: str) -> Reading:
    """Return the steady activity of a nucleus's first channel, by the lead of its evidence.

    Activity follows evidence within tens of ms, much faster than the sum of clicks moves. It is
    relative to rest, in units of 10 Hz.
    """
    names = [row.name for row in circuit.populations]
    require(nucleus in names, "models", f"must name a nucleus, one of {', '.join(names)}", nucleus)
    lead = np.linspace(-REACH_NATS, REACH_NATS, POINTS)
    wiring = wired(circuit)
    drive = np.stack([lead / 2, -lead / 2], axis=1)
    rates = wiring.rates(solve(wiring, drive))[:, wiring.blocks_of(nucleus)][:, 0]
    curve = (rates - rates[POINTS // 2]) / 10
    return Reading(name, linear=True, curve=(lead, np.asarray(curve)), circuit=circuit)

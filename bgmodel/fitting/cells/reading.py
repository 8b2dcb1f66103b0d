"""How recorded cells read the sum of clicks: as log odds, posterior, step, or a nucleus."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import expit

from bgmodel.support.arrays import Array
from circuits.anatomy import checked_circuit
from circuits.circuit import Circuit
from circuits.declaration.table_writer import identity
from circuits.dynamics.fixed_point import solve, wired
from circuits.errors import InputError, require

SHARPNESS, FLOOR, MOST_LOG = 8.0, 1e-4, 7.0
"""Sharpness of the threshold of a linear reading, its least factor, and the largest log rate."""
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
    bent : float, optional
        Input at which a hyperbolic tangent saturates; by default a line.
    scaled : bool
        Whether the input is in nats, with nats per click to be fitted, or in clicks.
    curve : (input (points,), nats; activity (points,)), optional
        The activity of a nucleus of a circuit in place of the line.
    circuit : Circuit, optional
        The circuit of that nucleus.
    """

    name: str
    linear: bool
    bent: float | None = None
    scaled: bool = False
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
        if self.bent is not None:
            tanh = np.tanh(x / self.bent)
            return tanh, (1 - tanh**2) / self.bent
        return x, np.ones_like(x)

    def rate(self, base: Array, drive: Array) -> tuple[Array, Array, Array | float]:
        """Return the logarithm of the rate, the rate, Hz, and the derivative of the log by drive.

        The rate is exp(base) times 1 + drive, with a soft threshold at 0, or times exp(drive).
        """
        if not self.linear:
            log = np.minimum(base + drive, MOST_LOG)
            return log, np.exp(log), 1.0
        rise = SHARPNESS * (1 + drive)
        factor = np.logaddexp(0, rise) / SHARPNESS + FLOOR
        log = np.minimum(base + np.log(factor), MOST_LOG)
        return log, np.exp(log), expit(rise) / factor


READINGS = {
    each.name: each
    for each in (
        Reading("exponential", linear=False),
        Reading("linear", linear=True),
        Reading("posterior", linear=False, bent=2.0, scaled=True),
        Reading("step", linear=False, bent=1.0),
    )
}
"""Readings without a circuit.

With log odds y of two sides, P of one less P of the other is tanh(y / 2).
"""


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
    activity = np.asarray((rates - rates[POINTS // 2]) / 10)
    return Reading(name, linear=True, scaled=True, curve=(lead, activity), circuit=circuit)

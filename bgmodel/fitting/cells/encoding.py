"""How recorded cells encode the sum of clicks: as log odds, posterior, step, or a nucleus."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.special import expit, ndtr

from circuits.anatomy import checked_circuit
from circuits.arrays import Array
from circuits.circuit import Circuit
from circuits.declaration.table_writer import identity
from circuits.dynamics.fixed_point import solve, wired
from circuits.errors import InputError, require

SHARPNESS, FLOOR, MOST_LOG = 8.0, 1e-4, 7.0
"""Sharpness of the threshold of a linear encoding, its least factor, and the largest log rate."""
REACH_NATS, POINTS = 8.0, 321
"""Largest input for which a circuit is solved, on either side, and the number of inputs."""
SHARPEST = 0.05
"""Least standard deviation, nats, over which the activity of a circuit is averaged."""
STILL_HZ = 1e-6
"""Change of a rate per nat that is rounding error, Hz."""


@dataclass(frozen=True, eq=False)
class Encoding:
    """How a cell encodes the sum of clicks."""

    name: str
    linear: bool  # whether the rate is linear in the function of the sum, or exponential
    bent: float | None = None  # input at which a hyperbolic tangent saturates; by default a line
    scaled: bool = False  # whether the input is in nats, of which a click has a fitted number
    # Input (points,), nats, and activity (points,) of a nucleus of a circuit in place of the line,
    # which continues beyond the ends with the slope there; and that circuit.
    curve: tuple[Array, Array] | None = None
    circuit: Circuit | None = None

    def identity(self) -> dict[str, Any]:
        """Return all that it depends on."""
        known = {"model": self.name}
        return known if self.circuit is None else known | {"circuit": identity(self.circuit)}

    def encode(self, x: Array, spread: float = 0.0) -> tuple[Array, Array, Array | float]:
        """Return the function of the sum, its derivative, and that by half the squared spread.

        A curve is averaged over Gaussian inputs with that standard deviation, nats: the sum moves
        within a bin. By the heat equation the last derivative is the second one by the input.
        """
        if self.curve is not None:
            at, value, slope = _averaged(self, float(np.hypot(spread, SHARPEST)))
            width = at[1] - at[0]
            place = (x - at[0]) / width
            # Beyond the ends ``bend`` is 0, so that the line continues.
            below = np.clip(place, 0, len(at) - 1).astype(np.int64)
            bend = np.append(np.diff(slope) / width, 0.0)[below]
            bend[place < 0] = 0.0
            away = (place - below) * width
            rise = slope[below] + bend * away
            return value[below] + away * (slope[below] + rise) / 2, rise, bend
        if self.bent is not None:
            tanh = np.tanh(x / self.bent)
            return tanh, (1 - tanh**2) / self.bent, 0.0
        return x, np.ones_like(x), 0.0

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


@lru_cache(maxsize=8)
def _averaged(encoding: Encoding, spread: float) -> tuple[Array, Array, Array]:
    """Return inputs, nats, with the value and the slope of a curve that is averaged over noise.

    Between inputs the slope is a line, and the value its integral.
    """
    assert encoding.curve is not None
    at, rate = encoding.curve
    slopes = np.diff(rate) / np.diff(at)
    x = np.linspace(at[0] - 4 * spread, at[-1] + 4 * spread, 2 * len(at))
    slope = slopes[0] + ndtr((x[:, None] - at[1:-1]) / spread) @ np.diff(slopes)
    rises = np.append(0.0, (slope[1:] + slope[:-1]) / 2 * np.diff(x))
    return x, rate[0] + slopes[0] * (x[0] - at[0]) + np.cumsum(rises), slope


ENCODINGS = {
    each.name: each
    for each in (
        Encoding("exponential", linear=False),
        Encoding("linear", linear=True),
        Encoding("posterior", linear=False, bent=2.0, scaled=True),
        Encoding("step", linear=False, bent=1.0),
    )
}
"""Encodings without a circuit.

With log odds y of two sides, P of one less P of the other is tanh(y / 2).
"""


def encoding_of(name: str, argument: str = "models") -> Encoding:
    """Return an encoding by its name, or as the nucleus of a circuit, such as "macaque D1"."""
    if name in ENCODINGS:
        return ENCODINGS[name]
    circuit, _, nucleus = str(name).rpartition(" ")
    if not circuit:
        allowed = ", ".join(ENCODINGS)
        must = f"must be {allowed}, or a circuit and a nucleus such as 'macaque D1'"
        raise InputError.of(argument, must, name)
    return nucleus_encoding(checked_circuit(circuit, 2), nucleus, str(name), argument)


def nucleus_encoding(
    circuit: Circuit, nucleus: str, name: str, argument: str = "models"
) -> Encoding:
    """Return the steady activity of a nucleus's first channel, by the lead of its evidence.

    Activity follows evidence within tens of ms, much faster than the sum of clicks moves. It is
    relative to rest, in units of its change per nat there.
    """
    names = [row.name for row in circuit.populations]
    require(nucleus in names, argument, f"must name a nucleus, one of {', '.join(names)}", nucleus)
    lead = np.linspace(-REACH_NATS, REACH_NATS, POINTS)
    wiring, middle = wired(circuit), POINTS // 2
    drive = np.stack([lead / 2, -lead / 2], axis=1)
    rates = wiring.rates(solve(wiring, drive))[:, wiring.blocks_of(nucleus)][:, 0]
    per_nat = (rates[middle + 1] - rates[middle - 1]) / (lead[middle + 1] - lead[middle - 1])
    require(abs(per_nat) > STILL_HZ, argument, "must name a nucleus that follows evidence", name)
    activity = np.asarray((rates - rates[middle]) / per_nat)
    return Encoding(name, linear=True, scaled=True, curve=(lead, activity), circuit=circuit)

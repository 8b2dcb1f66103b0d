"""The leaky integrate-and-fire cell."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from circuits.arrays import Array
from circuits.cells.cell import (
    BrianText,
    Cell,
    Constants,
    Line,
    Response,
    check_constants,
    register,
)
from circuits.cells.membrane import Membrane, lif_rate_hz
from circuits.cells.response import lif_response
from circuits.cells.single import ONE, ZERO, choose, fused, single
from circuits.checks import whole_ticks
from circuits.errors import require

OVERSHOOT = 0.5825971579390107
"""-zeta(1/2)/sqrt(2 pi): overshoot of a sampled walk over a bound, in steps (Siegmund 1985)."""


def _begin(
    uniform: Any,
    decay: Any,
    rest: Any,
    slope: Any,
    noise_step: Any,
    unit: Any,
    threshold: Any,
    held: Any,
) -> tuple[Any, ...]:
    return single(uniform) * threshold * unit, held * ZERO


def _tick(
    heard: Any, ones: Any, v: Any, wait: Any,
    decay: Any, rest: Any, slope: Any, noise_step: Any, unit: Any, threshold: Any, held: Any,
) -> tuple[Any, ...]:  # fmt: skip
    push = fused(noise_step, ones, fused(slope, single(heard), rest))
    moved = choose(wait > ZERO, v, fused(decay, v, push))
    fired = moved >= threshold
    left = choose(wait > ZERO, wait - ONE, ZERO)
    return fired, choose(fired, ZERO, moved), choose(fired, held, left)


@register
@dataclass(frozen=True)
class Lif(Membrane, Cell):
    """Leaky integrate-and-fire cell with white membrane noise, in mV above a reference.

    ``tau dV/dt = rest_mv + mv_per_nat x - V + noise_mv sqrt(2 tau) xi``. The threshold is lowered
    by the overshoot of a sampled path (Broadie, Glasserman & Kou 1997), so that the rate equals
    that in continuous time to first order in the tick. ``membrane.fit_current`` fits both
    ``rest_mv``, the mean potential at x = 0, and its slope ``mv_per_nat`` to a line.
    """

    rest_mv: float
    mv_per_nat: float
    hears: ClassVar[str] = "nats"
    state: ClassVar[tuple[str, ...]] = ("v", "wait")
    of_rates: ClassVar[tuple[str, ...]] = ("tau_ms",)
    begin = staticmethod(_begin)
    tick = staticmethod(_tick)
    brian: ClassVar[BrianText | None] = BrianText(
        tick="""
            push = fused(noise_step, ones(word, t_in_timesteps), fused(slope, nats, rest))
            v = chosen(wait > 0, v, fused(decay, v, push))
            wait = clip(wait - 1, 0, inf)
        """,
        spike="v >= threshold",
        reset="""
            v = 0
            wait = held
        """,
    )

    def __post_init__(self) -> None:
        check_constants(self, "tau_ms", "noise_mv")
        below = f"must lie below threshold_mv = {self.threshold_mv:g}"
        require(self.reset_mv < self.threshold_mv, "reset_mv", below, self.reset_mv)

    def step_mv(self, dt_ms: float, tau: Any = 1.0) -> Any:
        """Return the SD of the noise per tick, mV; ``tau`` is a factor on the time constant."""
        return self.noise_mv * np.sqrt(-np.expm1(-2 * dt_ms / (self.tau_ms * tau)))

    def sampled_threshold_mv(self, dt_ms: float, tau: Any = 1.0, height: Any = 1.0) -> Any:
        """Return the threshold for a path sampled every dt, mV.

        ``tau`` and ``height`` (neurons,) are factors on the time constant and on the distance from
        reset to threshold.
        """
        way = (self.threshold_mv - self.reset_mv) * height
        return self.reset_mv + way - OVERSHOOT * self.step_mv(dt_ms, tau)

    # ---- laws

    def membrane_ms(self) -> float:
        """Return the membrane's time constant."""
        return self.tau_ms

    def mean_mv(self, x: Array) -> Array:
        """Return the mean potential without a threshold, mV, at inputs x, nats."""
        return self.rest_mv + self.mv_per_nat * x

    def rate_hz(self, x: Array, line_hz: Array) -> Array:
        """Return the rate at steady inputs x, nats, by Siegert's formula, Hz."""
        return lif_rate_hz(self, self.mean_mv(x))

    def response(self, x: Array, line: Line, frequency_hz: Array) -> Response:
        """Return the response from the Fokker-Planck equation; it includes the membrane filter."""
        per_mv = lif_response(self, self.mean_mv(x), frequency_hz)
        gain, bend = self.mv_per_nat * per_mv.gain, self.mv_per_nat**2 * per_mv.bend
        return Response(gain, bend, per_mv.spectrum)

    def varied(self, factors: Array) -> tuple[Cell, float]:
        """Return a cell with scaled time constant, slope, and distance from reset to threshold."""
        tau, slope, top = (float(factor) for factor in factors)
        threshold_mv = self.reset_mv + top * (self.threshold_mv - self.reset_mv)
        constants = {"tau_ms": tau * self.tau_ms, "mv_per_nat": slope * self.mv_per_nat}
        return replace(self, **constants, threshold_mv=threshold_mv), 1.0

    # ---- spikes

    def constants(self, factors: Array, dt_ms: float) -> Constants:
        """Return the constants of a tick, ``v = decay v + (rest + slope nats + noise_step ones)``.

        v is measured from the reset, scaled so that all cells of the population have the same
        threshold; the noise is ``ones`` of 8 bits, and ``rest`` corrects for its mean of 4.
        """
        tau, slope, top = factors
        decay = np.exp(-dt_ms / (self.tau_ms * tau))
        bit = self.step_mv(dt_ms, tau) / np.sqrt(2)
        threshold = self.sampled_threshold_mv(dt_ms) - self.reset_mv
        unit = threshold / (self.sampled_threshold_mv(dt_ms, tau, top) - self.reset_mv)
        values = {
            "decay": decay,
            "rest": unit * ((self.rest_mv - self.reset_mv) * (1 - decay) - 4 * bit),
            "slope": unit * self.mv_per_nat * slope * (1 - decay),
            "noise_step": unit * bit,
            "unit": unit,
            "threshold": threshold,
            "held": whole_ticks("refractory_ms", self.refractory_ms, dt_ms),
        }
        return {name: np.float32(value) for name, value in values.items()}

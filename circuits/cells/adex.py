"""The adaptive exponential integrate-and-fire cell (Brette & Gerstner 2005)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from circuits.arrays import Array
from circuits.cells.cell import BrianText, Cell, Constants, check_constants, register
from circuits.cells.single import ONE, ZERO, choose, exponential, fused, single
from circuits.checks import whole_ticks
from circuits.errors import InputError


def _begin(
    uniform: Any,
    decay: Any, rest: Any, slope: Any, noise_step: Any, sharp: Any, knee: Any, lift: Any, pull: Any,
    fade: Any, follow: Any, tail: Any, peak: Any, jump: Any, held: Any, height: Any,
) -> tuple[Any, ...]:  # fmt: skip
    return single(uniform) * height, held * ZERO, held * ZERO


def _tick(
    heard: Any, ones: Any, v: Any, w: Any, wait: Any,
    decay: Any, rest: Any, slope: Any, noise_step: Any, sharp: Any, knee: Any, lift: Any, pull: Any,
    fade: Any, follow: Any, tail: Any, peak: Any, jump: Any, held: Any, height: Any,
) -> tuple[Any, ...]:  # fmt: skip
    push = fused(noise_step, ones, fused(slope, single(heard), rest))
    push = fused(lift, exponential(fused(sharp, v, knee)), push)
    moved = choose(wait > ZERO, v, fused(decay, v, fused(pull, w, push)))
    drawn = fused(fade, w, fused(follow, v, tail))
    fired = moved >= peak
    left = choose(wait > ZERO, wait - ONE, ZERO)
    return (
        fired,
        choose(fired, ZERO, moved),
        choose(fired, drawn + jump, drawn),
        choose(fired, held, left),
    )


@register
@dataclass(frozen=True)
class AdEx(Cell):
    """Adaptive exponential cell with white membrane noise (Brette & Gerstner 2005, equations 1-3).

    ``tau dV/dt = rest_mv + mv_per_nat x - V + sharpness_mv exp((V - knee_mv)/sharpness_mv) - W +
    noise_mv sqrt(2 tau) xi`` and ``tau_w dW/dt = adaptation (V - leak_mv) - W``; V and W in mV, W
    being the adaptation current over the leak conductance. At ``peak_mv`` it spikes: V goes to the
    reset, W up by ``jump_mv``. A tick is exact in the linear terms; the upstroke is held constant.

    The paper's cell (table 1, divided by a leak of 30 nS; mV unchanged): ``AdEx(tau_ms=9.37,
    noise_mv=..., knee_mv=-50.4, sharpness_mv=2, peak_mv=20, reset_mv=-70.6, refractory_ms=0,
    rest_mv=-70.6, mv_per_nat=..., tau_w_ms=144, adaptation=4/30, jump_mv=2.68, leak_mv=-70.6)``.
    """

    tau_ms: float
    noise_mv: float  #: Standard deviation of the linear membrane.
    knee_mv: float  #: Onset of the upstroke, V_T.
    sharpness_mv: float  #: Sharpness of the upstroke, Delta_T.
    peak_mv: float  #: Potential at which a spike is counted.
    reset_mv: float
    refractory_ms: float
    rest_mv: float  #: Mean potential of the linear membrane at x = 0.
    mv_per_nat: float
    tau_w_ms: float  #: Time constant of adaptation.
    adaptation: float  #: Steady-state W per mV of V, a / g_L.
    jump_mv: float  #: Increment of W per spike, b / g_L.
    leak_mv: float  #: Potential relative to which adaptation is measured, E_L.
    hears: ClassVar[str] = "nats"
    state: ClassVar[tuple[str, ...]] = ("v", "w", "wait")
    begin = staticmethod(_begin)
    tick = staticmethod(_tick)
    brian: ClassVar[BrianText | None] = BrianText(
        tick="""
            push = fused(noise_step, ones(word, t_in_timesteps), fused(slope, nats, rest))
            push = fused(lift, exponential(fused(sharp, v, knee)), push)
            drawn = fused(fade, w, fused(follow, v, tail))
            v = chosen(wait > 0, v, fused(decay, v, fused(pull, w, push)))
            w = drawn
            wait = clip(wait - 1, 0, inf)
        """,
        spike="v >= peak",
        reset="""
            v = 0
            w = single(w + jump)
            wait = held
        """,
    )

    def __post_init__(self) -> None:
        check_constants(self, "tau_ms", "tau_w_ms", "noise_mv", "sharpness_mv")
        if not self.reset_mv < self.knee_mv < self.peak_mv:
            values = f"{self.reset_mv}, {self.knee_mv} and {self.peak_mv}"
            reason = f"reset_mv must lie below knee_mv, and that below peak_mv, got {values}"
            raise InputError(reason, "reset_mv")

    def constants(self, factors: Array, dt_ms: float) -> Constants:
        """Return the constants of a tick, v in mV from the reset.

        The factors act on the time constant, mv_per_nat and the distance from reset to knee.
        """
        tau, slope, top = factors
        decay, fade = np.exp(-dt_ms / (self.tau_ms * tau)), np.exp(-dt_ms / self.tau_w_ms)
        bit = self.noise_mv * np.sqrt((1 - decay**2) / 2)
        way = (self.knee_mv - self.reset_mv) * top
        values = {
            "decay": decay,
            "rest": (self.rest_mv - self.reset_mv) * (1 - decay) - 4 * bit,
            "slope": self.mv_per_nat * slope * (1 - decay),
            "noise_step": bit,
            "sharp": 1 / self.sharpness_mv,
            "knee": -way / self.sharpness_mv,
            "lift": self.sharpness_mv * (1 - decay),
            "pull": decay - 1,
            "fade": fade,
            "follow": self.adaptation * (1 - fade),
            "tail": self.adaptation * (self.reset_mv - self.leak_mv) * (1 - fade),
            "peak": self.peak_mv - self.reset_mv,
            "jump": self.jump_mv,
            "held": whole_ticks("refractory_ms", self.refractory_ms, dt_ms),
            "height": way,
        }
        return {name: np.float32(value) for name, value in values.items()}

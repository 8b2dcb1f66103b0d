"""Cell types: what turns the input of a channel, in nats, into spikes or a rate.

An input ``x`` arrives in nats; a population's row says which rate that stands for,
``rate_hz = baseline_hz + gain_hz_per_nat * f(x)``. Source-like and escape cells fire at that rate
by construction; an integrate-and-fire cell turns x into a mean membrane potential and fires as its
membrane decides.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from circuits.checks import check_types

OVERSHOOT = 0.5825971579390107
"""-zeta(1/2)/sqrt(2 pi): how far, in steps, a sampled walk overshoots a bound (Siegmund 1985)."""


@dataclass(frozen=True)
class Rate:
    """A noiseless unit that passes its rate on: a population too large, or too abstract, for cells.

    Parameters
    ----------
    signed : bool
        Whether the rate stands for the difference from a tonic level, and so may be negative.
    """

    signed: bool = False
    kind: ClassVar[str] = "rate"

    def __post_init__(self) -> None:
        check_types(self, "a Rate cell")


@dataclass(frozen=True)
class Integrator:
    """A unit without leak, ``tau dx/dt = input``, that passes its rate on."""

    signed: bool = True
    kind: ClassVar[str] = "integrator"

    def __post_init__(self) -> None:
        check_types(self, "an Integrator cell")


@dataclass(frozen=True)
class Lif:
    """Leaky integrate-and-fire cell with white membrane noise, in mV above a reference.

    ``tau dV/dt = rest_mv + mv_per_nat x - V + noise_mv sqrt(2 tau) xi``. The threshold is lowered
    by the overshoot of a sampled path (Broadie, Glasserman & Kou 1997), so that the rate is that of
    continuous time to first order in the tick.

    Parameters
    ----------
    tau_ms, refractory_ms : float
        Membrane time constant and absolute refractory period, ms.
    noise_mv : float
        Standard deviation of the membrane without a threshold, mV.
    threshold_mv, reset_mv : float
        mV above the reference.
    rest_mv, mv_per_nat : float
        Mean potential at x = 0, and its slope. ``firing.fit_current`` finds both for a wanted line.
    """

    tau_ms: float
    noise_mv: float
    threshold_mv: float
    reset_mv: float
    refractory_ms: float
    rest_mv: float
    mv_per_nat: float
    kind: ClassVar[str] = "lif"

    def __post_init__(self) -> None:
        check_types(self, "a Lif cell")
        if not all(np.isfinite(value) for value in vars(self).values()):
            raise ValueError(f"constants of a Lif cell must be finite, got {vars(self)}")
        for name in ("tau_ms", "noise_mv"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} of a Lif cell must be > 0, got {getattr(self, name)}")
        if not self.refractory_ms >= 0:
            raise ValueError(f"refractory_ms must be >= 0, got {self.refractory_ms}")
        if not self.reset_mv < self.threshold_mv:
            raise ValueError(
                f"reset_mv must lie below threshold_mv, got {self.reset_mv} and {self.threshold_mv}"
            )

    def step_mv(self, dt_ms: float, tau: Any = 1.0) -> Any:
        """Return the sd of a tick's noise, mV; ``tau`` is a factor on the time constant."""
        return self.noise_mv * np.sqrt(-np.expm1(-2 * dt_ms / (self.tau_ms * tau)))

    def sampled_threshold_mv(self, dt_ms: float, tau: Any = 1.0, height: Any = 1.0) -> Any:
        """Return the threshold for a path sampled every dt, mV.

        Parameters
        ----------
        dt_ms : float
            One tick, ms.
        tau, height : float or arrays (neurons,)
            Factors, cell by cell, on the time constant and on the way from reset to threshold.
        """
        way = (self.threshold_mv - self.reset_mv) * height
        return self.reset_mv + way - OVERSHOOT * self.step_mv(dt_ms, tau)


@dataclass(frozen=True)
class Escape:
    """A cell that fires with hazard ``rate_hz`` after a refractory period: Poisson if that is 0."""

    refractory_ms: float = 0.0
    kind: ClassVar[str] = "escape"

    def __post_init__(self) -> None:
        check_types(self, "an Escape cell")
        if not 0 <= self.refractory_ms < np.inf:
            raise ValueError(f"refractory_ms must be >= 0, got {self.refractory_ms}")


@dataclass(frozen=True)
class Phase:
    """A renewal source of given CV: ``dphi = r dt + cv sqrt(r) dW``, a spike at every whole phi.

    Its intervals are inverse Gaussian with mean 1/r and coefficient of variation cv; its rate is
    exact. A pacemaker for cv well below 1, a cortical source near .5.
    """

    cv: float
    kind: ClassVar[str] = "phase"

    def __post_init__(self) -> None:
        check_types(self, "a Phase cell")
        if not 0 <= self.cv <= 1:
            raise ValueError(f"cv must lie in 0..1, got {self.cv}")


Cell = Rate | Integrator | Lif | Escape | Phase
SPIKING = (Lif, Escape, Phase)
CELLS: dict[str, type] = {kind.__name__: kind for kind in (Rate, Integrator, Lif, Escape, Phase)}
"""Cell types by the name of their class."""

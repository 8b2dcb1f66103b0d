"""The project's problems formulated for PyDDM and ssm-simulators.

The unit of time is a reading, and the unit of an accumulator the standard deviation of a reading.
Each mapping is then exact but for one: PyDDM's time is continuous. There a walk with increments of
mean d^2/2 and standard deviation d and bounds at +-theta is a diffusion of drift 1/2 and unit noise
in the time d^2 t, with bounds moved out by the mean overshoot, 0.5826 d (Siegmund 1979). The
variance of the overshoot is a quarter of that of a reading; by Wald's second identity the walk
takes a quarter of a reading longer for it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bgmodel.evidence import Evidence
from bgmodel.integrators.baselines import Lca, Race
from bgmodel.integrators.first_passage import gaussian_pair, walk
from bgmodel.integrators.sprt_theory import OVERSHOOT
from circuits.arrays import Array

LATE = 0.25
"""Readings that a walk takes longer than the diffusion with corrected bounds."""
LEFT = 1e-6
"""Approximate share of trials that are not decided by the last reading."""
FLOOR = 200.0
"""Distance of ssm-simulators' floor below the start, in sd of a reading: too far to be reached."""
SSM_READINGS = 900
"""Readings of a trial: ssm-simulators counts responses from 999 on as omissions."""


class Ends(NamedTuple):
    """Share of wrong responses, mean number of readings, and the distribution of times.

    ``cdf`` (points,) holds the probability of a decision by each of ``readings``, rising.
    """

    error_rate: float
    mean: float
    readings: Array
    cdf: Array

    def before(self, readings: Array) -> Array:
        """Return the probability of a decision by each number of readings."""
        return np.interp(readings, self.readings, self.cdf)


def readings_needed(d: float, theta: float) -> int:
    """Return the number of readings after which all but ``LEFT`` of the trials are decided."""
    # The slowest mode of the diffusion between the bounds.
    rate = d**2 / 2 * (1 / 4 + np.pi**2 / (4 * theta**2))
    return int(np.ceil(-np.log(LEFT) / rate))


def exact(d: float, theta: float, start: float) -> Ends:
    """Return the discrete walk by Nystrom's solution, the mean over both hypotheses.

    The means are ``d`` sd of a reading apart, bounds are at +-theta, and Z starts at ``start``,
    nats.
    """
    last = readings_needed(d, theta)
    first, second = (walk(x, -theta, theta, start=start, t_max=last) for x in gaussian_pair(d))
    pmf = (np.asarray(first.steps_pmf) + np.asarray(second.steps_pmf)) / 2
    error_rate = (first.p_upper + second.p_lower) / 2
    mean = (first.mean_steps + second.mean_steps) / 2
    return Ends(error_rate, mean, np.arange(last + 1.0), np.cumsum(pmf))


def by_pyddm(
    d: float, theta: float, start: float, *, overshoot: float = OVERSHOOT, drift: float = 1.0
) -> Ends:
    """Return the diffusion by PyDDM's analytic solution, the mean over both hypotheses.

    The bounds are moved out by ``overshoot`` times d; 0 is Wald's approximation. The factor on the
    drift is other than 1 for a control.
    """
    from pyddm import BoundConstant, DriftConstant, ICPoint, Model, NoiseConstant

    until = readings_needed(d, theta) * d**2
    densities = []
    for state in (-0.5, 0.5):
        model = Model(
            drift=DriftConstant(drift=state * drift),
            noise=NoiseConstant(noise=1),
            bound=BoundConstant(B=theta + overshoot * d),
            IC=ICPoint(x0=start),
            dt=until / 20_000,
            dx=0.001,
            T_dur=until,
        )
        solved = model.solve()
        densities.append([solved.pdf("error"), solved.pdf("correct")])
        times = solved.t_domain
    step = times[1] - times[0]
    (low_1, up_1), (low_2, up_2) = np.asarray(densities)
    wrong, both = (up_1 + low_2) / 2, (low_1 + up_1 + low_2 + up_2) / 2
    cdf = np.append(0, np.cumsum(both[1:] + both[:-1])) * step / 2
    mean = np.trapezoid(both * times, dx=step) / d**2 + LATE
    # The diffusion decides on average half a reading before the reading that shows it.
    readings = times / d**2 + LATE - 0.5
    return Ends(float(np.trapezoid(wrong, dx=step)), float(mean), readings, cdf)


class Responses(NamedTuple):
    """Whether each response is right (trials,), and the readings that it took."""

    correct: Array
    readings: Array


@dataclass(frozen=True)
class Accumulators:
    """A race, or leaky competing accumulators, of two to four; the first one is right.

    Parameters
    ----------
    alternatives : int
        2, 3 or 4; ssm-simulators has no ``lca`` of two.
    separation : float
        Mean of the true channel, sd of a reading.
    bound : float
        Distance of the bound above the start, sd of a reading.
    leak, inhibition : float, optional
        Per reading, in continuous time; without them it is a race.
    """

    alternatives: int
    separation: float
    bound: float
    leak: float | None = None
    inhibition: float = 0.0

    @property
    def decays(self) -> tuple[float, float]:
        """Decay per reading of the mean over channels, and of differences between channels."""
        leak = self.leak or 0.0
        return leak + (self.alternatives - 1) * self.inhibition, leak - self.inhibition

    def ours(self) -> tuple[Race | Lca, float]:
        """Return our integrator, and its threshold on OUT."""
        if self.leak is None:
            return Race(), -self.bound
        return Lca(1000 * self.leak, 1000 * self.inhibition), -self.bound

    def evidence(self, trials: int, rng: np.random.Generator) -> Evidence:
        """Draw readings of unit variance; truth is hypothesis 0.

        Our LCA takes a reading as constant until the next one, theirs adds it at once. The mean
        over channels and the differences between them (the two modes) are therefore divided by the
        part that a constant input leaves after one reading, so that both add the same.
        """
        readings = rng.standard_normal((trials, SSM_READINGS, self.alternatives))
        readings[:, :, 0] += self.separation
        together, apart = (-np.expm1(-k) / k if k else 1.0 for k in self.decays)
        common = readings.mean(axis=2, keepdims=True)
        held = common / together + (readings - common) / apart
        return Evidence(held, np.zeros(trials, dtype=int))

    def theirs(self, *, floor: float = FLOOR, drift: float = 1.0) -> tuple[str, dict[str, float]]:
        """Return the name of ssm-simulators' model, and its parameters at a time step of 1.

        Their accumulators cannot fall below 0: the start and the bound are raised by ``floor``, and
        the drift by what leak and inhibition take there. A time step subtracts g x_i + b sum_{j !=
        i} x_j; g and b are chosen so that both modes decay as ours do. A floor of 0, their default,
        and a factor on the drift other than 1 are controls.
        """
        n = self.alternatives
        together, apart = (-float(np.expm1(-k)) for k in self.decays)
        level = self.bound + floor
        parameters = {f"v{i}": floor * together for i in range(n)}
        parameters["v0"] += drift * self.separation
        parameters |= {"a": level} | {f"z{i}": floor / level for i in range(n)} | {"t": 0.0}
        if self.leak is None:
            return f"race_{n}", parameters
        b = (together - apart) / n
        return f"lca_{n}", parameters | {"g": apart + b, "b": b}


def by_ssm_simulators(model: str, theta: dict[str, float], trials: int, seed: int) -> Responses:
    """Return decisions of ssm-simulators with a time step of one reading."""
    from ssms.basic_simulators.simulator import simulator

    simulated = simulator(
        {name: np.full(1, value) for name, value in theta.items()},
        model=model,
        n_samples=trials,
        delta_t=1.0,
        max_t=SSM_READINGS,
        smooth_unif=False,
        random_state=seed,
    )
    choices = simulated["choices"].ravel()
    return Responses((choices == 0).astype(float), simulated["rts"].ravel().astype(float))

"""The likelihood of a diffusion with bias, drift variability and a falling gap, by PyDDM's solver.

PyDDM solves the Fokker-Planck equation at one drift on a grid of time and evidence. Drifts that
differ from trial to trial are averaged here over equally spaced drifts: of a normal density the
trapezoidal rule is exact to 1e-7 where the spacing is half its standard deviation (Trefethen &
Weideman 2014). Non-decision times and lapses are those of ``bgmodel.fitting.responses``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.special import ndtr

from bgmodel.fitting.algorithms import Gap
from circuits.arrays import Array, Integers

SPACING = 0.5
"""Spacing of drifts, 1/sqrt(s): about half their standard deviation here."""
REACH = 6.0
"""Range of drifts on either side of the mean, in standard deviations."""


def solved(
    gap: Gap, values: Mapping[str, float], drift: float, step: float, seconds: float
) -> Array:
    """Return the densities of both decisions that PyDDM finds at one drift, (2, times), 1/s.

    The drift is in 1/sqrt(s); ``step`` is that of time, s, and of evidence.
    """
    from pyddm import Bound, Model
    from pyddm.models import DriftConstant, ICPointRatio, NoiseConstant, OverlayNone

    class Falling(Bound):
        name = "bound of a gap"
        required_parameters = ()

        def get_bound(self, t, conditions, **_):
            return float(gap.at(values["bound"], values, np.array([t]))[0][0])

    made = Model(
        drift=DriftConstant(drift=drift), noise=NoiseConstant(noise=1), bound=Falling(),
        IC=ICPointRatio(x0=values["start"]), overlay=OverlayNone(),
        dx=step, dt=step, T_dur=seconds,
    ).solve()  # fmt: skip
    return np.stack([made.pdf("error"), made.pdf("correct")])


@dataclass
class ByPyddm:
    """Log likelihoods of trials by PyDDM's solver.

    Parameters
    ----------
    gap : Gap
        The gap.
    step : float
        PyDDM's step of time, s, and of evidence.
    seconds : float
        End of the window of responses, s; those of lapses are uniform until then.
    strength, response, rt_s : array (trials,)
        Signed strength, response (0 or 1) and response time of each trial.
    """

    gap: Gap
    step: float
    seconds: float
    strength: Array
    response: Integers
    rt_s: Array
    _solved: dict[tuple[float, ...], Array] = field(default_factory=dict)

    def each(self, values: Mapping[str, float]) -> Array:
        """Return the log likelihood of each trial, nats.

        Values are ``sensitivity``, ``bound``, ``start``, ``drift_sd``, the gap's own, and ``t0_s``,
        ``t0_sd_s`` and ``lapse``.
        """
        likelihood, inside = np.empty(len(self.rt_s)), np.empty(len(self.rt_s))
        # The non-decision time is averaged over each step.
        half = self.step / 2 / values["t0_sd_s"]
        for strength in np.unique(self.strength):
            density = self._density(values, values["sensitivity"] * strength)
            here = np.flatnonzero(self.strength == strength)
            times = np.arange(density.shape[1]) * self.step
            left = (self.rt_s[here, None] - values["t0_s"] - times) / values["t0_sd_s"]
            kernel = ndtr(left + half) - ndtr(left - half)
            likelihood[here] = np.einsum("ij,ij->i", density[self.response[here]], kernel)
            soon = ndtr((self.seconds - values["t0_s"] - times) / values["t0_sd_s"])
            inside[here] = density.sum(axis=0) @ soon * self.step
        lapse = values["lapse"]
        # Later responses were left out of the trials: what is seen are those within the window.
        each = (1 - lapse) * likelihood + lapse / (2 * self.seconds)
        return np.log(each / ((1 - lapse) * inside + lapse))

    def _density(self, values: Mapping[str, float], mean: float) -> Array:
        """Return the densities of both decisions, averaged over drifts."""
        if not values.get("drift_sd"):
            return self._at(values, mean)
        sd = values["drift_sd"]
        first, last = np.round((mean + np.array([-REACH, REACH]) * sd) / SPACING).astype(int)
        drifts = SPACING * np.arange(first, last + 1)
        weights = SPACING / sd * np.exp(-(((drifts - mean) / sd) ** 2) / 2) / np.sqrt(2 * np.pi)
        return np.asarray(
            sum(w * self._at(values, v) for w, v in zip(weights, drifts, strict=True))
        )

    def _at(self, values: Mapping[str, float], drift: float) -> Array:
        """Return a solution; those at the same gap and start are kept."""
        names = ("bound", "start", *(each.name for each in self.gap.parameters))
        of = tuple(float(values.get(name, 0.0)) for name in names)
        if self._solved and next(iter(self._solved))[:-1] != of:
            self._solved.clear()
        if (*of, drift) not in self._solved:
            self._solved[*of, drift] = solved(self.gap, values, drift, self.step, self.seconds)
        return self._solved[*of, drift]

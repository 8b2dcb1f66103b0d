"""Palmer's fit of accuracy and mean times by the closed form of a test with a constant gap."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bgmodel.fitting import passage
from bgmodel.fitting.design import Design
from circuits.arrays import Array


class MeansFit(NamedTuple):
    """The closed form that best fits accuracy and mean times.

    ``bound``, sqrt(s); ``sensitivity``, 1/sqrt(s) per unit of strength; ``t0_s``, s; ``mean_s``,
    ``sd_s`` and ``accuracy`` (cells,) are its predictions, the SD that of decision times alone.
    """

    bound: float
    sensitivity: float
    t0_s: float
    mean_s: Array
    sd_s: Array
    accuracy: Array


def fit_means(design: Design) -> MeansFit:
    """Return the closed form under which choices and mean times are most likely.

    Trials are binomial, and the mean time of each strength is Gaussian with its observed standard
    error (Palmer, Huk & Shadlen 2005). Times of both responses are pooled, because the closed form
    predicts that they are identically distributed. The design is by strength only, with a response
    in every trial.
    """
    from scipy.optimize import minimize

    seen = design.observed
    cells = [seen.cell == cell for cell in range(design.cells)]
    mean = np.array([seen.rt_s[some].mean() for some in cells])
    error = np.array([seen.rt_s[some].std() / np.sqrt(some.sum()) for some in cells])
    right = np.array([seen.response[some].sum() for some in cells])
    trials = design.trials

    def cost(logs: Array) -> float:
        sensitivity, bound, t0 = np.exp(logs)
        drift = sensitivity * design.strength
        p_correct = np.clip(passage.accuracy(drift, bound), 1e-12, 1 - 1e-12)
        off = (passage.mean_time_s(drift, bound) + t0 - mean) / error
        speaks = design.strength > 0  # without evidence no response is correct
        choices = right * np.log(p_correct) + (trials - right) * np.log1p(-p_correct)
        return float((off**2).sum() / 2 - choices[speaks].sum())

    minimum = minimize(
        cost, np.log([10.0, 0.7, 0.3]), method="Nelder-Mead",
        options={"xatol": 1e-7, "fatol": 1e-7, "maxiter": 5000},
    )  # fmt: skip
    sensitivity, bound, t0 = (float(value) for value in np.exp(minimum.x))
    drift = sensitivity * design.strength
    return MeansFit(
        bound,
        sensitivity,
        t0,
        passage.mean_time_s(drift, bound) + t0,
        passage.sd_time_s(drift, bound),
        passage.accuracy(drift, bound),
    )

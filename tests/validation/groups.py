"""Groups of people who follow the test, drawn from the prior of a hierarchical fit.

The prior is restricted to values as in fits to people and monkeys: each mean is uniform over a
range, and each standard deviation between people half-t below ``MOST_SD``. Draws of the posterior
within the same limits are then draws from the posterior under the prior that made the data, and the
rank of the truth among them is uniform (Talts et al. 2018). The scale is fixed: the unit that a fit
takes from the data would make the prior depend on them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bgmodel.fitting.algorithms import Model
from bgmodel.fitting.design import Design
from bgmodel.fitting.hierarchy.group import FREEDOM, SPREAD, Scale
from bgmodel.fitting.likelihood import Likelihood
from bgmodel.support.seeds import stream
from circuits.arrays import Array
from figures.data.decided import decided_by_test, responses

STRENGTHS = (0.032, 0.064, 0.128, 0.256)
RANGES = {
    "sensitivity": (8.0, 25.0), "bound": (0.45, 0.9), "threshold_nats": (0.17, 0.37),
    "t0_s": (0.25, 0.5), "t0_sd_s": (0.03, 0.1), "lapse": (0.002, 0.03),
}  # fmt: skip
"""Ranges of the median person's parameters, as in fits to people and monkeys."""
MOST_SD = 1.5
"""Largest standard deviation between people, in units of the scale: 3/8 of a typical value."""


@dataclass(frozen=True)
class Truth:
    """Parameters of a group and of its people, on the scale.

    Parameters
    ----------
    scale : Scale
        The scale.
    mean, sd : array (parameters,)
        Distribution of the group.
    scaled : array (people, parameters)
        The people.
    """

    scale: Scale
    mean: Array
    sd: Array
    scaled: Array


def names_of(model: Model) -> list[str]:
    """Return the names of the parameters that differ between people."""
    return [each.name for each in model.parameters if each.free]


def scale_of(likelihood: Likelihood) -> Scale:
    """Return the scale, whose unit is a quarter of the middle of each range."""
    middles = [sum(RANGES[name]) / 2 for name in likelihood.freedom.names]
    return Scale.of(likelihood.freedom, np.array(middles))


def group(scale: Scale, names: Sequence[str], rng: np.random.Generator, people: int) -> Truth:
    """Return a group and its people, drawn from the prior."""
    low, high = np.array([RANGES[name] for name in names]).T
    mean = scale.to(rng.uniform(low, high))
    sd = np.full(len(names), np.inf)
    while (above := sd > MOST_SD).any():
        sd[above] = SPREAD * np.abs(rng.standard_t(FREEDOM, size=above.sum()))
    return Truth(scale, mean, sd, mean + sd * rng.normal(size=(people, len(names))))


def trials_of(values: dict[str, float], seed: int, number: int, who: int, each: int) -> Design:
    """Return the trials of a person."""
    rng = stream(seed, "responses", "test", number, who)
    return responses(values, STRENGTHS, decided_by_test(values, STRENGTHS, each, rng), rng)

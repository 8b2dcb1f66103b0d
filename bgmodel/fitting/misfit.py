"""Whether data differ from a fitted model by more than chance, of a person or of a group.

Three chi-square tests: accuracy in each cell, mean response time in each cell, and the trials of
all cells counted by response and by the quantiles of the model's response times (Ratcliff &
Tuerlinckx 2002). No degree of freedom is subtracted for fitted parameters, so the tests are
conservative (Chernoff & Lehmann 1954).

In a group they are applied to sums over all people, at the medians of each person's parameters. Of
single people only the counts are tested: with fewer than a hundred trials in a cell, means and
shares are not Gaussian enough for as many tests as there are people.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from operator import add

import numpy as np
import pandas as pd

from bgmodel.fitting.design import Design
from bgmodel.fitting.likelihood import Likelihood
from bgmodel.fitting.optimum import Optimum
from bgmodel.fitting.responses import QUANTILES
from bgmodel.fitting.simulated.error import jackknifed
from circuits.arrays import Array, Truths

BEYOND_CHANCE = 0.003
"""Probability under the model below which the worst of the three tests is reported, after a
Bonferroni correction."""
COUNTED, LEAST, RESPONSES = 5, 1, 20
"""Expected number of trials from which a count is tested on its own, and all smaller ones together;
number of responses from which a mean is tested on its own."""
NAMED = 3
"""Number of cells that a warning names."""


ACCURACY, MEAN, TIMES = (
    "accuracy",
    "mean response time",
    "the distribution of responses and their times",
)
"""The three tests."""
ENOUGH = {ACCURACY: COUNTED, MEAN: RESPONSES, TIMES: COUNTED}
"""Size of a sum from which it is tested on its own."""
FIXED = {ACCURACY: 0, MEAN: 0, TIMES: 1}
"""Number of sums that data and model have in common: all trials are counted."""


@dataclass(frozen=True)
class Excess:
    """Observed minus predicted sums over trials."""

    off: Array  # (sums,), the differences
    variance: Array  # (sums,), for as many trials of the model
    parts: Array  # (parts, sums), predicted without each part of simulated trials; no row if exact
    size: Array  # (sums,), number of trials behind each

    def __add__(self, other: Excess) -> Excess:
        return Excess(
            self.off + other.off, self.variance + other.variance,
            self.parts + other.parts, self.size + other.size,
        )  # fmt: skip

    def placed(self, places: Sequence[int], count: int) -> Excess:
        """Return as many sums as ``count``, these at their places and 0 elsewhere."""

        def spread(values: Array) -> Array:
            sums = np.zeros((*values.shape[:-1], count))
            sums[..., places] = values
            return sums

        return Excess(*map(spread, (self.off, self.variance, self.parts, self.size)))

    def p(self, enough: float, fixed: int = 0) -> float:
        """Return the probability of a larger chi-square; sums below ``enough`` are pooled."""
        variance = self.variance + (jackknifed(self.parts) ** 2 if len(self.parts) else 0.0)
        some = variance > 0
        alone, rest = some & (self.size >= enough), some & (self.size < enough)
        chi_square = float((self.off[alone] ** 2 / variance[alone]).sum())
        freedom = int(alone.sum()) - fixed
        if self.size[rest].sum() >= LEAST:
            chi_square += float(self.off[rest].sum() ** 2 / variance[rest].sum())
            freedom += 1
        if freedom < 1:
            return 1.0
        from scipy.special import chdtrc

        return float(chdtrc(freedom, chi_square))


@dataclass(frozen=True)
class Misfit:
    """Difference between data and a fitted model.

    ``z_accuracy`` and ``z_mean_rt`` (cells,) are observed minus predicted, in standard deviations;
    NaN without a response. ``excess`` has the sums of each test.
    """

    z_accuracy: Array
    z_mean_rt: Array
    excess: dict[str, Excess]

    @cached_property
    def p(self) -> dict[str, float]:
        """Probability of a larger chi-square under the model, for each of the three tests."""
        return p_values(self.excess)

    def cautions(self, fitted: Optimum) -> list[str]:
        """Return a warning with the worst cells if three times the smallest p is below 0.003."""
        beyond = {name: p for name, p in self.p.items() if len(self.p) * p < BEYOND_CHANCE}
        if not beyond:
            return []
        design = fitted.likelihood.design
        size = np.nan_to_num(np.fmax(np.abs(self.z_accuracy), np.abs(self.z_mean_rt)))
        worst = "; ".join(
            f"{design.label(cell)} (z {self.z_accuracy[cell]:+.1f} and {self.z_mean_rt[cell]:+.1f})"
            for cell in np.argsort(-size)[:NAMED]
        )
        tests = ", ".join(f"{name} (p = {p:.1g})" for name, p in beyond.items())
        return [
            f"the model does not fit: data differ from it by more than chance in {tests}. The "
            f"largest differences of accuracy and mean response time are at {worst}. Parameters "
            "may be far off: check for guesses and for strengths in another unit, see cells() "
            "(cells.csv), or fit another model"
        ]


def misfit(fitted: Optimum, left: Sequence[tuple[Likelihood, Array]] = ()) -> Misfit:
    """Return the misfit of a fitted model; ``left`` is as from ``error.without_parts``."""
    fitted = fitted.complete
    design, density = fitted.likelihood.design, fitted.density
    edges_s = _edges_s(design, density)
    expected = _predicted(design, density, edges_s)
    low, high = fitted.likelihood.freedom.low, fitted.likelihood.freedom.high
    parts = [
        _predicted(
            design, replace(each, design=design).density(np.clip(vector, low, high)), edges_s
        )
        for each, vector in left
    ]
    off = _observed(design, edges_s) - expected
    simulation_variance = jackknifed(parts) ** 2 if parts else np.zeros(len(expected))
    share, _, counts = _split(expected, design.cells)
    seen = design.observed
    answered, timed = (
        np.bincount(seen.cell[some], None, design.cells)
        for some in (seen.response >= 0, np.isfinite(seen.rt_s))
    )
    n, m = (np.where(each > 0, each, np.nan) for each in (answered, timed))
    mass, middles_s = _timed(design, density), design.grid.middles_s
    with np.errstate(invalid="ignore"):  # without times
        mass = mass / mass.sum(axis=1, keepdims=True)
    variance = mass @ middles_s**2 - (mass @ middles_s) ** 2
    drawn = np.concatenate([share * (1 - share) / n, variance / m, counts])
    with np.errstate(invalid="ignore", divide="ignore"):
        z_accuracy, z_mean_rt, _ = _split(off / np.sqrt(drawn + simulation_variance), design.cells)
    # Means become sums over trials, which can be added.
    times = np.concatenate([answered, timed, np.ones(len(counts))])
    sizes = np.concatenate([answered * np.minimum(share, 1 - share), timed, counts])
    sums = (
        np.nan_to_num(times * off),
        np.nan_to_num(times**2 * drawn),
        times * np.reshape(parts, (len(parts), len(expected))),
        sizes,
    )
    split = zip(*(_split(each, design.cells) for each in sums), strict=True)
    excess = {
        test: Excess(*each) for test, each in zip((ACCURACY, MEAN, TIMES), split, strict=True)
    }
    return Misfit(z_accuracy, z_mean_rt, excess)


def p_values(excess: Mapping[str, Excess]) -> dict[str, float]:
    """Return the probability of a larger chi-square for each test."""
    return {test: each.p(ENOUGH[test], FIXED[test]) for test, each in excess.items()}


def _split(values: Array, cells: int) -> tuple[Array, Array, Array]:
    """Return values of accuracy and of mean time, both (..., cells), and of counts."""
    return values[..., :cells], values[..., cells : 2 * cells], values[..., 2 * cells :]


def _edges_s(design: Design, density: Array) -> Array:
    """Return the quantiles of response times of each cell, s, between 0 and infinity."""
    mass = _timed(design, density)
    mass[mass.sum(axis=1) == 0] = 1.0  # without times: responses are all in the first bin
    ends_s = np.arange(mass.shape[1] + 1) * design.grid.width_s
    below = np.pad(mass.cumsum(axis=1) / mass.sum(axis=1, keepdims=True), ((0, 0), (1, 0)))
    inner = np.array([np.interp(QUANTILES, one, ends_s) for one in below])
    return np.pad(inner, ((0, 0), (1, 1)), constant_values=((0, 0), (0, np.inf)))


def _predicted(design: Design, density: Array, edges_s: Array) -> Array:
    """Return accuracy and mean time of each cell, and the expected counts of all cells."""
    mass, missing = design.observed.outcomes(density)
    answered = mass.sum(axis=(1, 2))
    share = mass[:, 1].sum(axis=1) / answered
    timed = _timed(design, density)
    with np.errstate(invalid="ignore"):  # without times
        mean_s = timed @ design.grid.middles_s / timed.sum(axis=1)
    ends_s = np.arange(mass.shape[2] + 1) * design.grid.width_s
    below = np.pad(mass.cumsum(axis=2), ((0, 0), (0, 0), (1, 0)))
    parts = np.array(
        [
            [np.diff(np.interp(edges, ends_s, each)) for each in both]
            for edges, both in zip(edges_s, below, strict=True)
        ]
    )
    counts = np.tensordot(design.trials, parts, 1).ravel()
    return np.concatenate([share, mean_s, counts, [design.trials @ missing]])


def _timed(design: Design, density: Array) -> Array:
    """Return the probability of each time of response in each cell, (cells, bins)."""
    seen = design.observed
    return np.asarray(seen.with_times(seen.outcomes(density)[0]).sum(axis=1))


def _observed(design: Design, edges_s: Array) -> Array:
    """Return the observed counterparts of ``_predicted``."""
    seen = design.observed
    share, mean_s = np.full((2, design.cells), np.nan)
    counts = np.zeros((2, edges_s.shape[1] - 1))
    for cell in range(design.cells):
        some: Truths = (seen.cell == cell) & (seen.response >= 0)
        if some.any():
            share[cell] = seen.response[some].mean()
        if np.isfinite(seen.rt_s[some]).any():
            mean_s[cell] = np.nanmean(seen.rt_s[some])
        for response in (0, 1):
            rt_s = np.nan_to_num(seen.rt_s[some & (seen.response == response)])
            counts[response] += np.histogram(rt_s, edges_s[cell])[0]
    return np.concatenate([share, mean_s, counts.ravel(), [(seen.response < 0).sum()]])


TOGETHER = "all people together"
"""Name of the sums over people in warnings, in place of a person's."""


@dataclass(frozen=True)
class GroupMisfit:
    """Difference between the data of a group and a hierarchical fit."""

    people: dict[str, Misfit]
    # Strength and levels of conditions of each person's cells.
    cells: dict[str, list[tuple[float | str, ...]]]

    @cached_property
    def together(self) -> dict[str, float]:
        """Probability of a larger chi-square of all people together, for each of three tests."""
        return p_values({test: self.sums(test) for test in ENOUGH})

    def sums(self, test: str) -> Excess:
        """Return the sums over all people; those of cells by cell, which some may lack."""
        every = {who: each.excess[test] for who, each in self.people.items()}
        if test == TIMES:
            return reduce(add, every.values())
        cells = dict.fromkeys(cell for of_person in self.cells.values() for cell in of_person)
        place = {cell: number for number, cell in enumerate(cells)}
        parts = (
            one.placed([place[cell] for cell in self.cells[who]], len(place))
            for who, one in every.items()
        )
        return reduce(add, parts)

    def beyond_chance(self) -> pd.Series:
        """Return p values below 0.003 / their number, by person and test, the smallest first."""
        every = {(TOGETHER, test): p for test, p in self.together.items()}
        every |= {(who, TIMES): each.p[TIMES] for who, each in self.people.items()}
        p_values = pd.Series(every)
        return p_values[len(p_values) * p_values < BEYOND_CHANCE].sort_values(kind="stable")

    def cautions(self) -> list[str]:
        """Return a warning that names the people and the tests with a misfit."""
        p_values = self.beyond_chance()
        if p_values.empty:
            return []
        told = "; ".join(
            f"{test} of {who} (p = {p_values[who, test]:.1g})"
            for who, test in p_values.index[:NAMED]
        )
        more = f" and {len(p_values) - NAMED} more" if len(p_values) > NAMED else ""
        return [
            f"the model does not fit: data differ from it by more than chance in {told}{more}. "
            "Parameters may be far off: see cells() (people_cells.csv) and plot_cells(), check for "
            "guesses and for strengths in another unit, or fit another model"
        ]


def group_misfit(people: Mapping[str, Optimum]) -> GroupMisfit:
    """Return the misfit of a hierarchical fit; all people have one model."""
    misfits, cells = {}, {}
    for who, each in people.items():
        design = each.likelihood.design
        cells[who] = list(zip(design.strength.tolist(), *design.conditions.values(), strict=True))
        parts = [(part, each.vector) for part in each.likelihood.without_parts()]
        misfits[who] = misfit(each, parts)
    return GroupMisfit(misfits, cells)

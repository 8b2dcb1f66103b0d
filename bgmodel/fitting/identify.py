"""Identifiability: the directions in which parameters change the likelihood."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bgmodel.fitting.likelihood import STEP, Likelihood
from bgmodel.support.arrays import Array

ALIKE = 0.95
"""Cosine of two directions above which a fit that frees both gives a warning."""
SINGULAR = 1e-12
"""Below this least eigenvalue of the cosines, some parameters are not identifiable."""


@dataclass(frozen=True)
class Directions:
    """How parameters change the likelihood at a point, for a design and its numbers of trials."""

    names: list[str]
    vector: Array
    information: Array  # (parameters, parameters), Fisher; 0 if stored trials are too few
    idle: tuple[str, ...] = ()  # Parameters without effect on any probability.

    @property
    def cosines(self) -> Array:
        """Cosine of the score directions of each pair; 1 or -1 if they are not distinguishable."""
        length = np.sqrt(np.diag(self.information))
        safe = np.where(length > 0, length, np.inf)
        return np.asarray(np.clip(self.information / np.outer(safe, safe), -1.0, 1.0))

    @cached_property
    def standard_errors(self) -> Array:
        """Standard error of each with all others free; infinite if it is not identifiable."""
        length = np.sqrt(np.diag(self.information))
        errors = np.full(len(length), np.inf)
        some = np.flatnonzero(length > 0)
        cosines = self.cosines[np.ix_(some, some)]
        # An estimate of a nearly singular matrix may have negative eigenvalues.
        if len(some) and np.linalg.eigvalsh(cosines)[0] > SINGULAR:
            errors[some] = np.sqrt(np.diag(np.linalg.inv(cosines))) / length[some]
        return errors

    def cautions(self) -> list[str]:
        """Return warnings of pairs and parameters that these data cannot identify."""
        cosines = self.cosines
        warnings = []
        for i, j in zip(*np.triu_indices(len(self.names), 1), strict=True):
            if abs(cosines[i, j]) < ALIKE:
                continue
            step = STEP * abs(self.vector[i]) or STEP
            ridge = -self.information[i, j] / self.information[j, j] * step
            warnings.append(
                f"trials of this design hardly distinguish {self.names[i]} from "
                f"{self.names[j]} (cosine {cosines[i, j]:.2f}): a change of {self.names[i]} by "
                f"{step:+.3g} is compensated by one of {self.names[j]} by {ridge:+.3g}. Fix one "
                "of them, or add a condition that changes it alone"
            )
        warnings += [f"nothing in this design depends on {name}: fix it" for name in self.idle]
        lacking = [
            name
            for name, error in zip(self.names, self.standard_errors, strict=True)
            if np.isinf(error)
        ]
        if lacking and not warnings:
            warnings.append(
                f"no standard error can be given for {', '.join(lacking)}: the design, or too few "
                "simulated trials, do not identify them. Fix one of them, or simulate more "
                "trials (trials)"
            )
        return warnings


def directions(likelihood: Likelihood, vector: Array) -> Directions:
    """Return how parameters change the likelihood at a point, priors included."""
    information, still = likelihood.information(vector)
    _, precision = likelihood.freedom.prior_slope(vector)
    return Directions(likelihood.freedom.names, vector, information + np.diag(precision), still)

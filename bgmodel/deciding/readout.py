"""Properties of an integrator's OUT, and the checks of every decision made from it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bgmodel.support.checks import is_number, reals, whole
from circuits.arrays import Array
from circuits.errors import InputError, RangeWarning, require

NATS, LOG_ODDS = "nats", "nats of log odds"
"""Units of OUT from which a posterior follows: OUT = -ln P, and OUT = the log odds against."""
POSTERIORS = (0.5, 1.0)
"""A threshold in this range that makes no sense in nats was probably meant as a posterior."""


@dataclass(frozen=True)
class ReadOut:
    """The range of OUT, and the meaning of thresholds on it."""

    name: str
    lowest: float = -np.inf  # that can be reached, or that the read-out can resolve
    # Lowest OUT at rest: a threshold at or above it needs no evidence. Infinity if the ticks of
    # the trace before the first reading show it.
    rest: float = np.inf
    unit: str = NATS  # "nats" for OUT = -ln P, "nats of log odds" for the SPRT, or another
    warn_of_noise: Callable[[float], None] | None = None  # called with a threshold
    advice: str = ""  # how to change where OUT rests
    off: bool = False  # whether it rests where no posterior follows from it

    def doubt(self, threshold: float, hypotheses: int) -> None:
        """Warn if a threshold was probably meant as a posterior: in nats it is a low one."""
        low, high = POSTERIORS
        if self.unit == NATS and max(low, np.log(2)) < threshold < high < np.log(hypotheses):
            RangeWarning.warn(
                f"a threshold of {threshold:g} nats stops at a posterior of "
                f"{np.exp(-threshold):.3f}{meant(threshold)}"
            )

    def threshold(self, posterior: npt.ArrayLike, hypotheses: int) -> Array:
        """Return the threshold on OUT of a stopping posterior above chance and below 1."""
        if self.unit not in (NATS, LOG_ODDS):
            raise InputError(
                f"{self.name} works in {self.unit}, not nats: a posterior has no meaning there; "
                f"give a threshold, an OUT in {self.unit}",
                "posterior",
            )
        nats = threshold_from_posterior(posterior, hypotheses)
        return nats + np.log1p(-np.exp(-nats)) if self.unit == LOG_ODDS else nats

    def one(self, threshold: float | None, posterior: float | None, hypotheses: int) -> float:
        """Return the single threshold on OUT, given directly or as a posterior, after checks."""
        check_one_given("threshold", threshold, posterior)
        value = posterior if threshold is None else threshold
        if value is None or not is_number(value):
            field = "posterior" if threshold is None else "threshold"
            raise InputError.of(field, "must be one number", value)
        level = float(value)
        if threshold is None:
            level = float(self.threshold(value, hypotheses))
        self.check(level)
        if posterior is None:
            self.doubt(level, hypotheses)
        elif self.off:
            RangeWarning.warn(
                f"{self.name} stops at other posteriors than asked for: {self.advice}"
            )
        return level

    def check(self, thresholds: npt.ArrayLike) -> None:
        """Refuse thresholds, in ``unit``, that are met without evidence or are never reached.

        Of several, warn with the number of such thresholds, and refuse only if none is left.
        """
        levels = np.atleast_1d(reals("thresholds", thresholds))
        if not levels.size or not np.isfinite(levels).all():
            raise InputError.of("thresholds", f"must be finite {self.unit}", levels)
        rows = levels.reshape(len(levels), -1)
        early, low = rows.max(axis=1) >= self.rest, rows.max(axis=1) < self.lowest
        if (early | low).all():
            first = float(rows[0].max())
            raise InputError(
                self._without_evidence(first) if early[0] else self._unread(first), "thresholds"
            )
        for wrong, why in ((early, self._without_evidence), (low, self._unread)):
            if wrong.any():
                reason = why(float(rows[wrong].flat[0]))
                RangeWarning.warn(
                    f"{wrong.sum()} of {len(rows)} thresholds are unusable, the first: {reason}"
                )

    def _without_evidence(self, threshold: float) -> str:
        return (
            f"{self.name} rests at OUT = {round(self.rest, 2) + 0.0:.2f}, which is not above the "
            f"threshold of {threshold:.2f} {self.unit}: it would decide without evidence"
            f"{self.advice and f'; {self.advice}'}{meant(threshold)}"
        )

    def _unread(self, threshold: float) -> str:
        at, of = "", ""
        if self.unit == NATS:
            highest = np.floor(1000 * np.exp(-self.lowest)) / 1000  # which may be given
            at = f", so that posteriors must be at most {highest:.3f}"
            of = f", a posterior of {np.exp(-threshold):.3f}" if threshold >= 0 else ""
        return (
            f"{self.name} resolves no OUT below {self.lowest:.3g} {self.unit}{at}; the threshold "
            f"is {threshold:.2f} {self.unit}{of}"
        )


def check_one_given(name: str, threshold: object, posterior: object) -> None:
    """Raise ValueError unless exactly one is given; ``name`` is the argument of the threshold."""
    if threshold is None and posterior is None:
        raise InputError(
            "neither a posterior nor a threshold is given: give posterior=0.82, or "
            f"{name}, an OUT at which to decide",
            "posterior",
        )
    if threshold is not None and posterior is not None:
        raise InputError(f"give either posterior or {name}, not both", "posterior", posterior)


def meant(threshold: float) -> str:
    """Return a hint for a threshold that looks like a posterior, or an empty string."""
    low, high = POSTERIORS
    if not low < threshold < high:
        return ""
    return f"; did you mean a posterior (posterior={threshold:g})?"


def threshold_from_posterior(posterior: npt.ArrayLike, hypotheses: int = 2) -> Array:
    """Return the ``Msprt`` threshold on OUT, nats, that stops at a posterior: ``-ln P``.

    Parameters
    ----------
    posterior : float or array
        Posterior probability of the chosen hypothesis.
    hypotheses : int
        Number of hypotheses; at chance, one over it, or below, no reading would be needed.

    Raises
    ------
    ValueError
        If a posterior is not above chance and below 1.
    """
    asked = np.asarray(reals("posterior", posterior), dtype=np.float64)
    count = whole("hypotheses", hypotheses, 2)
    require(
        asked.size and ((asked > 1 / count) & (asked < 1)).all(),
        "posterior",
        f"must lie between chance, {1 / count:.3g} with {count} hypotheses, and 1",
        asked,
    )
    return -np.log(asked)

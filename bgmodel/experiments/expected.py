"""What is expected of a measure: a direction or a value, and the verdict on an estimate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from bgmodel.bootstrap import Z95
from bgmodel.deciding.measures import (
    MEASURES,
    OF_ALL,
    OF_DECIDED,
    OF_DIFFUSION,
    OF_STOP,
    SHARES,
)
from circuits.errors import DataWarning, InputError, require

AGREES, DISAGREES, OPEN = "agrees", "disagrees", "left open"
COMPATIBLE, DIFFERS, NO_INTERVAL = "compatible", "differs", "no interval to compare"
"""Comparison of a published effect with the model's: whether their difference includes 0."""
FAILS, UNANSWERED = "fails", "not answered"
"""Outcomes of a number of the exam: the circuit lacks the behaviour, or it does not apply."""
WITHOUT = "decides without evidence"
"""The outcome, regardless of the prediction, if the manipulated circuit ignores evidence."""
FEWEST_DECIDED = 20
"""Least number of trials decided in time for a statement on a condition's decisions."""
PERCENT = "percent"
"""Condition with the change in per cent of the control's value, for measures of decisions."""
RELATIVE = (*OF_DECIDED, *OF_ALL)
"""Measures with a change in per cent."""
LIKELY = dict.fromkeys((*MEASURES, *OF_STOP), (1.0, np.inf)) | dict.fromkeys(SHARES, (0.0, 0.5))
LIKELY |= dict.fromkeys(OF_DIFFUSION[:2], (0.0, 1.0))
"""Measures, with the range of sizes of a change (other than 0) without a warning."""
OF_UNITS = {"decided": "a number of trials", **dict.fromkeys(SHARES, "a share of trials")}
OF_UNITS |= dict.fromkeys(OF_DIFFUSION[:2], "in the units of EZ-diffusion, with a noise of s = 0.1")
"""What a warning says of the unit of a measure; of others that it is in ms."""


@dataclass(frozen=True)
class Expected:
    """What is expected of a measure: a direction, or a value with its error.

    In an experiment the measure is that of the manipulation minus that of the control: a prediction
    is a direction, a published effect a value. A number of the exam is either.
    """

    measure: str
    """A name in ``measures.MEASURES`` or ``measures.OF_STOP``."""
    direction: Literal["up", "down", "none"] | None = None
    """Direction of a change; "none" means that it stays within ``at_least``."""
    at_least: float = 0.0
    """The smallest change that counts, in the measure's unit."""
    value: float | None = None
    """The value; in the middle of its interval if it is not given."""
    se: float | None = None
    """Its standard error."""
    low: float | None = None
    """Lower end of its 95 % interval, instead of a standard error."""
    high: float | None = None
    """Upper end of its 95 % interval."""
    unit: str = "own"
    """The measure's unit, or "percent" of the control's value if time scales differ."""
    source: str = ""
    """Where it was published, and how the number was derived."""

    def __post_init__(self) -> None:
        require(0 <= self.at_least < np.inf, "at_least", "must be >= 0", self.at_least)
        numbers = [number is not None for number in (self.value, self.se, self.low, self.high)]
        if self.direction is None:
            require(self.at_least == 0, "at_least", "is for a direction", self.at_least)
            whole = numbers[1:] in ([0, 0, 0], [1, 0, 0], [0, 1, 1])
            require(whole, "low", "must be given with high and without se", self.low)
            low, high = self.interval
            require(self.se is None or self.se > 0, "se", "must be > 0", self.se)
            require(not low > high, "low", "must be below high", self.low)
            inside = np.isfinite(self.middle) and not (self.middle < low or self.middle > high)
            must = "must lie between low and high, or there must be a direction"
            require(inside, "value", must, self.value)
        else:
            must = "must not be combined with a value or an interval"
            require(not any(numbers), "direction", must, self.direction)
            fits = self.direction != "none" or self.at_least > 0
            require(fits, "at_least", 'must be > 0 if the direction is "none"', self.at_least)
        self._check_fits()

    def _check_fits(self) -> None:
        """Refuse an unknown measure or an impossible size; warn if its unit seems to be another."""
        must = f"must be one of {', '.join(LIKELY)}"
        require(self.measure in LIKELY, "measure", must, self.measure)
        value = self.direction is None
        units = ("own", PERCENT) if value else ("own",)
        require(self.unit in units, "unit", f"must be {' or '.join(units)}", self.unit)
        what, size = ("value", abs(self.middle)) if value else ("at_least", self.at_least)
        if self.unit == PERCENT:
            must = f"must be one of {', '.join(RELATIVE)} for a change in percent"
            require(self.measure in RELATIVE, "measure", must, self.measure)
            if 0 < size < 1:
                DataWarning.warn(f"a change of {self.middle:g} percent is tiny: give -15 for -15 %")
            return
        if self.measure in SHARES and (size > 1 or (size == 1 and not value)):
            must = f"must be a share, below 1, got {size:g}: write 0.01 for 1 %"
            raise InputError(f"{what} of {self.measure} {must}", what)
        low, high = LIKELY[self.measure]
        if size and not low <= size <= high:
            DataWarning.warn(
                f"{what} = {size:g} is an unlikely change of {self.measure}, which is "
                f"{OF_UNITS.get(self.measure, 'in ms, not in s')}"
            )

    @property
    def interval(self) -> tuple[float, float]:
        """The ends of the 95 % interval; NaN if they are unknown."""
        if self.se is not None and self.value is not None:
            return self.value - Z95 * self.se, self.value + Z95 * self.se
        low, high = (np.nan if end is None else end for end in (self.low, self.high))
        return low, high

    @property
    def middle(self) -> float:
        """The value, by default the middle of its interval; NaN for a direction."""
        return sum(self.interval) / 2 if self.value is None else self.value

    def error(self, value: float) -> float:
        """Return the standard error on the side of another value; NaN if it is unknown.

        An interval counts as one of 95 %.
        """
        low, high = self.interval
        if self.se is not None:
            return self.se
        if self.value is None:
            return (high - low) / (2 * Z95)
        return (high - self.value if value > self.value else self.value - low) / Z95

    def z(self, value: float, below: float, above: float) -> float:
        """Return the difference of an estimate from the value, in standard errors of both.

        Parameters
        ----------
        value, below, above : float
            The estimate, and its standard error on either side. Of two asymmetric intervals the
            sides count that point to each other, as of independent samples (Zou & Donner 2008).
        """
        apart = value - self.middle
        error = float(np.hypot(below if apart > 0 else above, self.error(value)))
        return apart / max(error, float(np.finfo(float).tiny))

    def outcome(self, value: float, low: float, high: float) -> str:
        """Return the verdict on an estimate from its 95 % interval; open if it is not finite.

        On a direction: "agrees" if the whole interval is beyond ``at_least`` (within it for
        "none"), "disagrees" if none of it is, otherwise "left open". On a value: "compatible" if
        the 95 % interval of the difference includes 0, otherwise "differs".
        """
        if not np.isfinite([value, low, high][self.direction is not None :]).all():
            return OPEN
        if self.direction is None:
            z = self.z(value, (value - low) / Z95, (high - value) / Z95)
            return NO_INTERVAL if np.isnan(z) else COMPATIBLE if abs(z) <= Z95 else DIFFERS
        if self.direction == "none":
            inside = -self.at_least < low and high < self.at_least
            outside = low > self.at_least or high < -self.at_least
            return AGREES if inside else DISAGREES if outside else OPEN
        if self.direction == "down":
            low, high = -high, -low
        return AGREES if low > self.at_least else DISAGREES if high < self.at_least else OPEN

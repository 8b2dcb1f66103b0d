"""Predictions of an experiment, and published effects as numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

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
WITHOUT = "decides without evidence"
"""The outcome, regardless of the prediction, if the manipulated circuit ignores evidence."""
FEWEST_DECIDED = 20
"""Least number of trials decided in time for a statement on a condition's decisions."""
PERCENT = "percent"
"""Condition with the change in per cent of the control's value, for measures of decisions."""
RELATIVE = (*OF_DECIDED, *OF_ALL)
"""Measures with a change in per cent."""
LIKELY = {"decided": (1.0, np.inf), "drift": (0.0, 1.0), "boundary_separation": (0.0, 1.0)}
"""Range of sizes of a change (other than 0) without a warning."""
LIKELY |= dict.fromkeys(SHARES, (0.0, 0.5))
LIKELY |= {name: (1.0, np.inf) for name in (*MEASURES, *OF_STOP) if name.endswith("_ms")}


@dataclass(frozen=True)
class Prediction:
    """A predicted change of one measure."""

    measure: str
    """A name in ``measures.MEASURES`` or ``measures.OF_STOP``."""
    direction: Literal["up", "down", "none"]
    """Direction of the change; "none" means that it stays within ``at_least``."""
    at_least: float
    """The smallest change that counts, in the measure's unit."""

    def __post_init__(self) -> None:
        _check_measure(self.measure)
        require(0 <= self.at_least < np.inf, "at_least", "must be >= 0", self.at_least)
        check_size("at_least", self.measure, self.at_least, below=1)
        fits = self.direction != "none" or self.at_least
        require(fits, "at_least", 'must be > 0 if the direction is "none"', self.at_least)

    def outcome(self, low: float, high: float) -> str:
        """Return the verdict from the change's 95 % interval: agrees, disagrees or left open."""
        return outcome_of(self.direction, self.at_least, low, high)


def outcome_of(
    direction: Literal["up", "down", "none"], at_least: float, low: float, high: float
) -> str:
    """Return the verdict on a direction from the 95 % interval of a change; open if it is NaN."""
    if not (np.isfinite(low) and np.isfinite(high)):
        return OPEN
    if direction == "none":
        inside = -at_least < low and high < at_least
        outside = low > at_least or high < -at_least
        return AGREES if inside else DISAGREES if outside else OPEN
    if direction == "down":
        low, high = -high, -low
    return AGREES if low > at_least else DISAGREES if high < at_least else OPEN


@dataclass(frozen=True)
class Effect:
    """A published effect on one measure, as a number: manipulation minus control."""

    measure: str
    """A name in ``measures.MEASURES`` or ``measures.OF_STOP``."""
    value: float
    """The change."""
    source: str
    """Where it was published, and how the number was derived."""
    low: float | None = None
    """Lower end of its 95 % interval, if published."""
    high: float | None = None
    """Upper end of its 95 % interval, if published."""
    unit: Literal["own", "percent"] = "own"
    """The measure's unit, or per cent of the control's value if time scales differ."""

    def __post_init__(self) -> None:
        _check_measure(self.measure)
        if self.unit == PERCENT:
            must = f"must be one of {', '.join(RELATIVE)} for a change in percent"
            require(self.measure in RELATIVE, "measure", must, self.measure)
        if (self.low is None) != (self.high is None):
            raise InputError("an effect's interval needs both low and high, got one of them", "low")
        low, high = self.interval
        if not (np.isfinite(self.value) and (np.isnan(low) or low <= self.value <= high)):
            raise InputError.of("value", "must lie between low and high", self.value)
        if self.unit == PERCENT and 0 < abs(self.value) < 1:
            DataWarning.warn(f"a change of {self.value:g} percent is tiny: give -15 for -15 %")
        if self.unit == "own":
            check_size("value", self.measure, abs(self.value), below=np.nextafter(1, 2))

    @property
    def interval(self) -> tuple[float, float]:
        """Its 95 % interval; NaN if none was published."""
        low, high = (np.nan if end is None else end for end in (self.low, self.high))
        return low, high


def _check_measure(name: str) -> None:
    """Raise ValueError listing all names, for an unknown measure."""
    every = (*MEASURES, *OF_STOP)
    require(name in every, "measure", f"must be one of {', '.join(every)}", name)


def check_size(what: str, measure: str, size: float, below: float) -> None:
    """Refuse an impossible change of a measure; warn if it seems to be in another unit."""
    if measure in SHARES and size >= below:
        raise InputError(
            f"{what} of {measure} must be a share, below 1, got {size:g}: write 0.01 for 1 %", what
        )
    low, high = LIKELY[measure]
    if size and not low <= size <= high:
        units = {"decided": "a number of trials", **dict.fromkeys(SHARES, "a share of trials")}
        of_diffusion = "in the units of EZ-diffusion, with a noise of s = 0.1"
        units |= dict.fromkeys(OF_DIFFUSION[:2], of_diffusion)
        DataWarning.warn(
            f"{what} = {size:g} is an unlikely change of {measure}, which is "
            f"{units.get(measure, 'in ms, not in s')}"
        )

"""The exponential function in a form that compilers vectorise; a call of a library is not."""

from __future__ import annotations

import math

import numpy as np

from bgmodel.support.compiling import inlined

DEGREE = 13
"""Of the Taylor series between +-log(2) / 2, where its remainder is 1e-17."""
COEFFICIENTS = tuple(1 / math.factorial(n) for n in range(DEGREE, -1, -1))
LOWEST = -700.0
"""Below it the result is that of this exponent, 1e-304."""
LOG2_HIGH, LOG2_LOW = 0.693145751953125, 1.4286068203094173e-06
"""log(2) as a sum, so that multiples of the first are exact (Cody & Waite 1980)."""
PER_LOG2 = 1 / math.log(2)
BIAS, MANTISSA = 1023, 52
"""Of a number in double precision: what is added to its exponent, and the bits after it."""


def _exponential(x: float) -> float:
    """Return exp(x) for x between ``LOWEST`` and 700, with a relative error below 4e-16."""
    x = max(x, LOWEST)
    twos = np.floor(x * PER_LOG2 + 0.5)
    rest = x - twos * LOG2_HIGH - twos * LOG2_LOW
    polynomial = 0.0
    for coefficient in COEFFICIENTS:
        polynomial = polynomial * rest + coefficient
    power: float = np.int64((np.int64(twos) + BIAS) << MANTISSA).view(np.float64)
    return polynomial * power


exponential = inlined(_exponential)

"""The spectrum of a renewal process, whose intervals are independent of each other."""

from __future__ import annotations

import numpy as np

from circuits.arrays import Array, Complex


def renewal_spectrum(rate: Array, interval: Complex) -> Array:
    """Return the power spectrum of a renewal process from its interval transform (Cox 1962)."""
    return np.asarray(rate * (1 - np.abs(interval) ** 2) / np.abs(1 - interval) ** 2)

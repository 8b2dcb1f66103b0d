"""Array type aliases, one per kind of number."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]
Index = npt.NDArray[np.intp]
"""Indices into another array."""
Integers = npt.NDArray[np.integer]
Truths = npt.NDArray[np.bool_]

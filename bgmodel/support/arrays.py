"""Names for the types of arrays, one per kind of number."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
"""Numbers in double precision: what everything is computed with unless stated."""
Singles = npt.NDArray[np.float32]
"""Numbers in single precision: what taps are kept in."""
Reals = npt.NDArray[np.floating]
"""Numbers in either precision."""
Integers = npt.NDArray[np.integer]
Truths = npt.NDArray[np.bool_]
Image = npt.NDArray[np.uint8]
"""Grey values of pixels, row by row from the top."""

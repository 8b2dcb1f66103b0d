"""Names for the types of arrays, one per kind of number."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
"""Numbers in double precision, used unless stated otherwise."""
Singles = npt.NDArray[np.float32]
"""Numbers in single precision, used for taps."""
Reals = npt.NDArray[np.floating]
"""Numbers in either precision."""
Integers = npt.NDArray[np.integer]
Truths = npt.NDArray[np.bool_]
Image = npt.NDArray[np.uint8]
"""Grey values of pixels, row by row from the top."""

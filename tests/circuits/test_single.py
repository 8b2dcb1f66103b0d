"""Arithmetic in single precision."""

import numpy as np
import numpy.testing as npt

from circuits import single


def test_the_exponential_of_all_engines_is_the_exponential():
    x = np.linspace(-40, 40, 4001).astype(np.float32)
    npt.assert_allclose(single.exponential(x), np.exp(x.astype(float)), rtol=5e-7)
    from circuits.engines.ensemble import lanes

    compiled = lanes.numba.njit(lambda values: [lanes.exp32(value) for value in values])(x)
    npt.assert_array_equal(np.array(compiled), single.exponential(x))

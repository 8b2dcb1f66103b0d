"""Arithmetic in single precision."""

import numpy as np
import numpy.testing as npt

from circuits.cells import single


def test_the_exponential_of_all_engines_is_the_exponential_from_minus_87_to_60():
    x = np.linspace(-100, 100, 10_001).astype(np.float32)
    powers, within = single.exponential(x), (x >= -87) & (x <= 60)
    npt.assert_allclose(powers, np.exp(np.clip(x.astype(float), -87, 60)), rtol=5e-7)
    assert np.ptp(powers[x < -87]) == np.ptp(powers[x > 60]) == 0
    assert np.diff(powers[within]).min() > 0
    from circuits.engines.spikes import lanes

    compiled = lanes.numba.njit(lambda values: [lanes.exp32(value) for value in values])(x)
    npt.assert_array_equal(np.array(compiled), powers)

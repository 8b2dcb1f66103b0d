"""The exact tables: weights that break their constraints."""

import pytest

from circuits import anatomy
from tests.helpers import refused


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        ({"w_gpe_stn": 1.2}, "w_gpe_stn"),
        ({"w_gpe_stn": -0.1}, "w_gpe_stn"),
        ({"w_gpe_stn": 0.5, "w_gpe_snr": 0.6}, "w_gpe_stn"),
        ({"w_d2_gpe": -1}, "w_gpe_stn"),
        ({"w_d2_gpe": 0.5, "w_d1_snr": 1.2}, "w_d1_snr"),
    ],
)
def test_weights_that_break_the_constraints_of_appendix_b_are_refused(weights, message):
    with refused(message):
        anatomy.appendix_b(**weights)

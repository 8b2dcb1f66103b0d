"""Times that must be whole ticks."""

import numpy as np
import pytest

from circuits import anatomy
from circuits.checks import is_whole, whole_ticks
from circuits.dynamics.ticks import Scheme
from circuits.dynamics.wiring import wire
from tests.circuits.helpers import run_rate


def test_times_are_whole_ticks():
    assert whole_ticks("delay", 2.5, 0.1) == 25
    circuit = anatomy.bogacz_gurney().with_projection("STN->GPe", delay_ms=2.05)
    with pytest.raises(
        ValueError, match=r"delay of STN->GPe of 2.05 ms is not a multiple of dt_ms = 0.1"
    ):
        _ = Scheme(wire(circuit), 0.1).unit_delay
    with pytest.raises(ValueError, match="delay of STN->GPe"):
        run_rate(circuit, np.zeros((1, 1, 2)), step_ms=1)


@pytest.mark.parametrize("value", [3, 3.0, np.int32(3), np.float32(3), -2, 0])
def test_a_whole_number_is_one_of_whatever_type(value):
    assert is_whole(value)


@pytest.mark.parametrize("value", [2.5, np.inf, True, np.bool_(True), "3", None, [3]])
def test_what_is_no_whole_number(value):
    assert not is_whole(value)

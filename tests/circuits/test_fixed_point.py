"""The fixed point: it stays, and its parts come upstream first."""

import numpy as np
import pytest

from circuits import anatomy, fixed_point
from tests.circuits.helpers import evidence


@pytest.mark.parametrize("name", sorted(anatomy.CIRCUITS))
def test_the_fixed_point_stays_where_it_is(name):
    circuit = anatomy.circuit(name, 4)
    wiring = fixed_point.wired(circuit)
    drive = 0.6 * evidence(4)
    x = fixed_point.solve(wiring, drive)
    units = wiring.rates(x) @ wiring.deliver.T + wiring.constant
    still = x
    assert np.abs(wiring.inputs(units) + wiring.drive(drive) - still).max() < 1e-12


def test_parts_come_upstream_first_and_say_which_loop():
    wiring = fixed_point.wired(anatomy.appendix_b(3))
    found = [
        ({wiring.row(b).name for b in blocks}, loop) for blocks, loop in fixed_point.parts(wiring)
    ]
    order = {name: i for i, (names, _) in enumerate(found) for name in names}
    assert ({"STN", "GPe"}, True) in found
    assert [loop for names, loop in found if len(names) == 1] == [False] * 4
    assert order["ctx"] < order["D2"] < order["GPe"] < order["SNr"]
    assert order["D1"] < order["SNr"]

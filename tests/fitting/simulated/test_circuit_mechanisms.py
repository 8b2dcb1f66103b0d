"""Edits of a circuit with numbers left open."""

import numpy as np
import pytest

from bgmodel.fitting.simulated.circuit import MECHANISMS, NONE
from circuits.anatomy import load_circuit
from circuits.declaration.table_writer import digest

MACAQUE = load_circuit("macaque", 2)
OPEN = [name for name, each in MECHANISMS.items() if each.axes]


@pytest.mark.parametrize("name", OPEN)
def test_a_criterion_changes_the_circuit_at_every_value(name):
    mechanism = MECHANISMS[name]
    ends = [
        [axis.values[0] for axis in mechanism.axes],
        [axis.values[-1] for axis in mechanism.axes],
    ]
    made = [digest(mechanism.apply(MACAQUE, point)) for point in ends]
    assert len({*made, digest(MACAQUE)}) == 3 or name in ("stn_loss", "gpe_loss")
    assert made[0] != made[1]


@pytest.mark.parametrize("name", OPEN)
def test_an_axis_goes_evenly_from_bound_to_bound_by_its_start(name):
    for axis in MECHANISMS[name].axes:
        each = axis.parameter
        assert [axis.values[0], axis.values[-1]] == [each.low, each.high]
        assert np.diff(axis.values) == pytest.approx((each.high - each.low) / (axis.points - 1))
        # Where a parameter stands unless it is moved, the circuit itself is simulated.
        assert np.abs(axis.values - each.start).min() < 1e-9


def test_the_threshold_alone_edits_nothing():
    assert NONE.apply(MACAQUE, ()) is MACAQUE
    assert MECHANISMS["threshold"] is NONE


def test_values_go_where_their_names_stand():
    made = MECHANISMS["dopamine"].apply(MACAQUE, (0.75,))
    assert digest(made) == digest(MACAQUE.dopamine(0.75))
    with pytest.raises(ValueError, match=r"zip\(\) argument"):
        MECHANISMS["dopamine"].apply(MACAQUE, (0.75, 0.8))

"""The table as arrays: whole numbers, roles, sparse connections."""

from dataclasses import replace

import numpy as np
import pytest

from circuits import anatomy
from circuits.dynamics import fixed_point
from circuits.dynamics.wiring import fan_in, wire


def test_sparse_connections_have_one_in_degree_and_belong_to_the_circuit():
    circuit = anatomy.spiking_msprt().with_neurons(40).with_connections(0.25)
    p = circuit.projection("D1->SNr")
    wires = fan_in(circuit, p, 0, 0)
    assert wires.shape == (40, 10)
    assert all(len(set(row)) == 10 for row in wires.tolist())
    assert 0 <= wires.min() <= wires.max() < 40
    assert np.array_equal(wires, fan_in(circuit.lesion("GPe"), p, 0, 0))
    assert not np.array_equal(wires, fan_in(circuit, p, 1, 1))
    assert not np.array_equal(wires, fan_in(replace(circuit, wiring_seed=1), p, 0, 0))
    # Every source is chosen about equally often: 40 * 0.25 expected of each.
    uses = np.bincount(wires.ravel(), minlength=40)
    assert ((uses - 10) ** 2 / (40 * 0.25 * 0.75)).sum() < 80


@pytest.mark.parametrize("name", ["spiking_msprt", "appendix_b"])
def test_slope_and_curvature_of_rates_are_their_derivatives_and_nothing_below_the_floor(name):
    wiring = wire(anatomy.load_circuit(name))
    h = 1e-4
    for x in (-3.0, -1.05, 0.55, 2.05):  # either side of every floor, and on none
        inputs = np.full(wiring.blocks, x)
        below, at, above = (wiring.rates(inputs + d) for d in (-h, 0, h))
        slope, curvature = (above - below) / (2 * h), (above - 2 * at + below) / h**2
        np.testing.assert_allclose(wiring.rates_slope(inputs), slope, atol=1e-4)
        np.testing.assert_allclose(wiring.rates_curvature(inputs), curvature, rtol=1e-4, atol=1e-3)
        silent = (at == 0) & (wiring.floor_hz == 0)
        assert x > -3 or silent.any()
        assert not wiring.rates_curvature(inputs)[silent].any()


def test_beside_a_replaced_lesion_another_one_is_not_replaced():
    table = anatomy.macaque(2)
    both = fixed_point.wired(table.clamp("GPe", 0.5).lesion("D2", 0.3))
    alone, intact = fixed_point.wired(table.lesion("D2", 0.3)), wire(table)
    of = [table.projections[path].source for path in intact.path]
    constants = {name: both.constant[[s == name for s in of]] for name in ("GPe", "D2", "STN")}
    for name in ("D2", "STN"):
        np.testing.assert_array_equal(constants[name], alone.constant[[s == name for s in of]])
    assert (constants["GPe"] > intact.constant[[s == "GPe" for s in of]]).all()

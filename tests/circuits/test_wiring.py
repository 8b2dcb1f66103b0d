"""Sparse connections."""

from dataclasses import replace

import numpy as np

from circuits import anatomy
from circuits.wiring import fan_in


def test_sparse_connections_have_one_in_degree_and_belong_to_the_circuit():
    circuit = anatomy.spiking_msprt().with_neurons(40).with_connections(0.25)
    p = circuit.projection("D1", "SNr")
    wires = fan_in(circuit, p, 0, 0)
    assert wires.shape == (40, 10)
    assert all(len(set(row)) == 10 for row in wires.tolist())
    assert 0 <= wires.min() <= wires.max() < 40
    assert np.array_equal(wires, fan_in(circuit.without("GPe"), p, 0, 0))
    assert not np.array_equal(wires, fan_in(circuit, p, 1, 1))
    assert not np.array_equal(wires, fan_in(replace(circuit, wiring_seed=1), p, 0, 0))
    # Every source is chosen about equally often: 40 * .25 expected of each.
    uses = np.bincount(wires.ravel(), minlength=40)
    assert ((uses - 10) ** 2 / (40 * 0.25 * 0.75)).sum() < 80

"""The fixed point: it stays, its parts come upstream first, and OUT there is near -ln P."""

from dataclasses import replace

import numpy as np
import pytest

from circuits import anatomy
from circuits.dynamics import fixed_point
from circuits.dynamics.wiring import fan_in, wire
from tests.circuits.helpers import evidence, run_algebra


@pytest.mark.parametrize("name", sorted(anatomy.CIRCUITS))
def test_the_fixed_point_stays_where_it_is(name):
    circuit = anatomy.load_circuit(name, 4)
    wiring = fixed_point.wired(circuit)
    drive = 0.6 * evidence(4)
    x = fixed_point.solve(wiring, drive)
    units = wiring.rates(x) @ wiring.deliver.T + wiring.constant
    still = x
    assert np.abs(wiring.inputs(units) + wiring.drive(drive) - still).max() < 1e-12


def test_parts_come_upstream_first_and_say_which_loop():
    wiring = fixed_point.wired(anatomy.appendix_b(3))
    parts = [({wiring.rows[k].name for k in b}, loop) for b, loop in fixed_point.parts(wiring)]
    order = {name: i for i, (names, _) in enumerate(parts) for name in names}
    assert ({"STN", "GPe"}, True) in parts
    assert [loop for names, loop in parts if len(names) == 1] == [False] * 4
    assert order["ctx"] < order["D2"] < order["GPe"] < order["SNr"]
    assert order["D1"] < order["SNr"]


@pytest.mark.parametrize(
    "channels", [2, 6, 100, 150, pytest.param(300, marks=pytest.mark.validate)]
)
def test_gpr_rests_where_its_equations_do_by_hand_for_any_number_of_channels(channels):
    # STN s = 0.25 - GPe g, g = 0.9 N s + 0.2, output 0.9 N s - 0.3 g + 0.2; striatum is silent.
    s = 0.05 / (1 + 0.9 * channels)
    g = 0.9 * channels * s + 0.2
    wiring = fixed_point.wired(anatomy.gpr(channels))
    output = wiring.rates(fixed_point.rest(wiring))[wiring.owner == wiring.owner[-1]]
    np.testing.assert_allclose(output, 100 * (0.9 * channels * s - 0.3 * g + 0.2), rtol=1e-9)


def test_the_cached_state_at_rest_is_that_of_a_fresh_solution():
    for circuit in (anatomy.macaque(), anatomy.macaque().lesion("STN", 0.1)):
        wiring = fixed_point.wired(circuit)
        for _ in range(2):
            x, rates = fixed_point.resting_state(circuit)
            assert np.array_equal(x, fixed_point.rest(wiring))
            assert np.array_equal(rates, fixed_point.rest_rates(wiring))


@pytest.mark.parametrize("make", [anatomy.bogacz_gurney, anatomy.appendix_b])
@pytest.mark.parametrize(("channels", "others"), [(2, None), (2, 1), (5, None), (5, 1), (5, 3)])
def test_out_of_an_exact_table_is_off_by_nothing(make, channels, others):
    for circuit in (make(channels), replace(make(channels), centred=True, max_deficit_nats=40.0)):
        assert fixed_point.off_nats(circuit, others) == pytest.approx((0, 0), abs=1e-8)


@pytest.mark.parametrize("nats", [0.05, 0.2])
def test_out_is_off_by_as_much_as_the_read_out_is_biased(nats):
    table = anatomy.bogacz_gurney(3)
    bias = table.population("SNr").bias_nats + nats
    offsets = fixed_point.off_nats(table.with_population("SNr", bias_nats=bias))
    assert offsets == pytest.approx((nats, nats), abs=1e-8)


def test_competitors_beyond_the_reach_of_a_centred_drive_are_cut_there():
    """One competitor is level with the leader: OUT is ln 2. The third counts as 2 nats behind."""
    table = replace(anatomy.bogacz_gurney(3), centred=True, max_deficit_nats=2.0)
    table = replace(table, readable_nats=(np.log(2) - 1e-9, np.log(2)))
    offsets = fixed_point.off_nats(table, 1)
    drive = np.array([0.0, 0.0, -2.0])
    out = run_algebra(table, (drive - drive.mean())[None, None]).output_nats[0, 0, 0]
    assert offsets == pytest.approx((out - np.log(2),) * 2, abs=1e-6)
    assert offsets[0] == pytest.approx(np.log(2 + np.exp(-2)) - np.log(2), abs=1e-6)


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

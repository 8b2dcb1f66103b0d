"""The fixed point: it stays, its parts come upstream first, and OUT there is near -ln P."""

import re
from dataclasses import replace

import numpy as np
import pytest

from circuits import anatomy
from circuits.cells import Rate
from circuits.circuit import Circuit
from circuits.declaration.rows import Population, Projection
from circuits.dynamics import fixed_point
from circuits.dynamics.wiring import Wiring
from circuits.engines import run
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
    parts = [
        ({wiring.row(b).name for b in blocks}, loop) for blocks, loop in fixed_point.parts(wiring)
    ]
    order = {name: i for i, (names, _) in enumerate(parts) for name in names}
    assert ({"STN", "GPe"}, True) in parts
    assert [loop for names, loop in parts if len(names) == 1] == [False] * 4
    assert order["ctx"] < order["D2"] < order["GPe"] < order["SNr"]
    assert order["D1"] < order["SNr"]


def test_a_nucleus_that_inhibits_itself_alone_settles_where_its_rates_do():
    circuit = anatomy.bogacz_gurney().with_rows(Projection("SNr", "SNr", -0.2, delay_ms=1))
    drive = np.zeros((1, 60, 2))
    exact = run(circuit, drive, engine="algebra", step_ms=10).output_nats[0, -1]
    alone = run(anatomy.bogacz_gurney(), drive, engine="algebra", step_ms=10).output_nats[0, -1]
    # x = OUT - 0.2 x.
    np.testing.assert_allclose(exact, alone / 1.2, rtol=1e-9)
    settled = run(circuit, drive, engine="rate", step_ms=10).output_nats[0, -1]
    np.testing.assert_allclose(settled, exact, atol=1e-6)


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


def steps_of(monkeypatch, circuit, name, drive):
    """Return the states of the first channel of a population that rates are asked for, nats."""
    wiring, seen, rates = fixed_point.wired(circuit), [], Wiring.rates
    block = wiring.blocks_of(name)[0]

    def noted(self, x):
        seen.append(x[0, block])
        return rates(self, x)

    monkeypatch.setattr(Wiring, "rates", noted)
    fixed_point.solve(wiring, np.array([drive]))
    return np.array(seen)


def test_an_exponent_goes_to_its_fixed_point_by_at_most_one_nat_per_step(monkeypatch):
    inputs = steps_of(monkeypatch, anatomy.bogacz_gurney(), "STN", [9.0, -2.0])
    steps = np.abs(np.diff(inputs))
    assert steps.max() == pytest.approx(1.0, rel=1e-12)
    np.testing.assert_allclose(steps[2:5], 1.0, rtol=1e-12)


@pytest.mark.parametrize(("patience", "share"), [(100, 5), (0, 41)])
def test_where_blocks_are_silent_a_step_is_a_fifth_of_the_error_and_later_less(
    patience, share, monkeypatch
):
    """Far from the end, dx/dt = error is damped by 4; after too many steps, by 40."""
    rows = (
        Population("source", Rate(signed=True), 0.0, 10.0),
        Population("target", Rate(), 0.0, 10.0, bias_nats=-40.0, transfer="rectified"),
    )
    paths = (Projection("source", "target", 1.0), Projection("target", "target", 0.5))
    table = Circuit("silent", rows, paths, 2, input="source", readout="target")
    monkeypatch.setattr(fixed_point, "PATIENCE", patience)
    table = replace(table, reference_nats=np.log(2))
    inputs = steps_of(monkeypatch, table, "target", [30.0, 30.0])
    error = -10 - inputs[1:6]
    np.testing.assert_allclose(np.diff(inputs[1:6]), error[:-1] / share, rtol=1e-12)


def test_the_cached_state_at_rest_is_that_of_a_fresh_solution():
    for circuit in (
        anatomy.load_circuit("macaque"),
        anatomy.load_circuit("macaque").lesion("STN", 0.1),
    ):
        wiring = fixed_point.wired(circuit)
        for _ in range(2):
            x, rates = fixed_point.resting_state(circuit)
            assert np.array_equal(x, fixed_point.rest(wiring))
            assert np.array_equal(rates, fixed_point.rest_rates(wiring))


@pytest.mark.parametrize("make", [anatomy.bogacz_gurney, anatomy.appendix_b])
@pytest.mark.parametrize(
    ("channels", "competitors"), [(2, None), (2, 1), (5, None), (5, 1), (5, 3)]
)
def test_out_of_an_exact_table_is_off_by_nothing(make, channels, competitors):
    for circuit in (make(channels), replace(make(channels), centred=True, max_deficit_nats=40.0)):
        assert fixed_point.off_nats(circuit, competitors) == pytest.approx((0, 0), abs=1e-8)


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


@pytest.mark.parametrize("competitors", [0, 3])
def test_as_many_competitors_as_channels_or_no_competitor_are_refused(competitors):
    with pytest.raises(
        ValueError, match=re.escape(f"competitors must be within 1..2, got {competitors}")
    ):
        fixed_point.off_nats(anatomy.bogacz_gurney(3), competitors)


def test_a_circuit_in_saliences_has_no_distance_from_a_posterior():
    with pytest.raises(ValueError, match="not nats: OUT as -ln P has no meaning there"):
        fixed_point.off_nats(anatomy.gpr(3))

"""An input in nats in Hz, per cent, pA and nS."""

import re
from dataclasses import replace

import numpy as np
import pytest

from circuits import anatomy
from circuits.cells.membrane import lif_mean_mv, lif_rate_hz
from circuits.dynamics.fixed_point import solve, wired
from circuits.laws import units
from tests.helpers import ROOT

STEP = 1e-5


def settled_hz(circuit, name, nats):
    """Return the mean rate of a nucleus at the fixed point, with an input to all its channels."""
    wiring = wired(circuit)
    blocks = wiring.blocks_of(name)
    bias = wiring.bias.copy()
    bias[blocks] += nats
    lit = replace(wiring, bias=bias)
    rates = lit.rates(solve(lit, np.zeros((1, circuit.channels))))[0]
    return rates[blocks].mean()


def is_slope(value, rate_of):
    """Whether a number is the slope of a function at 0, from one side where it has a kink."""
    left, right = ((rate_of(side) - rate_of(0)) / side for side in (-STEP, STEP))
    return any(value == pytest.approx(side, rel=1e-3, abs=2e-3) for side in (left, right))


@pytest.mark.parametrize("channels", [2, 3])
@pytest.mark.parametrize("name", anatomy.CIRCUITS)
def test_slopes_are_those_of_the_fixed_point_and_of_the_nucleus_alone(name, channels):
    circuit = anatomy.load_circuit(name, channels)
    unit = circuit.unit.removesuffix("s")
    wiring = wired(circuit)
    x = solve(wiring, np.zeros((1, channels)))[0]
    for row in circuit.effect_of_nats().to_dict("records"):
        blocks = wiring.blocks_of(row["nucleus"])

        def alone(nats, blocks=blocks):
            return wiring.rates(x + nats)[blocks].mean()

        def settled(nats, nucleus=row["nucleus"]):
            return settled_hz(circuit, nucleus, nats)

        assert row["rest_hz"] == pytest.approx(alone(0))
        assert row["hz"] == pytest.approx(alone(1) - alone(0))
        assert is_slope(row[f"hz_per_{unit}"], alone), row["nucleus"]
        assert is_slope(row[f"settled_hz_per_{unit}"], settled), row["nucleus"]


def test_an_input_of_the_exponential_stn_multiplies_its_rate():
    table = anatomy.load_circuit("macaque").effect_of_nats(-2).set_index("nucleus")
    assert table.loc["STN", "percent"] == pytest.approx(100 * (np.exp(-2) - 1))
    assert table.loc["SNr", "percent"] == -100, "40 Hz per nat from 68: silent"


@pytest.mark.parametrize("nats", [-0.3, 0.5])
def test_a_current_of_that_size_has_the_effect_of_the_nats(nats):
    """On cells with a membrane by their own f-I curve; on the others by that of the usual cell."""
    circuit = anatomy.load_circuit("spiking_msprt")
    wiring = wired(circuit)
    x = solve(wiring, np.zeros((1, 2)))[0]
    reversal_mv = 0.0 if nats > 0 else -70.0
    for row in circuit.effect_of_nats(nats).to_dict("records"):
        shift_mv = row["current_pa"] / units.LEAK_NS
        population = circuit[row["nucleus"]]
        if hasattr(population.cell, "mv_per_nat"):
            cell, here = population.cell, x[wiring.blocks_of(row["nucleus"])]
            shifted = lif_rate_hz(cell, cell.mean_mv(here) + shift_mv)
            np.testing.assert_allclose(shifted, cell.rate_hz(here + nats, None))
        else:
            mean_mv = lif_mean_mv(units.CELL, row["rest_hz"])
            hz = row["rest_hz"] + row["hz"]
            assert lif_rate_hz(units.CELL, mean_mv + shift_mv) == pytest.approx(hz)
        # The current of that conductance at the potential of the cell.
        assert row["conductance_ns"] > 0
        assert row["conductance_ns"] * (reversal_mv + 50.0) == pytest.approx(row["current_pa"])


def test_what_has_no_effect_or_no_rate_has_no_number():
    table = anatomy.load_circuit("gpr").effect_of_nats(0.1).set_index("nucleus")
    assert table.loc["D1", "hz"] == 0
    assert table.loc["D1", ["percent", "current_pa", "conductance_ns"]].isna().all()


def test_the_page_shows_what_the_function_returns():
    """The table of the guide to units, and the number of synaptic events."""
    circuit, page = anatomy.load_circuit("macaque"), (ROOT / "docs/guides/units.md").read_text()
    columns = ["rest_hz", "hz", "percent", "hz_per_nat", "settled_hz_per_nat"]
    shown = {
        cells[0]: [float(cell) for cell in cells[1:]]
        for line in page.splitlines()
        if (cells := line.strip("| ").split(" | "))[0] in [row.name for row in circuit.populations]
    }
    effects = circuit.effect_of_nats(-2).set_index("nucleus")
    assert list(shown) == list(effects.index)
    for nucleus, numbers in shown.items():
        wanted = effects.loc[nucleus, columns].astype(float)
        np.testing.assert_allclose(numbers, wanted, rtol=0.01, err_msg=nucleus)
    conductance = circuit.effect_of_nats().set_index("nucleus").loc["STN", "conductance_ns"]
    (events,) = re.findall(r"as much as (\d+)\s+further", page)
    assert float(events) == pytest.approx(conductance / (1.65 * 0.002), rel=0.005)

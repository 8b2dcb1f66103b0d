"""Encodings of cells: those of an exact circuit, their derivatives, and their identity."""

import numpy as np
import pytest

from bgmodel.fitting.cells.encoding import ENCODINGS, encoding_of, nucleus_encoding
from circuits.anatomy import load_circuit
from tests.helpers import refused

LEAD = np.linspace(-2, 2, 41)
REST_HZ = 12.0
"""Rate of STN at rest in the exact circuit, two channels."""


def test_the_direct_pathway_of_the_exact_circuit_is_a_line_and_its_stn_exponential():
    """Of evidence +-l/2, relative to the slope at rest: D1 has l, and STN's channels exp(l)."""
    direct, stn = (encoding_of(f"bogacz_gurney {name}").encode for name in ("D1", "STN"))
    assert direct(LEAD)[0] == pytest.approx(LEAD, abs=1e-9)
    assert direct(10 * LEAD, 3.0)[0] == pytest.approx(10 * LEAD, abs=1e-9)
    rate_hz, other_hz = (REST_HZ * (1 + stn(lead)[0] / 2) for lead in (LEAD, -LEAD))
    assert rate_hz / other_hz == pytest.approx(np.exp(LEAD), rel=1e-3)


@pytest.mark.parametrize("spread", [0.0, 0.7, 3.0])
@pytest.mark.parametrize("name", [*ENCODINGS, "macaque D1", "macaque D2", "macaque STN"])
def test_an_encoding_has_its_derivatives(name, spread):
    read, at = encoding_of(name).encode, 6 * LEAD  # beyond the ends of a curve too
    slope = (read(at + 1e-6, spread)[0] - read(at - 1e-6, spread)[0]) / 2e-6
    _, by_input, by_spread = read(at, spread)
    assert by_input == pytest.approx(slope, abs=1e-6)
    if spread:  # that by the spread is of the curve between two inputs at which it is known
        apart = read(at, spread + 1e-4)[0] - read(at, spread - 1e-4)[0]
        assert apart / (2e-4 * spread) == pytest.approx(by_spread + 0 * at, abs=0.02)


def test_a_curve_is_averaged_over_the_noise_of_its_input():
    """By quadrature over the curve without noise, on both sides of the kinks of D2."""
    read, spread = encoding_of("macaque D2").encode, 1.5
    nodes = np.linspace(-6, 6, 4001)
    weights = np.exp(-(nodes**2) / 2)
    inputs = 3 * LEAD[:, None] + spread * nodes
    mean = (read(inputs)[0] * weights).sum(axis=1) / weights.sum()
    assert read(3 * LEAD, spread)[0] == pytest.approx(mean, abs=1e-3)


def test_a_circuit_that_was_edited_is_another_encoding():
    """With the name alone, a fit would resume from pieces stored for another circuit."""
    circuit = load_circuit("macaque", 2)
    intact, lost = (nucleus_encoding(c, "D1", "D1") for c in (circuit, circuit.lesion("STN", 0.1)))
    assert intact.identity() != lost.identity()
    assert intact.identity() == nucleus_encoding(circuit, "D1", "D1").identity()


def test_unknown_encodings_are_refused():
    for name in ("sigmoid", "macaque D7", "macaque ctx_inh", "nowhere D1"):
        with refused("models" if name != "nowhere D1" else "circuit"):
            encoding_of(name)

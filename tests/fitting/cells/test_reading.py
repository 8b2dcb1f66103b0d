"""Readings of cells: those of an exact circuit, their derivatives, and their identity."""

import numpy as np
import pytest

from bgmodel.fitting.cells.reading import READINGS, nucleus_reading, reading_of
from circuits.anatomy import load_circuit
from tests.helpers import refused

LEAD = np.linspace(-2, 2, 41)
REST_HZ = 12.0
"""Rate of STN at rest in the exact circuit, two channels."""


def test_the_direct_pathway_of_the_exact_circuit_is_a_line_and_its_stn_exponential():
    """Of evidence +-l/2: D1 has l/2, and STN's two channels a ratio of exp(l)."""
    direct, stn = (reading_of(f"bogacz_gurney {name}").read for name in ("D1", "STN"))
    assert direct(LEAD)[0] == pytest.approx(LEAD / 2, abs=1e-9)
    rate_hz, other_hz = (REST_HZ + 10 * stn(lead)[0] for lead in (LEAD, -LEAD))
    assert rate_hz / other_hz == pytest.approx(np.exp(LEAD), rel=1e-3)


@pytest.mark.parametrize("name", [*READINGS, "macaque D1", "macaque STN"])
def test_a_reading_has_its_derivative(name):
    read, at = (
        reading_of(name).read,
        LEAD + 0.011,
    )  # between the inputs at which circuits are solved
    slope = (read(at + 1e-6)[0] - read(at - 1e-6)[0]) / 2e-6
    assert read(at)[1] == pytest.approx(slope, abs=1e-6)


def test_a_circuit_that_was_edited_is_another_reading():
    """With the name alone, a fit would resume from pieces stored for another circuit."""
    circuit = load_circuit("macaque", 2)
    intact, lost = (nucleus_reading(c, "D1", "D1") for c in (circuit, circuit.lesion("STN", 0.1)))
    assert intact.identity() != lost.identity()
    assert intact.identity() == nucleus_reading(circuit, "D1", "D1").identity()


def test_unknown_readings_are_refused():
    for name in ("sigmoid", "macaque D7", "nowhere D1"):
        with refused("models" if name != "nowhere D1" else "circuit"):
            reading_of(name)

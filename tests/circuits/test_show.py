"""A circuit on one page."""

import re

import numpy as np
import pytest

from circuits import anatomy, show

PUBLISHED = {"D1": (0, 1), "D2": (0, 1), "STN": (15.2, 22.8), "SNr": (59.1, 79.5)}
"""Resting rates of the macaque, Hz, of Lienard & Girard 2014."""


@pytest.mark.parametrize("name", anatomy.CIRCUITS)
def test_the_page_holds_every_row_with_its_source(name):
    circuit = anatomy.load_circuit(name, 3)
    page = show.text(circuit)
    for row in circuit.populations:
        assert row.name in page
        assert row.cite
        assert row.cite in page
    for p in circuit.projections:
        assert f"{p.source} -> {p.target}" in page
        assert p.cite in page
    assert max(len(line) for line in page.splitlines()) <= 240


def test_the_page_says_whether_a_circuit_is_in_the_family_and_what_fails():
    circuit = anatomy.macaque(3)
    assert "in the family of OUT = -ln P: Sigma0 2.6, loop gain 0.72" in show.text(circuit)
    page = show.text(circuit.scale("ctx->D1", 0.9))
    assert "not in the family of OUT = -ln P:\n  direct: " in page
    assert "off by +0.12" in page  # a tenth of 1 + 0.1 * 0.55 + 0.15, rounded
    assert "family" not in show.text(anatomy.gpr())  # not in nats


@pytest.mark.parametrize("channels", range(2, 9))
def test_the_macaque_names_the_nuclei_that_rest_outside_the_published_range(channels):
    """STN rests at 32 / N and SNr at 40 + 40 ln N Hz: which of them is outside turns on N."""
    rates = {"D1": 1.28, "D2": 0.5, "STN": 32.3 / channels, "SNr": 40 + 40 * np.log(channels)}
    outside = {
        name: f"{low:.3g} to {high:.3g}"
        for name, (low, high) in PUBLISHED.items()
        if not low <= rates[name] <= high
    }
    page = show.text(anatomy.macaque(channels))
    (line,) = (line for line in page.splitlines() if "outside the published range" in line)
    assert dict(re.findall(r"(\w+) [\d.]+ \(([\d.]+ to [\d.]+)\)", line)) == outside

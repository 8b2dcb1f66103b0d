"""Rates at rest beside those that are printed for the animal."""

import re

import numpy as np
import pytest

from circuits import anatomy
from circuits.anatomy.printed_rates import at_rest, outside


@pytest.mark.parametrize("channels", range(2, 9))
def test_the_macaque_names_what_rests_outside_what_its_own_text_says_is_printed(channels):
    """STN rests at 44 / N and SNr at 20 + 36 ln N Hz: which of them is outside turns on N."""
    text = " ".join((anatomy.macaque.__doc__ or "").split())
    printed = re.search(r"MSN (\d+)-(\d+), STN (\d+)-(\d+), .* SNr (\d+)-(\d+) Hz", text)
    assert printed is not None
    msn, stn, snr = np.array(printed.groups(), dtype=float).reshape(3, 2)
    at = {"STN": (44 / channels, stn), "SNr": (20 + 36 * np.log(channels), snr)}
    at |= {"D1": (4.8, msn), "D2": (3.0, msn)}
    want = {
        name: f"{low:.0f} to {high:.0f}"
        for name, (hz, (low, high)) in at.items()
        if not low <= hz <= high
    }
    said = outside(anatomy.macaque(channels))
    assert said.startswith("outside what is printed for the macaque, Hz: ")
    assert dict(re.findall(r"(\w+) \d+ \((\d+ to \d+)\)", said)) == want
    found = at_rest(anatomy.macaque(channels))
    assert [found[name] for name in at] == pytest.approx([hz for hz, _ in at.values()])


def test_of_a_circuit_that_is_no_animal_nothing_is_printed():
    assert outside(anatomy.spiking_msprt(2)) == ""

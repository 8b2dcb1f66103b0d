"""The tuned macaque computes what ``macaque`` does, with the animal's rates and beta."""

import numpy as np
import pytest

from circuits.anatomy import load_circuit, macaque_tuned
from circuits.anatomy.macaque_tuned import MOST_LEAD_NATS
from circuits.dynamics.fixed_point import off_nats, resting_hz
from circuits.engines import run
from circuits.laws.family import failures, shift_nats
from circuits.laws.spectra import rate_spectrum

ALTERNATIVES = (2, 3, 4, 5, 6, 7, 8)
PUBLISHED_HZ = {
    "FSI": (7.8, 14.0), "STN": (15.2, 22.8), "GPe": (55.7, 74.5), "SNr": (59.1, 79.5),
}  # fmt: skip
"""Lienard & Girard 2014."""


@pytest.mark.parametrize("channels", ALTERNATIVES)
def test_out_is_minus_ln_p_where_it_is_read(channels):
    circuit = macaque_tuned(channels)
    assert failures(circuit) == []
    assert np.abs(off_nats(circuit)).max() <= 0.001
    out = run(circuit, np.zeros((1, 1, channels)), engine="algebra", step_ms=1.0).output_nats
    assert out == pytest.approx(np.log(channels), abs=1e-9)


def test_two_alternatives_rest_at_the_published_rates():
    rates = resting_hz(macaque_tuned(2))
    for name, (low, high) in PUBLISHED_HZ.items():
        assert low <= rates[name] <= high, name
    assert 0 < (rates["D1"] + rates["D2"]) / 2 <= 1


def test_without_half_the_dopamine_stn_beats_at_8_to_15_hz():
    hz = np.arange(4.0, 60.25, 0.25)
    power = rate_spectrum(macaque_tuned(2).dopamine(0.5), "STN", hz)
    assert 8 <= hz[power.argmax()] <= 15


def test_an_acute_loss_of_stn_acts_as_the_theorem_says():
    for lost in (0.1, 0.3, 0.5):
        circuit = macaque_tuned(4)
        assert shift_nats(circuit.lesion("STN", lost), circuit) == pytest.approx(
            np.log1p(-lost), abs=1e-4
        )


def test_interneurons_take_from_d1_what_cortex_adds():
    """Without them, and with the weight that they restore, the circuit computes the same."""
    circuit = macaque_tuned(2)
    weight = next(p.weight for p in circuit.projections if p.pair == "ctx->D1")
    taken = next(-p.weight for p in circuit.projections if p.pair == "FSI->D1")
    without = circuit.scale("FSI", "D1", 0).scale("ctx", "D1", (weight - taken) / weight)
    d1 = without.population("D1")
    without = without.with_population("D1", bias_nats=d1.bias_nats + taken * circuit.rest_drive)
    drive = np.array([[[1.0, -0.5]], [[0.0, 0.3]]])
    one, other = (run(c, drive, engine="algebra", step_ms=1.0) for c in (circuit, without))
    np.testing.assert_allclose(one.output_nats, other.output_nats, atol=1e-9)


def test_it_states_a_lead_for_every_number_of_alternatives_that_it_takes():
    assert sorted(MOST_LEAD_NATS) == list(range(2, load_circuit("macaque_tuned").most_channels + 1))
    assert load_circuit("macaque_tuned", 12).max_lead_nats == MOST_LEAD_NATS[12]

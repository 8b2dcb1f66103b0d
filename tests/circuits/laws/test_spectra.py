"""Power spectra against what is known: independent spikes, and a loop at its onset."""

from dataclasses import replace

import numpy as np
import pytest

from circuits import anatomy
from circuits.cells import Phase
from circuits.engines import rate
from circuits.engines.ensemble import run as ensemble
from circuits.laws.response import phase_spectrum
from circuits.laws.stability import growth, onset, roots
from circuits.spec import Circuit, Population


def test_independent_spikes_have_twice_their_rate_over_their_number():
    """The one-sided density of n cells is twice the power of one over n, at every frequency."""
    hz, cells = 40.0, 300
    row = Population("source", Phase(1.0), hz, 1.0, neurons=cells)
    alone = Circuit("alone", (row,), (), 2, input="source", readout="source")
    alone = replace(alone, reference_nats=np.log(2))
    found = ensemble.run(alone, np.zeros((20, 4, 2)), step_ms=1000, seed=71)
    frequency, power = found.spectrum("source", from_ms=500)
    inside = (frequency > 5) & (frequency < 480)
    # Two channels are averaged: their number is that of both.
    law = 2 * phase_spectrum(Phase(1.0), [hz], frequency[inside])[0] / (2 * cells)
    assert power[inside].mean() == pytest.approx(law.mean(), rel=0.03)
    half = frequency[inside] < 50
    assert power[inside][half].mean() == pytest.approx(law[half].mean(), rel=0.1)


@pytest.mark.filterwarnings("ignore:S runs from")
def test_a_loop_beyond_its_onset_turns_at_the_computed_frequency():
    table = anatomy.bogacz_gurney()
    begins = onset(table)
    beyond = replace(table, reference_nats=1.04 * begins.total_nats)
    drive = np.array([[[0.3, -0.3], [0.0, 0.0], [0.0, 0.0]]])
    found = rate.run(beyond, drive, step_ms=2000, sample_ms=1.0)
    frequency, power = found.spectrum("STN", from_ms=2500, segment_ms=2000)
    peak = frequency[1:][power[1:].argmax()]
    assert peak == pytest.approx(begins.frequency_hz, rel=0.1)


def test_growth_is_the_first_of_the_roots():
    table = anatomy.spiking_msprt()
    found = roots(table, (0.5, -0.5))
    assert growth(table, (0.5, -0.5)) == found[0]
    assert np.all(np.diff(found.real) <= 0)


def test_a_segment_must_fit():
    found = rate.run(anatomy.bogacz_gurney(), np.zeros((1, 1, 2)), step_ms=500)
    with pytest.raises(ValueError, match="segment_ms must fit into what is left"):
        found.spectrum("STN", from_ms=100)

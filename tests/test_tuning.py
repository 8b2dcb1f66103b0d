"""What tuning edits: filters and codes that are what they say."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.tuning.cortex import coded
from benchmarks.tuning.filters import Run
from benchmarks.tuning.neighbours import tuning_evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from circuits.anatomy import load_circuit

SEED, GAIN = 7, 0.7


def test_out_for_other_filters_is_that_of_a_run_with_them():
    """D1 and STN fire identically in both runs; only the timing of SNr's spikes differs."""
    evidence = tuning_evidence(20, 2, 4.0, SEED)
    table = load_circuit("spiking_msprt")
    slow = table.with_projection("D1", "SNr", tau_ms=20, delay_ms=15).with_projection(
        "STN", "SNr", tau_ms=60
    )
    slow = replace(slow, readout_tau_ms=60.0)
    run = Run(table, evidence, GAIN, SEED)

    def distance(filters, simulated):
        out = BasalGanglia(simulated, "ensemble", GAIN, SEED).run(evidence).out_nats
        # SNr is silent below: there its rate tells nothing of its input.
        seen = (out > 0.1) & (np.arange(out.shape[1]) > 100)[:, None]
        return np.sqrt(np.mean((run.out(filters).out_nats - out)[seen] ** 2))

    assert distance(table, table) < 0.005
    assert distance(slow, slow) < 0.03
    assert distance(table, slow) > 0.1


@pytest.mark.parametrize("channels", [2, 4, 8])
def test_another_cortical_code_does_the_same_until_losers_fall_silent(channels):
    table = load_circuit("spiking_msprt", channels)
    top, hz = table.reference_nats, table.population("ctx").gain_hz_per_nat
    near, far = (np.array([[[odds] + [0.0] * (channels - 1)]]) for odds in (1.5, 4.5))

    def out(c, drive):
        return (
            BasalGanglia(c, "algebra")
            .run_drive(drive - drive.mean(), step_ms=1.0)
            .output_nats[0, -1, 0]
        )

    np.testing.assert_allclose(out(coded(table, top, hz), near), out(table, near), atol=1e-12)
    for other in (top - 0.3, top + 1):
        edited = coded(table, other, 2 * hz)
        assert edited.population("ctx").gain_hz_per_nat == 2 * hz
        np.testing.assert_allclose(out(edited, near), out(table, near), atol=1e-9)
    # Silent losers seem no further behind than the code is high.
    exact = np.log1p((channels - 1) * np.exp(-4.5))
    assert out(coded(table, top + 3, hz), far) == pytest.approx(exact, abs=0.03)
    assert out(coded(table, 1.5, hz), far) > np.log1p((channels - 1) * np.exp(-1.5))
    assert table.readable_nats[0] < out(table, far) < table.readable_nats[0] + 0.03

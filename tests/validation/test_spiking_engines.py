"""Long checks of the spiking engines: make validate."""

import numpy as np
import pytest

from bgmodel.integrators.basal_ganglia import drive_of
from bgmodel.simulated_evidence import separated_evidence
from bgmodel.support.seeds import stream
from circuits import anatomy
from tests.circuits.helpers import run_spikes
from tests.integrators.test_steady import shifts

pytestmark = pytest.mark.validate

STEPS, STEP_MS, SETTLE_MS, GAIN = 14, 50.0, 100.0, 0.6


def evidence(trials, channels=2, name="validation"):
    return separated_evidence(
        trials, STEPS, 0.8 / np.sqrt(2), rng=stream(31, name), hypotheses=channels, step_ms=STEP_MS
    )


@pytest.mark.parametrize("channels", [2, 4])
def test_half_the_tick_changes_mean_out_by_less_than_its_standard_error(channels):
    trials = 500
    circuit = anatomy.spiking_msprt(channels)
    drive = drive_of(evidence(trials, channels), GAIN)
    settings = {"step_ms": STEP_MS, "settle_ms": SETTLE_MS, "workers": 2, "rates": False}
    means = [
        run_spikes(circuit, drive, seed=5, dt_ms=dt, **settings).output_nats.mean(axis=1)
        for dt in (0.1, 0.05)
    ]
    change = (means[1] - means[0]).mean(axis=0)
    error = means[0].std(axis=0, ddof=1) / np.sqrt(trials)
    print(f"change {change.round(5)} nats, standard error {error.round(5)}")
    assert (np.abs(change) < error).all()


def test_lesions_are_met_by_the_laws_of_a_finite_number_of_cells():
    """With 300 cells and with 3 000; those of infinitely many cells leave three times as much."""
    for neurons, trials in ((300, 40), (3000, 6)):
        table = anatomy.spiking_msprt(4).with_neurons(neurons)
        edited = {
            "STN": table.lesion("STN", 0.2),
            "GPe": table.lesion("GPe", 0.2),
            "D2": table.lesion("D2"),
        }
        shifted = shifts(table, edited, (1.75, 2.25, 2.75), seed=32, trials=trials)
        left = {
            name: np.abs(shifted["value"] - shifted[name]).mean()
            for name in ("exact", "own_laws", "finite")
        }
        print(neurons, left)
        assert left["finite"] < 0.0015
        assert left["exact"] > 5 * left["finite"]
        if neurons == 300:
            assert left["own_laws"] > 3 * left["finite"]

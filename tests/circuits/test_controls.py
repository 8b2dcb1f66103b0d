"""Circuits changed at random: each number once, and noise of a stated size."""

import numpy as np
import pytest

from bgmodel.integrators.basal_ganglia import BasalGanglia
from circuits.anatomy import circuit
from circuits.controls import correlated, perturbed

SEED = 51
TABLE = circuit("spiking_msprt", 4)


def test_every_number_is_varied_once_each_way():
    made = perturbed(TABLE, 0.2)
    assert len({str(table) for table in made.values()} | {str(TABLE)}) == len(made) + 1
    assert made["STN cv +20%"].population("STN").cell.cv == pytest.approx(0.36)
    assert made["ctx->STN delay_ms -20%"].projection("ctx", "STN").delay_ms == 2.0
    assert made["GPe tau_ms +20%"].population("GPe").cell.tau_ms == pytest.approx(12)
    assert made["read-out tau_ms -20%"].readout_tau_ms == pytest.approx(22.4)


def test_shared_noise_has_the_size_that_was_asked():
    noisy = correlated(TABLE, 0.2)
    silence = np.zeros((40, 10, 4))
    sd = []
    for table in (TABLE, noisy):
        y = BasalGanglia(table, "ensemble", seed=SEED).run_drive(silence, 50.0).decoded_nats("ctx")
        # Over 20 ms, the time of the shared noise.
        sd.append(y.reshape(40, 25, 20, 4).mean(axis=2).std())
    assert np.sqrt(sd[1] ** 2 - sd[0] ** 2) == pytest.approx(
        0.2 * np.sqrt(2 * np.exp(-1)), rel=0.25
    )

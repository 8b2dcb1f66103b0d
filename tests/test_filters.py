"""OUT for other filters from one run of spikes is what a run with those filters gives."""

from dataclasses import replace

import numpy as np

from benchmarks.filters import Run
from benchmarks.tuning import tuning_evidence
from bgmodel.basal_ganglia import BasalGanglia, circuit

SEED, GAIN = 7, 0.7


def test_out_for_other_filters_is_that_of_a_run_with_them():
    """D1 and STN fire alike in both runs; what differs is how SNr's own spikes fall."""
    evidence = tuning_evidence(20, 2, 4.0, SEED)
    table = circuit("spiking_msprt")
    slow = table.changed("D1->SNr", tau_ms=20, delay_ms=15).changed("STN->SNr", tau_ms=60)
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

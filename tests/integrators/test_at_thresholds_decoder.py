"""The decoder of the spikes that a circuit is given."""

import numpy as np
import pytest

from bgmodel import Evidence, Msprt
from bgmodel.integrators.at_thresholds import decoded_input
from bgmodel.integrators.basal_ganglia import BasalGanglia
from circuits.anatomy import load_circuit
from circuits.engines import Spikes

GAIN = 0.5


def test_the_decoder_of_a_steady_input_is_the_test():
    """Its OUT is -ln softmax of the decoded cortical activity, within the counting error."""
    steady = Evidence(np.zeros((40, 20, 4)), step_ms=50.0)
    steady.log_likelihood[:, 0, 0] = 3.0
    model = BasalGanglia(load_circuit("spiking_msprt", 4), Spikes(workers=2), GAIN, 51)
    activity = model.activity(steady)
    out = decoded_input(activity, model.trace(activity, steady), tau_ms=100.0).out_nats[:, -200:, 0]
    wanted = Msprt(GAIN).run(steady).out_nats[0, -1, 0]
    assert out.mean() == pytest.approx(wanted, abs=0.03)

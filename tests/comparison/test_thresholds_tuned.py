"""The gain and the thresholds of a circuit, chosen on trials kept for that."""

import numpy as np
import pytest

from bgmodel import gaussian_evidence
from bgmodel.comparison.thresholds import GAINS, fastest_gain
from circuits.anatomy import load_circuit
from circuits.errors import InputError

EVIDENCE = gaussian_evidence(200, d_prime=0.5, t_max=100, seed=1)


def test_a_circuit_in_nats_keeps_its_gain_and_another_gets_the_fastest():
    model, _ = fastest_gain(load_circuit("spiking_msprt"), "rate", EVIDENCE, 1)
    assert model.gain == model.circuit.default_gain
    assert fastest_gain(load_circuit("bogacz_gurney"), "rate", EVIDENCE, 1)[0].gain == 1
    model, decided = fastest_gain(load_circuit("gpr"), "rate", EVIDENCE, 1)
    assert model.gain in GAINS
    slow, slower = fastest_gain(load_circuit("gpr"), "rate", EVIDENCE, 1, gain=0.05)
    assert slow.gain == 0.05
    at = [np.interp(0.9, np.sort(one.posterior.mean(axis=1)), np.sort(one.time_ms.mean(axis=1)))
          for one in (decided, slower)]  # fmt: skip
    assert at[0] <= at[1]


def test_a_circuit_that_rests_below_its_thresholds_is_refused():
    with pytest.raises(InputError):
        fastest_gain(load_circuit("linear_gpe"), "rate", EVIDENCE, 1)

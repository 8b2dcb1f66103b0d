"""The demo: the chain of learning, evidence and spikes, and its picture."""

import numpy as np
import pytest

from bgmodel import demo as demos
from bgmodel import learn
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.learning.reinforce import Learner
from bgmodel.support.seeds import stream
from circuits.anatomy import load_circuit
from circuits.engines import Spikes

pytestmark = pytest.mark.usefixtures("no_check_of_noise")


@pytest.fixture(scope="module")
def chain():
    """Return the chain of seed 1 after a brief course of learning."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(demos, "LEARNER", Learner(episodes=800))
        return demos.demo(seed=1)


def test_its_spikes_are_those_of_the_compiled_engine(chain):
    engine = Spikes(dt_ms=demos.STEP_MS, settle_ms=demos.SETTLE_MS)
    model = BasalGanglia(load_circuit("macaque", 2), engine, chain.gain, 1)
    out = model.run(chain.evidence).out_nats
    assert np.allclose(out, chain.traces["circuit"].out_nats)


def test_its_evidence_and_its_threshold_are_those_of_the_functions_that_it_shows(chain):
    evidence = demos.TASK.evidence(1, seed=stream(1, "demo"))
    assert np.array_equal(evidence.log_likelihood, chain.evidence.log_likelihood)
    learned = learn(demos.TASK, xi=50, runs=5, seed=1, learner=Learner(episodes=800))
    assert np.array_equal(learned.learned, chain.learned.learned)
    # At the circuit's gain, log odds of the posterior are those of half the boundary separation.
    posterior = np.exp(-chain.threshold_nats)
    odds = np.log(posterior / (1 - posterior))
    assert odds == pytest.approx(chain.gain * learned.learned.mean() / 2)


def test_a_decision_is_the_first_crossing_of_the_learned_threshold(chain):
    for name, decision in chain.decisions.items():
        trace = chain.traces[name]
        at = int(np.searchsorted(trace.time_ms, decision.time_ms[0]))
        out = trace.out_nats[0, :, decision.choice[0]]
        assert out[at] <= chain.threshold_nats + 1e-9
        assert (out[:at] > chain.threshold_nats - 1e-9).all()

"""Who listens around a long loop hears of every trial; who does not hears nothing."""

import numpy as np

from bgmodel.integrators.basal_ganglia import BATCH, BasalGanglia
from bgmodel.integrators.deciding import decide_at_thresholds
from bgmodel.support.processes import advance, shown_by
from circuits.anatomy import load_circuit
from tests.helpers import some_evidence


def test_every_part_of_the_trials_is_heard_of_once():
    evidence = some_evidence(trials=BATCH + 30, steps=4, hypotheses=2)
    heard = []
    with shown_by(heard.append):
        decide_at_thresholds(
            BasalGanglia(load_circuit("bogacz_gurney"), "algebra"), evidence, np.array([0.3])
        )
    assert heard == [BATCH, 30]
    advance(5)
    assert heard == [BATCH, 30]


def test_the_innermost_listener_hears_alone():
    outer, inner = [], []
    with shown_by(outer.append):
        with shown_by(inner.append):
            advance(2)
        advance(3)
    assert (outer, inner) == ([3], [2])

"""What the project claims of its circuits, on scoring seeds: make validate."""

from dataclasses import replace

import numpy as np
import pytest

from bgmodel import Msprt, Sprt, first_crossing, stream
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.simulated_evidence import separated_evidence
from bgmodel.tactile.source import held_out_taps, source
from bgmodel.tactile.task import SameDifferent
from circuits.anatomy import load_circuit
from circuits.engines import Rate
from tests.comparison.deadlines import Task, changed, compared

pytestmark = pytest.mark.validate
SCORING_SEED = 40_002


def test_the_algebraic_circuit_is_the_sprt_on_gratings():
    """N = 2: no decision of 1e5 tactile trials differs, in choice or in time."""
    readings = source(held_out_taps(), SameDifferent(period_mm=1.5), fold=0)
    model = BasalGanglia(load_circuit("bogacz_gurney"), "algebra")
    gap, different, trials = 4.0, 0, 0
    for part in range(20):
        evidence = readings.draw(5000, 30, rng=stream(SCORING_SEED, "mapping", part))
        exact = first_crossing(Sprt().run(evidence), float(Sprt.threshold(gap)))
        decision = first_crossing(model.run(evidence), float(Msprt.threshold(gap)))
        # The circuit holds each reading for a step: it is read when it comes.
        different += np.sum(exact.choice != decision.choice)
        trials += evidence.trials
    print(f"{different} of {trials} decisions differ")
    assert different == 0


def test_the_rate_circuit_agrees_where_it_settles():
    """N = 4, 2 000 trials: read when a reading ends, 99.9 % of choices are the MSPRT's.

    That holds while a reading lasts until the circuit has settled; how agreement falls as readings
    get faster, and when OUT is read all the time, is printed. The circuit rests at S = 1: without a
    common mode S grows with the evidence, and the loop with delays oscillates from 5.5.
    """
    table = replace(load_circuit("bogacz_gurney", 4), reference_nats=1.0)
    threshold = float(-np.log(0.9))
    agree = {}
    for step_ms in (10.0, 20.0, 50.0, 100.0, 500.0):
        evidence = separated_evidence(
            2000, 25, 0.5, rng=stream(SCORING_SEED, "slow"), hypotheses=4, step_ms=step_ms
        )
        exact = first_crossing(Msprt().run(evidence), threshold).choice
        for sample_ms in (step_ms, step_ms / 10):
            model = BasalGanglia(table, Rate(sample_ms=sample_ms, dt_ms=1.0))
            choices = [
                first_crossing(trace, threshold).choice for _, _, trace in model.batches(evidence)
            ]
            agree[step_ms, sample_ms] = np.mean(np.concatenate(choices) == exact)
            print(
                f"every {step_ms:g} ms, read every {sample_ms:g}: {agree[step_ms, sample_ms]:.4f}"
            )
    settled = [agree[step_ms, step_ms] for step_ms in (10.0, 20.0, 50.0, 100.0, 500.0)]
    assert settled[0] < 0.99
    assert min(settled[3:]) >= 0.999


@pytest.mark.parametrize("seed", range(100))
def test_a_later_deadline_changes_no_comparison(seed):
    """Random tasks, engines and deadlines: what is reported stays within its interval."""
    assert changed(compared(Task.drawn(seed))).empty

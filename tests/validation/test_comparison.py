"""What the project claims of its tests and circuits, on scoring seeds: make validate."""

from dataclasses import replace

import numpy as np
import pytest

from bgmodel import Msprt, Sprt, first_crossing, stream
from bgmodel.comparison.edited import compare_edits
from bgmodel.comparison.matched import matched_measures
from bgmodel.deciding.tradeoff import tradeoff
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.baselines import MaxVsAverage
from bgmodel.integrators.first_passage import gaussian_pair
from bgmodel.integrators.sprt_theory import sprt
from bgmodel.learning.gap import fold_sources
from bgmodel.simulated_evidence import separated_evidence
from bgmodel.tactile.source import held_out_taps, source
from bgmodel.tactile.task import SameDifferent
from circuits.anatomy import load_circuit
from circuits.engines import Rates, Spikes
from circuits.laws.controls import linear_stn, shuffled_stn
from tests.comparison.deadlines import DeadlineTask, changed, compared

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
            model = BasalGanglia(table, Rates(sample_ms=sample_ms, dt_ms=1.0))
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
    assert changed(compared(DeadlineTask.drawn(seed))).empty


def test_a_circuit_without_what_computes_agrees_less():
    """Controls at N = 4, 1 000 trials: each must lose by its margin, with its interval.

    GPe held at rest: decisions within 50 ms of the MSPRT's fall by 0.2. A linear STN makes the
    circuit that of max-vs-average: it needs longer for the same accuracy, as that does against
    the MSPRT, by 30 ms or more, and 0.1 fewer decisions lie within 50 ms. A shuffled STN-SNr
    pathway: accuracy 0.95 is never reached.
    """
    table = load_circuit("spiking_msprt", 4)
    edited = {
        "GPe": table.clamp("GPe"),
        "linear": linear_stn(table),
        "shuffled": shuffled_stn(table),
    }
    evidence = separated_evidence(
        1000, 40, 1 / np.sqrt(2), rng=stream(SCORING_SEED, "control"), hypotheses=4, step_ms=50.0
    )
    model = BasalGanglia(table, Spikes(workers=2), 0.5, SCORING_SEED)
    edits = compare_edits(model, edited, evidence, seed=SCORING_SEED, accuracies=(0.95,))
    change = edits[edits["kind"] == "change"].set_index(["variant", "measure"])
    baseline = matched_measures(
        tradeoff(Msprt(0.5).run(evidence), evidence),
        tradeoff(MaxVsAverage().run(evidence), evidence),
        rng=stream(SCORING_SEED, "bootstrap"),
        accuracies=(0.95,),
    ).set_index("measure")
    shown = (("GPe", "within_50_ms"), ("linear", "extra_ms"), ("linear", "within_50_ms"))
    ends = ["value", "low", "high"]
    for key in shown:
        print(*key, change.loc[key, ends].round(3).tolist())
    print("max-vs-average extra_ms", baseline.loc["extra_ms", ends].round(1).tolist())
    assert change.loc[("GPe", "within_50_ms"), "high"] < -0.2
    assert change.loc[("linear", "extra_ms"), "low"] > 30
    assert change.loc[("linear", "within_50_ms"), "high"] < -0.1
    # As much as max-vs-average, within what 1 000 trials tell.
    assert change.loc[("linear", "extra_ms"), "low"] < baseline.loc["extra_ms", "high"]
    assert change.loc[("linear", "extra_ms"), "high"] > baseline.loc["extra_ms", "low"]
    assert np.isnan(change.loc[("shuffled", "agreement"), "value"])


def test_two_hypothesis_msprt_is_the_sprt_in_a_million_trials():
    separations = np.linspace(0, 8, 33)
    readings = fold_sources(held_out_taps(), 2.0)[0]
    for part in range(50):
        rng = stream(101, "equality", part)
        if part % 2:
            evidence = readings.draw(20_000, 30, rng=rng)
        else:
            evidence = separated_evidence(20_000, 50, 0.4, rng=rng)
        a = first_crossing(Sprt().run(evidence), Sprt.threshold(separations))
        b = first_crossing(Msprt().run(evidence), Msprt.threshold(separations))
        assert (a.choice != b.choice).sum() + (a.time_ms != b.time_ms).sum() == 0


def test_discrete_simulation_ends_as_the_exact_solution():
    """|z| < 4 for error rate and mean time at 1e6 trials over a grid of (d, theta)."""
    trials, t_max = 1_000_000, 200
    thetas = np.array([0.0, 0.5, 1.0, 2.0, 3.0, 4.0])
    for d in (0.5, 1.0, 2.0):
        sums = np.zeros((4, len(thetas)))
        for part in range(50):
            rng = stream(101, "exact", d, part)
            evidence = separated_evidence(trials // 50, t_max, d / np.sqrt(2), rng=rng)
            decision = first_crossing(Sprt().run(evidence), Sprt.threshold(2 * thetas))
            wrong = decision.choice != evidence.truth
            sums += [wrong.sum(1), decision.steps.sum(1), (decision.steps**2).sum(1), 0 * thetas]
        error, steps, squares, _ = sums / trials
        exact = sprt(*gaussian_pair(d), 2 * thetas, t_max=t_max)
        p = exact.error_rate
        z_error = (error - p) / np.sqrt(p * (1 - p) / trials)
        z_steps = (steps - exact.mean_steps) / np.sqrt((squares - steps**2) / trials + 1e-30)
        print(f"d {d}: z of error {np.round(z_error, 1)}, of time {np.round(z_steps, 1)}")
        assert np.abs(z_error).max() < 4
        assert np.abs(z_steps[steps > 1]).max() < 4

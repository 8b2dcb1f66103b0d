"""One function lets reward move a threshold, a level of dopamine or weights."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.special import expit

import bgmodel as bg
from bgmodel.integrators.first_passage import GaussianIncrements
from bgmodel.integrators.sprt_theory import optimal_separation
from bgmodel.learning import from_reward
from bgmodel.learning.deciders import WeightLearner
from bgmodel.learning.from_reward import (
    DOPAMINE,
    THRESHOLD,
    WEIGHTS,
    _learned_and_scored,
    _readings,
    learn,
)
from bgmodel.learning.gap import learn_gap
from bgmodel.learning.reinforce import Learner
from bgmodel.tactile.task import EdgeDirection, EdgeTurn, SameDifferent
from bgmodel.task import Gaussian
from bgmodel.trials.task_trials import EvidenceTable
from circuits.errors import LearningWarning
from tests.helpers import long_table, refused, refusing, told

SHORT = Learner(episodes=1500)
RATE = bg.BasalGanglia("macaque", "rate")
FEW = {"runs": 2, "seed": 3}
GAP = {**FEW, "xi": 50.0, "start_separation": 0.5, "learner": SHORT}


def test_the_gap_of_the_test_is_that_of_its_own_function():
    """The same streams, for 2 and for 2.0: numbers stored before are found again."""
    task = SameDifferent(2)
    learned = learn(task, learner=SHORT, start=1, **FEW)
    given = GAP | {"start_separation": 1.0}
    gap = learn_gap(task.source(), name=(2.0, 0), t_max=40, **given)
    assert learned.what == THRESHOLD
    np.testing.assert_array_equal(learned.learned, gap.learned.learned)
    assert learned.best == gap.optimum.boundary_separation
    assert learned.regret == pytest.approx(100 * np.mean(gap.regret))
    np.testing.assert_array_equal(learned.table["mean"], gap.learned.mean_played.ravel())


def test_the_best_gap_for_gaussian_evidence_is_that_of_the_exact_theory():
    """The log-likelihood ratio of a reading is normal, with mean d'^2 / 2 and variance d'^2."""
    learned = learn(Gaussian(d_prime=1.0), learner=SHORT, **FEW)
    exact = optimal_separation(
        GaussianIncrements(-0.5, 1.0), GaussianIncrements(0.5, 1.0), 50.0, t_max=40
    )
    assert learned.best == pytest.approx(exact.boundary_separation, rel=0.05)
    assert learned.regret < learned.regrets.loc["start", "value"]


@pytest.mark.parametrize(
    ("task", "model", "what"),
    [
        (SameDifferent(2.0), None, THRESHOLD),
        (SameDifferent(2.0), None, WEIGHTS),
        (Gaussian(d_prime=1.0), RATE, DOPAMINE),
        (Gaussian(d_prime=1.0), RATE, THRESHOLD),
    ],
    ids=["gap", "weights", "dopamine", "log odds"],
)
def test_all_that_reward_moves_has_one_kind_of_result(task, model, what):
    learner = WeightLearner(trials=300) if what == WEIGHTS else SHORT
    learned, again = (
        learn(task, model, what=what, learner=learner, trials=200, **FEW) for _ in range(2)
    )
    np.testing.assert_array_equal(learned.learned, again.learned)
    assert learned.what == what
    assert learned.learned.shape == (2,)
    rows = learned.summary().set_index("measure")
    assert rows.loc["learned", "value"] == pytest.approx(learned.learned.mean())
    assert rows.loc["regret_percent, learned", "value"] == learned.regret
    assert f"learned, best: {learned.unit}" in repr(learned.summary())
    as_posterior = f"a posterior of {expit(learned.learned.mean()):.2f}"
    assert (as_posterior in repr(learned)) is (model is not None and what == THRESHOLD)
    assert learned.to_dataframe().groupby("run").ngroups == 2
    assert learned.plot().axes[0].get_xlabel()
    assert f"{learned.learned.mean():.2f}" in repr(learned)


def test_weights_that_never_suffice_are_told():
    steps = WeightLearner(trials=200, rate=100.0)
    with pytest.warns(LearningWarning, match="2 of 2 runs do not reach 90 % correct"):
        learned = learn(Gaussian(d_prime=0.7, t_max=15), what=WEIGHTS, learner=steps, **FEW)
    assert np.isnan(learned.regret)
    assert "regret unknown %" in learned.verdict()
    assert learned.cautions


def test_taps_that_tell_nothing_teach_no_weights():
    rng = np.random.default_rng(4)
    taps = pd.DataFrame({"yaw_deg": np.linspace(-180, 180, 600, endpoint=False)})
    taps["edge_deg"] = rng.permutation(taps["yaw_deg"])
    steps = WeightLearner(trials=100)
    warned = told(
        lambda: learn(EdgeDirection(4, 20.0), what=WEIGHTS, taps=taps, learner=steps, **FEW)
    )
    assert len(warned) == 2
    assert "does not distinguish the 4 hypotheses" in warned[0]
    assert "2 of 2 runs do not reach 90 % correct" in warned[1]


def test_taps_of_another_sensor_teach_another_threshold():
    rng = np.random.default_rng(4)
    yaw = rng.uniform(-180, 180, 1200)
    taps = bg.load_taps().iloc[:1200].assign(yaw_deg=yaw, edge_deg=yaw + rng.normal(0, 4, 1200))
    learned = learn(EdgeTurn(step_deg=5.0), taps=taps, learner=SHORT, **FEW)
    assert learned.best > 0
    with refused("taps .*edge"):
        learn(EdgeTurn(), learner=SHORT)


def test_the_test_learns_from_a_table_as_from_the_task_that_its_readings_are_of(
    tmp_path, monkeypatch
):
    """The table has the same readings in longer trials, one of them shorter than the others."""
    monkeypatch.setattr(from_reward, "READINGS", 2000)
    task = Gaussian(t_max=20)
    readings = _readings(task, {}, FEW["seed"])
    values = np.concatenate([each.reshape(-1, 20, 2) for each in readings.log_likelihood])
    table = long_table(bg.Evidence(values, np.repeat([0, 1], len(values) // 2)))
    last = (table["trial"] == len(values) - 1) & (table["step"] > 5)
    path = tmp_path / "mine.parquet"
    table.to_parquet(path)
    both = [learn(each, learner=SHORT, **FEW).best for each in (EvidenceTable(path), task)]
    assert both[0] == both[1]
    table[~last].to_parquet(path)
    readings.log_likelihood[1] = readings.log_likelihood[1][:-14]
    by_hand = learn_gap(readings, name=(0.0, 0), t_max=20, **GAP)
    learned = learn(EvidenceTable(path), learner=SHORT, **FEW)
    np.testing.assert_array_equal(learned.learned, by_hand.learned.learned)
    assert learned.best == by_hand.optimum.boundary_separation
    table[table["truth"] == "a"].to_parquet(path)
    with refused("evidence"):
        learn(EvidenceTable(path), learner=SHORT, **FEW)


@pytest.mark.parametrize("order", ["in turn", "in blocks", "at random"])
def test_both_halves_of_a_table_have_the_same_truths(order, tmp_path):
    truth = np.arange(120) % 2
    rng = bg.stream(2)
    truth = {"in turn": truth, "in blocks": np.sort(truth)}.get(order, rng.permutation(truth))
    values = bg.stream(1).normal(size=(120, 2, 2))
    long_table(bg.Evidence(values, truth)).to_csv(tmp_path / "mine.csv", index=False)
    halves = _learned_and_scored(EvidenceTable(tmp_path / "mine.csv"), 7, {}, 0)
    assert [np.bincount(each.truth).tolist() for each in halves] == [[30, 30]] * 2
    trials = np.concatenate([each.log_likelihood for each in halves])
    assert len({each.tobytes() for each in trials}) == 120


test_what_cannot_be_learned_is_one_sentence = refusing(
    ({"task": "gaussian"}, "task"),
    ({"model": "macaque"}, "model"),
    ({"what": "gap"}, "what"),
    ({"task": Gaussian(3)}, "channels"),
    ({"task": EvidenceTable("mine.csv"), "what": WEIGHTS}, "task"),
    ({"xi": 0.0}, "xi"),
    ({"runs": 0}, "runs"),
    ({"seed": -1}, "seed"),
    ({"rule": "confidence"}, "rule"),
    ({"posterior": 0.9}, "posterior"),
    ({"what": WEIGHTS, "start": 1.0}, "start"),
    ({"model": RATE, "levels": 1}, "levels"),
    ({"what": WEIGHTS, "learner": SHORT}, "learner"),
    ({"learner": WeightLearner()}, "learner"),
    ({"model": replace(RATE, engine="algebra")}, "engine"),
    ({"model": RATE, "start": 9.0, "trials": 100}, "start"),
    ({"model": RATE, "trials": 99}, "trials"),
    ({"model": RATE, "what": THRESHOLD, "posterior": 0.9}, "posterior"),
    ({"start": 9.0}, "start"),
    of=lambda changes: learn(**({"task": SameDifferent()} | changes)),
)


def test_dopamine_without_a_circuit_is_that_of_the_default_one():
    options = {"what": DOPAMINE, "runs": 1, "trials": 120, "seed": 3, "learner": SHORT}
    learned = learn(Gaussian(), **options)
    named = learn(Gaussian(), bg.BasalGanglia("macaque", "rate", seed=3), **options)
    assert np.array_equal(learned.learned, named.learned)

"""Learning of a level of dopamine, with controls that must fail."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import chisquare, norm

from bgmodel import Msprt, stream
from bgmodel.bootstrap import resampled
from bgmodel.deciding.tradeoff import tradeoff
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from bgmodel.learning import dopamine_learner as level
from bgmodel.learning.dopamine import playable_levels
from bgmodel.learning.dopamine_learner import (
    CRITERION,
    LEVEL,
    POPULATIONS,
    SPIKES,
    TEST,
    CircuitLearned,
    check_decided,
    criterion_outcomes,
    decide_as_learned,
    learn_in_circuit,
    learn_level,
    level_outcomes,
    regret,
    scored_runs,
    threshold_of,
)
from bgmodel.learning.gap import check_start
from bgmodel.learning.reinforce import GaussianPolicy, Learned, Learner, LevelOutcomes, learn
from bgmodel.simulated_evidence import gaussian_evidence, separated_evidence
from bgmodel.tactile.source import held_out_taps, source
from bgmodel.tactile.task import SameDifferent
from circuits.anatomy import DEFAULT, load_circuit
from circuits.engines import Rates
from circuits.errors import DeadlineWarning, LearningWarning, quiet
from tests.helpers import refused, refusing
from tests.levels import MODEL, PLAYED, SEED, XI, synthetic


def test_a_run_is_scored_where_fresh_trials_know_its_level_and_nowhere_else():
    made = synthetic()
    some = LevelOutcomes(made.levels[5:20], made.correct[5:20], made.steps[5:20], made.forced[5:20])
    ends = [made.levels[4], made.levels[10], made.levels[19]]
    table = scored_runs(ends, some, xi=XI, start_level=made.levels[0], first=made)
    assert np.isnan(table.loc[0, ["regret", "reward"]].to_numpy(float)).all()
    assert table["reward"][2] == pytest.approx(some.expected(ends[2], XI))
    wanted = (table["best_reward"] - table["reward"]) / table["best_reward"].abs()
    np.testing.assert_allclose(table["regret"], wanted)
    assert table["start_regret"].eq(float(regret(made.levels[0], made, XI))).all()


def test_the_deadline_is_warned_of_where_it_decides_more_than_half_of_the_trials(recwarn):
    def outcomes(*forced):
        many = len(forced), 4
        return LevelOutcomes(np.arange(len(forced)), *np.ones((2, *many)), np.array(forced))

    check_decided(outcomes(0.5, 0.45))
    assert not recwarn
    with pytest.warns(DeadlineWarning):
        check_decided(outcomes(0.55, 0.5, 0.51))
    with pytest.raises(ValueError, match="at every level"):
        check_decided(outcomes(0.55, 0.51))


def test_outcomes_that_nothing_can_be_learned_from_are_refused():
    short, long = (separated_evidence(20, steps, 0.5, rng=1, step_ms=50) for steps in (1, 40))
    with pytest.raises(ValueError, match="deadline"):
        level_outcomes(MODEL, short, [0.95, 1.0])
    with refused("thresholds without evidence"):  # OUT at rest is ln 2
        level_outcomes(MODEL, long, [0.95, 1.0], 0.9)


def test_level_outcomes_return_the_mean_reward_between_its_levels():
    made = synthetic()
    runs = 20_000
    rngs = [stream(SEED, "mean")] * runs
    world = made.environment(XI, rngs)
    for played in (0.76, 1.2, 1.713):
        rewards = world(0, np.full(runs, played))
        assert abs(rewards.mean() - made.expected(played, XI)) < 5 * rewards.std() / np.sqrt(runs)
    assert made.best(XI)[0] == pytest.approx(1.2, abs=0.03)
    wrong = LevelOutcomes(made.levels, ~made.correct, made.steps, made.forced)
    assert wrong.rewards(XI) == pytest.approx(made.rewards(XI) - XI)


def test_the_trial_and_the_level_are_drawn_by_chances_of_their_own():
    """A level halfway between two is either, whichever trial is drawn."""
    trials, runs = 100, 20_000
    steps = np.arange(2.0 * trials).reshape(2, trials)
    made = LevelOutcomes(np.array([1.0, 1.5]), np.ones((2, trials), bool), steps, np.zeros(2))
    world = made.environment(XI, [stream(SEED, "chances")] * runs)
    row, trial = np.divmod(-world(0, np.full(runs, 1.25)), trials)
    expected = np.bincount((10 * row + trial // 10).astype(int), minlength=20)
    assert chisquare(expected).pvalue > 1e-4
    assert abs(np.corrcoef(row, trial)[0, 1]) < 4 / np.sqrt(runs)


@pytest.mark.parametrize("mean", [0.8, 0.95, 1.6])
def test_the_gradient_of_the_level_agrees_with_the_finite_difference(mean):
    """Also at 0.8, near the end of the range, where many draws are clipped."""
    made = synthetic()
    policy = GaussianPolicy(bounds=PLAYED, first_share=0.06)
    runs = 40_000
    sd = policy.sd(0)
    rng = stream(SEED, "gradient", mean)
    played, gradient = policy.sample(np.full(runs, mean), rng.standard_normal(runs), 0)
    r = made.environment(XI, [rng] * runs)(0, played)
    estimate = (r - r.mean()) * gradient
    x = np.linspace(mean - 6 * sd, mean + 6 * sd, 4001)

    def smoothed(mu):
        weights = norm.pdf(x, mu, sd)
        return (made.expected(np.clip(x, *PLAYED), XI) * weights).sum() / weights.sum()

    h = 1e-3
    exact = (smoothed(mean + h) - smoothed(mean - h)) / (2 * h)
    assert abs(exact) > 2
    assert abs(estimate.mean() - exact) < 4 * estimate.std() / np.sqrt(runs)


SHORT = Learner(episodes=6000)


@pytest.mark.parametrize("start", [0.8, 1.9])
def test_reward_finds_the_best_level_and_its_opposite_the_worst(start):
    made = synthetic()
    options = {"xi": XI, "start_level": start, "runs": 8, "seed": SEED, "name": start}
    learned = learn_level(made, learner=SHORT, **options)
    assert regret(start, made, XI) > 0.09
    assert regret(learned.learned, made, XI).max() < 0.03
    # Dopamine with the wrong sign: a rise for what was worse than expected.
    rngs = [stream(SEED, "flipped", run) for run in range(8)]
    world, told = made.environment(XI, rngs), {"rngs": rngs, "learner": SHORT}
    policy = GaussianPolicy(bounds=PLAYED)
    flipped = learn(lambda k, played: -world(k, played) - 20, start, policy=policy, **told)
    assert regret(flipped.learned, made, XI).min() > 0.09


@cache
def touched(name):
    """Return the outcomes of a circuit, each channel with its own tactile evidence."""
    table, readings = load_circuit(name), source(held_out_taps(), SameDifferent(1.5), fold=0)
    drawn = readings.draw(1500, 30, rng=stream(SEED, "tactile"), step_ms=50.0)
    gain = gain_of(table) if name == DEFAULT else MODEL.gain
    levels = playable_levels(replace(MODEL, circuit=table, gain=gain), 9)
    engine = Rates(dt_ms=0.5, sample_ms=5.0)
    return level_outcomes(replace(MODEL, circuit=table, gain=gain, engine=engine), drawn, levels)


LONG = pytest.mark.validate


@pytest.mark.parametrize(
    ("name", "start"),
    [
        ("spiking_msprt", 1.69),
        (DEFAULT, 0.75),
        pytest.param("spiking_msprt", 0.86, marks=LONG),
        pytest.param(DEFAULT, 1.1, marks=LONG),
    ],
)
def test_dopamine_learns_the_level_of_a_circuit_that_touches(name, start):
    tactile = touched(name)
    learned = learn_level(tactile, xi=XI, start_level=start, runs=3, seed=SEED, name="tactile")
    assert regret(start, tactile, XI) > 0.1
    assert regret(learned.learned, tactile, XI).max() < 0.05
    # Tonic and phasic are two quantities: one has settled, the other has not.
    late = slice(-1000, None)
    assert learned.mean_played[:, late].std(axis=1).max() < 0.1
    assert learned.prediction_error[:, late].std(axis=1).min() > 1


def test_reward_needs_the_truth(swept, level_evidence):
    with refused("truth"):
        LevelOutcomes.of(swept, Evidence(level_evidence.log_likelihood))


def short(start_level=1.0, runs=2, **options):
    learner = Learner(episodes=600)
    options |= {"xi": XI, "seed": SEED, "name": "short", "learner": learner}
    return learn_level(synthetic(10), start_level=start_level, runs=runs, **options)


test_learning_of_a_level_without_sense_is_refused = refusing(
    (lambda: synthetic(10).rewards(0.0), "xi"),
    (lambda: short(start_level=3.0), "start_level"),
    (lambda: short(start_level=np.nan), "start_level"),
    (lambda: short(runs=0), "runs"),
    (lambda: GaussianPolicy(bounds=(2.0, 1.0)), "bounds"),
    (lambda: GaussianPolicy(first_share=-1.0), "first_share"),
    (lambda: check_start(-0.01), "start_separation"),
    (lambda: check_start(8.01), "start_separation"),
)


def test_trials_and_exploration_have_streams_of_their_own(monkeypatch):
    asked = []
    monkeypatch.setattr(level, "stream", lambda *names: asked.append(names) or stream(*names))
    short(runs=3)
    assert len(asked) == len(set(asked)) == 6


def pool(errors, steps, trials, seed):
    """Outcomes of levels with these shares of errors and mean times, on paired trials."""
    rng = stream(seed, "pool")
    drawn = rng.random(trials)
    correct = drawn[None] >= np.asarray(errors)[:, None]
    times = np.asarray(steps)[:, None] + 0 * drawn
    return LevelOutcomes(1.0 + np.arange(len(errors)), correct, times, np.zeros(len(errors)))


def found_on(outcomes, fresh, start=1.0, learner=SHORT, runs=4):
    told = {"runs": runs, "seed": 3, "name": "a", "learner": learner}
    learned = learn_level(outcomes, xi=XI, start_level=start, **told)
    return CircuitLearned(MODEL, learned, outcomes, fresh, XI, start, LEVEL)


@pytest.mark.parametrize("trials", [300, 3000])
def test_what_trials_leave_open_is_the_regret_of_a_choice_between_two_levels(trials):
    """Of two levels, resampled means differ by a normal variable of known mean and variance."""
    outcomes = pool((0.01, 0.02), (3.0, 2.6), trials, 1)
    weights = resampled(trials, 2000, 2)[1:]
    rewards = outcomes.rewards(50.0)
    gap = rewards[0] - rewards[1]
    wrong = norm.cdf(-abs(gap.mean()) * np.sqrt(trials) / gap.std())
    expected = wrong * abs(gap.mean()) / abs(rewards.mean(axis=1).max())
    # Errors are few, so that their number is not quite normal.
    assert outcomes.unresolved(50.0, weights) == pytest.approx(expected, rel=0.2, abs=2e-3)


def test_regret_has_the_value_of_the_mean_over_runs_and_an_interval_about_it():
    outcomes, fresh = synthetic(11), synthetic(12)
    learned = found_on(outcomes, fresh, float(outcomes.levels[3]))
    value, low, high = learned.regrets.loc["learned"]
    assert value == pytest.approx(100 * regret(learned.learned.learned, fresh, 50.0).mean())
    assert low <= value <= high
    start = 100 * regret(outcomes.levels[3], fresh, 50.0)
    assert learned.regrets.loc["start", "value"] == pytest.approx(start)


def test_runs_that_miss_the_best_of_their_own_trials_are_the_cause_if_they_end_worse():
    errors, steps = (0.02, 0.02, 0.02, 0.02), (2.0, 3.0, 4.0, 5.0)
    outcomes = pool(errors, steps, 5000, 1)
    away = Learned(*np.full((4, 1, 9), 4.0), np.array([4.0]))
    learned = CircuitLearned(MODEL, away, outcomes, outcomes, 50.0, 1.0, LEVEL)
    worse, edge = learned.cautions
    assert "give more episodes" in worse
    assert "lower end" in edge


@pytest.mark.parametrize(
    ("steps", "edge"),
    [((2.0, 3.0, 4.0), "lower"), ((4.0, 3.0, 2.0), "upper"), ((2.2, 2.0, 2.2), "")],
)
def test_a_best_level_at_an_end_of_the_range_is_said_with_what_moves_the_range(steps, edge):
    outcomes = pool((0.02, 0.02, 0.02), steps, 2000, 1)
    assert outcomes.at_edge(50.0) == edge
    cautions = found_on(outcomes, outcomes, 2.0).cautions
    assert len(cautions) == bool(edge)
    if edge:
        assert f"{edge} end" in cautions[0]
        assert ("higher posterior" if edge == "lower" else "lower posterior") in cautions[0]


def test_an_exact_circuit_learns_the_threshold_of_the_test():
    """At the fixed point OUT is -ln P, so that both have the same outcomes at each threshold."""
    evidence = gaussian_evidence(200, d_prime=1, t_max=30, seed=1)
    model = BasalGanglia("bogacz_gurney", "algebra", 1.0)
    levels = np.linspace(0.4, 4, 25)
    outcomes = criterion_outcomes(model, evidence, levels)
    swept = tradeoff(Msprt().run(evidence), evidence, threshold_of(levels))
    np.testing.assert_array_equal(outcomes.correct, swept.choice == evidence.truth)
    np.testing.assert_array_equal(outcomes.steps, swept.time_ms / evidence.step_ms)
    told = {"what": CRITERION, "levels": levels, "runs": 3, "learner": SHORT}
    with quiet(LearningWarning):  # the trials are few
        learned = learn_in_circuit(model, evidence, evidence, **told)
    assert learned.start == levels[0]
    assert learned.regrets.loc["learned", "value"] < 5 < learned.regrets.loc["start", "value"]
    assert learned.threshold_nats == pytest.approx(np.log1p(np.exp(-learned.value)))


GAP = 5.0
EVIDENCE = gaussian_evidence(100, d_prime=1, t_max=30, seed=5)
EXACT = BasalGanglia("bogacz_gurney", "algebra", 1.0)
CRITERIA = np.linspace(0.5, 4, 7)


def learned(value, model=EXACT, what=CRITERION):
    """Return what a circuit has learned if all runs end at a value."""
    fresh = criterion_outcomes(model, EVIDENCE, CRITERIA)
    ends = Learned(*np.full((4, 2, 9), value), np.full(2, value))
    return CircuitLearned(model, ends, fresh, fresh, XI, CRITERIA[0], what)


def test_an_exact_circuit_at_the_gap_of_the_test_decides_as_the_test():
    """At the fixed point OUT is -ln P: half a gap is the log odds at which both decide."""
    told = {"engine": "algebra", "resamples": 200}
    table = decide_as_learned(learned(GAP / 2), EVIDENCE, gaps=(GAP, GAP), **told)
    wide = table.set_index(["who", "measure"])
    test = Msprt().decide(EVIDENCE, float(Msprt.threshold(GAP)))
    for who in (TEST, POPULATIONS, SPIKES):
        assert wide.loc[(who, "accuracy"), "value"] == pytest.approx(test.accuracy)
        readings = test.time_ms.mean() / EVIDENCE.step_ms
        assert wide.loc[(who, "readings"), "value"] == pytest.approx(readings)
        cost = XI * (1 - test.accuracy) + readings
        assert wide.loc[(who, "cost"), "value"] == pytest.approx(cost)
    above = wide.xs("above_test", level="measure")
    np.testing.assert_allclose(above[["value", "low", "high"]], 0, atol=1e-9)
    assert set(above.index) == {POPULATIONS, SPIKES}


def test_regret_is_what_the_best_threshold_of_the_trials_for_learning_would_have_saved():
    rewards = criterion_outcomes(EXACT, EVIDENCE, CRITERIA).rewards(XI).mean(axis=1)
    for k, wanted in enumerate(100 * (rewards / rewards.max() - 1)):
        told = {"engine": "algebra", "groups": np.arange(100) % 10}
        table = decide_as_learned(learned(CRITERIA[k]), EVIDENCE, **told)
        rows = table.set_index(["who", "measure"])
        assert TEST not in rows.index.get_level_values("who")
        value, low, high = rows.loc[(SPIKES, "regret"), ["value", "low", "high"]]
        assert value == pytest.approx(wanted)
        assert low <= value <= high


def test_a_level_of_dopamine_is_no_threshold():
    with refused("learned criterion"):
        decide_as_learned(learned(1.0, what=LEVEL), EVIDENCE, engine="algebra")

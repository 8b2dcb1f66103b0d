"""Weights learned from reward: fixed points by their closed form, laws, and bad input."""

import numpy as np
import pytest

from bgmodel.evidence import minus_log_softmax
from bgmodel.learning.critics import Trial
from bgmodel.learning.deciders import FixedPoint, WeightLearner
from bgmodel.learning.feature_sources import PoissonFeatures, tap_features
from bgmodel.learning.features import Features
from bgmodel.learning.learned_weights import LearnedWeights, counted_weights
from bgmodel.learning.weight_rules import rule_of
from bgmodel.learning.weights import learn_weights
from bgmodel.support.seeds import stream
from bgmodel.tactile.source import held_out_taps
from bgmodel.tactile.task import SameDifferent
from tests.helpers import refused, refusing

CELLS = PoissonFeatures(channels=3, units=12, centred=True, t_max=25)
EXACT = np.log(CELLS.means)
"""Exact weights: mean counts are removed, and sum to the same under all hypotheses."""
STOPPING = [
    FixedPoint(criterion=0.7),
    FixedPoint(criterion=0.95),
    FixedPoint(sampled=1),
    FixedPoint(sampled=6, drawn=True),
]


def updates(weights, decider, *, rule="confidence", trials=6000):
    """Return the update by each of many trials under fixed weights, (trials, N, units)."""
    part = CELLS.draw(trials, rng=stream(1, "updates"))
    w = np.broadcast_to(weights, (trials, *weights.shape))
    noise = stream(2, "noise").standard_normal((trials, 4))[:, :-1]
    chosen = decider.choose(part, w, noise, 0)
    heard = (np.arange(part.steps) <= chosen.last[:, None]).astype(float)
    trace = (heard[:, None] @ part.values)[:, 0]
    reward = (chosen.choice == part.truth).astype(float)
    posterior = np.exp(-minus_log_softmax(chosen.drive))
    confidence = posterior[np.arange(trials), chosen.choice]
    trial = Trial(trace, chosen.choice, posterior, confidence, reward)
    error = reward - (confidence if rule != "reinforce" else reward.mean())
    return rule_of(rule).change(w, trial, error)


def largest_z(update):
    error = update.std(axis=0) / np.sqrt(len(update))
    return np.abs(update.mean(axis=0) / error).max()


@pytest.mark.parametrize("decider", STOPPING, ids=repr)
@pytest.mark.parametrize("rule", ["confidence", "chosen"])
def test_exact_log_likelihoods_are_a_fixed_point_under_any_stopping_rule(decider, rule):
    # 36 weights: the largest of as many z scores exceeds 4 in one of 400 tests.
    assert largest_z(updates(EXACT, decider, rule=rule)) < 4


def one_of_two(p):
    """Return single readings of two units, the first with probability p under hypothesis 0."""
    rng = np.random.default_rng(4)
    truth = np.arange(4000) % 2
    first = rng.random(4000) < np.where(truth == 0, p, 1 - p)
    values = np.stack([first, ~first], axis=1).astype(float)[:, None]
    return Features(values, truth, ("0", "1"))


def test_one_reading_teaches_the_log_odds_of_its_probability():
    """For one reading of p = 0.75 the posterior that is learned has log odds ln 3."""
    learner = WeightLearner(trials=4000, rate=0.2, half_trials=400)
    one = FixedPoint(sampled=1)
    w = learn_weights(one_of_two(0.75), seed=3, learner=learner, decider=one).weights
    odds = (w[:, 0, 0] - w[:, 1, 0] + w[:, 1, 1] - w[:, 0, 1]) / 2
    error = odds.std() / np.sqrt(len(odds))
    assert abs(odds.mean() - np.log(3)) < 4 * error + 0.05  # the table's own p is not quite 0.75
    assert error < 0.1


@pytest.fixture(scope="module")
def gratings():
    return tap_features(held_out_taps(), SameDifferent(2.0))


def test_reward_teaches_nearly_the_exact_likelihoods_of_taps(gratings):
    learned = learn_weights(gratings[0], seed=11, learner=WeightLearner(trials=3000), runs=4)
    test = gratings[1].draw(2000, rng=12)
    calibration = learned.calibration(test)
    assert 0.8 < calibration.slope.mean() < 1.2
    assert calibration.r.min() > 0.95
    assert learned.relative_time(test).mean() < 1.06
    early = learned.after(60).calibration(test)
    # The mean over all kept weights of the last quarter is nearly the mean over its trials.
    assert learned.after(3000, averaged=0.25).weights == pytest.approx(learned.weights, abs=0.1)
    assert early.slope.mean() < 0.5 * calibration.slope.mean()
    course = learned.course
    assert course.correct[:, -500:].mean() > 0.9
    assert course.readings[:, :100].mean() > 3 * course.readings[:, -100:].mean()


def test_runs_do_not_depend_on_each_other():
    options = {"seed": 1, "learner": WeightLearner(trials=300)}
    few, many = (learn_weights(CELLS, runs=n, **options).weights for n in (2, 5))
    assert many[:2] == pytest.approx(few, rel=1e-9)
    assert np.ptp(many, axis=0).max() > 0.01


def test_exact_weights_are_calibrated_and_as_fast_as_exact_likelihoods():
    test = CELLS.draw(600, rng=9)
    exact = LearnedWeights(np.stack([EXACT, 2 * EXACT]), test.names)
    calibration = exact.calibration(test)
    assert calibration.slope == pytest.approx([1, 2])
    assert calibration.r == pytest.approx(1)
    assert exact.relative_time(test, 0.8)[0] == pytest.approx(1)
    assert len(exact.to_dataframe()) == 2 * 3 * 12
    points = exact.plot(test, run=1).axes[0].lines[0]
    assert points.get_ydata() == pytest.approx(2 * points.get_xdata())
    counted = counted_weights(CELLS.draw(2000, rng=10))
    assert counted.calibration(test).slope[0] == pytest.approx(1, abs=0.1)
    assert counted.relative_time(test, 0.8)[0] == pytest.approx(1, abs=0.05)


def test_counts_use_the_readings_of_many_trials_first():
    drawn = one_of_two(0.75)
    w = counted_weights(drawn, readings=1000).weights[0]
    first = drawn.values[:1000, 0]
    known = [np.log((first[drawn.truth[:1000] == i].sum(axis=0) + 0.5) / 500) for i in (0, 1)]
    assert w == pytest.approx(np.array(known))
    with refused("readings no reading belongs to"):
        counted_weights(drawn, readings=1)


def learning(**options):
    return lambda: learn_weights(CELLS, **{"seed": 1, "runs": 2} | options)


def evidence_of(units, **options):
    learned = LearnedWeights(np.zeros((1, 3, units)), tuple("012"))
    return lambda: learned.to_evidence(CELLS.draw(2, rng=1), **options)


test_options_out_of_range_are_refused = pytest.mark.filterwarnings("ignore:overflow|invalid")(
    refusing(
        (learning(rule="none"), "rule"),
        (learning(critic="none"), "critic"),
        (learning(runs=0), "runs"),
        (learning(learner=WeightLearner(rate=1e308)), "rate weights are no longer finite"),
        (lambda: WeightLearner(trials=0), "trials"),
        (lambda: WeightLearner(rate=0), "rate"),
        (lambda: WeightLearner(averaged=1.5), "averaged"),
        (lambda: WeightLearner(half_trials=0), "half_trials"),
        (lambda: WeightLearner(half_trials="long"), "half_trials"),
        (lambda: rule_of(["q"]), "rule"),
        (evidence_of(12, run="first"), "run"),
        (lambda: learning(learner=WeightLearner(trials=5))().after(6), "trials"),
        (lambda: FixedPoint(criterion=1.2), "criterion"),
        (lambda: FixedPoint(sampled=0), "sampled"),
        (lambda: LearnedWeights(np.zeros((1, 2, 3)), ("a", "b")).after(10), "trials"),
        (lambda: LearnedWeights(np.zeros((1, 3, 3)), ("a", "b")), "weights"),
        (evidence_of(3), "features"),
    )
)

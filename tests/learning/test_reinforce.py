"""Learning: rewards, the exhaustive search, the policy gradient and what it converges to."""

from dataclasses import fields

import numpy as np
import pytest
from scipy.stats import norm

from bgmodel import Sprt, first_crossing, stream, threshold_from_gap
from bgmodel.comparison.compare import Sweep
from bgmodel.decision import crossing_of_each
from bgmodel.evidence import gaussian_evidence
from bgmodel.learning.policies import BernoulliPolicy, GaussianPolicy
from bgmodel.learning.reinforce import (
    Learned,
    Learner,
    exhaustive_search,
    learn,
    smoothed,
)
from bgmodel.learning.reward import mean_reward, reward
from bgmodel.learning.worlds import trials_of
from bgmodel.theory.sprt import gaussian_pair, optimal_delta, reward_curve

D, XI, T_MAX = 1.0, 25.0, 40
# In gaussian_evidence, two unit-variance channels: d of the ratio is sqrt 2 times theirs.
SEPARATION = D / np.sqrt(2)


def draw(rng):
    return lambda trials: gaussian_evidence(trials, T_MAX, SEPARATION, rng=rng)


def test_records_of_what_is_played_name_neither_gap_nor_threshold():
    """A gap and a level of dopamine are two uses of one learner and of one sweep."""
    names = {field.name for record in (Learned, Sweep) for field in fields(record)}
    assert {"played", "mean_played", "learned", "settings"} <= names
    assert not [name for name in names if "gap" in name or "delta" in name or "thresh" in name]


def test_reward_is_the_papers():
    evidence = gaussian_evidence(200, T_MAX, SEPARATION, rng=stream(1, "reward"))
    trace = Sprt().run(evidence)
    decision = first_crossing(trace, float(threshold_from_gap(3.0)))
    wrong = decision.choice != evidence.truth
    assert reward(decision, evidence.truth, 7.0) == pytest.approx(-7.0 * wrong - decision.steps)
    free = first_crossing(trace, -1e9, forced=False)
    assert reward(free, evidence.truth, 7.0) == pytest.approx(np.full(200, -7.0 - T_MAX))


def test_exhaustive_search_finds_the_exact_curve():
    deltas = np.linspace(0, 8, 9)
    evidence = gaussian_evidence(200_000, T_MAX, SEPARATION, rng=stream(2, "search"))
    counts = exhaustive_search(evidence, deltas)
    exact = reward_curve(*gaussian_pair(D), deltas, XI, t_max=T_MAX)
    # The sd of a reward is at most xi / 2 plus that of a time bounded by t_max.
    assert np.abs(mean_reward(counts, XI) - exact).max() < 4 * (XI / 2 + T_MAX / 2) / np.sqrt(2e5)
    blocks = exhaustive_search((evidence[i : i + 7000] for i in range(0, 200_000, 7000)), deltas)
    assert (blocks.correct == counts.correct).all()
    assert (blocks.steps == counts.steps).all()


def exact_smoothed_reward(mean, sd):
    """Return the expected reward of a Gaussian policy, by quadrature over exact rewards."""
    gaps = np.linspace(0, 8, 161)
    curve = reward_curve(*gaussian_pair(D), gaps, XI, t_max=T_MAX)
    x = np.linspace(mean - 6 * sd, mean + 6 * sd, 2001)
    weights = norm.pdf(x, mean, sd)
    return (np.interp(np.clip(x, 0, 8), gaps, curve) * weights).sum() / weights.sum()


@pytest.mark.parametrize("mean", [1.0, 6.0])
def test_policy_gradient_agrees_with_the_finite_difference(mean):
    policy = GaussianPolicy(first_share=0.7 / 8)
    runs = 100_000
    rng = stream(3, "gradient", mean)
    gaps, gradient = policy.sample(policy.start(runs, mean), rng.standard_normal((runs, 1)), 0)
    evidence = draw(rng)(runs)
    decision = crossing_of_each(Sprt().run(evidence), threshold_from_gap(gaps))
    r = reward(decision, evidence.truth, XI)
    estimate = (r - r.mean()) * gradient[:, 0]
    h = 0.05
    exact = (exact_smoothed_reward(mean + h, 0.7) - exact_smoothed_reward(mean - h, 0.7)) / (2 * h)
    assert abs(exact) > 0.3
    assert abs(estimate.mean() - exact) < 4 * estimate.std() / np.sqrt(runs)


def test_bernoulli_gradient_agrees_with_the_finite_difference():
    policy = BernoulliPolicy(units=3)
    rng = stream(4, "bernoulli")
    w = np.array([0.4, -0.7, 0.2])
    runs = 200_000
    gaps, gradient = policy.sample(np.tile(w, (runs, 1)), rng.standard_normal((runs, 3)), 0)

    def expected(weights):
        total = 0.0
        for bits in np.ndindex(2, 2, 2):
            p = 1 / (1 + np.exp(-weights))
            chance = np.prod(np.where(np.array(bits) == 1, p, 1 - p))
            total += chance * np.sin(policy.sizes @ bits)
        return total

    estimate = np.sin(gaps)[:, None] * gradient
    for j in range(3):
        step = np.eye(3)[j] * 1e-5
        exact = (expected(w + step) - expected(w - step)) / 2e-5
        assert abs(estimate[:, j].mean() - exact) < 4 * estimate[:, j].std() / np.sqrt(runs)
    assert policy.sizes.sum() == pytest.approx(8)


def run_from(start, sign=1.0, policy=None, runs=4, seed=5):
    rngs = [stream(seed, "trials", start, run) for run in range(runs)]
    environment = trials_of([draw(rng) for rng in rngs], XI)
    return learn(
        lambda k, gaps: sign * environment(k, gaps),
        start,
        rngs=[stream(seed, "explore", start, run) for run in range(runs)],
        policy=policy,
        learner=Learner(episodes=6000),
    )


@pytest.mark.parametrize("start", [0.5, 7.5])
@pytest.mark.parametrize("policy", [GaussianPolicy(), BernoulliPolicy()])
def test_learning_approaches_the_exact_optimum(start, policy):
    pair = gaussian_pair(D)
    best = optimal_delta(*pair, XI, t_max=T_MAX)

    def regret(delta):
        return -reward_curve(*pair, delta, XI, t_max=T_MAX) / best.cost - 1

    learned = run_from(start, policy=policy)
    assert regret(start) > 0.12
    assert np.median(regret(learned.learned)) < 0.05
    # The control: with the sign of the reward flipped, learning must fail.
    assert np.median(regret(run_from(start, sign=-1.0, policy=policy).learned)) > 0.12


def test_a_run_does_not_depend_on_its_neighbours():
    four, two = run_from(0.5), run_from(0.5, runs=2)
    assert np.array_equal(four.played[:2], two.played)
    assert np.array_equal(four.reward[:2], two.reward)


def test_prediction_error_is_reward_minus_a_running_baseline():
    learned = run_from(7.5)
    assert np.abs(learned.prediction_error[:, -1000:].mean()) < 0.5
    assert np.corrcoef(learned.reward.ravel(), learned.prediction_error.ravel())[0, 1] > 0.9


def test_smoothed_is_a_running_mean():
    curve = np.arange(10.0)
    assert smoothed(curve, 1).tolist() == curve.tolist()
    assert smoothed(curve, 4)[[0, 1, 5]].tolist() == [0.0, 0.5, 3.5]


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: Learner(episodes=10), "episodes must be at least last"),
        (lambda: Learner(rate=-1), "rate must be > 0"),
        (lambda: smoothed(np.ones(3), 0), "window must be >= 1"),
        (lambda: exhaustive_search([], [1.0]), "at least one trial"),
        (lambda: trials_of([], xi=0.0), "xi must be > 0"),
        (
            lambda: learn(lambda k, gaps: gaps * np.nan, 1.0, rngs=[stream(1)]),
            "a reward is not finite in episode 0",
        ),
    ],
)
def test_bad_input_gets_one_clear_sentence(call, says):
    with pytest.raises(ValueError, match=says):
        call()


def test_worlds_that_switch_draw_trials_of_their_own():
    """Blocks that do not begin where a switch does: no trial comes twice."""
    world = trials_of([draw(stream(9, "switch"))], XI, block=50)
    gaps = np.array([2.0])
    first = [world(k, gaps)[0] for k in range(10, 40)]
    again = [world(k, gaps)[0] for k in range(110, 140)]
    assert first != again

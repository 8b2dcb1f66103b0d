"""Learning: the exhaustive search, policy gradients, what reward converges to, and worlds."""

import numpy as np
import pytest

from bgmodel import Evidence, stream
from bgmodel.deciding.reward import reward_of
from bgmodel.deciding.tradeoff import Tradeoff
from bgmodel.integrators.first_passage import gaussian_pair
from bgmodel.integrators.sprt_theory import optimal_separation, reward_curve
from bgmodel.learning.reinforce import (
    GaussianPolicy,
    Learner,
    LevelOutcomes,
    exhaustive_search,
    learn,
    smoothed,
    trials_of,
)
from bgmodel.simulated_evidence import separated_evidence
from tests.helpers import refused, refusing
from tests.learning.helpers import SEPARATION, T_MAX, XI, D, draw
from tests.levels import SEED


def test_exhaustive_search_finds_the_exact_curve():
    separations = np.linspace(0, 8, 9)
    evidence = separated_evidence(200_000, T_MAX, SEPARATION, rng=stream(2, "search"))
    counts = exhaustive_search(evidence, separations)
    exact = reward_curve(*gaussian_pair(D), separations, XI, t_max=T_MAX)
    # The sd of a reward is at most xi / 2 plus that of a time bounded by t_max.
    searched = reward_of(1 - counts.accuracy, counts.mean_steps, XI)
    assert np.abs(searched - exact).max() < 4 * (XI / 2 + T_MAX / 2) / np.sqrt(2e5)
    parts = (evidence[i : i + 7000] for i in range(0, 200_000, 7000))
    blocks = exhaustive_search(parts, separations)
    assert (blocks.correct == counts.correct).all()
    assert (blocks.steps == counts.steps).all()


def run_from(start, sign=1.0, runs=4, seed=5):
    rngs, explore = (
        [stream(seed, name, start, run) for run in range(runs)] for name in ("trials", "explore")
    )
    world = trials_of([draw(rng) for rng in rngs], XI)
    learner = Learner(episodes=6000)
    return learn(lambda k, gaps: sign * world(k, gaps), start, rngs=explore, learner=learner)


@pytest.mark.parametrize("start", [7.5, pytest.param(0.5, marks=pytest.mark.validate)])
def test_learning_approaches_the_exact_optimum(start):
    pair = gaussian_pair(D)
    best = optimal_separation(*pair, XI, t_max=T_MAX)

    def regret(boundary_separation):
        return -reward_curve(*pair, boundary_separation, XI, t_max=T_MAX) / best.cost - 1

    learned = run_from(start)
    assert regret(start) > 0.12
    assert np.median(regret(learned.learned)) < 0.05
    # The control: with the sign of the reward flipped, learning must fail.
    assert np.median(regret(run_from(start, sign=-1.0).learned)) > 0.12


def test_a_run_does_not_depend_on_its_neighbours():
    four, two = run_from(0.5), run_from(0.5, runs=2)
    assert np.array_equal(four.played[:2], two.played)
    assert np.array_equal(four.reward[:2], two.reward)


def three(name):
    return [stream(SEED, name, run) for run in range(3)]


TWO, LEVELS = np.ones((2, 3)), np.array([1.0, 1.1])


test_bad_input_to_learning_gets_one_clear_sentence = refusing(
    (lambda: Learner(episodes=10), "episodes must be at least last"),
    (lambda: Learner(rate=-1), "rate must be > 0"),
    (
        lambda: Learner(episodes=3000, baseline_rate=1e-5),
        "baseline_rate must be above 0.000333, or no trial is left",
    ),
    (lambda: Learner(baseline_rate=1.5), "baseline_rate at most 1"),
    (lambda: smoothed(np.ones(3), 0), "window must be >= 1"),
    (lambda: exhaustive_search([], [1.0]), "evidence at least one trial"),
    (lambda: trials_of([], xi=0.0), "xi must be > 0"),
    (lambda: LevelOutcomes(LEVELS[::-1], TWO, TWO, np.zeros(2)), "levels"),
    (lambda: LevelOutcomes(LEVELS, TWO[:1], TWO[:1], np.zeros(2)), "correct"),
    (lambda: LevelOutcomes(LEVELS, TWO, np.ones((2, 4)), np.zeros(2)), "steps"),
)


def test_a_reward_that_is_not_finite_ends_learning():
    with pytest.raises(ValueError, match="a reward is not finite in episode 40"):
        learn(lambda k, x: np.where(k == 40, np.nan, -x), 2.0, rngs=three("stopped"))


@pytest.mark.parametrize("unit", [1.0, 0.01])
def test_a_step_is_a_falling_share_of_the_error_along_the_score(unit):
    """REINFORCE (Williams 1992): rate, error, and (x - mu) / sd^2; at first it only watches.

    The error counts as a share of the baseline, of a reading where rewards are smaller than that.
    """
    policy = GaussianPolicy(bounds=(-6.0, 10.0), first_share=0.02, last_share=0.02)
    told = {"rngs": three("step"), "policy": policy, "learner": Learner(episodes=1202)}
    learned = learn(lambda k, x: -unit * (10 + (x - 3) ** 2), 2.0, **told)
    mean, sd = learned.mean_played, 0.02 * 16
    # It watches for 100 trials: the baseline takes a share of 0.01 of each reward.
    assert (mean[:, :101] == 2.0).all()
    assert (mean[:, 101] != 2.0).all()
    watched = learned.reward[:, :100].mean(axis=1)
    assert learned.prediction_error[:, 100] == pytest.approx(learned.reward[:, 100] - watched)
    for k in (100, 200, 1000, 1200):
        error = learned.prediction_error[:, k]
        share = error / np.maximum(np.abs(learned.reward[:, k] - error), 1.0)
        score = (learned.played[:, k] - mean[:, k]) / sd**2
        # The range is twice that of gaps, 8 nats: the step is four times as long.
        rate = 4 * 0.04 / (1 + k / 1000)
        assert mean[:, k + 1] - mean[:, k] == pytest.approx(rate * share * score, rel=1e-6)


@pytest.mark.parametrize("bounds", [(0.0, 8.0), (0.75, 2.0)])
def test_exploration_narrows_from_a_quarter_of_the_range_to_a_twentieth(bounds):
    """Half of the way is gone after 2000 trials."""
    policy, width = GaussianPolicy(bounds=bounds), bounds[1] - bounds[0]
    assert policy.sd(0) == pytest.approx(width / 4)
    assert policy.sd(2000) == pytest.approx((width / 4 + width / 20) / 2)
    assert policy.sd(10**12) == pytest.approx(width / 20)


def test_trials_asked_for_later_are_other_ones():
    """Blocks that do not begin where a request does: no trial comes twice."""
    world = trials_of([draw(stream(9, "switch"))], XI, block=50)
    gaps = np.array([2.0])
    first = [world(k, gaps)[0] for k in range(10, 40)]
    again = [world(k, gaps)[0] for k in range(110, 140)]
    assert first != again


def test_outcomes_are_sorted_by_level_and_count_readings_from_the_onset():
    """Two levels, three trials: times by hand; what comes before the onset takes no reading."""
    evidence = Evidence(np.zeros((3, 2, 2)), np.array([0, 1, 1]), step_ms=50.0)
    choice, time_ms = np.array([[0, 0, 1], [1, 1, 1]]), np.array([[50.0, 25, -9], [100, 75, 150]])
    late = np.array([[False] * 3, [False, False, True]])
    decisions = Tradeoff(np.array([1.4, 0.9]), choice, time_ms, late, time_ms < 0, np.ones((2, 3)))
    made = LevelOutcomes.of(decisions, evidence)
    assert made.levels.tolist() == [0.9, 1.4]
    assert made.correct.tolist() == [[False, True, True], [True, False, True]]
    assert made.steps.tolist() == [[2, 1.5, 3], [1, 0.5, 0]]
    assert made.forced == pytest.approx([1 / 3, 0])
    assert made.rewards(10.0).tolist() == [[-12, -1.5, -3], [-1, -10.5, 0]]
    assert made.best(10.0) == (1.4, pytest.approx(-11.5 / 3))
    with refused("evidence"):
        LevelOutcomes.of(decisions, evidence[:2])

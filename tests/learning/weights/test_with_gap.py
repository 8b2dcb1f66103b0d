"""Weights and gap learned together, against the exact optimum."""

import numpy as np
import pytest

from bgmodel.learning.reinforce import Learned, Learner
from bgmodel.learning.weights.feedback import WeightLearner
from bgmodel.learning.weights.learned import LearnedWeights
from bgmodel.learning.weights.sources import PoissonFeatures
from bgmodel.learning.weights.with_gap import LearnedTogether, learn_weights_and_gap
from bgmodel.theory.sprt import Empirical, optimal_separation
from tests.helpers import refused

CELLS = PoissonFeatures(channels=2, units=8, peak=2.0, centred=True, t_max=30)
XI = 25.0


def together(boundary_separation):
    gap = Learned(*(np.zeros((1, 1)) for _ in range(4)), np.array([boundary_separation]))
    return LearnedTogether(LearnedWeights(np.log(CELLS.means)[None], ("0", "1")), gap)


def test_exact_weights_at_the_optimal_gap_have_no_regret():
    """The optimal gap comes from the exact distribution of the ratio, not from these trials."""
    sample = CELLS.draw(2000, rng=1)
    ratio = sample.log_likelihood[..., 1] - sample.log_likelihood[..., 0]
    pair = [Empirical.of_sample(ratio[sample.truth == i].ravel()) for i in (0, 1)]
    best = optimal_separation(*pair, XI, t_max=30).boundary_separation
    test = CELLS.draw(8000, rng=2)
    assert 0 <= together(best).regret(test, XI)[0] < 0.02
    assert together(best + 3).regret(test, XI)[0] > 0.1


def test_no_gap_beyond_the_range_of_the_paper_has_less_cost_than_the_optimum():
    """Errors at 1e5 readings: the best gap of these trials is wider than 8 nats."""
    test = CELLS.draw(8000, rng=2)
    regret = np.array([together(gap).regret(test, 1e5)[0] for gap in (8.0, 12.0, 16.0)])
    assert (regret >= 0).all()
    assert regret[1:].min() < regret[0]


def test_a_short_course_learns_both():
    learned = learn_weights_and_gap(
        CELLS, xi=XI, start_separation=1.0, seed=1, runs=3, learner=WeightLearner(trials=1500)
    )
    assert learned.gap.mean_played.shape == (3, 1500)
    assert learned.gap.learned.min() > 1.0
    test = CELLS.draw(2000, rng=3)
    assert learned.weights.calibration(test).r.min() > 0.9
    assert learned.regret(test, XI).mean() < 0.5


def test_two_hypotheses_and_one_number_of_trials_are_required():
    with refused("episodes"):
        learn_weights_and_gap(CELLS, xi=XI, start_separation=1, seed=1, gap_learner=Learner(1000))
    with refused("source source must have 2 hypotheses"):
        learn_weights_and_gap(PoissonFeatures(), xi=XI, start_separation=1, seed=1)
    with pytest.raises(ValueError, match="xi"):
        learn_weights_and_gap(CELLS, xi=-1, start_separation=1, seed=1)

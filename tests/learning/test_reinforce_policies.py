"""Policy gradients against finite differences."""

import numpy as np
import pytest
from scipy.stats import norm

from bgmodel import Sprt, stream
from bgmodel.deciding.decision import crossing_of_each
from bgmodel.deciding.reward import reward
from bgmodel.learning.reinforce import GaussianPolicy
from bgmodel.theory.sprt import gaussian_pair, reward_curve
from tests.learning.helpers import T_MAX, XI, D, draw


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
    start = policy.start(np.full(runs, mean))
    gaps, gradient = policy.sample(start, rng.standard_normal((runs, 1)), 0)
    evidence = draw(rng)(runs)
    decision = crossing_of_each(Sprt().run(evidence), Sprt.threshold(gaps))
    r = reward(decision, evidence.truth, XI)
    estimate = (r - r.mean()) * gradient[:, 0]
    h = 0.05
    exact = (exact_smoothed_reward(mean + h, 0.7) - exact_smoothed_reward(mean - h, 0.7)) / (2 * h)
    assert abs(exact) > 0.3
    assert abs(estimate.mean() - exact) < 4 * estimate.std() / np.sqrt(runs)


@pytest.mark.parametrize("bounds", [(0.0, 8.0), (0.75, 2.0)])
def test_exploration_narrows_from_a_quarter_of_the_range_to_a_twentieth(bounds):
    """Half of the way is gone after 2000 trials."""
    policy, width = GaussianPolicy(bounds=bounds), bounds[1] - bounds[0]
    assert policy.sd(0) == pytest.approx(width / 4)
    assert policy.sd(2000) == pytest.approx((width / 4 + width / 20) / 2)
    assert policy.sd(10**12) == pytest.approx(width / 20)

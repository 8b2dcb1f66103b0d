"""The sampler on densities that are known."""

import numpy as np
import pytest

from bgmodel.fitting.identify import Directions
from bgmodel.fitting.parameters import Parameter, freedom
from bgmodel.fitting.posterior import ENOUGH, Posterior, _correlated, posterior


class Known:
    """A log likelihood in two parameters between -10 and 10, Gaussian or flat."""

    def __init__(self, information, low=-10.0):
        self.information = np.asarray(information, float)
        parameters = [Parameter(name, low, 10.0, max(low, 0.0)) for name in "ab"]
        self.freedom = freedom(parameters, {}, 1)

    def __call__(self, vector):
        inside = (vector >= self.freedom.low) & (vector <= self.freedom.high)
        return float(-vector @ self.information @ vector / 2) if inside.all() else -np.inf

    def heights(self, vectors):
        return np.array([self(vector) for vector in vectors])

    def draw(self, **options):
        return posterior(
            self, Directions(["a", "b"], self.freedom.start, self.information), **options
        )


GAUSSIAN = Known(np.linalg.inv([[1.0, 1.2], [1.2, 4.0]]))


def test_draws_from_a_gaussian_have_its_covariance():
    chain = GAUSSIAN.draw()
    assert chain.long_enough
    assert chain.lasts > ENOUGH
    # It looks at the chain every 500 steps, and stops once the chain is long enough.
    assert len(chain.draws) in {32 * 250 * looks for looks in range(1, 5)}
    error = 4 / np.sqrt(chain.effective)
    assert np.cov(chain.draws.T) == pytest.approx(np.array([[1.0, 1.2], [1.2, 4.0]]), abs=4 * error)
    assert chain.draws.std(axis=0) == pytest.approx([1, 2], rel=error)
    assert np.abs(chain.mean / [1, 2]).max() < error
    assert chain.interval(0.9)[1] == pytest.approx(1.645 * np.array([1, 2]), rel=2 * error)
    assert chain.log_density[:5] == pytest.approx([GAUSSIAN(x) for x in chain.draws[:5]])


def test_without_information_draws_fill_the_bounds_evenly():
    chain = Known(np.zeros((2, 2)), low=2.0).draw()
    assert chain.draws.min() >= 2
    assert chain.draws.max() <= 10
    error = 4 * 8 / np.sqrt(12 * chain.effective)
    assert chain.mean == pytest.approx(6, abs=error)
    assert chain.interval(0.9) == pytest.approx(np.array([[2.4, 2.4], [9.6, 9.6]]), abs=2 * error)


def test_the_same_seed_draws_the_same_and_another_one_others():
    one, same, other = (GAUSSIAN.draw(most_steps=40, seed=seed) for seed in (1, 1, 2))
    assert np.array_equal(one.draws, same.draws)
    assert not np.array_equal(one.draws, other.draws)


def test_a_short_chain_says_so_and_what_it_is_worth(caplog, capfd):
    chain = GAUSSIAN.draw(most_steps=60)
    assert not chain.long_enough
    assert 0 < chain.lasts < ENOUGH
    assert chain.effective < len(chain.draws) == 60 // 2 * 32
    # Nothing of the sampler's own warnings.
    assert caplog.text == ""
    assert capfd.readouterr() == ("", "")


def test_an_interval_holds_nine_tenths_unless_another_share_is_asked_for():
    draws = np.linspace(0, 1, 1001)[:, None] * [1.0, 10.0]
    chain = Posterior(["a", "b"], draws, draws[:, 0], 1.0, 1.0)
    assert chain.interval() == pytest.approx(np.array([[0.05, 0.5], [0.95, 9.5]]))
    assert chain.interval(0.5) == pytest.approx(np.array([[0.25, 2.5], [0.75, 7.5]]))


def test_no_chain_is_worth_more_than_its_draws():
    """Where each draw takes back the last, the autocorrelation time would be below a step."""
    rng = np.random.default_rng(6)
    noise = rng.normal(size=(400, 8, 2))
    assert _correlated(np.diff(noise, axis=0)) == 1
    slow = np.cumsum(noise, axis=0)
    assert _correlated(slow) > 10
    # The slowest parameter counts; for one that does not move there is no estimate.
    both = np.stack([noise[1:, :, 0], slow[1:, :, 0]], axis=2)
    assert _correlated(both) == pytest.approx(_correlated(slow[1:, :, :1]))
    with np.errstate(invalid="ignore"):
        assert _correlated(np.zeros((400, 8, 1))) == 400

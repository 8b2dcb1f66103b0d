"""Walks of a sample versus those of the underlying density."""

import numpy as np
import pytest
from scipy.special import ndtri

from bgmodel.theory.first_passage import _gradient_adjoint, _share, empirical_chain
from bgmodel.theory.sprt import Empirical, gaussian_pair, walk


@pytest.mark.parametrize("t_max", [None, 1, 10])
@pytest.mark.parametrize("d", [0.25, 0.5, 1.0, 2.0])
def test_quantiles_of_a_gaussian_agree_with_it(d, t_max):
    x = gaussian_pair(d)[1]
    grid = (np.arange(200_000) + 0.5) / 200_000
    sample = Empirical.of_sample(x.mean + x.sd * ndtri(grid))
    for lower, upper, start in ((-3, 3, 0), (-1, 2.5, 0.3), (0, 0, 0)):
        fine = walk(x, lower, upper, start=start, t_max=t_max)
        coarse = walk(sample, lower, upper, start=start, t_max=t_max)
        # The quantiles are a little narrower than the Gaussian, which alone costs about 1e-6.
        assert coarse.p_upper == pytest.approx(fine.p_upper, abs=4e-6)
        assert coarse.mean_steps == pytest.approx(fine.mean_steps, rel=4e-6)


def test_where_one_reading_always_decides_nothing_is_left_for_cells():
    """Light atoms need cells; none where all lie beyond a bound, however close the bounds are."""
    values = np.concatenate([np.linspace(-2, -1, 1000), np.linspace(1, 2, 1000)])
    x = Empirical.of_sample(values)
    assert not x.heavy.all()
    states = [
        len(empirical_chain(x, -bound, bound, 0.0, None, cells=64)[0]) for bound in (1e-3, 1.5)
    ]
    assert states[0] == 1
    assert states[1] > 64
    passage = walk(x, -1e-3, 1e-3)
    assert (passage.p_upper, passage.mean_steps) == pytest.approx((0.5, 1.0), abs=1e-12)


@pytest.mark.parametrize(
    ("cells", "upper", "states"), [(200, 2.0, 200), (201, 2.0, 202), (50, 29.9, 124)]
)
def test_there_are_as_many_cells_as_asked_an_even_number_and_four_to_a_standard_deviation(
    cells, upper, states
):
    # Readings with an sd of 1 in atoms too light to be followed, but for the start: one state more.
    values = ndtri((np.arange(2000) + 0.5) / 2000)
    x = Empirical.of_sample(values / values.std())
    onward = empirical_chain(x, -1.0, upper, 0.0, None, cells)[0]
    assert onward.shape == (1 + states, 1 + states)


def test_atoms_of_two_in_a_thousand_keep_their_place_and_lighter_ones_do_not():
    weights = np.array([0.0021, 0.0019, 0.996])
    assert Empirical(np.array([-1.0, 0.5, 1.0]), weights).heavy.tolist() == [True, False, True]
    # No more than the 32 heaviest.
    some = np.concatenate([np.full(32, 0.03), np.full(8, 0.005)])
    assert Empirical(np.arange(40.0), some).heavy.tolist() == [True] * 32 + [False] * 8


def test_a_place_that_is_not_followed_goes_to_two_cells_that_keep_its_mean():
    edges = np.linspace(-1.0, 3.0, 9)
    middles = (edges[1:] + edges[:-1]) / 2
    landing, weight = np.array([-0.75, -0.6, 0.0, 0.51, 2.7]), np.array([0.1, 0.2, 0.3, 0.15, 0.25])
    onward = np.zeros((5, 8))
    _share(onward, np.arange(5), landing, weight, edges)
    assert onward.sum(axis=1) == pytest.approx(weight)
    assert onward @ middles == pytest.approx(weight * landing)
    assert (np.abs(middles - landing[:, None])[onward > 0] < 0.5).all()
    # Beyond the middle of an outer cell there is only that one.
    onward = np.zeros((1, 8))
    _share(onward, np.zeros(2, int), np.array([-0.9, 2.9]), np.array([0.4, 0.6]), edges)
    assert onward[0].tolist() == [0.4, 0, 0, 0, 0, 0, 0, 0.6]


def test_an_effect_of_slopes_is_one_of_the_masses_they_are_taken_from():
    """The adjoint of numpy's gradient: one-sided at the ends, central between them."""
    rng = np.random.default_rng(4)
    masses, effect = rng.random(9), rng.normal(size=(9, 3))
    assert masses @ _gradient_adjoint(effect) == pytest.approx(np.gradient(masses) @ effect)

"""Exact walks against enumeration and identities, and those of a sample against the density."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ndtr, ndtri

from bgmodel.integrators.first_passage import (
    Empirical,
    GaussianIncrements,
    _gradient_adjoint,
    _share,
    empirical_chain,
    gaussian_pair,
    walk,
)
from bgmodel.integrators.sprt_theory import sprt
from tests.helpers import refused


def capped_sample(size=40_000, cap=1.0):
    """Likelihood ratios with a fifth exactly 0, a tenth at -cap and a fifth at cap."""
    rng = np.random.default_rng(20)
    x = np.clip(rng.normal(0.2, 1.0, size), -cap, cap)
    x[rng.random(size) < 0.2] = 0.0
    return x


def enumerate_walk(x, lower, upper, t_max):
    """Every path of a walk with few whole-numbered steps, weighed by its probability."""
    upward, pmf = 0.0, np.zeros(t_max + 1)
    for path in itertools.product(range(x.values.size), repeat=t_max):
        p, z = np.prod(x.weights[list(path)]), 0.0
        for t, step in enumerate(path, start=1):
            z += x.values[step]
            if z <= lower or z >= upper or t == t_max:
                break
        pmf[t] += p
        even = lower == z == upper or (lower < z < upper and z == 0)
        upward += p * (0.5 if even else z > lower and (z >= upper or z > 0))
    return upward, pmf


@pytest.mark.parametrize("bounds", [(-2, 2), (-1, 3), (0, 0), (0, 2), (-2.5, 1.5), (-9, 9)])
@pytest.mark.parametrize("values", [(-1.0, 0.0, 1.0), (-2.0, 1.0, 3.0)])
def test_few_atoms_are_exact(values, bounds):
    x = Empirical(np.array(values), np.array([0.3, 0.25, 0.45]))
    upward, pmf = enumerate_walk(x, *bounds, t_max=7)
    exact = walk(x, *bounds, t_max=7)
    assert exact.p_upper == pytest.approx(upward, abs=1e-13)
    assert exact.steps_pmf == pytest.approx(pmf, abs=1e-13)


def test_atoms_that_never_meet_are_shared_out():
    rng = np.random.default_rng(7)
    x = Empirical.of_sample(rng.normal(0.1, 0.6, 32))  # 32 and then 1024 places: too many
    upward, pmf = enumerate_walk(x, -0.7, 0.9, t_max=3)
    exact = walk(x, -0.7, 0.9, t_max=3)
    assert exact.p_upper == pytest.approx(upward, abs=1e-3)
    assert exact.steps_pmf == pytest.approx(pmf, abs=2e-4)


def test_bounds_off_by_rounding_are_still_met():
    """Three steps of 0.1 are 0.30000000000000004 and still meet a bound of 0.3."""
    x = Empirical(np.array([-0.1, 0.1]), np.array([0.4, 0.6]))
    odds = 0.4 / 0.6  # gambler's ruin, Feller (1968) XIV.2: 3 steps either way
    ruin = walk(x, -0.3, 0.3)
    assert ruin.p_lower == pytest.approx((odds**3 - odds**6) / (1 - odds**6), abs=1e-12)
    assert ruin.mean_steps == pytest.approx(3 * (ruin.p_upper - ruin.p_lower) / 0.2, abs=1e-10)


@pytest.mark.parametrize("bounds", [(-2.0, 2.0), (-0.55, 0.55), (-3.0, 3.0), (-1.0, 2.7)])
def test_refining_the_cells_converges(bounds):
    x = Empirical.of_sample(capped_sample())
    finest = walk(x, *bounds, t_max=50, cells=2048)
    gaps = []
    for cells in (16, 64, 256):
        rough = walk(x, *bounds, t_max=50, cells=cells)
        steps = rough.mean_steps / finest.mean_steps - 1
        gaps.append(np.hypot(rough.p_upper - finest.p_upper, steps))
    assert gaps[0] > 3 * gaps[2]
    assert gaps[1] < 1e-3
    assert gaps[2] < 1.5e-4


@pytest.mark.parametrize("t_max", [None, 6])
def test_the_mirrored_walk_swaps_the_responses(t_max):
    x = gaussian_pair(0.7)[1]
    y = capped_sample(4000)
    pairs = [
        (x, GaussianIncrements(-x.mean, x.sd)),
        (Empirical.of_sample(y), Empirical.of_sample(-y)),
    ]
    for there, back in pairs:
        one = walk(there, -1.2, 2.1, start=0.4, t_max=t_max)
        other = walk(back, -2.1, 1.2, start=-0.4, t_max=t_max)
        assert one.p_upper == pytest.approx(other.p_lower, abs=1e-9)
        assert one.mean_steps == pytest.approx(other.mean_steps, rel=1e-9)
        assert one.p_upper != pytest.approx(other.p_upper, abs=0.1)


@pytest.mark.parametrize("factor", [0.05, 20.0])
@pytest.mark.parametrize(("lower", "upper"), [(-500.0, 500.0), (-1.5, 500.0), (-2.0, 3.0)])
def test_a_walk_knows_no_unit(lower, upper, factor):
    """All in units of the sd: readings, bounds and start may be multiplied by one factor."""
    for mean in (0.3, -1.2):
        passage = walk(GaussianIncrements(mean, 0.9), lower, upper, start=0.4, t_max=12)
        scaled = GaussianIncrements(factor * mean, factor * 0.9)
        bounds = factor * lower, factor * upper
        other = walk(scaled, *bounds, start=factor * 0.4, t_max=12)
        assert other.p_upper == pytest.approx(passage.p_upper, abs=1e-11)
        assert other.steps_pmf == pytest.approx(passage.steps_pmf, abs=1e-11)


@pytest.mark.parametrize("sd", [0.2, 1.3])
@pytest.mark.parametrize("mean", [1.0, -1.0])
def test_far_from_all_bounds_the_deadline_asks_for_the_sign_of_a_gaussian_sum(mean, sd):
    """Z_t is N(start + t mean, t sd^2), closed form; no reading brings it to a bound."""
    for t_max in (1, 2, 5, 40):
        end = walk(GaussianIncrements(mean, sd), -180.0, 180.0, start=-0.6 * mean, t_max=t_max)
        wanted = ndtr(mean * (t_max - 0.6) / (sd * np.sqrt(t_max)))
        assert end.p_upper == pytest.approx(wanted, abs=1e-11)
        assert end.p_forced == pytest.approx(1, abs=1e-11)
        assert end.steps_pmf[:-1] == pytest.approx(0, abs=1e-11)


def test_only_a_start_strictly_beyond_a_bound_takes_no_reading():
    for x in (gaussian_pair(1.0)[1], Empirical(np.array([-1.0, 1.0]), np.array([0.2, 0.8]))):
        for start, upper, pmf in ((1.01, 1.0, [1, 0, 0]), (-1.01, 0.0, [1, 0, 0])):
            end = walk(x, -1, 1, start=start, t_max=2)
            assert (end.p_upper, end.p_lower, end.mean_steps) == (upper, 1 - upper, 0)
            assert end.steps_pmf.tolist() == pmf
        assert walk(x, -1, 1, start=1.0, t_max=2).steps_pmf[0] == 0
    assert sprt(*gaussian_pair(1.0), 1.0, prior_s2=0.7) == (pytest.approx(0.3), 0)
    assert sprt(*gaussian_pair(1.0), 2.0, prior_s2=0.7).mean_steps > 1


def test_a_walk_that_never_moves_needs_bounds_that_are_one_or_a_deadline():
    still = Empirical.of_sample([0.0])
    end = walk(still, 0.0, 0.0)
    assert (end.p_upper, end.p_lower, end.p_forced, end.mean_steps) == (0.5, 0.5, 0.0, 1.0)
    late = walk(still, -1.0, 1.0, t_max=3)
    assert (late.p_upper, late.p_forced, late.mean_steps) == (0.5, 1.0, 3.0)
    with refused("increments"):
        walk(still, -1.0, 1.0)


values = st.lists(st.floats(-3, 3), min_size=1, max_size=40)
gaussians = st.builds(GaussianIncrements, st.floats(-2, 2), st.floats(0.05, 3))
empiricals = values.map(Empirical.of_sample)


@settings(max_examples=150)
@given(
    x=st.one_of(gaussians, empiricals),
    lower=st.floats(-3, 2),
    width=st.floats(0, 5),
    start=st.floats(-3, 3),
    t_max=st.integers(1, 25),
)
def test_probabilities_add_up(x, lower, width, start, t_max):
    end = walk(x, lower, lower + width, start=start, t_max=t_max)
    assert end.p_upper + end.p_lower == pytest.approx(1, abs=1e-9)
    assert end.steps_pmf.sum() == pytest.approx(1, abs=1e-9)
    assert end.steps_pmf.shape == (t_max + 1,)
    assert end.steps_pmf.min() > -1e-6
    assert -1e-9 <= end.p_forced <= end.steps_pmf[-1] + 1e-6
    assert 0 <= end.mean_steps <= t_max + 1e-9
    assert min(end.p_upper, end.p_lower) > -1e-6


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

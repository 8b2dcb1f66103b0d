"""The exact sequential test against tables, enumeration, identities and simulation."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit
from scipy.special import ndtr, ndtri

from bgmodel.theory.sprt import (
    Empirical,
    Gaussian,
    gaussian_pair,
    optimal_delta,
    optimal_threshold,
    reward_curve,
    siegmund,
    sprt,
    wald,
    walk,
)

TRIALS = 1_000_000
Z_LIMIT = 4.0  # about 200 z-values below: one beyond 4 is expected once in 80 sets of seeds
NEVER = 1 << 30

# d, theta: exact ER and E[T], then Wald's and Siegmund's, as printed.
TABLE = [
    (0.25, 3, (".04127", "92.608"), (".04743", "86.894"), (".04126", "92.354")),
    (0.5, 1, (".21582", "6.124"), (".26894", "3.697"), (".21563", "5.875")),
    (1, 1, (".16916", "2.373"), (".26894", "0.924"), (".17043", "2.086")),
    (1, 3, (".02714", "7.046"), (".04743", "5.431"), (".02705", "6.778")),
    (2, 3, (".01582", "2.294"), (".04743", "1.358"), (".01529", "2.019")),
]
SETTINGS = [(d, theta) for d, theta, *_ in TABLE]


def as_printed(test, printed):
    error, steps = printed
    return f"{test.error_rate:.5f}" == f"0{error}" and f"{test.mean_steps:.3f}" == steps


@pytest.mark.parametrize(("d", "theta", "exact", "by_wald", "by_siegmund"), TABLE)
def test_tabulated_values_to_every_digit(d, theta, exact, by_wald, by_siegmund):
    assert as_printed(sprt(*gaussian_pair(d), 2 * theta), exact)
    assert as_printed(wald(d, theta), by_wald)
    assert as_printed(siegmund(d, theta), by_siegmund)


@pytest.mark.parametrize(("d", "theta"), SETTINGS)
def test_wald_misses_the_overshoot_and_siegmund_most_of_it(d, theta):
    """Negative control: raw Wald is off by the shift of the bounds, far beyond our accuracy."""
    exact = sprt(*gaussian_pair(d), 2 * theta)
    rough, corrected = wald(d, theta), siegmund(d, theta)
    # log odds of an error: theta for Wald, theta + 0.5826 d for the discrete test.
    gap = np.log(1 / exact.error_rate - 1) - theta
    assert gap == pytest.approx(0.5826 * d, rel=0.04)
    assert rough.error_rate - exact.error_rate > 0.005
    assert abs(corrected.error_rate - exact.error_rate) < 0.1 * abs(
        rough.error_rate - exact.error_rate
    )
    assert rough.mean_steps < corrected.mean_steps < exact.mean_steps


@pytest.mark.parametrize(
    ("d", "xi", "theta"), [(0.5, 50, 1.051), (1, 50, 2.372), (1, 200, 3.931), (1.5, 50, 3.018)]
)
def test_optimal_threshold(d, xi, theta):
    best = optimal_delta(*gaussian_pair(d), xi, t_max=None, bounds=(0, 10))
    assert best.delta / 2 == pytest.approx(theta, abs=6e-4)
    assert optimal_threshold(d, xi) == pytest.approx(theta, abs=0.012)
    at_closed_form = -reward_curve(*gaussian_pair(d), 2 * optimal_threshold(d, xi), xi)
    assert 0 <= at_closed_form - best.cost < 1e-3


def test_one_reading_is_optimal_where_errors_are_cheap():
    assert optimal_delta(*gaussian_pair(0.5), 10, t_max=None).delta == 0
    assert optimal_threshold(0.5, [8, 10, 50]) == pytest.approx([0, 0.0187, 1.0508], abs=1e-4)


def test_optimal_threshold_solves_its_equation():
    d, xi = np.meshgrid([0.1, 0.5, 1.0, 2.0], [50.0, 1e3, 1e6])
    theta = optimal_threshold(d, xi) + 0.5825971579 * d
    expected = xi * d**2 / 4
    inner = optimal_threshold(d, xi) > 0
    assert inner.sum() > 8
    assert (np.sinh(theta) + theta)[inner] == pytest.approx(expected[inner], rel=1e-8)


@pytest.mark.parametrize(
    ("c", "theta", "error", "steps", "reward"),
    [
        (0.005, 3.230, 0.0262, 15.69, -0.1046),
        (0.01, 2.425, 0.0567, 11.49, -0.1715),
        (0.02, 1.597, 0.1209, 7.03, -0.2616),
        (0.05, 0.630, 0.2637, 2.44, -0.3858),
    ],
)
def test_lepora_2016(c, theta, error, steps, reward):
    """Readings N(+-1/3, 1), an error costs 1 and a reading c."""
    pair = gaussian_pair(2 / 3)
    best = optimal_delta(*pair, 1 / c, t_max=None)
    test = sprt(*pair, 2 * theta)
    assert best.delta / 2 == pytest.approx(theta, abs=6e-4)
    assert test.error_rate == pytest.approx(error, abs=5.1e-5)
    assert test.mean_steps == pytest.approx(steps, abs=5.1e-3)
    assert -c * best.cost == pytest.approx(reward, abs=5.1e-5)


@njit
def simulate(rng, draw, x, lower, upper, start, t_max, trials):
    steps, upward, forced = np.zeros(trials), 0, 0
    for i in range(trials):
        z, t = start, 0
        while True:
            z += draw(rng, x)
            t += 1
            if z <= lower or z >= upper or t == t_max:
                if (z <= lower and z >= upper) or (lower < z < upper and z == 0):
                    upward += rng.random() < 0.5
                else:
                    upward += z >= upper or (z > lower and z > 0)
                forced += lower < z < upper
                break
        steps[i] = t
    return steps, upward, forced


@njit
def draw_gaussian(rng, x):
    return x[0] + x[1] * rng.standard_normal()


@njit
def draw_sample(rng, x):
    return x[int(rng.random() * x.size)]


def assert_agrees(exact, simulated):
    """Every |z| below 4: P(upper), P(forced), E[T] and, with a deadline, each P(T = t)."""
    steps, upward, forced = simulated
    counts = [(upward, exact.p_upper), (forced, exact.p_forced)]
    if exact.steps_pmf is not None:
        seen = np.bincount(steps.astype(int), minlength=exact.steps_pmf.size)
        counts += zip(seen, exact.steps_pmf, strict=True)
    for count, p in counts:
        if min(p, 1 - p) * steps.size > 25:  # else a normal z means little
            assert abs(count - p * steps.size) < Z_LIMIT * np.sqrt(steps.size * p * (1 - p))
        else:
            assert min(count, steps.size - count) < 80
    error = steps.std() / np.sqrt(steps.size)
    assert abs(steps.mean() - exact.mean_steps) <= Z_LIMIT * error + 1e-9


CASES = [
    *[(d, -theta, theta, 0.0, None) for d, theta in SETTINGS[1:]],
    *[(d, -theta, theta, 0.0, t_max) for d, theta in SETTINGS for t_max in (1, 4, 20)],
    (0.5, -1.0, 2.5, 0.3, None),
    (0.5, -1.0, 2.5, 0.3, 7),
    (1.0, 0.2, 2.0, 1.0, 5),  # 0 lies below both bounds: forced responses are all R2
    (1.0, -1.0, 1.0, 1.0, 5),  # a start on a bound reads once more
    (1.0, 0.0, 0.0, 0.0, 3),
]


@pytest.mark.parametrize("case", range(len(CASES)))
def test_gaussian_walk_against_simulation(case):
    d, lower, upper, start, t_max = CASES[case]
    x = gaussian_pair(d)[case % 2]
    exact = walk(x, lower, upper, start=start, t_max=t_max)
    rng, limit = np.random.default_rng(100 + case), t_max or NEVER
    moments = np.array([x.mean, x.sd])
    args = (moments, lower, upper, start, limit, TRIALS)
    assert_agrees(exact, simulate(rng, draw_gaussian, *args))


def capped_sample(size=40_000, cap=1.0):
    """Likelihood ratios with a fifth exactly 0, a tenth at -cap and a fifth at cap."""
    rng = np.random.default_rng(20)
    x = np.clip(rng.normal(0.2, 1.0, size), -cap, cap)
    x[rng.random(size) < 0.2] = 0.0
    return x


SAMPLE_CASES = [
    (-2.0, 2.0, 0.0, None),  # two caps meet a bound exactly
    (-2.0, 2.0, 0.0, 6),
    (-0.5, 0.5, 0.0, 50),
    (-1.0, 1.0, 0.0, 1),  # one cap meets it, and Z = 0 is a tie
    (-1.0, 1.0, 0.0, 2),
    (-3.0, 3.0, 0.0, 2),  # no bound in reach
    (-1.0, 2.5, 0.37, None),
    (-1.0, 2.5, 0.37, 8),
    (-1.4, 1.6, 0.6, 5),  # the start and one cap meet each bound
    (0.0, 0.0, 0.0, 5),
]


@pytest.mark.parametrize("case", range(len(SAMPLE_CASES)))
def test_empirical_walk_against_simulation(case):
    lower, upper, start, t_max = SAMPLE_CASES[case]
    x = capped_sample()
    exact = walk(Empirical.of_sample(x), lower, upper, start=start, t_max=t_max)
    rng, limit = np.random.default_rng(300 + case), t_max or NEVER
    args = (x, lower, upper, start, limit, TRIALS)
    assert_agrees(exact, simulate(rng, draw_sample, *args))


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


@pytest.mark.parametrize(
    "x", [Gaussian(0.2, 0.9), Empirical.of_sample(ndtri(np.arange(1, 999) / 999))]
)
def test_bounds_out_of_reach_cost_nothing(x):
    far, near = walk(x, -1e6, 1e6, t_max=4), walk(x, -14.0, 14.0, t_max=4)
    assert far.p_forced == pytest.approx(1, abs=1e-9)
    assert far.p_upper == pytest.approx(near.p_upper, abs=1e-5)


def test_bounds_off_by_rounding_are_still_met():
    """Three steps of 0.1 are 0.30000000000000004 and still meet a bound of 0.3."""
    x = Empirical(np.array([-0.1, 0.1]), np.array([0.4, 0.6]))
    odds = 0.4 / 0.6  # gambler's ruin, Feller (1968) XIV.2: 3 steps either way
    ruin = walk(x, -0.3, 0.3)
    assert ruin.p_lower == pytest.approx((odds**3 - odds**6) / (1 - odds**6), abs=1e-12)
    assert ruin.mean_steps == pytest.approx(3 * (ruin.p_upper - ruin.p_lower) / 0.2, abs=1e-10)


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
        (x, Gaussian(-x.mean, x.sd)),
        (Empirical.of_sample(y), Empirical.of_sample(-y)),
    ]
    for there, back in pairs:
        one = walk(there, -1.2, 2.1, start=0.4, t_max=t_max)
        other = walk(back, -2.1, 1.2, start=-0.4, t_max=t_max)
        assert one.p_upper == pytest.approx(other.p_lower, abs=1e-9)
        assert one.mean_steps == pytest.approx(other.mean_steps, rel=1e-9)
        assert one.p_upper != pytest.approx(other.p_upper, abs=0.1)


def test_swapping_the_states_leaves_the_symmetric_test():
    s1, s2 = gaussian_pair(0.8)
    even = sprt(s1, s2, [0.5, 3.0], t_max=9)
    swapped = sprt(Gaussian(-s2.mean, s2.sd), Gaussian(-s1.mean, s1.sd), [0.5, 3.0], t_max=9)
    assert even.error_rate == pytest.approx(swapped.error_rate, abs=1e-12)
    tilted = sprt(s1, s2, [0.5, 3.0], prior_s2=0.7, t_max=9)
    other = sprt(s1, s2, [0.5, 3.0], prior_s2=0.3, t_max=9)
    assert tilted.error_rate == pytest.approx(other.error_rate, abs=1e-12)
    assert tilted.mean_steps == pytest.approx(other.mean_steps, abs=1e-9)
    assert np.all(tilted.error_rate < even.error_rate)  # a prior is worth something


def likelihood_ratio_pair(values, p):
    """Atoms x under S2 with probabilities p, and under S1 with p exp(-x), both made to sum to 1."""
    s1 = p * np.exp(-values)
    return Empirical(values, s1 / s1.sum()), Empirical(values, p)


@pytest.mark.parametrize("steps", [1, 2, 5])
@pytest.mark.parametrize("stay", [0.0, 0.4])
def test_wald_is_exact_without_overshoot(steps, stay):
    """Readings worth -c, 0 or c that meet the bounds: ER = 1 / (1 + e^theta), m E[T] = E[Z_T]."""
    c = 0.37
    up = (1 - stay) / (1 + np.exp(-c))
    s1, s2 = likelihood_ratio_pair(np.array([-c, 0, c]), np.array([1 - stay - up, stay, up]))
    test = sprt(s1, s2, 2 * steps * c)
    assert test.error_rate == pytest.approx(1 / (1 + np.exp(steps * c)), rel=1e-11)
    mean = s2.weights @ s2.values
    expected = steps * c * (1 - 2 * test.error_rate) / mean
    assert test.mean_steps == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize("theta", [0.5, 1.0, 3.0])
@pytest.mark.parametrize("d", [0.3, 1.0])
def test_likelihood_ratio_identity_bounds_the_errors(d, theta):
    """P1(R2) = E2[exp(-Z_T); R2] with theta <= Z_T < theta + the largest possible overshoot."""
    s1, s2 = gaussian_pair(d)
    ratio = walk(s1, -theta, theta).p_upper / walk(s2, -theta, theta).p_upper
    assert theta + 0.5 * d < -np.log(ratio) < theta + 0.7 * d
    cap = d
    grid = np.clip(s2.mean + d * ndtri((np.arange(5000) + 0.5) / 5000), -cap, cap)
    weights = np.full(grid.size, 1 / grid.size)
    shift = np.log(weights @ np.exp(-grid))  # makes the capped values true likelihood ratios
    capped = likelihood_ratio_pair(grid + shift, weights)
    ratio = walk(capped[0], -theta, theta).p_upper / walk(capped[1], -theta, theta).p_upper
    assert theta < -np.log(ratio) < theta + cap + shift


@pytest.mark.parametrize("lower_upper", [(-1.5, 1.5), (-0.3, 2.0)])
def test_a_late_deadline_is_none(lower_upper):
    for x in (gaussian_pair(0.6)[1], Empirical.of_sample(capped_sample(5000))):
        late, never = walk(x, *lower_upper, t_max=600), walk(x, *lower_upper)
        assert late.p_upper == pytest.approx(never.p_upper, abs=1e-10)
        assert late.mean_steps == pytest.approx(never.mean_steps, rel=1e-9)
        assert late.p_forced < 1e-10 < walk(x, *lower_upper, t_max=3).p_forced


def test_no_reading_only_strictly_beyond_a_bound():
    for x in (gaussian_pair(1.0)[1], Empirical(np.array([-1.0, 1.0]), np.array([0.2, 0.8]))):
        for start, upper, pmf in ((1.01, 1.0, [1, 0, 0]), (-1.01, 0.0, [1, 0, 0])):
            end = walk(x, -1, 1, start=start, t_max=2)
            assert (end.p_upper, end.p_lower, end.mean_steps) == (upper, 1 - upper, 0)
            assert end.steps_pmf.tolist() == pmf
        assert walk(x, -1, 1, start=1.0, t_max=2).steps_pmf[0] == 0
    assert sprt(*gaussian_pair(1.0), 1.0, prior_s2=0.7) == (pytest.approx(0.3), 0)
    assert sprt(*gaussian_pair(1.0), 2.0, prior_s2=0.7).mean_steps > 1


def test_delta_zero_takes_the_sign_of_one_reading():
    d = np.array([0.4, 1.0, 2.0])
    for separation in d:
        test = sprt(*gaussian_pair(separation), 0.0)
        assert test.error_rate == pytest.approx(ndtr(-separation / 2), abs=1e-13)
        assert test.mean_steps == pytest.approx(1.0, abs=1e-13)
    tied = Empirical(np.array([-1.0, 0.0, 1.0]), np.array([0.2, 0.5, 0.3]))
    assert walk(tied, 0, 0).p_lower == pytest.approx(0.2 + 0.5 / 2)  # a tie goes to each by half
    assert walk(tied, -5, 5, t_max=1).p_lower == pytest.approx(0.2 + 0.5 / 2)


def test_reward_curve_and_its_best_threshold():
    pair = gaussian_pair(0.6)
    deltas = np.linspace(0, 8, 81)
    reward = reward_curve(*pair, deltas, 40, t_max=30)
    assert reward.shape == (81,)
    test = sprt(*pair, deltas[7], t_max=30)
    assert reward[7] == pytest.approx(-40 * test.error_rate - test.mean_steps, rel=1e-12)
    best = optimal_delta(*pair, 40, t_max=30)
    assert abs(best.delta - deltas[np.argmax(reward)]) <= 0.1
    assert 0 <= -best.cost - reward.max() < 1e-2
    assert optimal_delta(*pair, 40, t_max=30, bounds=(5, 8)).delta == pytest.approx(5, abs=1e-4)


values = st.lists(st.floats(-3, 3), min_size=1, max_size=40)
gaussians = st.builds(Gaussian, st.floats(-2, 2), st.floats(0.05, 3))
empiricals = values.map(Empirical.of_sample)


@settings(max_examples=150, deadline=None, derandomize=True)
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


G = Gaussian(0.1, 1.0)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Gaussian(0.0, 0.0), "sd .* got 0.0"),
        (lambda: Gaussian(np.nan, 1.0), "mean .* got nan"),
        (lambda: gaussian_pair(-1.0), "d .* got -1.0"),
        (lambda: Empirical.of_sample([]), "values"),
        (lambda: Empirical.of_sample([1.0, np.inf]), "values .* finite"),
        (lambda: Empirical(np.ones(2), np.ones(2)), "sum of weights must be 1, got 2"),
        (lambda: Empirical(np.ones(2), np.array([1.5, -0.5])), "weights .* at least 0"),
        (lambda: Empirical(np.ones(2), np.ones(1)), "weights .* shape"),
        (lambda: walk(G, 1.0, -1.0), "lower must be at most upper = -1.0, got 1.0"),
        (lambda: walk(G, -1.0, np.inf), "upper must be finite, got inf"),
        (lambda: walk(G, -1.0, 1.0, start=np.nan), "start"),
        (lambda: walk(G, -1.0, 1.0, t_max=0), "t_max .* at least 1, got 0"),
        (lambda: walk(G, -1.0, 1.0, t_max=2.5), "t_max"),
        (lambda: walk(G, -1.0, 1.0, cells=2), "cells"),
        (lambda: walk(G, -1e5, 1e5), "lower and upper must be closer"),
        (lambda: walk(Empirical.of_sample([0.0]), -1.0, 1.0), "increments"),
        (lambda: sprt(G, G, [1.0, -0.1]), "delta"),
        (lambda: sprt(G, G, 1.0, prior_s2=1.0), "prior_s2"),
        (lambda: wald(0.0, 1.0), "d must be"),
        (lambda: siegmund(1.0, -0.2), "theta .* got -0.2"),
        (lambda: optimal_threshold(1.0, 0.0), "xi .* got 0.0"),
        (lambda: optimal_delta(G, G, -2.0, t_max=5), "xi .* got -2.0"),
        (lambda: optimal_delta(G, G, 2.0, t_max=5, bounds=(3.0, 1.0)), "bounds"),
    ],
)
def test_errors_name_the_argument(call, message):
    with pytest.raises(ValueError, match=message):
        call()

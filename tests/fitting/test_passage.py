"""Times of decision against closed forms, scaling, and PyDDM."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bgmodel.fitting import passage
from bgmodel.fitting.algorithms import EXPONENTIAL
from tests.closed_forms import accuracy, mean_time_s, sd_time_s
from tests.drawn import with_drift

DRIFT = st.floats(-6.0, 6.0)
BOUND = st.floats(0.2, 1.5)


def exponential(bound, fall_s, time_s):
    return EXPONENTIAL.at(bound, {"fall_per_s": 1 / fall_s}, time_s)


def moments(drift, bound):
    times = np.linspace(0.0, 18 * bound**2, 6001)[1:]
    mass = from_start(bound, 0.0, drift, times)
    mean = mass.sum(axis=0) @ times
    sd = np.sqrt(mass.sum(axis=0) @ times**2 - mean**2)
    return mass.sum(), mass[int(drift >= 0)].sum(), mean, sd


@given(DRIFT, BOUND)
@settings(max_examples=40)
def test_densities_of_a_constant_bound_integrate_to_the_closed_forms(drift, bound):
    mass, right, mean, sd = moments(drift, bound)
    assert mass == pytest.approx(1, abs=1e-6)
    assert right == pytest.approx(float(accuracy(drift, bound)), abs=1e-6)
    assert mean == pytest.approx(float(mean_time_s(drift, bound)), abs=1e-5 * bound**2)
    assert sd == pytest.approx(float(sd_time_s(drift, bound)), abs=1e-4 * bound**2)


@given(BOUND)
def test_closed_forms_go_over_smoothly_to_those_without_drift(bound):
    drifts = np.array([0.0, 1e-7, 1e-5, 0.0199 / bound, 0.0201 / bound])
    assert accuracy(drifts[:2], bound) == pytest.approx([0.5, 0.5], abs=1e-6)
    assert mean_time_s(drifts, bound) == pytest.approx(bound**2, rel=2e-4)
    assert sd_time_s(drifts, bound) == pytest.approx(np.sqrt(2 / 3) * bound**2, rel=4e-4)
    near, far = sd_time_s(drifts[3:], bound)
    assert near == pytest.approx(far, rel=1e-5)


@pytest.mark.parametrize(
    ("bound", "share", "far", "close"),
    [(0.4, 0.0, 1e-3, 1e-6), (0.7, 0.0, 1e-3, 1e-6), (1.5, 0.0, 1e-3, 1e-6),
     (0.7, -0.6, 0.05, 5e-3), (0.7, 0.3, 0.05, 5e-3), (0.7, 0.8, 0.05, 5e-3)],
)  # fmt: skip
def test_a_bound_that_does_not_fall_has_the_density_of_a_constant_one(bound, share, far, close):
    """From any start; the first times after one near a bound are steep."""
    times = np.arange(1, 1000) * 0.0025
    exact = passage.constant_at_rest(bound, times, share * bound)[:, 20:]
    falling, wrong = (
        passage.falling_at_rest(b + 0 * times, 0 * times, times, start=share * bound)[:, 20:]
        for b in (bound, bound + max(far, 0.01 * bound))
    )
    assert falling == pytest.approx(exact, abs=close)
    assert np.abs(wrong - exact).max() > far


@given(BOUND, st.floats(0.2, 3.0), st.floats(0.5, 2.0))
@settings(max_examples=15)
def test_time_scales_with_the_square_of_evidence(bound, fall_s, scale):
    times = np.arange(1, 400) * 0.005 * bound**2
    unscaled = passage.falling_at_rest(*exponential(bound, fall_s, times), times)
    far = exponential(scale * bound, scale**2 * fall_s, scale**2 * times)
    wide = passage.falling_at_rest(*far, scale**2 * times)
    assert scale**2 * wide == pytest.approx(unscaled, rel=1e-9, abs=1e-12)


@given(st.lists(DRIFT, min_size=1, max_size=4), st.floats(0.4, 1.2), st.floats(0.3, 2.0))
@settings(max_examples=30)
def test_at_the_bound_the_responses_stand_as_the_likelihood_ratio_says(drifts, bound, fall_s):
    times = np.arange(1, 200) * 0.01
    gap, slope = exponential(bound, fall_s, times)
    at_rest = passage.falling_at_rest(gap, slope, times)
    drift = np.array(drifts)
    density = with_drift(at_rest, gap, times, drift)
    some = density[:, 0] > 1e-200
    odds = np.exp(2 * drift[:, None] * gap)
    assert density[:, 1][some] == pytest.approx((density[:, 0] * odds)[some], rel=1e-9)
    assert density[:, ::-1] == pytest.approx(with_drift(at_rest, gap, times, -drift), rel=1e-12)


START = st.floats(-0.85, 0.85)


def from_start(bound, start, drift, times):
    at_rest = passage.constant_at_rest(bound, times, start)
    (density,) = with_drift(at_rest, np.full(len(times), bound), times, [drift], start)
    return density * (times[1] - times[0])


@given(st.floats(-4.0, 4.0), st.floats(0.3, 1.2), START)
@settings(max_examples=40)
def test_from_any_start_choices_and_mean_times_are_the_closed_forms(drift, bound, share):
    """P(1) = (1 - e^(-2 v (A + z))) / (1 - e^(-4 v A)); E[T] = (E[X] - z) / v."""
    z = share * bound
    times = np.linspace(0.0, 18 * bound**2, 12_001)[1:]
    mass = from_start(bound, z, drift, times)
    if abs(drift * bound) < 1e-3:
        right, mean = (bound + z) / (2 * bound), bound**2 - z**2
    else:
        right = np.expm1(-2 * drift * (bound + z)) / np.expm1(-4 * drift * bound)
        mean = ((2 * right - 1) * bound - z) / drift
    assert mass.sum() == pytest.approx(1, abs=2e-3)
    assert mass[1].sum() == pytest.approx(right, abs=2e-3)
    assert mass.sum(axis=0) @ times == pytest.approx(mean, abs=3e-3 * bound**2)


@given(st.floats(0.4, 1.2), START, st.floats(-3.0, 3.0))
@settings(max_examples=20)
def test_a_start_and_a_drift_of_the_other_sign_exchange_the_responses(bound, share, drift):
    times = np.arange(1, 400) * 0.005
    gap, slope = exponential(bound, 0.7, times)
    falling, fixed = [], []
    for sign in (1, -1):
        z = sign * share * bound
        at_rest = passage.falling_at_rest(gap, slope, times, start=z)
        falling.append(with_drift(at_rest, gap, times, [sign * drift], z)[0])
        fixed.append(from_start(bound, z, sign * drift, times))
    for one, other in (falling, fixed):
        assert one == pytest.approx(other[::-1], rel=1e-9, abs=1e-9)


def of_pyddm(bound, fall_s, drift, dt):
    """Return both masses and the mean time that PyDDM finds at a step."""
    from pyddm import Model, models

    falling = models.BoundCollapsingExponential(B=bound, tau=1 / fall_s)
    process = {"drift": models.DriftConstant(drift=drift), "noise": models.NoiseConstant(noise=1)}
    steps = {"dx": dt, "dt": dt, "T_dur": 3.0}
    solved = Model(bound=falling, overlay=models.OverlayNone(), **process, **steps).solve()
    both = np.stack([solved.pdf("error"), solved.pdf("correct")]) * dt
    return np.array([*both.sum(axis=1), both.sum(axis=0) @ solved.t_domain])


@pytest.mark.parametrize(("bound", "fall_s", "drift"), [(0.8, 0.7, 2.0), (1.2, 2.0, 0.5)])
def test_a_falling_gap_is_where_pyddm_goes_as_its_step_goes_to_nothing(bound, fall_s, drift):
    times = np.arange(1, 1500) * 0.002
    gap, slope = exponential(bound, fall_s, times)
    at_rest = passage.falling_at_rest(gap, slope, times)
    (mass,) = with_drift(at_rest, gap, times, [drift]) * 0.002
    ours = np.array([*mass.sum(axis=1), mass.sum(axis=0) @ times])
    coarse, fine = (of_pyddm(bound, fall_s, drift, dt) for dt in (0.002, 0.001))
    # Its error is of the first order in its step.
    assert ours == pytest.approx(2 * fine - coarse, abs=3e-4)
    assert abs(ours - coarse)[2] > 1e-3


@pytest.mark.parametrize("fall_per_s", [0.0, 1.5])
@pytest.mark.parametrize(("start", "drift_sd"), [(0.0, 0.0), (0.2, 0.0), (-0.1, 0.8)])
def test_sums_in_bins_are_those_of_the_densities(fall_per_s, start, drift_sd):
    times, drifts = (np.arange(300) + 0.5) * 0.004, np.array([-3.0, 0.0, 0.4, 90.0])
    gap, slope = EXPONENTIAL.at(0.8, {"fall_per_s": fall_per_s}, times)
    at_rest = passage.falling_at_rest(gap, slope, times, start=start)
    mass = with_drift(at_rest, gap, times, drifts, start, drift_sd) * 0.004
    wanted = mass.reshape(4, 2, 75, 4).sum(axis=3)
    told = {"width_s": np.full(300, 0.004), "bins": np.arange(300) // 4}
    sums, other = (
        passage.binned(at_rest, gap, times, drifts + off, start, drift_sd, **told)
        for off in (0.0, 0.01)
    )
    assert sums == pytest.approx(wanted, rel=1e-11, abs=1e-200)
    assert np.abs(other - wanted).max() > 1e-6

"""Drifts and starts that vary from trial to trial: quadrature, limits, signs, recovery."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import norm

from bgmodel.fitting import passage
from bgmodel.fitting.algorithms import CONSTANT, EXPONENTIAL, GapModel
from bgmodel.fitting.responses import Grid
from tests.drawn import with_drift
from tests.test_start_point import drawn, fitted

GRID = Grid(1500)
GAP = pytest.mark.parametrize("gap", [CONSTANT, EXPONENTIAL], ids=lambda gap: gap.name)


def decided(drift, gap=CONSTANT, grid=GRID, **values):
    drift = np.atleast_1d(np.asarray(drift, float))
    every = {"sensitivity": 1.0, "fall_per_s": 1.0, **values}
    every = {name: np.full(len(drift), value) for name, value in every.items()}
    return GapModel(gap).decided(every, drift, grid)


def chosen(drift, bound, start):
    """Return the probability of response 1 of a constant bound, (1 - e^..) / (1 - e^..)."""
    if abs(drift * bound) < 1e-9:
        return (bound + start) / (2 * bound)
    return np.expm1(-2 * drift * (bound + start)) / np.expm1(-4 * drift * bound)


@given(st.floats(-4, 4), st.floats(0.05, 4.0), st.floats(0.3, 1.5), st.floats(-0.8, 0.8))
@settings(max_examples=8)
def test_varying_drifts_give_the_mean_density_at_any_bound(mean, sd, bound, share):
    times, start = np.arange(1, 60) * 0.03, share * bound
    for gap in (CONSTANT, EXPONENTIAL):
        at, slope = gap.at(bound, {"fall_per_s": 0.7}, times)
        rest = passage.falling_at_rest(at, slope, times, start=start)
        (shares,) = with_drift(rest, at, times, [mean], start, sd)
        for place in (2, 20, 55):
            one = slice(place, place + 1)

            def density(drift, one=one, rest=rest, at=at):
                return with_drift(rest[:, one], at[one], times[one], [drift], start)[0, :, 0]

            wide = (mean - 9 * sd, mean + 9 * sd)
            for response in (0, 1):
                (integral, _) = quad(
                    lambda v, k=response: norm.pdf(v, mean, sd) * density(v)[k],
                    *wide, epsabs=1e-10, limit=200,
                )  # fmt: skip
                assert shares[response, place] == pytest.approx(integral, rel=1e-6, abs=1e-8)


@given(st.floats(-3, 3), st.floats(0.1, 3.0), st.floats(0.3, 0.9))
@settings(max_examples=20)
def test_choices_under_varying_drifts_are_those_of_quadrature(mean, sd, bound):
    masses = decided(mean, bound=bound, drift_sd=sd)[0]
    integral, _ = quad(
        lambda v: norm.pdf(v, mean, sd) * chosen(v, bound, 0.0), mean - 9 * sd, mean + 9 * sd
    )
    assert masses.sum() == pytest.approx(1, abs=1e-3)
    assert masses[1].sum() == pytest.approx(integral, abs=5e-4)


@given(st.floats(-3, 3), st.floats(0.05, 0.9), st.floats(0.3, 0.9), st.floats(-0.7, 0.7))
@settings(max_examples=20)
def test_choices_under_varying_starts_are_those_of_quadrature(drift, spread, bound, share):
    masses = decided(drift, bound=bound, start=share, start_spread=spread)[0]
    half = spread * (1 - abs(share)) * bound
    middle = share * bound
    integral, _ = quad(lambda z: chosen(drift, bound, z) / (2 * half), middle - half, middle + half)
    assert masses.sum() == pytest.approx(1, abs=1e-3)
    assert masses[1].sum() == pytest.approx(integral, abs=5e-4)


@GAP
def test_without_variability_it_is_the_test_alone(gap):
    same = {"bound": 0.8, "start": -0.3}
    masses = decided([0.0, 1.0, -2.0], gap, **same)
    none = decided([0.0, 1.0, -2.0], gap, **same, drift_sd=0.0, start_spread=0.0)
    assert np.array_equal(masses, none)
    for name, small in (("drift_sd", 1e-4), ("start_spread", 1e-4)):
        nearly = decided([0.0, 1.0, -2.0], gap, **same, **{name: small})
        assert nearly == pytest.approx(masses, abs=1e-6)
        # It grows with the variance, not with the standard deviation.
        each = (decided([1.0], gap, **same, **{name: x}) for x in (0.02, 0.04))
        two, four = (np.abs(density - masses[1]).max() for density in each)
        assert four / two == pytest.approx(4, rel=0.05)


@GAP
@given(st.floats(-5, 5), st.floats(0, 5), st.floats(0, 0.9), st.floats(0.3, 8.0))
@settings(max_examples=25)
def test_any_values_within_bounds_give_masses(gap, drift, sd, spread, bound):
    masses = decided(drift, gap, Grid(300), bound=bound, drift_sd=sd, start_spread=spread)
    assert np.isfinite(masses).all()
    assert (masses >= 0).all()
    assert masses.sum() < 1 + 4e-3
    if gap is EXPONENTIAL and bound < 1:
        assert masses.sum() > 1 - 0.02


def test_varying_drifts_are_recovered_and_nothing_is_gained_without():
    # Strong evidence and a high bound: drifts of the other sign make slow errors.
    table = drawn(94_002, bound=1.0, start=0.0, drift_sd=1.5)
    held = ("t0_sd_s=0.05", "lapse=0.01")
    plain = ("sensitivity", "bound", "t0_s")

    def gain(table):
        best, values = fitted(table, free=(*plain, "drift_sd"), fix=held)
        return best.log_likelihood - fitted(table, free=plain, fix=held)[0].log_likelihood, values

    nats, values = gain(table)
    assert values["drift_sd"] == pytest.approx(1.5, abs=0.4)
    assert nats > 8
    nats, _ = gain(drawn(94_003, bound=1.0, start=0.0))
    assert -0.02 < nats < 3

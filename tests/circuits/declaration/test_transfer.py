"""Transfers: derivatives, ends, and the text that Brian2 runs."""

import numpy as np
import pytest

from circuits.declaration.transfer import TRANSFERS, named
from circuits.engines.population import kernel as population
from circuits.engines.spikes import kernel as spikes
from tests.circuits.helpers import call

X = np.array([-70.0, -3.2, -0.4, 0.3, 0.7, 1.3, 4.9, 5.4, 5.6, 8.0])
"""On both sides of every kink, and on none."""


@pytest.mark.parametrize("name", TRANSFERS)
def test_slope_and_curvature_are_derivatives(name):
    law, h = named(name), 1e-4
    below, at, above = (law(X + d) for d in (-h, 0.0, h))
    np.testing.assert_allclose(law.slope(X), (above - below) / (2 * h), rtol=1e-6, atol=1e-8)
    bend = (above - 2 * at + below) / h**2
    np.testing.assert_allclose(law.curvature(X), bend, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("name", TRANSFERS)
def test_the_text_says_what_the_function_does(name):
    text = named(name).brian.format(x="x")
    known = {"clip": np.clip, "exp": np.exp, "log": np.log, "inf": np.inf}
    known["int"] = lambda truth: truth.astype(int)
    for x in (X, np.array([0.0, 1.0, 5.5, 59.0, 61.0, 200.0])):
        np.testing.assert_allclose(eval(text, known | {"x": x}), named(name)(x), rtol=1e-12)


@pytest.mark.parametrize(
    ("name", "x", "activity"),
    [
        ("rectified", [-2, 0, 3], [0, 0, 3]),
        ("saturating", [-2, 5, 7], [0, 5, 5.5]),
        ("ramp", [-2, 0.9, 1.2], [0, 0.9, 1]),
        ("exp", [-2, 59, 61], [np.exp(-2), np.exp(59), np.exp(60)]),
        ("log", [-2, 1, np.e], [0, 0, 1]),
        ("s_minus_log_s", [-2, 0, 1, np.e], [0, 0, 1, np.e - 1]),
    ],
)
def test_transfers_end_at_their_stated_bounds(name, x, activity):
    np.testing.assert_allclose(named(name)(x), activity, rtol=1e-12)


@pytest.mark.parametrize(
    ("name", "activity", "x"),
    [
        ("rectified", [-0.1, 0, 9], [np.nan, 0, 9]),
        ("saturating", [-0.1, 0, 5.5, 5.6], [np.nan, 0, 5.5, np.nan]),
        ("ramp", [-0.1, 0, 1, 1.1], [np.nan, 0, 1, np.nan]),
        ("exp", [-1, 0, 1, np.e], [np.nan, np.nan, 0, 1]),
        ("log", [-0.1, 0, 1], [np.nan, 1, np.e]),
    ],
)
def test_an_activity_that_no_input_has_has_no_inverse(name, activity, x):
    np.testing.assert_allclose(named(name).inverse(np.array(activity)), x)


@pytest.mark.parametrize("name", spikes.TRANSFERS)
def test_the_spikes_kernel_has_the_same_transfers(name):
    outputs = [spikes._law(spikes.TRANSFERS[name], x) for x in X]
    np.testing.assert_allclose(outputs, named(name)(X), rtol=1e-15)


@pytest.mark.parametrize("name", population.TRANSFERS)
def test_the_population_kernel_has_the_same_transfers_in_single_precision(name):
    values = np.zeros(-(-len(X) // population.LANES) * population.LANES, np.float32)
    values[: len(X)] = X
    found = tuple(np.zeros(len(values), kind) for kind in (np.int32, np.float32, np.float32))
    no_table = (np.float32(0), np.float32(0), np.zeros(2, np.float32), found)
    call(population._apply, len(values), population.TRANSFERS[name], values, *no_table)
    outputs = values[: len(X)]
    np.testing.assert_allclose(outputs, named(name)(X.astype(np.float32)), rtol=3e-7, atol=1e-30)

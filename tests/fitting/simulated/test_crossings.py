"""Stored crossings of an ideal integrator against the exact walk."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bgmodel.fitting.responses import BIN_S, Grid, moments
from bgmodel.fitting.simulated.crossings import (
    DRIFTS,
    count,
    interpolated,
    log_mixture,
    log_odds,
    read,
    simulated,
)
from bgmodel.fitting.simulated.error import decided
from bgmodel.integrators.first_passage import GaussianIncrements, walk
from tests.closed_forms import accuracy
from tests.drawn import GAIN, ideal

GRID = Grid(300)
THRESHOLDS = np.log1p(np.exp(-np.linspace(2.8, 0.3, 26)))
BEYOND_A_BOUND = 0.5826
"""Mean overshoot of a GaussianIncrements walk, in sd of a step (Siegmund 1985)."""


@pytest.fixture(scope="module")
def stored():
    return simulated(ideal, THRESHOLDS, seconds=3.0, trials=900, seed=7)


def effective(stored, row, drift):
    """Return how many independent trials the weights at a drift are worth."""
    read_s = (stored.bins[row] + 1) * BIN_S
    common = -(drift**2) * read_s / 2 - log_mixture(DRIFTS, read_s, stored.evidence[row])
    weights = np.exp(common) * np.cosh(drift * stored.evidence[row])
    return weights.sum() ** 2 / (weights**2).sum()


@pytest.mark.parametrize("drift", [0.5, 1.5, 3.0, 5.5, 9.0, 13.0])
@pytest.mark.parametrize("row", [8, 18])
def test_a_drift_that_was_not_simulated_ends_as_the_exact_walk(stored, row, drift):
    mass = decided([(stored, 1.0)], THRESHOLDS[row], [drift], GRID)
    computed = {name: float(value[0]) for name, value in moments(mass / BIN_S, GRID).items()}
    bound = float(log_odds(THRESHOLDS[row]))
    step = GaussianIncrements(GAIN * drift * BIN_S, GAIN * np.sqrt(BIN_S))
    exact = walk(step, -bound, bound, t_max=300)
    steps = np.arange(301)
    ended = np.append(exact.steps_pmf[:-1], exact.steps_pmf[-1] - exact.p_forced)
    mean = ended @ steps / ended.sum()
    sd = np.sqrt(ended @ steps**2 / ended.sum() - mean**2)
    few, forced = effective(stored, row, drift), exact.p_forced
    error_s = sd * BIN_S / np.sqrt(few)
    assert computed["mean_s"] + BIN_S / 2 == pytest.approx(mean * BIN_S, abs=3.5 * error_s)
    wrong = 1 - walk(step, -bound, bound).p_upper
    # What is known of the bound says more of an error than its count does.
    most = max(0.003 * (wrong > 1e-3), 0.1 * wrong)
    assert 1 - computed["accuracy"] == pytest.approx(wrong, abs=most)
    assert 1 - computed["answered"] == pytest.approx(forced, abs=3.5 * (forced / few) ** 0.5 + 1e-6)
    level = bound / GAIN + BEYOND_A_BOUND * np.sqrt(BIN_S)
    assert computed["accuracy"] == pytest.approx(float(accuracy(drift, level)), abs=0.003)


DRIFT = st.floats(0, 16)


@given(DRIFT, st.floats(THRESHOLDS[0], THRESHOLDS[-1]))
@settings(max_examples=30)
def test_evidence_for_the_other_response_exchanges_them(stored, drift, threshold):
    one, other = decided([(stored, 1.0)], threshold, [drift, -drift], GRID)
    assert one == pytest.approx(other[::-1], abs=1e-12)
    assert one[1].sum() >= one[0].sum() - 1e-9


@given(DRIFT, st.floats(THRESHOLDS[0], THRESHOLDS[-1]))
@settings(max_examples=20)
def test_a_longer_grid_adds_bins_and_changes_none(stored, drift, threshold):
    standard = decided([(stored, 1.0)], threshold, [drift], GRID)
    # Interpolation of noisy densities may fall a little below 0 in single bins.
    assert standard.min() > -2e-3
    # So may the undecided, by less than one of the 900 trials: their counts are sharpened.
    assert standard.sum() <= 1 + 1 / 900
    short, long = (decided([(stored, 1.0)], threshold, [drift], Grid(n)) for n in (60, 350))
    assert np.array_equal(short, standard[:, :, :60])
    assert np.array_equal(long[:, :, :300], standard)
    assert long[:, :, 300:].sum() == 0


@given(st.floats(0, 9), st.lists(st.floats(-5, 5), min_size=3, max_size=3))
def test_interpolation_meets_quadratics_and_its_weights_sum_to_1(place, line):
    rows = interpolated(place, 10)
    assert sum(weight for _, weight in rows) == pytest.approx(1)
    if 1 <= place <= 8:
        at_place = sum(weight * np.polyval(line, row) for row, weight in rows)
        assert at_place == pytest.approx(np.polyval(line, place), abs=1e-9)


def each_alone(stored, row, v, bins):
    """Return the probabilities of both responses, trial by trial, without any grid of evidence."""
    mass, total = np.zeros((2, bins)), 0.0
    read_s = (stored.bins[row] + 1) * BIN_S
    mixture = log_mixture(DRIFTS, read_s, stored.evidence[row])
    for sign in (1, -1):
        weight = np.exp(sign * v * stored.evidence[row] - v**2 * read_s / 2 - mixture)
        total += weight.sum()
        for choice in (0, 1):
            some = stored.choice[row] == choice
            response = 1 - choice if sign == 1 else choice
            np.add.at(mass[response], stored.bins[row][some], weight[some])
    return mass / total


@pytest.mark.parametrize("v", [0.0, 0.7, 3.0, 9.0, 15.0])
@pytest.mark.parametrize("row", [2, 18])
def test_counts_on_the_grid_say_what_the_trials_say_one_by_one(stored, row, v):
    alone = each_alone(stored, row, v, GRID.bins)
    (mass,) = decided([(stored, 1.0)], THRESHOLDS[row], [v], GRID)
    assert mass.sum() == pytest.approx(alone.sum(), abs=1e-4)
    assert mass == pytest.approx(alone, rel=5e-3, abs=1e-4)


def test_a_decision_has_heard_its_bin_and_no_later_reading():
    """OUT that falls at reading k alone is crossed in bin k, with the evidence read by then."""
    seen = []

    def run(read, first):
        seen.append((read, first))
        trace = ideal(read, first)
        trace.out_nats[:] = 1.0
        trace.out_nats[:, 12:, 1] = 0.1
        return trace

    crossings = simulated(run, np.array([0.3]), seconds=0.2, trials=4, seed=1, drifts=[0.0, 2.0])
    assert [first for _, first in seen] == [0, 4]
    read = np.concatenate([each for each, _ in seen])
    assert (crossings.bins == 12).all()
    assert (crossings.choice == 1).all()
    assert crossings.evidence[0] == pytest.approx(read[:, 12, 0] - read[:, 12, 1])


def test_parts_hold_every_trial_once(stored):
    even = np.array([True, False])
    first, second = (stored.part(parts).counted(8) for parts in (even, ~even))
    counted = stored.counted(8)
    assert first.decided + second.decided == pytest.approx(counted.decided)
    assert first.never + second.never == pytest.approx(counted.never)
    assert first.decided.sum() == pytest.approx(second.decided.sum(), rel=0.1)


def waits(read, first):
    """Return OUT of an ideal integrator that is silent until 2.9 s are read."""
    trace = ideal(read, first)
    silent = trace.time_ms[None, :, None] < 2900
    return replace(trace, out_nats=np.where(silent, np.log(2), trace.out_nats))


@pytest.mark.parametrize("v", [15.0, 30.0, 33.0])
def test_weights_that_one_offset_would_let_overflow_are_those_of_trials_one_by_one(v):
    late = simulated(waits, THRESHOLDS, seconds=3.0, trials=100, seed=7)
    (mass,) = read([(late, 1.0)], [(8, 1.0)], np.array([v])).transpose(2, 1, 0)
    assert mass == pytest.approx(each_alone(late, 8, v, len(mass[0])), rel=5e-3, abs=1e-6)
    both = read([(late, 1.0)], [(8, 1.0)], np.array([v, 2.0]))
    assert both[..., 1] == pytest.approx(read([(late, 1.0)], [(8, 1.0)], np.array([2.0]))[..., 0])


MIDDLE, WIDTH = 40, 0.1


def counted(bins, choice, share, evidence=None):
    """Return the counts that decided and that did not, by bin and evidence."""
    bins, choice = np.array(bins, np.int16), np.array(choice, np.int8)
    evidence = np.zeros(bins.shape) if evidence is None else evidence
    decided, never = np.zeros((1, 32, 2 * MIDDLE + 1)), np.zeros(2 * MIDDLE + 1)
    count(bins, choice, evidence, np.array(share), np.array([True]), WIDTH, decided, never)
    return decided[0], never


@pytest.mark.parametrize("other", [1, -1])
def test_a_trial_of_two_choices_is_divided_as_the_shares_say(other):
    decided, never = counted([[10], [20]], [[0], [other]], [0.75, 0.25])
    assert decided[10].sum() == pytest.approx(0.75)
    assert decided[20].sum() == pytest.approx(0.25 * (other == 1))
    assert never.sum() == pytest.approx(0.25 * (other == -1))


@given(st.integers(1, 4), st.integers(0, 2**32))
@settings(max_examples=30)
def test_every_trial_counts_once_and_keeps_its_evidence(settings_, seed):
    rng = np.random.default_rng(seed)
    bins, choice = rng.integers(0, 30, (settings_, 40)), rng.integers(0, 2, (settings_, 40))
    evidence = rng.uniform(-3, 3, (settings_, 40))
    share = rng.dirichlet(np.ones(settings_))
    decided, _ = counted(bins, choice, share, evidence)
    assert decided.sum() == pytest.approx(40)
    towards = share @ np.where(choice == 0, evidence, -evidence)
    columns = (np.arange(2 * MIDDLE + 1) - MIDDLE) * WIDTH
    assert (decided @ columns).sum() == pytest.approx(towards.sum())

"""Information per trial against closed forms, its bias and its error."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

import bgmodel as bg
from bgmodel import stream
from bgmodel.discriminating.information import (
    BINS,
    CORRECT,
    MISSED,
    OTHER,
    Partition,
    Recorded,
    Recording,
    divergence,
    information,
)
from bgmodel.discriminating.result import INSEPARABLE, SEPARABLE
from bgmodel.discriminating.space import Probe, Space
from bgmodel.discriminating.trials import PairedTrials
from bgmodel.experiments.models import model_of
from circuits.laws.fluctuation import count_ratio
from tests.helpers import refusing

MEAN_MS, SD_MS, APART_MS = 500.0, 100.0, 50.0


def timed(mean_ms, trials, seed):
    times = mean_ms + SD_MS * stream(seed, "times").standard_normal(trials)
    return Recorded(np.full(trials, CORRECT), times)


def chosen(share, trials, seed):
    """Return trials with one bin per choice: the times are all alike."""
    right = stream(seed, "choices").random(trials) < share
    return Recorded(np.where(right, CORRECT, OTHER), np.full(trials, MEAN_MS))


def test_two_gaussians_have_the_divergence_of_their_bins():
    true, other = timed(MEAN_MS, 40_000, 1), timed(MEAN_MS + APART_MS, 40_000, 2)
    estimate, [bins] = information([true], [other], [1.0])
    cuts = np.concatenate([[-np.inf], bins.edges[CORRECT], [np.inf]])
    p, q = (np.diff(norm.cdf(cuts, mean, SD_MS)) for mean in (MEAN_MS, MEAN_MS + APART_MS))
    exact = float(p @ np.log(p / q))
    assert len(p) == BINS
    assert abs(estimate.nats - exact) < 4 * estimate.error < 0.02
    # Bins lose some of what times tell: (apart / sd)^2 / 2 nats.
    assert 0.8 * APART_MS**2 / (2 * SD_MS**2) < estimate.nats < APART_MS**2 / (2 * SD_MS**2)


def test_choices_have_the_divergence_of_two_proportions():
    estimate, _ = information([chosen(0.9, 40_000, 1)], [chosen(0.8, 40_000, 2)], [1.0])
    exact = 0.9 * np.log(0.9 / 0.8) + 0.1 * np.log(0.1 / 0.2)
    assert abs(estimate.nats - exact) < 4 * estimate.error < 0.02


def test_a_model_against_itself_tells_nothing_within_the_error():
    """Thirty pairs of independent samples: the mean is 0, where the plain estimate is biased."""
    seen = []
    for seed in range(30):
        one, other = (timed(MEAN_MS, 600, 10 * seed + k) for k in (1, 2))
        estimate, _ = information([one], [other], [1.0])
        seen.append((estimate.nats, estimate.plain_nats, estimate.error))
    corrected, plain, errors = np.transpose(seen)
    spread = corrected.std() / np.sqrt(30)
    assert abs(corrected.mean()) < 3 * spread
    assert plain.mean() > 6 * spread
    # (bins - 1) / trials for two independent samples
    assert plain.mean() == pytest.approx((BINS - 1) / 600, rel=0.4)
    assert (corrected > 1.96 * errors).mean() <= 0.1
    assert 0.7 < errors.mean() / corrected.std() < 2.5
    # The same trials tell exactly nothing.
    estimate, _ = information([one], [one], [1.0])
    assert (estimate.nats, estimate.error) == (0.0, 0.0)


def test_common_random_numbers_reduce_the_error():
    one = timed(MEAN_MS, 2000, 1)
    paired, _ = information([one], [one.later(5.0)], [1.0])
    apart, _ = information([one], [timed(MEAN_MS + 5.0, 2000, 2)], [1.0])
    assert paired.error < 0.7 * apart.error


def test_missed_trials_have_a_bin_without_times():
    one = timed(MEAN_MS, 500, 1)
    late = Recorded(np.where(np.arange(500) < 100, MISSED, CORRECT), np.full(500, np.nan))
    bins = Partition.of(one)
    assert (bins.place(late)[:100] == bins.bins - 1).all()
    assert (bins.place(one) < bins.bins - 1).all()


def test_kinds_of_trials_count_by_their_share():
    same, true, other = chosen(0.5, 4000, 1), chosen(0.9, 4000, 2), chosen(0.6, 4000, 3)
    alone, _ = information([true], [other], [1.0])
    mixed, _ = information([same, true], [same, other], [0.75, 0.25])
    assert mixed.nats == pytest.approx(0.25 * alone.nats, rel=1e-9)
    assert divergence([same, true], [same, other], [0.75, 0.25]) == pytest.approx(mixed.plain_nats)
    assert mixed.weights.sum() == pytest.approx(1)


SPACE = Space(d_prime=(1.0,), accuracy=(0.85,), deadline_ms=(1000.0,))
FEW = {"space": SPACE, "trials": 400, "check_trials": 400}
LOSS = {"second_edits": ["lesion STN 10%"], **FEW}
RECORDING, MORE = Recording("STN", cells=10), {"check_trials": 3000}


@pytest.fixture(scope="module")
def table():
    return bg.load_circuit("macaque", 2)


@pytest.mark.parametrize(("nucleus", "cv"), [("STN", 0.3), ("D1", 0.5)])
def test_the_ratio_of_counts_is_the_square_of_the_cv_of_renewal_cells(table, nucleus, cv):
    assert table.population(nucleus).cell.cv == cv
    assert count_ratio(table, nucleus) == pytest.approx(cv**2, rel=1e-3)


@pytest.mark.parametrize("nucleus", ["GPe", "D1"])
@pytest.mark.parametrize("cells", [1, 7])
def test_counts_have_the_mean_of_the_rate_and_the_variance_of_renewal_cells(table, nucleus, cells):
    recording, hz = Recording(nucleus, (0.0, 250.0), cells), 60.0
    trials = 100_000
    counts = recording.counts(np.full(trials, hz), table, bg.stream(1, "counts"))
    mean = 0.25 * hz
    variance = cells * (count_ratio(table, nucleus) * mean + 1 / 6)
    assert counts.mean() == pytest.approx(cells * mean, abs=4 * np.sqrt(variance / trials))
    assert counts.var() == pytest.approx(variance, rel=4 * np.sqrt(2 / trials))


def test_rates_are_those_of_the_window_and_of_the_true_alternative():
    rates = np.zeros((2, 10, 3))
    rates[0, 2:5, 1], rates[1, 2:5, 2] = 40.0, 10.0
    rates[:, 5:] = 1000.0
    time_ms, truth = np.arange(1, 11) * 100.0, np.array([1, 2])
    recording = Recording("STN", (200.0, 500.0))
    assert recording.mean_hz(rates, time_ms, truth).tolist() == [40.0, 10.0]
    shared = rates[:, :, :1] + 7.0
    assert recording.mean_hz(shared, time_ms, truth).tolist() == [7.0, 7.0]


def shown(mean, seed, trials=40_000):
    rng = bg.stream(seed, "shown")
    right = rng.random(trials) < 0.8
    spikes = mean + 2.0 * rng.standard_normal(trials)
    times = 500 + 50 * rng.standard_normal(trials)
    return Recorded(np.where(right, CORRECT, OTHER), times, spikes)


def test_counts_that_depend_on_nothing_else_tell_the_divergence_of_their_bins():
    true, other = shown(20.0, 1), shown(21.0, 2)
    estimate, [bins] = information([true], [other], [1.0])
    cuts = np.concatenate([[-np.inf], bins.counts, [np.inf]])
    p, q = (np.diff(norm.cdf(cuts, mean, 2.0)) for mean in (20.0, 21.0))
    exact = float(p @ np.log(p / q))
    assert abs(estimate.nats - exact) < 4 * estimate.error < 0.02
    assert 0.75 * 0.125 < estimate.nats < 0.125  # (apart / sd)^2 / 2, of which bins lose some


def test_every_bin_of_choice_time_and_count_is_one_place():
    trials = shown(20.0, 3, 2000)
    bins = Partition.of(trials)
    assert set(bins.place(trials)) <= set(range(bins.bins))
    timed, alone = Partition(bins.edges), replace(trials, spikes=None)
    assert bins.bins == 4 * timed.bins
    assert (bins.place(trials) // 4 == timed.place(alone)).all()


@pytest.fixture(scope="module")
def recorded():
    return bg.discriminate("macaque", recording=RECORDING, **(LOSS | MORE))


def test_spikes_tell_a_loss_of_stn_that_behaviour_cannot(recorded):
    """At matched thresholds a loss of STN is a lower threshold; the cells that are left differ."""
    assert bg.discriminate("macaque", **LOSS).verdict == INSEPARABLE
    assert recorded.verdict == SEPARABLE
    assert recorded.sequential["median"].between(30, 80).all()
    ratio = recorded.sequential["simulated_median"] / recorded.sequential["median"]
    assert ratio.between(0.75, 1.33).all()
    wanted = {"nucleus": "STN", "window_ms": (100.0, 300.0), "cells": 10}
    assert recorded.settings["recording"] == wanted


def test_cells_that_the_edit_does_not_reach_fire_alike_in_both_models():
    """SNr sends nothing back: the spikes of all other nuclei are the same, one by one."""
    models = model_of("macaque"), model_of("macaque", ["scale GPe->SNr 0.9"])
    for nucleus, alike in (("STN", True), ("ctx", True), ("SNr", False)):
        trials = PairedTrials(models, SPACE, 7, 200, recording=Recording(nucleus, cells=10))
        first, second = (trials.simulated(k, Probe(2, 1.0)).spikes for k in (0, 1))
        assert (first == second).all() == alike


def test_the_answer_does_not_depend_on_threads(recorded):
    again = bg.discriminate("macaque", recording=RECORDING, workers=2, **(LOSS | MORE))
    assert again.to_json() == recorded.to_json()


test_bad_recordings_are_refused_by_their_field = refusing(
    (lambda: Recording("STN", cells=0), "cells"),
    (lambda: Recording("STN", cells=2000), "cells"),
    (lambda: Recording("STN", (300.0, 100.0)), "window_ms"),
    (lambda: Recording("STN", (-1.0, 100.0)), "window_ms"),
    (lambda: Recording("STN", 100.0), "window_ms"),
    (lambda: Recording("STN", (100.0, 5000.0)), "window_ms"),
    (lambda: Recording(3), "nucleus"),
    (lambda: Recording("thalamus"), "nucleus"),
    (lambda: Recording("ctx_inh"), "nucleus"),
    (lambda: "STN", "recording"),
    of=lambda recording: bg.discriminate("macaque", recording=recording(), **LOSS),
)

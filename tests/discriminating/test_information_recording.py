"""Recorded spikes: their statistics, what they tell in closed form, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

import bgmodel as bg
from bgmodel.discriminating.information import (
    CORRECT,
    OTHER,
    Partition,
    Recorded,
    Recording,
    information,
)
from bgmodel.discriminating.result import INSEPARABLE, SEPARABLE
from bgmodel.discriminating.space import Probe, Space
from bgmodel.discriminating.trials import PairedTrials
from bgmodel.experiments.models import model_of
from circuits.laws.fluctuation import count_ratio
from tests.helpers import refused

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
    assert recorded.settings["recording"] == {
        "nucleus": "STN", "window_ms": (100.0, 300.0), "cells": 10
    }  # fmt: skip


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


@pytest.mark.parametrize(
    ("recording", "field"),
    [
        (lambda: Recording("STN", cells=0), "cells"),
        (lambda: Recording("STN", cells=2000), "cells"),
        (lambda: Recording("STN", (300.0, 100.0)), "window_ms"),
        (lambda: Recording("STN", (-1.0, 100.0)), "window_ms"),
        (lambda: Recording("STN", 100.0), "window_ms"),
        (lambda: Recording(3), "nucleus"),
        (lambda: Recording("thalamus"), "nucleus"),
        (lambda: Recording("ctx_inh"), "nucleus"),
        (lambda: Recording("STN", (100.0, 5000.0)), "window_ms"),
        (lambda: "STN", "recording"),
    ],
)
def test_bad_recordings_are_refused_by_their_field(recording, field):
    with refused(field):
        bg.discriminate("macaque", recording=recording(), **LOSS)

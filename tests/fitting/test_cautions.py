"""Errors due to bins, slow trials, and fast ones that are left out: said only where they are."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bgmodel.fitting import model_comparison, passage
from bgmodel.fitting.algorithms import GapModel
from bgmodel.fitting.cautions import (
    EDGE_NATS,
    PARTS,
    cut_nats,
    finer,
    moved_by_bins,
    of_bins,
    of_cuts,
    resolved,
    slow_trials,
)
from bgmodel.fitting.design import design_of
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.model_comparison import crossvalidated
from bgmodel.fitting.optimum import Optimum, optimum
from bgmodel.fitting.posterior import directions
from bgmodel.fitting.responses import Grid, moments, responded
from bgmodel.fitting.settings import settings_of
from bgmodel.fitting.simulated.race import RaceModel
from bgmodel.support.seeds import stream
from tests.drawn import TRUTH, drawn, slowed
from tests.fitting.conftest import fitted_with

pytestmark = pytest.mark.usefixtures("brief_search")
SEED = 24_611
STRENGTHS = (0.1, 0.2, 0.4)
SENSITIVITY, T0_S = 8.0, 0.3
ENDS_S = np.concatenate([[0], np.geomspace(1e-7, 1e-3, 2000), np.arange(1.1e-3, 4, 1e-4)])


def table(bound, start, t0_sd_s, trials, seed):
    """Return trials of the test, drawn without bins from the exact density of its decisions."""
    rng = stream(seed, "exact")
    time_s, width_s = (ENDS_S[1:] + ENDS_S[:-1]) / 2, np.diff(ENDS_S)
    at_rest = passage.constant_at_rest(bound, time_s, start * bound)
    parts = []
    for strength in STRENGTHS:
        drift, away = SENSITIVITY * strength, bound * np.array([[-1 - start], [1 - start]])
        mass = (at_rest * np.exp(drift * away - drift**2 * time_s / 2) * width_s).ravel().cumsum()
        place = np.searchsorted(mass, mass[-1] * rng.random(trials))
        response, at = np.divmod(place, len(time_s))
        decided = ENDS_S[at] + width_s[at] * rng.random(trials)
        rt_s = decided + T0_S + t0_sd_s * rng.normal(size=trials)
        parts.append(pd.DataFrame({"rt": rt_s, "response": response, "x": strength}))
    return pd.concat(parts, ignore_index=True).assign(participant_id="a")


def likelihood(bound, start=0.0, t0_sd_s=0.02, trials=2000, seed=SEED):
    free = ("+start",) if start else ()
    asked = settings_of(strength="x", free=free, fix={"lapse": 0.001})
    choices = asked.read(table(bound, start, t0_sd_s, trials, seed))
    return asked.likelihood(asked.design(choices), GapModel())


def fitted(some):
    peak = optimum(some)
    return peak, directions(some, peak.vector)


def test_the_error_of_bins_is_the_difference_to_a_fit_with_narrow_bins():
    some = likelihood(0.3, start=0.85)
    peak, there = fitted(some)
    narrow = optimum(finer(some), starts=[peak.vector])
    apart = peak.vector - narrow.vector
    moved = moved_by_bins(some, there) * (1 - 1 / PARTS)
    k = there.names.index("t0_s")
    assert apart[k] < -0.0015  # later by 2 ms
    assert 0.5 < moved[k] / apart[k] < 2  # one step of scoring
    assert narrow.vector[k] == pytest.approx(T0_S, abs=4 * there.standard_errors[k])
    (caution,) = of_bins(some, there)
    assert "t0_s" in caution


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("bound", "t0_sd_s"), [(0.4, 0.02), (0.7, 0.05), (1.2, 0.1)])
def test_ordinary_decisions_are_not(bound, t0_sd_s, seed):
    some = likelihood(bound, t0_sd_s=t0_sd_s, trials=1000, seed=seed)
    _, there = fitted(some)
    assert of_bins(some, there) == []
    assert (np.abs(moved_by_bins(some, there)) < 0.1 * there.standard_errors).all()


def test_models_with_bins_of_one_width_are_left_out():
    """Such as a simulated circuit."""
    some = likelihood(0.12, t0_sd_s=0.01, trials=300)
    _, there = fitted(some)
    assert moved_by_bins(some, there).any()
    assert not moved_by_bins(replace(some, model=object()), there).any()


@pytest.mark.parametrize("model", [GapModel(), RaceModel(2)], ids=["gap", "race"])
def test_densities_do_not_depend_on_the_width_of_bins(model):
    values = {each.name: np.array([each.start]) for each in model.parameters}
    response = {name: values[name] for name in ("t0_s", "t0_sd_s", "lapse")}
    measured = []
    for parts in (1, 2, 5):
        grid = Grid(400 * parts, 0.01 / parts)
        density = responded(model.decided(values, np.ones(1), grid), grid, **response)
        measured.append([float(each[0]) for each in moments(density, grid).values()])
    np.testing.assert_allclose(measured[1:], [measured[0]] * 2, rtol=2e-4)


def test_models_are_compared_in_the_bins_of_their_fits(monkeypatch):
    """Whatever bins the likelihood had that is given: those of fast decisions are too wide."""
    monkeypatch.setattr(model_comparison, "FOLDS", 2)
    some = likelihood(0.3, start=0.85, trials=300)
    fine = resolved(optimum(some))
    wide = Optimum(some, fine.vector, some(fine.vector), 1)
    scores = crossvalidated({"wide": {"a": wide}, "narrow": {"a": fine}}).table
    assert scores.loc["wide", "log_likelihood"] == pytest.approx(
        scores.loc["narrow", "log_likelihood"], abs=0.02
    )
    assert abs(some(fine.vector) - fine.log_likelihood) > 0.5


MODEL, SLOW_SEED = GapModel(), 84
TRUE = {"sensitivity": 12.0, "bound": 0.7, **TRUTH}
CLEAN = drawn(MODEL, [0.0, 0.1, 0.4], 200, SLOW_SEED, seconds=4.0, **TRUE)
SLOWED = slowed(CLEAN, SLOW_SEED)


def said(words, some, window_s=None, **options):
    """Return a fit, and what it says in these words."""
    return fitted_with(words, likelihood_of(MODEL, design_of(some, rt_window=window_s), **options))


@pytest.fixture(scope="module")
def slow_fit():
    return said("slower", SLOWED)


def test_a_clean_set_has_no_slow_trials():
    fit, texts = said("slower", CLEAN)
    assert texts == []
    assert slow_trials(fit.optimum).gain_nats < 0.5


def test_a_tail_of_slow_trials_is_said_with_their_number(slow_fit):
    """Of 600 trials 5 % have an exponential delay, and lapses take up a part of them."""
    fit, (text,) = slow_fit
    slow = slow_trials(fit.optimum)
    assert slow.gain_nats > 1
    assert text.startswith(f"all, constant_gap: about {round(600 * slow.share)} of 600 trials are")
    assert 0.005 <= slow.share <= 0.08
    assert "rt_window" in text
    assert "free lapse, which" not in text


def test_where_lapses_are_held_it_is_advised_to_free_them_and_that_helps(slow_fit):
    held, (text,) = said("slower", SLOWED, fixed={"lapse": 0.001})
    assert "free lapse, which" in text
    free, _ = slow_fit
    off = [abs(each.optimum.values["bound"] - 0.7) for each in (free, held)]
    assert off[0] < off[1] / 2


BEGUN, CUT = drawn(MODEL, [0.0, 0.1, 0.4], 250, 87, seconds=4.0, **TRUE), "abruptly"
"""Trials, the fastest of which are left out, and what is then said."""


def test_a_clean_set_is_not_said_to_begin_abruptly():
    fit, texts = said(CUT, BEGUN)
    assert texts == []
    assert cut_nats(fit.optimum) < 2


@pytest.mark.parametrize("share", [0.2, 0.35])
def test_fast_trials_that_were_left_out_are_asked_for_and_the_window_mends_the_fit(share):
    """With the window the truth is as likely as it should be, and without it impossible."""
    first_s = float(np.quantile(BEGUN.rt_s, share))
    kept = BEGUN.where(first_s <= BEGUN.rt_s)
    off, (text,) = said(CUT, kept)
    assert f"all at {kept.rt_s.min():.4g} s" in text
    mended, texts = said(CUT, kept, (first_s, np.inf))
    assert texts == []
    worse = [
        fit.log_likelihood
        - fit.optimum.likelihood(np.array([TRUE[name] for name in fit.optimum.values]))
        for fit in (off, mended)
    ]
    assert worse[0] > 50
    assert worse[1] < 5.5  # half of the 95 % point of chi-square, 5 degrees of freedom
    assert mended.optimum.values["bound"] == pytest.approx(0.7, abs=0.04)
    assert mended.log_likelihood - off.log_likelihood > cut_nats(off.optimum) > EDGE_NATS


def test_the_window_of_rounded_times_begins_half_a_step_earlier():
    first_s = round(float(np.quantile(BEGUN.rt_s, 0.3)), 2)
    rounded = replace(BEGUN, rt_s=np.round(BEGUN.rt_s, 2))
    kept = rounded.where(rounded.rt_s >= first_s)
    _, (text,) = said(CUT, kept)
    assert f"all at {first_s - 0.005:.4g} s" in text
    right, texts = said(CUT, kept, (first_s - 0.005, np.inf))
    assert texts == []
    late, _ = said(CUT, kept, (first_s, np.inf))
    off = [abs(fit.optimum.values["t0_s"] - TRUE["t0_s"]) for fit in (right, late)]
    assert off[0] < off[1]


def test_times_in_coarse_steps_are_not_taken_to_begin_abruptly():
    some = drawn(MODEL, [0.05, 0.1, 0.2, 0.4], 400, 12, seconds=3, sensitivity=10.0, bound=0.5)
    _, texts = said(CUT, replace(some, rt_s=np.ceil(10 * some.rt_s) / 10))
    assert texts == []


def test_a_warning_names_a_few_people_of_many():
    optimum = said(CUT, BEGUN.where(np.quantile(BEGUN.rt_s, 0.3) <= BEGUN.rt_s))[0].optimum
    (text,) = of_cuts([optimum] * 9)
    assert (text.count("all at"), text.count(" and 5 more: ")) == (4, 1)

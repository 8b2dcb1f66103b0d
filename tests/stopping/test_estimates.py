"""Estimates of the stop-signal reaction time: a known one is found, and what the guide refuses."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from bgmodel.stopping.estimates import estimate_ssrt, inhibition_function
from bgmodel.stopping.trials import StopTrials, drawn_delays
from circuits.errors import DataWarning, quiet
from tests.helpers import refusing, told
from tests.stop_trials import walked

TRUE_MS = 220.0


def test_the_integration_method_finds_a_known_time():
    """The bar of the guide's simulations: within 15 ms on the mean of 40 people."""
    estimates = [estimate_ssrt(walked(seed)) for seed in range(40)]
    ssrt_ms = np.array([each.ssrt_ms for each in estimates])
    error = ssrt_ms.std() / np.sqrt(40)
    assert ssrt_ms.mean() == pytest.approx(TRUE_MS, abs=15)
    assert error < 4
    # The mean method takes the mean of skewed go times for their median.
    assert np.mean([each.ssrt_mean_ms for each in estimates]) > ssrt_ms.mean() + 5


def test_omissions_count_as_the_slowest_responses():
    go = [300.0, 400.0, 500.0, np.nan]
    trials = StopTrials([*go, 350.0, np.nan], [np.nan] * 4 + [200.0, 200.0])
    with pytest.warns(DataWarning, match="2 stop trials"):
        estimate = estimate_ssrt(trials)
    # Half of the stop trials fail: the second of four go times, 400, less the delay.
    assert estimate.ssrt_ms == 200.0
    assert estimate.omissions == 0.25
    assert estimate.ssrt_mean_ms == 200.0
    assert estimate.failed_minus_go_ms == -50.0


def test_the_inhibition_function_rises_and_its_time_is_constant_in_a_race():
    rng = np.random.default_rng(4)
    times = 380 + rng.gamma(2.0, 50.0, 40_000)
    ssd = drawn_delays(40_000, [200.0, 250.0, 300.0], 0.5, rng)
    times[times > np.nan_to_num(ssd + TRUE_MS, nan=np.inf)] = np.nan
    table = inhibition_function(StopTrials(times, ssd))
    assert table["p_respond"].is_monotonic_increasing
    trials, failed = int(table["trials"][1]), round(table["p_respond"][1] * table["trials"][1])
    exact = stats.binomtest(failed, trials).proportion_ci(method="wilson")
    assert table.loc[1, ["low", "high"]].to_list() == pytest.approx(exact, rel=1e-6)
    assert ((table["low"] <= table["p_respond"]) & (table["p_respond"] < table["high"])).all()
    assert table["ssrt_ms"].to_numpy() == pytest.approx(TRUE_MS, abs=4)


TWO_STOPS = [np.nan, np.nan, 200.0, 200.0]


test_what_the_guide_refuses_is_refused = refusing(
    (lambda: StopTrials([400, 500, np.nan, np.nan], TWO_STOPS), "trials is 0.00, outside 0.25"),
    (lambda: StopTrials([400, 500, 600, np.nan], TWO_STOPS), "trials slower"),
    (lambda: StopTrials([400, 500], [np.nan, np.nan]), "ssd_ms stop trials"),
    (lambda: StopTrials([np.nan, np.nan, 450, 1], TWO_STOPS), "rt_ms go trials"),
    of=lambda trials: estimate_ssrt(trials()),
)


test_impossible_trials_are_refused = refusing(
    (([400], [200]), "ssd_ms go trials"),
    (([400, -1], [np.nan, 200]), "rt_ms >= 0"),
    (([400, np.inf], [np.nan, 200]), "rt_ms >= 0"),
    (([400, 300], [np.nan]), "ssd_ms one per trial"),
    (([400, 300], [np.nan, 900], None, 800), "ssd_ms before the deadline"),
    of=lambda trials: StopTrials(*trials),
)


def test_delays_in_seconds_are_warned_of():
    with pytest.warns(DataWarning, match="not in seconds"):
        StopTrials([400.0, 300.0], [np.nan, 0.25])


def drifting(trials, by_ms):
    """Return the same race whose go times and signals become later, or earlier, by a time."""
    later = np.linspace(max(0.0, -by_ms), max(0.0, by_ms), len(trials.rt_ms))
    return replace(trials, rt_ms=trials.rt_ms + later, ssd_ms=trials.ssd_ms + later)


@pytest.mark.parametrize(("by_ms", "which"), [(500.0, "slower"), (-500.0, "faster")])
def test_a_trend_of_go_times_is_told_with_the_estimate_without_it(by_ms, which):
    """Without a trend, 1 of 1800 simulated people is told, also if neighbours correlate."""
    seed = 0
    assert not told(estimate_ssrt, walked(seed))
    before_ms = estimate_ssrt(walked(seed)).ssrt_ms
    trials = drifting(walked(seed), by_ms)
    (text,) = told(lambda: estimate_ssrt(trials, checked=False))
    assert text.startswith(f"go responses become {which} from trial to trial")
    with quiet():
        known_ms = estimate_ssrt(trials, checked=False).ssrt_ms
        flat_ms = estimate_ssrt(trials.without_trend()[1], checked=False).ssrt_ms
    assert f"would be {flat_ms:.0f} ms, not {known_ms:.0f}." in text
    assert abs(known_ms - before_ms) > 15
    assert flat_ms == pytest.approx(before_ms, abs=8)

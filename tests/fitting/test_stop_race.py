"""Fits of stop trials: closed forms, known stop processes, and what cannot be told apart."""

import re
from dataclasses import replace

import numpy as np
import pytest

from bgmodel.fitting.hierarchy.group import ALMOST
from bgmodel.fitting.hierarchy.group_fit import fit_group
from bgmodel.fitting.optimum import optimum
from bgmodel.fitting.person_fit import fit_likelihood
from bgmodel.fitting.stop_process import (
    GO,
    crossed_later,
    go_process,
    laid,
    raised_bound,
    threshold_nats,
)
from bgmodel.fitting.stop_race import StopRace, likelihood, stop_model
from bgmodel.stopping.inputs import MOST_NATS
from bgmodel.stopping.trials import StopTrials, drawn_delays
from tests.closed_forms import accuracy
from tests.helpers import refused

DELAYS = np.arange(50.0, 451.0, 50.0)
TRUE = {"ssrt_ms": 200.0, "ssrt_sd_ms": 40.0, "failures": 0.1}
ALIKE = StopRace(slowing_ms=(0.0, 0.0))


def raced(seed, trials=200, people_sd_ms=0.0, **true):
    """Return the record of a person in an independent race, half stop trials."""
    rng, true = np.random.default_rng(seed), TRUE | true
    go = 300 + 30 * rng.standard_normal() + rng.gamma(3.0, 50.0, trials)
    ssd = drawn_delays(trials, DELAYS, 0.5, rng)
    stop = ssd + true["ssrt_ms"] + people_sd_ms * rng.standard_normal()
    stop = stop + true["ssrt_sd_ms"] * rng.standard_normal(trials)
    stopped = (go > np.nan_to_num(stop, nan=np.inf)) & (rng.random(trials) > true["failures"])
    return StopTrials(np.where(stopped, np.nan, go), ssd).to_trials(f"p{seed}")


def values(trials, **changes):
    every = TRUE | {"strength_nats": MOST_NATS} | changes
    return {name: np.full(trials.trials, float(value)) for name, value in every.items()}


def test_responses_are_the_share_of_faster_go_times_without_spread_and_failures():
    trials = raced(1)
    one = StopTrials.of(trials)
    responded = ALIKE.p_respond(trials, values(trials, ssrt_sd_ms=1e-9, failures=0))
    ends, go = one.ssd_ms[one.stop] + 200, one.rt_ms[~one.stop]
    assert responded == pytest.approx([np.mean(go <= end) for end in ends], abs=1e-12)


def test_failures_and_spread_have_their_closed_form():
    trials = raced(1)
    one, rng = StopTrials.of(trials), np.random.default_rng(1)
    go = one.rt_ms[~one.stop]
    ends = one.ssd_ms[one.stop] + 200 + 40 * rng.standard_normal((4000, one.stop.sum()))
    drawn = 0.1 + 0.9 * (np.searchsorted(np.sort(go), ends, side="right") / len(go)).mean(axis=0)
    responded = ALIKE.p_respond(trials, values(trials))
    assert responded == pytest.approx(drawn, abs=0.02)
    log, failed = ALIKE.log_density(trials, values(trials)), one.responded[one.stop]
    assert log[one.stop] == pytest.approx(np.log(np.where(failed, responded, 1 - responded)))
    assert not log[~one.stop].any()


def test_values_may_differ_between_trials_and_several_sets_stand_side_by_side():
    trials = raced(1)
    one, other = values(trials), values(trials, ssrt_ms=260.0, failures=0.3)
    first = np.arange(trials.trials) < 80
    both = {name: np.where(first, one[name], other[name]) for name in one}
    alone = [ALIKE.log_density(trials, each) for each in (one, other)]
    assert ALIKE.log_density(trials, both) == pytest.approx(np.where(first, *alone))
    stacked = {name: np.stack([one[name], other[name]]) for name in one}
    assert ALIKE.log_density(trials, stacked) == pytest.approx(np.stack(alone))


def test_simulated_trials_have_the_probabilities_and_the_go_times():
    trials = raced(1, 3000)
    one = StopTrials.of(trials)
    made = StopTrials.of(ALIKE.simulate(trials, values(trials), np.random.default_rng(2)))
    p = ALIKE.p_respond(trials, values(trials))
    apart = made.responded[one.stop].mean() - p.mean()
    assert abs(apart) < 4 * np.sqrt((p * (1 - p)).mean() / len(p))
    assert np.nanmean(made.rt_ms[~one.stop]) == pytest.approx(one.rt_ms[~one.stop].mean(), abs=10)
    assert (made.stop == one.stop).all()


def test_known_parameters_are_found_and_the_model_fits():
    fit = fit_likelihood(likelihood(ALIKE, raced(3, 3000)))
    table = fit.parameters().set_index("parameter")
    for name, value in TRUE.items():
        assert abs(table.loc[name, "value"] - value) < 3.5 * table.loc[name, "standard_error"]
    assert table.loc["ssrt_ms", "standard_error"] < 12
    assert min(fit.misfit.p.values()) > 0.001


def test_a_hierarchy_finds_the_group_and_one_standard_deviation_between_trials():
    every = [raced(100 + who, 160, 30.0) for who in range(12)]
    group = fit_group({each.people()[0]: likelihood(ALIKE, each) for each in every})
    table, between = group.summary(), group.between[..., 1]
    assert group.agreement.reached
    for name, value in TRUE.items():
        low, high = table.loc[name, ["low", "high"]]
        assert low - (high - low) / 2 < value < high + (high - low) / 2
    low, high = table.loc["ssrt_ms", ["between_low", "between_high"]]
    assert low < 30 < high
    assert between.max() <= ALMOST * group.scale.unit[1]


def weak():
    """Return trials, and races of two people whose thresholds are 0.3 and 0.2 nats."""
    rng = np.random.default_rng(2)
    go = 350 + rng.gamma(2.0, 60.0, 400)
    ssd = np.append(np.full(400, np.nan), [150.0, 250.0, 350.0, 450.0])
    trials = StopTrials(np.append(go, np.full(4, np.nan)), ssd).to_trials()
    race = StopRace("circuit", 2.0, np.arange(1.0, 201.0), np.linspace(0.005, 1, 200))
    bounds = [-np.log(np.expm1(theta)) / 2.0 for theta in (0.3, 0.2)]
    process = {"sensitivity": 3.0, "t0_s": 0.3, "t0_sd_s": 0.03}
    return trials, [replace(race, go=process | {"bound": bound}) for bound in bounds]


def test_a_weak_stop_blocks_those_below_its_strength_and_delays_the_others():
    trials, races = weak()
    assert [race.threshold for race in races] == pytest.approx([0.3, 0.2])
    # A step has no latency.
    first, second = (replace(race, time_ms=None) for race in races)

    def p(race, strength):
        theta = {"ssrt_ms": 1.0, "ssrt_sd_ms": 5.0, "failures": 0.0, "strength_nats": strength}
        return race.p_respond(trials, values(trials, **theta))

    assert p(second, 0.25) == pytest.approx(p(second, MOST_NATS), abs=1e-12)
    strong, some, more, none = (p(first, strength)[-1] for strength in (0.4, 0.25, 0.1, 0.0))
    assert strong < some < more <= none + 1e-9
    many = StopTrials(np.tile(1000 * trials.rt_s, 5), np.tile(1000 * trials.ssd_s, 5)).to_trials()
    theta = values(many, ssrt_ms=1.0, ssrt_sd_ms=5.0, failures=0.0, strength_nats=0.1)
    rng, stop = np.random.default_rng(4), np.isfinite(many.ssd_s)
    made = [(first.simulate(many, theta, rng).response >= 0)[stop] for _ in range(40)]
    expected = first.p_respond(many, theta).mean()
    assert np.mean(made) == pytest.approx(expected, abs=4 * 0.5 / 800**0.5)


def test_the_latency_of_a_stop_is_that_at_the_threshold():
    _, races = weak()
    # c rises by 0.5 % of the strength per ms.
    latencies_ms = [race.latency_ms(np.array([0.6, 0.25])) for race in races]
    assert latencies_ms[0] == pytest.approx([100.0, 100.0], abs=1.5)
    assert latencies_ms[1] == pytest.approx([0.2 / 0.6 * 200, 160.0], abs=1.5)
    assert not replace(races[0], time_ms=None).latency_ms(np.array([1.0])).any()


def test_the_circuits_stop_is_its_step_response():
    model = stop_model("macaque")
    assert model.name == "macaque"
    assert model.added[-1] == pytest.approx(1.0, abs=0.01)
    assert stop_model("constant_gap").added is None
    with refused("models"):
        stop_model("falling_gap")


def test_slowing_after_stops_is_taken_out_of_go_times_and_put_into_stop_trials():
    #      go   stop   go   stop  stop
    rt = [400.0, 350, 460] + [400.0] * 12 + [np.nan, 380.0]
    ssd = [np.nan, 200.0, np.nan] + [np.nan] * 12 + [250.0, 250.0]
    trials = StopTrials([*rt, 480.0, 350.0, 300.0], [*ssd, np.nan, 200.0, 200.0]).to_trials()
    # After failed stops go responses are 60 and 80 ms later.
    data = laid(trials)
    assert data.slower_ms[data.stop].tolist() == [0, 0, 0, 0, 70]
    assert data.go_ms.tolist() == [400.0, 390.0] + [400.0] * 12 + [410.0]
    assert laid(trials, (0.0, 0.0)).slower_ms.max() == 0


def test_a_go_process_is_found_in_a_persons_go_trials():
    rng = np.random.default_rng(3)
    v, a, t0, dt = 3.0, 0.5, 0.3, 1e-3
    x, rt = np.zeros(400), np.full(400, np.nan)
    for step in range(4000):
        x = np.where(np.isnan(rt), x + v * dt + np.sqrt(dt) * rng.standard_normal(400), x)
        rt = np.where(np.isnan(rt) & (np.abs(x) >= a), step * dt + t0, rt)
    trials = StopTrials(1000 * rt, np.full(400, np.nan), x > 0)
    estimates = go_process(trials.to_trials())
    assert list(estimates) == list(GO)
    assert estimates["sensitivity"] == pytest.approx(v, abs=0.5)
    assert estimates["bound"] == pytest.approx(a, abs=0.07)
    never = StopTrials(np.full(9, np.nan), np.full(9, np.nan), np.zeros(9, bool))
    for unknown in (replace(trials, correct=None), never):
        assert np.isnan(list(go_process(unknown.to_trials()).values())).all()


def test_a_person_without_enough_trials_is_refused():
    for rt, ssd in (([400.0, 300.0], [np.nan, 200.0]), ([400.0] * 12, [np.nan] * 12)):
        with refused("ssd"):
            likelihood("constant_gap", StopTrials(rt, ssd).to_trials())


def test_shuffled_delays_are_far_less_likely():
    """Negative control: outcomes that do not depend on the delay contradict the closed form."""
    trials, rng = raced(3, 800), np.random.default_rng(5)
    ssd_s = trials.ssd_s.copy()
    ssd_s[~np.isnan(ssd_s)] = rng.permutation(ssd_s[~np.isnan(ssd_s)])
    tables = trials, replace(trials, ssd_s=ssd_s)
    true, shuffled = (optimum(likelihood(ALIKE, each)).log_likelihood for each in tables)
    assert shuffled < true - 50


def test_the_raised_bound_has_the_posterior_that_the_stop_leaves():
    # Palmer's accuracy is the posterior of the test at its bound.
    v, a = np.array([1.0, 3.0]), np.array([0.4, 0.6])
    assert np.exp(-threshold_nats(a, 2 * v)) == pytest.approx(accuracy(v, a))
    a, n = np.array([0.5]), np.array([2.0])
    theta = threshold_nats(a, n)
    assert raised_bound(a, n, 0.0) == pytest.approx(a)
    assert threshold_nats(raised_bound(a, n, 0.1), n) == pytest.approx(theta - 0.1)
    assert np.isinf(raised_bound(a, n, float(theta[0])))
    assert np.isinf(raised_bound(a, n, 2.0))


def test_nothing_is_crossed_without_time_or_without_a_bound():
    u = np.array([0.0, 0.1, 0.5])
    assert crossed_later(3.0, 0.5, np.inf, u, u + 1).tolist() == [0, 0, 0]
    assert crossed_later(3.0, 0.5, 0.8, u, np.zeros(3)).tolist() == [0, 0, 0]
    # With a long time all are.
    assert crossed_later(3.0, 0.5, 0.8, u, np.full(3, 50.0)) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize(("u", "b"), [(0.1, 0.7), (0.25, 1.0)])
def test_simulated_paths_cross_as_often(u, b):
    rng = np.random.default_rng(7)
    v, a, w, dt, paths = 2.0, 0.5, 0.3, 2e-4, 8000
    # The discrete walk overshoots: its bounds are 0.583 steps too far (Siegmund 1985).
    less = 0.583 * np.sqrt(dt)
    x, left = np.zeros(paths), []
    for bound, seconds in ((a, u), (b, w)):
        for _ in range(round(seconds / dt)):
            x += v * dt + np.sqrt(dt) * rng.standard_normal(len(x))
            x = x[np.abs(x) < bound - less]
        left.append(len(x))
    alive, share = left[0], 1 - left[1] / left[0]
    error = np.sqrt(share * (1 - share) / alive)
    crossed = crossed_later(v, a, b, np.array([u]), np.array([w]))[0]
    assert crossed == pytest.approx(share, abs=4 * error + 0.005)


@pytest.mark.parametrize("u", [0.02, 0.1, 0.4])
def test_where_the_bounds_stay_crossings_are_those_of_one_diffusion(u):
    """The density by images (60 places in the sum: .3 %); within w no path reaches both bounds."""
    v, a, w = 2.0, 0.5, 0.05
    x, n = np.linspace(-a, a, 4001), np.arange(-20, 21)

    def survival(t):
        images = (-1.0) ** n * np.exp(-((x[:, None] - 2 * n * a) ** 2) / (2 * t))
        return np.trapezoid(np.exp(v * x - v**2 * t / 2) * images.sum(axis=1) / np.sqrt(t), x)

    crossed = crossed_later(v, a, a, np.array([u]), np.array([w]))[0]
    assert crossed == pytest.approx(1 - survival(u + w) / survival(u), rel=5e-3)


def test_a_fit_tells_of_go_times_with_a_trend_and_what_it_would_find_without():
    """The same race on a clock that runs away: SSRT 200 ms, whatever the trend."""
    clean = raced(6, 400)
    later_s = np.linspace(0, 0.5, 400)
    slower = replace(clean, rt_s=clean.rt_s + later_s, ssd_s=clean.ssd_s + later_s)
    for trials, words in ((clean, ()), (slower, ("slower",))):
        fitted = optimum(likelihood(ALIKE, trials))
        texts = fitted.likelihood.cautions()
        assert [re.search("become (slower|faster)", text)[1] for text in texts] == list(words)
    flat, known = map(float, re.search(r"would be (\S+) ms, not (\S+)\.", texts[0]).groups())
    assert known == round(fitted.values["ssrt_ms"])
    assert abs(known - 200) > 50 > 25 > abs(flat - 200)

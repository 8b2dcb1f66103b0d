"""Fits of stop trials: known parameters are found, what cannot be told apart is stated."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy.special import expit, logit, logsumexp

from bgmodel.fitting.stops.data import GO, go_processes, stop_data
from bgmodel.fitting.stops.fit import StopFit, fit_stops
from bgmodel.fitting.stops.likelihood import COORDINATES, StopLikelihood, StopValues
from bgmodel.fitting.stops.model import TEST, StopModel, circuit_stop
from bgmodel.fitting.stops.prediction import halves
from bgmodel.stopping.trials import StopTrials, drawn_delays
from circuits.errors import DataWarning
from tests.helpers import refused

TRUE = StopValues(200.0, 30.0, 40.0, 0.1, 0.5)
DELAYS = np.arange(50.0, 451.0, 50.0)


def raced(seed, people=40, trials=200, true=TRUE):
    """Return participants of an independent race with trigger failures, half stop trials."""
    rng = np.random.default_rng(seed)
    found = {}
    for who in range(people):
        go = 300 + 30 * rng.standard_normal() + rng.gamma(3.0, 50.0, trials)
        ssd = drawn_delays(trials, DELAYS, 0.5, rng)
        mean = true.ssrt_ms + true.ssrt_people_sd_ms * rng.standard_normal()
        odds = np.log(true.failures / (1 - true.failures))
        f = 1 / (1 + np.exp(-odds - true.failures_people_sd * rng.standard_normal()))
        stop = ssd + mean + true.ssrt_trial_sd_ms * rng.standard_normal(trials)
        stopped = (go > np.nan_to_num(stop, nan=np.inf)) & (rng.random(trials) > f)
        found[f"p{who}"] = StopTrials(np.where(stopped, np.nan, go), ssd)
    return found


@pytest.fixture(scope="module")
def people():
    return raced(1)


@pytest.fixture(scope="module")
def unknown(people):
    return go_processes(people)


@pytest.mark.parametrize("times", [False, True])
def test_known_parameters_are_found_within_their_errors(people, unknown, times):
    fit = fit_stops(people, slowed=False, times=times, go=unknown)
    table = fit.parameters().set_index("parameter")
    for name in ("ssrt_ms", "ssrt_people_sd_ms", "ssrt_trial_sd_ms", "failures"):
        row = table.loc[name]
        assert abs(row["value"] - getattr(TRUE, name)) < 3.5 * row["error"]
    # Errors are as small as 4 000 trials allow: 40 people whose SSRT varies by 30 ms.
    assert 30 / np.sqrt(40) < table.loc["ssrt_ms", "error"] < 4 * 30 / np.sqrt(40)
    assert table.loc["failures", "error"] < 0.04
    assert "strength_nats is not fitted" in fit.summary()


@pytest.mark.parametrize("spread", [True, False])
def test_intervals_stay_within_the_range_of_a_parameter(spread):
    names = [n for n in COORDINATES if spread or "people" not in n]
    errors = {"ssrt_ms": 300.0, "failures": 0.1} | {n: 60.0 for n in names if "sd" in n}
    errors = {name: errors[name] for name in names}
    unseen = SimpleNamespace(thresholds=np.array([np.nan]))
    fit = StopFit(unseen, spread, TRUE, errors, 0.0, pd.DataFrame())
    table = fit.parameters().set_index("parameter")
    for name, error in errors.items():
        value, far = getattr(TRUE, name), 1.96 * error
        low, high = table.loc[name, ["low", "high"]]
        if name == "ssrt_ms":
            expected = value - far, value + far
        elif name == "failures":
            far /= value * (1 - value)
            expected = expit(logit(value) - far), expit(logit(value) + far)
        else:
            expected = value * np.exp(-far / value), value * np.exp(far / value)
        assert (low, high) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_one_participant_has_one_ssrt_and_no_spread(seed):
    """Nodes of a spread that nobody has would put the mean anywhere around the SSRT."""
    alone = StopValues(180.0, 0.0, 25.0, 0.05, 0.0)
    fit = fit_stops(raced(seed, people=1, trials=3000, true=alone), slowed=False)
    table = fit.parameters().set_index("parameter")
    assert not fit.spread
    assert set(fit.errors) == {"ssrt_ms", "ssrt_trial_sd_ms", "failures"}
    assert 2 < table.loc["ssrt_ms", "error"] < 12
    for name in ("ssrt_ms", "failures"):
        assert abs(table.loc[name, "value"] - getattr(alone, name)) < 3.5 * table.loc[name, "error"]


def test_fine_nodes_integrate_over_participants_of_many_trials():
    """Against a sum over SSRTs 2 ms apart; the usual nodes are too far apart by far."""
    people = raced(7, people=3, trials=900, true=TRUE)
    data, values = stop_data(people, slowed=False), replace(TRUE, ssrt_people_sd_ms=60.0)
    usual = StopLikelihood(data, TEST, go_processes(people))
    fine = replace(usual, fine=True)
    places = np.arange(-300.0, 300.1, 2.0)
    weights = np.exp(-((places / 60.0) ** 2) / 2)
    alone = replace(values, ssrt_people_sd_ms=0.0)
    each = [fine.each(replace(alone, ssrt_ms=values.ssrt_ms + place)) for place in places]
    exact = logsumexp(each, axis=0, b=(weights / weights.sum())[:, None])
    np.testing.assert_allclose(fine.each(values), exact, atol=0.02)
    assert np.abs(usual.each(values) - exact).max() > 0.2


def test_few_participants_of_many_trials_are_fitted_with_fine_nodes():
    fit = fit_stops(raced(7, people=2, trials=600), slowed=False)
    assert fit.likelihood.fine
    assert np.isnan(fit.errors["ssrt_ms"])  # five numbers of two people


def test_differences_between_people_are_seen_in_the_likelihood(people, unknown):
    apart, shared = (
        fit_stops(people, spread=spread, slowed=False, go=unknown) for spread in (True, False)
    )
    assert apart.log_likelihood > shared.log_likelihood + 5
    assert set(shared.errors) == {"ssrt_ms", "ssrt_trial_sd_ms", "failures"}


@pytest.fixture(scope="module")
def both_halves(people, unknown):
    """Return fits of either half of the trials, and what they predict of the other."""
    return halves(people, slowed=False, go=unknown)


def test_one_half_predicts_the_other_if_the_race_is_right(people, both_halves):
    for fit, found in both_halves.values():
        assert abs(found.bias) < 0.03
        assert found.p > 0.01
        assert found.largest < 0.11
        assert abs(found.late_ms) < 20
        assert found.deciles["trials"].sum() + len(fit.likelihood.data.ssd_ms) == sum(
            each.stop.sum() for each in people.values()
        )


def test_shuffled_delays_are_not_predicted(people, unknown, both_halves):
    """Negative control: outcomes that do not depend on the delay contradict the closed form."""
    rng = np.random.default_rng(5)
    shuffled = {}
    for who, trials in people.items():
        ssd = trials.ssd_ms.copy()
        ssd[trials.stop] = rng.permutation(ssd[trials.stop])
        shuffled[who] = replace(trials, ssd_ms=ssd)
    fit, _ = both_halves["odd"]
    worse, prediction = halves(shuffled, slowed=False, go=unknown)["odd"]
    assert worse.log_likelihood < fit.log_likelihood - 100
    assert prediction.deciles["predicted"].std() < 0.1


def diffusion(noise_nats=2.0):
    """Return data of two people whose thresholds are 0.3 and 0.2 nats, and their likelihood."""
    rng = np.random.default_rng(2)
    go = 350 + rng.gamma(2.0, 60.0, 400)
    ssd = np.append(np.full(400, np.nan), [150.0, 250.0, 350.0, 450.0])
    trials = StopTrials(np.append(go, np.full(4, np.nan)), ssd)
    people = {"a": trials, "b": trials}
    bounds = [-np.log(np.expm1(theta)) / noise_nats for theta in (0.3, 0.2)]
    table = pd.DataFrame({"participant_id": list("ab"), "sensitivity": 3.0, "bound": bounds,
                       "t0_s": 0.3, "t0_sd_s": 0.03})  # fmt: skip
    model = StopModel("circuit", noise_nats, np.arange(1.0, 201.0), np.linspace(0.005, 1, 200))
    return StopLikelihood(stop_data(people, slowed=False), model, table)


def test_a_weak_stop_blocks_those_below_its_strength_and_delays_the_others():
    likelihood = diffusion()
    assert likelihood.thresholds == pytest.approx([0.3, 0.2])
    blocked, weak, none = (likelihood.responses(a)[:, -200] for a in (0.4, 0.25, 0.0))
    at = likelihood.data.go_below[:, -200]
    assert blocked == pytest.approx(at)
    assert weak[1] == at[1]
    assert at[0] <= weak[0]
    early = likelihood.data.grid_ms.searchsorted(400)
    below, raised = likelihood.data.go_below[0, early], likelihood.responses(0.25)[0, early]
    assert below < raised < likelihood.responses(0.1)[0, early] <= none[0] + 1e-9


def test_the_latency_of_a_stop_is_that_at_the_threshold():
    likelihood = diffusion()
    # c rises by 0.5 % of the strength per ms.
    assert likelihood.latency_ms(0.6) == pytest.approx([100.0, 0.2 / 0.6 * 200], abs=1.5)
    assert likelihood.latency_ms(0.25) == pytest.approx([100.0, 160.0], abs=1.5)
    assert likelihood.latency_ms(np.inf).tolist() == [0, 0]
    assert replace(likelihood, model=TEST).latency_ms(1.0).tolist() == [0, 0]


def test_the_circuits_stop_is_its_step_response():
    model = circuit_stop()
    assert model.name == "macaque"
    assert model.added[-1] == pytest.approx(1.0, abs=0.01)
    theta = np.array([0.2])
    assert model.latency_ms(theta, 1.0) < model.latency_ms(theta, 0.3)


def test_slowing_after_stops_is_taken_out_of_go_times_and_put_into_stop_trials():
    #      go   stop   go   stop  stop
    rt = [400.0, 350, 460] + [400.0] * 12 + [np.nan, 380.0]
    ssd = [np.nan, 200.0, np.nan] + [np.nan] * 12 + [250.0, 250.0]
    data = stop_data({"a": StopTrials(rt, ssd)})
    assert data.slower_ms.tolist() == [0.0, 0.0, 0.0]
    assert data.go_ms[0].tolist() == [400.0] * 14
    again = StopTrials([*rt, 480.0, 350.0, 300.0], [*ssd, np.nan, 200.0, 200.0])
    data = stop_data({"a": again})
    # After failed stops go responses are 60 and 80 ms later.
    assert data.slower_ms.tolist() == [0, 0, 0, 0, 70]
    assert stop_data({"a": again}, slowed=False).slower_ms.max() == 0


def test_a_go_process_is_found_in_a_persons_go_trials():
    rng = np.random.default_rng(3)
    v, a, t0, dt = 3.0, 0.5, 0.3, 1e-3
    x, rt = np.zeros(400), np.full(400, np.nan)
    for step in range(4000):
        x = np.where(np.isnan(rt), x + v * dt + np.sqrt(dt) * rng.standard_normal(400), x)
        rt = np.where(np.isnan(rt) & (np.abs(x) >= a), step * dt + t0, rt)
    trials = StopTrials(1000 * rt, np.full(400, np.nan), x > 0)
    never = StopTrials(np.full(9, np.nan), np.full(9, np.nan), np.zeros(9, bool))
    people = {"a": trials, "b": replace(trials, correct=None), "c": never}
    found = go_processes(people)
    assert list(found) == ["participant_id", *GO]
    assert found.loc[0, "sensitivity"] == pytest.approx(v, abs=0.5)
    assert found.loc[0, "bound"] == pytest.approx(a, abs=0.07)
    assert found.loc[1:, list(GO)].isna().all(axis=None)


def test_people_without_enough_trials_are_left_out():
    few = StopTrials([400.0, 300.0], [np.nan, 200.0])
    with pytest.warns(DataWarning, match="1 participants without stop trials or with fewer"):
        assert stop_data({**raced(2, people=1), "few": few}).names == ("p0",)
    with refused("people must have a participant with stop trials and 10 go responses"):
        stop_data({"few": few})

"""The likelihood against its definition, and its limits."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm

import bgmodel as bg
from bgmodel.evidence import minus_log_softmax
from bgmodel.fit_trials import question
from bgmodel.fitting.known.known_likelihood import OnTrials, known_likelihood
from bgmodel.fitting.known.models import EXACT, runs_of_cues
from bgmodel.fitting.known.trials import known_design, known_trials
from bgmodel.fitting.misfit import misfit
from bgmodel.fitting.optimum import Optimum, optimum
from bgmodel.fitting.posterior import directions
from bgmodel.fitting.settings import settings_of
from bgmodel.trials.reader import read_trials
from bgmodel.trials.record import joined
from circuits.errors import DataWarning, collected
from tests.known_trials import TRUTH, few, simulated
from tests.trials.test_timed_readings import clicked, tables

VALUES = {
    "gain": 0.8, "leak_hz": 0.0, "threshold": 0.5, "noise": 0.2, "urgency": 0.3, "run_effect": 0.1,
    "bias_b": 0.1, "bias_c": -0.2, "t0_s": 0.2, "t0_sd_s": 0.06, "lapse": 0.05,
}  # fmt: skip


def vector_of(likelihood, values):
    return np.array([values[name] for name in likelihood.freedom.names])


def test_it_is_the_sum_over_readings_of_hazard_and_non_decision_time():
    """Without a response it is the probability of no decision."""
    trials, none = few(), np.arange(20) < 5
    choice, rt_s = np.where(none, -1, trials.choice), np.where(none, np.nan, trials.rt_s)
    trials = replace(trials, choice=choice, rt_s=rt_s)
    likelihood = known_likelihood(EXACT["msprt"], trials, free=list(VALUES))
    log_density = likelihood.each(vector_of(likelihood, VALUES))
    out = minus_log_softmax(0.8 * np.cumsum(trials.log_likelihood, axis=1))
    out = out - 0.1 * np.maximum(runs_of_cues(trials.log_likelihood) - 1, 0)
    for trial in range(trials.trials):
        alive, density = 1.0, 0.0
        for k in range(3):
            time_s = trials.time_s[trial, k]
            past = (0.5 + 0.3 * time_s + np.array([0, 0.1, -0.2]) - out[trial, k]) / 0.2
            hazard = np.exp(past) / (1 + np.exp(past).sum())
            late = norm.pdf(trials.rt_s[trial], time_s + 0.2, 0.06)
            density += alive * hazard[trials.choice[trial]] * late
            alive *= 1 - hazard.sum()
        response = 0.95 * density + 0.05 / (3 * np.nanmax(trials.rt_s))
        expected = 0.95 * alive if none[trial] else response
        assert log_density[trial] == pytest.approx(np.log(expected))


def test_two_alternatives_without_leak_and_noise_decide_alike_in_test_and_leaky_sum():
    trials = simulated(200)
    odds = 1.5
    values = {"leak_hz": 0.0, "urgency": 0.0, "run_effect": 0.0, "bias_1": 0.0, "gain": 1.0}
    test = known_likelihood(EXACT["msprt"], trials)
    leaky = known_likelihood(EXACT["leaky_sum"], trials)
    level = float(np.log1p(np.exp(-odds)))
    first, _ = test.decisions({**values, "threshold": level, "noise": 1e-7})
    second, _ = leaky.decisions({**values, "threshold": odds / 2, "noise": 1e-7})
    np.testing.assert_allclose(first, second, atol=1e-6)


def common(trials):
    return trials.log_likelihood + np.random.default_rng(1).normal(size=(60, 40, 1))


def late(trials):
    unseen = np.arange(40) >= trials.seen[:, None]
    return np.where(unseen[:, :, None], 9.0, trials.log_likelihood)


def test_a_size_of_cues_that_is_assumed_is_said_where_it_matters():
    data, cues = clicked(swapped=False)

    def doubts(model, cues=cues, **options):
        with collected(DataWarning) as said:
            question(settings_of(evidence=cues, **options), data, [model])
        return [each for each in said if "+gain" in each]

    assert len(doubts("msprt")) == 1
    assert not doubts("leaky_sum") + doubts("run") + doubts("msprt", free="+gain")
    assert not doubts("msprt", fix={"gain": 0.5}) + doubts("msprt", cues.assign(value=0.5))

    def heights(value, **values):
        read = read_trials(data, evidence=cues.assign(value=value))
        likelihood = known_likelihood(EXACT["msprt"], known_trials(read), free=["+gain"])
        every = dict(zip(likelihood.freedom.names, likelihood.freedom.start, strict=True))
        return likelihood(np.array(list((every | values).values())))

    assert heights(1.0, gain=1.0) == pytest.approx(heights(0.5, gain=2.0))
    assert abs(heights(1.0, gain=1.0) - heights(0.5, gain=1.0)) > 1


def test_a_search_does_not_depend_on_the_zero_of_the_clock():
    trials = simulated(120)
    later = replace(trials, rt_s=trials.rt_s + 2, time_s=trials.time_s + 2)
    slower = replace(trials, rt_s=trials.rt_s + 0.5)
    made, shifted, other = (
        known_likelihood(EXACT["msprt"], each).starts() for each in (trials, later, slower)
    )
    np.testing.assert_allclose(shifted, made)
    assert not np.allclose(other, made)


@pytest.mark.parametrize("model", list(EXACT))
@pytest.mark.parametrize("changed", [common, late])
def test_evidence_common_to_all_alternatives_or_after_the_response_changes_nothing(model, changed):
    trials = simulated(60)
    every = trials, replace(trials, log_likelihood=changed(trials))
    first, second = (known_likelihood(EXACT[model], each) for each in every)
    start = first.freedom.start
    np.testing.assert_allclose(first.each(start), second.each(start), atol=1e-8)


def test_gain_is_free_and_biases_are_not_if_there_are_more_than_two_alternatives():
    trials = simulated(60)
    names = known_likelihood(EXACT["msprt"], trials).freedom.names
    assert "gain" not in names
    assert "bias_1" in names
    added = known_likelihood(EXACT["msprt"], trials, free=["+gain"]).freedom.names
    assert set(added) == {*names, "gain"}
    of_three = known_likelihood(EXACT["msprt"], few()).freedom.names
    assert "gain" in of_three
    assert "bias_b" not in of_three


@pytest.mark.parametrize("channels", [2, 4])
def test_parameters_of_the_test_are_found_again(channels):
    peak = optimum(known_likelihood(EXACT["msprt"], simulated(300, 11, channels=channels)))
    there = directions(peak.likelihood, peak.vector)
    for name, value, error in zip(there.names, peak.vector, there.standard_errors, strict=True):
        if name in TRUTH and name != "lapse":
            assert abs(value - TRUTH[name]) < 3.5 * error
            assert error < 0.5 * TRUTH[name]
    assert peak.log_likelihood >= peak.likelihood(truth_of(peak.likelihood)) - 1e-6


def truth_of(likelihood):
    return np.array([TRUTH.get(name, 0.0) for name in likelihood.freedom.names])


def test_the_probability_of_a_response_by_a_time_is_the_integral_of_its_density():
    """After the last reading, which is then seen in every trial."""
    likelihood, step_s = known_likelihood(EXACT["msprt"], few()), 2e-3
    span, total = likelihood.trials.span_s, 0.0
    for at_s in np.arange(0.3 + step_s / 2, span, step_s):
        trials = replace(likelihood.trials, rt_s=np.append(np.full(19, at_s), span))
        total = total + step_s * replace(likelihood, trials=trials).responses(VALUES)[0]
    ends = likelihood.answered(VALUES, np.tile([0.3, span], (20, 1)))
    np.testing.assert_allclose(total[:19], np.diff(ends, axis=1)[:19, 0], atol=1e-3)


def misfits(channels, ended):
    """Return z scores of accuracy and mean time, and p values, of 30 observers at the truth."""
    zs, ps = [], []
    for seed in range(30):
        trials = simulated(100, 1000 + seed, channels=channels, t_max=150)
        if ended:
            trials = shortened(trials)
        likelihood = known_likelihood(EXACT["msprt"], trials, fixed={"threshold": 0.12})
        checked = misfit(Optimum(likelihood, truth_of(likelihood), 0.0, 1))
        zs.append([checked.z_accuracy[0], checked.z_mean_rt[0]])
        ps.append(list(checked.p.values()))
    return np.array(zs), np.array(ps)


def shortened(trials):
    read = np.arange(trials.time_s.shape[1]) < np.maximum(trials.seen, 1)[:, None]
    return replace(
        trials, lengths=read.sum(axis=1), forced=False,
        time_s=np.where(read, trials.time_s, np.inf),
        log_likelihood=np.where(read[:, :, None], trials.log_likelihood, 0.0),
    )  # fmt: skip


@pytest.mark.parametrize(("channels", "ended"), [(2, False), (2, True), (4, True)])
def test_predictions_are_calibrated_even_if_readings_end_with_the_response(channels, ended):
    zs, ps = misfits(channels, ended)
    assert (abs(zs.mean(axis=0)) < 3 / np.sqrt(30)).all()
    assert (zs.std(axis=0) < 1.5).all()
    assert (ps < 0.05).mean() < 0.15


OBSERVER = {
    "gain": 0.9, "leak_hz": 0.5, "threshold": 0.5, "noise": 0.2, "urgency": 0.1, "run_effect": 0.05,
    "bias_1": 0.1, "t0_s": 0.3, "t0_sd_s": 0.05, "lapse": 0.02,
}  # fmt: skip
FIXED = {name: OBSERVER[name] for name in ("leak_hz", "noise", "t0_s", "t0_sd_s", "lapse")}
FIXED |= {"bias_1": 0.0}


def read(trials=60, seed=51, who="all", **conditions):
    """Return trials with conditions that change nothing, by default c, which alternates."""
    data, evidence = tables(simulated(trials, seed))
    conditions = conditions or {"c": np.resize(["a", "b"], trials)}
    data, evidence = (each.assign(participant_id=who) for each in (data, evidence))
    return bg.read_trials(
        data.assign(**conditions), evidence=evidence, forced=True, conditions=list(conditions)
    )


def likelihood_of(model, trials, by=(), **options):
    known = OnTrials(EXACT[model], known_trials(trials))
    return settings_of(**options).likelihood(known_design(trials, by), known)


@pytest.mark.parametrize("timed", [True, False])
@pytest.mark.parametrize("model", list(EXACT))
def test_each_trial_has_the_parameters_of_its_condition(model, timed):
    data, evidence = tables(simulated(60, 51))
    data = data.assign(c=np.resize(["a", "b", "b"], 60))
    data = data if timed else data.drop(columns="rt")
    trials = bg.read_trials(data, evidence=evidence, forced=True, conditions="c")
    names = [each.name for each in OnTrials(EXACT[model], known_trials(trials)).parameters]
    names = names if timed else [name for name in names if not name.startswith("t0")]
    alone = likelihood_of(model, trials, free=names)
    both = likelihood_of(model, trials, ["c"], vary=dict.fromkeys(names, "c"))
    at = np.array([OBSERVER[name] for name in names])
    values = {"a": at, "b": at * np.linspace(1.1, 1.4, len(at))}
    vector = np.array([values[name[-2]][names.index(name[:-5])] for name in both.freedom.names])
    each, density, cell = both.each(vector), both.density(vector), both.design.observed.cell
    assert both.design.conditions == {"c": ["a", "b"]}
    for k, level in enumerate("ab"):
        some = np.flatnonzero(cell == k)
        assert len(some) == (20, 40)[k]
        np.testing.assert_allclose(each[some], alone.each(values[level])[some])
        expected = alone.part(some).density(values[level])[0]
        np.testing.assert_allclose(density[k], expected, atol=1e-12)
        part = both.part(some)
        np.testing.assert_allclose(part.each(vector), each[some])
        np.testing.assert_array_equal(part.part(np.arange(5)).each(vector), each[some[:5]])


def test_a_condition_with_one_level_changes_nothing():
    data, evidence = tables(simulated(60, 51))
    asked = {"evidence": evidence, "forced": True, "fix": {"lapse": 0.02}}
    plain = bg.fit(data, "msprt", **asked)
    same = bg.fit(data.assign(c="a"), "msprt", vary={"threshold": "c"}, **asked)
    assert same.log_likelihood == plain.log_likelihood
    np.testing.assert_array_equal(same.optimum.vector, plain.optimum.vector)
    assert "threshold[c=a]" in same.summary().index


def test_people_who_are_pooled_are_fitted_as_one():
    people = np.resize(["p", "q"], 40)
    data, evidence = tables(simulated(40, 53))
    data = data.assign(c=np.resize(["a", "a", "b", "b"], 40), participant_id=people)
    evidence["participant_id"] = people[evidence["trial"]]
    asked = {"forced": True, "vary": {"threshold": "c"}, "fix": {**FIXED, "leak_hz": 0.0}}
    pooled = bg.fit(data, "msprt", people="pooled", evidence=evidence, **asked)
    one, other = (each.drop(columns="participant_id") for each in (data, evidence))
    assert pooled.log_likelihood == bg.fit(one, "msprt", evidence=other, **asked).log_likelihood


def test_a_threshold_of_each_condition_is_found_again():
    true = {"threshold[c=a]": 0.8, "threshold[c=b]": 1.2}
    made = bg.simulate("leaky_sum", true, read(200), seed=2, vary={"threshold": "c"}, fix=FIXED)
    fit = bg.fit(made, "leaky_sum", vary={"threshold": "c"}, fix=FIXED)
    table = fit.summary()
    off = table["value"] - pd.Series(true)
    assert (abs(off) < 2 * table["standard_error"]).all()
    assert (table["standard_error"] < 0.1).all()
    cells = fit.cells()
    assert cells["c"].tolist() == ["a", "b"]
    assert cells["model_mean_s"].diff()[1] > 0.1
    assert (abs(cells[["z_accuracy", "z_mean_rt"]]) < 3).all(axis=None)


def test_the_slope_of_a_covariate_is_found_again_and_that_of_another_is_0():
    signal, other = np.random.default_rng(3).normal(size=(2, 200))
    trials = read(200, signal=signal, other=other)
    true = {"threshold[Intercept]": 1.0, "threshold[signal]": 0.15}
    asked = {"formula": "threshold ~ signal + other", "fix": FIXED}
    made = bg.simulate("leaky_sum", true, trials, seed=4, **asked)
    table = bg.fit(made, "leaky_sum", **asked).summary()
    z = (table["value"] - pd.Series({**true, "threshold[other]": 0.0})) / table["standard_error"]
    assert (abs(z) < 2).all()
    assert (table["standard_error"] < 0.05).all()


@pytest.mark.filterwarnings("ignore::circuits.errors.FitWarning")
def test_the_effect_of_a_condition_is_found_again_in_a_group():
    fixed = {**FIXED, "leak_hz": 0.0, "noise": 0.05}
    rng, asked = np.random.default_rng(4), {"formula": "threshold ~ c", "fix": fixed}
    people = []
    for k in range(8):
        effect = 0.1 + 0.02 * rng.normal()
        true = {"threshold[Intercept]": 0.2 + 0.03 * rng.normal(), "threshold[c[T.b]]": effect}
        trials = read(40, 700 + k, who=f"p{k}")
        people.append(bg.simulate("msprt", true, trials, seed=k, **asked))
    asked = {**asked, "people": "hierarchical", "most_draws": 100}
    group = bg.fit(joined(people), "msprt", **asked)
    row = group.summary().loc["threshold[c[T.b]]"]
    assert 0 < row["low"] < 0.1 < row["high"]
    assert group.cells()["c"].tolist() == 8 * ["a", "b"]

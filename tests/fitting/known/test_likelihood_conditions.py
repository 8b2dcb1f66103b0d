"""Parameters of models of known evidence that differ between conditions of the trials."""

import numpy as np
import pandas as pd
import pytest

import bgmodel as bg
from bgmodel.fitting.known.likelihood import OnTrials
from bgmodel.fitting.known.models import EXACT
from bgmodel.fitting.known.trials import known_design, known_trials
from bgmodel.fitting.settings import settings_of
from bgmodel.trials.record import joined
from tests.known_trials import simulated
from tests.trials.test_timed_readings import tables

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
        np.testing.assert_allclose(both.part(some).each(vector), each[some])


def test_two_conditions_without_a_common_parameter_are_two_fits():
    data, evidence = tables(simulated(80, 52))
    data = data.assign(c=np.resize(["a", "b"], 80))
    slowest = data.groupby("c")["rt"].idxmax()
    data.loc[slowest, "rt"] = data["rt"].max()  # lapses extend up to it
    asked = {"evidence": evidence, "forced": True, "fix": {"t0_sd_s": 0.05, "lapse": 0.02}}
    free = ("threshold", "noise", "bias_1", "t0_s")
    both = bg.fit(data, "msprt", vary=dict.fromkeys(free, "c"), **asked)
    total = 0.0
    for level, part in data.groupby("c"):
        seen = evidence["trial"].isin(part["trial"].astype(int))
        alone = bg.fit(part, "msprt", **{**asked, "evidence": evidence[seen]})
        total += alone.log_likelihood
        for name in free:
            error = alone.summary().loc[name, "standard_error"]
            off = alone.optimum.values[name] - both.optimum.values[f"{name}[c={level}]"]
            assert abs(off) < 0.05 * error
    assert both.log_likelihood == pytest.approx(total, abs=0.01)


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

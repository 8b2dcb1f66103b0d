"""Choices without times, and responses that are given by waiting: read, fitted and simulated."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.special import expit

import bgmodel as bg
from bgmodel.fit_trials import question
from bgmodel.fitting.algorithms import GapModel
from bgmodel.fitting.design import FAVOURS, design_of
from bgmodel.fitting.known.known_likelihood import known_likelihood
from bgmodel.fitting.known.models import EXACT
from bgmodel.fitting.known.trials import known_trials
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.model_comparison import predicted
from bgmodel.fitting.responses import responded
from bgmodel.fitting.settings import settings_of
from bgmodel.learning.value_models import LAPSES, MODELS, likelihood
from circuits.errors import DataWarning, FitWarning
from tests.drawn import choices, drawn
from tests.helpers import refused, refusing, told, unwarned

pytestmark = pytest.mark.filterwarnings("ignore:there is no column rt")
STRENGTHS = np.array([0.05, 0.1, 0.2, 0.4])
TRUE = {"sensitivity": 9.0, "lapse": 0.05}
BOUND = 0.7
"""The default of the bound, which choices alone leave open."""
GO = bg.Columns(withheld="no", deadline_s=1.2)
GIVEN = {"sensitivity": 7.0, "bound": 0.6, "t0_s": 0.3, "t0_sd_s": 0.05, "lapse": 0.02}


def table(trials=400, seed=1, people=("a",), spread=0.0, **values):
    """Return choices alone of people, from the closed form of a constant bound."""
    rng = np.random.default_rng(seed)
    truth, parts = {**TRUE, **values}, []
    for who in people:
        strength = np.repeat([*-STRENGTHS, *STRENGTHS], trials // 8)
        drift = truth["sensitivity"] * np.exp(spread * rng.standard_normal()) * strength
        p = (1 - truth["lapse"]) * expit(2 * drift * BOUND) + truth["lapse"] / 2
        responses = (rng.random(len(p)) < p).astype(int)
        rows = {"participant_id": who, "response": responses, "coherence": strength}
        parts.append(pd.DataFrame(rows))
    return pd.concat(parts, ignore_index=True)


def timed(seed=3, trials=300):
    """Return choices with times by a deadline, at two strengths of both signs."""
    return drawn(GapModel(), [0.1, 0.3], trials, seed, deadline_s=1.2, **GIVEN)


def go_table(trials=None):
    """Return trials as a table in which response 0, and none, is "no" without a time."""
    trials = timed() if trials is None else trials
    went = trials.response == 1
    rows = {"response": np.where(went, "go", "no"), "coherence": trials.strength}
    return pd.DataFrame({"rt": np.where(went, trials.rt_s, np.nan), **rows})


def without_times(trials):
    return replace(trials, rt_s=np.full(trials.trials, np.nan))


def fixed_at(likelihood, **values):
    """Return the vector of a fit with some values, others at their start."""
    names = zip(likelihood.freedom.names, likelihood.freedom.start, strict=True)
    return np.array([values.get(name, start) for name, start in names])


# Choices alone.


def test_a_constant_bound_gives_choices_their_closed_form():
    """``1 / (1 + exp(-2 v a))``, whatever the bound: time has no part in it."""
    trials = bg.read_trials(table(), strength="coherence")
    assert not trials.timed
    assert "without times" in trials.summary()
    for bound in (0.3, BOUND, 2.0):
        design = design_of(trials)
        asked = likelihood_of(GapModel(), design, free=["sensitivity"], fixed={"bound": bound})
        drift = 5.0 * trials.strength
        p = 0.99 * expit(2 * drift * bound * (2 * trials.response - 1)) + 0.005
        assert np.allclose(np.exp(asked.each(np.array([5.0]))), p, atol=2e-4)


def test_a_biased_start_gives_choices_their_closed_form():
    """The probability of the upper of two bounds from a start (Wald 1947)."""
    asked = settings_of(free=["sensitivity", "start"], strength="coherence")
    one = question(asked, table(), ["constant_gap"])
    (each,) = one.likelihoods("constant_gap").values()
    assert FAVOURS in each.design.conditions
    trials, z = each.design.choices, 0.4 * BOUND
    drift = 5.0 * trials.strength
    up = np.expm1(-2 * drift * (BOUND + z)) / np.expm1(-4 * drift * BOUND)
    p = 0.99 * np.where(trials.response == 1, up, 1 - up) + 0.005
    likelihoods = np.exp(each.each(fixed_at(each, sensitivity=5.0, start=0.4)))
    assert np.allclose(likelihoods, p, atol=5e-4)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_choices_alone_give_back_sensitivity_and_lapses(seed):
    fit = bg.fit(table(4000, seed), "constant_gap", strength="coherence")
    rows = fit.summary()
    assert rows.index.tolist() == list(TRUE)
    for name, value in TRUE.items():
        assert abs(rows.value[name] - value) < 3.5 * rows.standard_error[name]
    assert min(fit.misfit.p.values()) > 1e-3
    assert fit.cells().mean_s.isna().all()
    assert fit.cells().model_mean_s.isna().all()
    assert np.allclose(fit.cells().accuracy, fit.cells().model_accuracy, atol=0.06)
    assert fit.residuals().empty


def test_what_choices_alone_leave_open_is_said():
    options = {"strength": "coherence"}
    with pytest.warns(FitWarning) as caught:
        fit = bg.fit(table(), "constant_gap", free=["sensitivity", "bound"], **options)
    assert [each.category for each in caught].count(FitWarning) == 1
    assert fit.directions.cosines[0, 1] == pytest.approx(1, abs=1e-4)
    assert (fit.summary().standard_error > fit.summary().value).all()
    for more in ({"free": "+t0_s"}, {"vary": {"t0_sd_s": "cue"}}, {"formula": "t0_s ~ cue"}):
        named = "t0_sd_s" if "vary" in more else "t0_s"
        cue = table().assign(cue=list("ab") * 200)
        with refused(named):
            bg.fit(cue, "constant_gap", **more, **options)
    with refused("rt_window"):
        bg.fit(table(), "constant_gap", rt_window=(0.1, 2.0), **options)


@pytest.mark.parametrize("model", ["falling_gap", "msprt", "race", "lca", "macaque"])
def test_every_model_of_decisions_answers_for_choices_alone(model):
    asked = settings_of(strength="coherence", trials=200)
    one = question(asked, table(80), [model])
    (each,) = one.likelihoods(model).values()
    assert each.freedom.names == ["sensitivity", "lapse"]
    both = without_times(each.design.choices), each.design.choices
    assert both[0].checksum == both[1].checksum
    p = each.density(each.freedom.start) * each.design.grid.width_s
    assert np.allclose(p.sum(axis=(1, 2)), 1)
    assert not p[:, :, 1:].any()
    assert (np.diff(p[:, 1, 0]) > 0).all()


def test_more_than_two_alternatives_share_what_is_not_correct():
    rng = np.random.default_rng(1)
    shown = rng.integers(4, size=200)
    chosen = np.where(rng.random(200) < 0.6, shown, rng.integers(4, size=200))
    data = pd.DataFrame({"response": [f"r{k}" for k in chosen], "shown": [f"r{k}" for k in shown]})
    columns = bg.Columns(stimulus="shown")
    fit = bg.fit(data, "race", columns=columns, fix={"lapse": 0.01})
    (row,) = fit.cells().itertuples()
    assert row.model_accuracy == pytest.approx(row.accuracy, abs=1e-3)
    answers = [row.accuracy, *3 * [(1 - row.accuracy) / 3]]
    most = 200 * (np.array(answers) @ np.log(answers))
    assert fit.log_likelihood == pytest.approx(most, abs=0.01)


def test_what_is_simulated_without_times_has_none_and_fits():
    trials = bg.read_trials(table(2000), strength="coherence")
    made = bg.simulate("constant_gap", {"sensitivity": 6.0}, trials, seed=1)
    assert not made.timed
    assert (made.response >= 0).all()
    estimates = bg.fit(made, "constant_gap").summary()
    assert abs(estimates.value.sensitivity - 6) < 3.5 * estimates.standard_error.sensitivity
    one = question(settings_of(), made, ["constant_gap"]).likelihoods("constant_gap")["a"]
    assert np.isfinite(predicted(one).each).all()


def test_a_learner_needs_no_times():
    """A softmax of values: log odds 2 v a, with v the difference of values times its scale."""
    rng = np.random.default_rng(5)
    data = pd.DataFrame({"response": rng.integers(2, size=120), "pair": list("AB") * 60})
    data["reward"] = (rng.random(120) < 0.2 + 0.6 * data.response).astype(int)
    with unwarned():
        trials = bg.read_trials(data.assign(rt=np.nan))
    each = likelihood("q", trials)
    assert each.freedom.names == ["rate", "scale", "stickiness"]
    vector = np.array([0.3, 2.0, 0.0])
    drift, bound, *_ = each.model.diffusion(trials, each.values(vector))
    p = (1 - LAPSES) * expit(2 * drift * bound * (2 * trials.response - 1)) + LAPSES / 2
    assert np.allclose(each.each(vector), np.log(p))
    fit = bg.fit(trials, "q")
    assert np.isfinite(fit.log_likelihood)
    assert min(fit.misfit.p.values()) > 1e-3
    assert not MODELS["q"].simulate(trials, each.values(vector), rng).timed


# Known evidence.


def readings(trials=300, drift=0.4, steps=8, seed=2, noise=0.0):
    """Return choices by the sign of all readings, and these: a walk with a drift, every 0.1 s."""
    rng = np.random.default_rng(seed)
    side = rng.choice([-1, 1], trials)
    value = 0.1 * drift * side[:, None] + np.sqrt(0.1) * rng.standard_normal((trials, steps))
    total = value.sum(axis=1)
    upper = total + noise * rng.logistic(size=trials) > 0
    number, place = np.divmod(np.arange(trials * steps), steps)
    evidence = pd.DataFrame({"trial": number, "time": 0.1 * (place + 1), "value": value.ravel()})
    return pd.DataFrame({"trial": range(trials), "response": upper * 1}), evidence, total, side


UPPER = bg.Columns(upper="1")


def test_choices_at_the_end_of_known_evidence_are_a_logistic_regression_on_its_sum():
    data, evidence, total, _ = readings()
    trials = bg.read_trials(data, evidence=evidence, forced=True, columns=UPPER)
    model, held = EXACT["leaky_sum"], {"threshold": 100.0, "leak_hz": 0.0, "lapse": 0.001}
    each = question(settings_of(fix=held), trials, ["leaky_sum"]).likelihoods("leaky_sum")["all"]
    assert each.freedom.names == ["noise", "bias_1"]
    p = 0.999 * expit(total * (2 * trials.response - 1) / 0.5) + 0.0005
    assert np.allclose(each.each(np.array([0.5, 0.0])), np.log(p), atol=1e-6)
    known = known_trials(trials)
    assert known_likelihood(model, known, fixed=held).freedom.names == ["noise", "bias_1"]


def test_noise_of_choices_at_the_end_is_recovered_checked_and_simulated():
    data, evidence, *_ = readings(1500, noise=0.4)
    options = {"evidence": evidence, "forced": True, "columns": UPPER}
    held = {"threshold": 100.0, "leak_hz": 0.0, "lapse": 0.001}
    fit = bg.fit(data, "leaky_sum", fix=held, **options)
    row = fit.summary().loc["noise"]
    assert abs(row.value - 0.4) < 3.5 * row.standard_error
    assert min(fit.misfit.p.values()) > 1e-3
    fit.plot()
    made = bg.simulate("leaky_sum", {**held, "noise": 0.4}, data, seed=1, **options)
    assert not made.timed
    assert (made.response >= 0).all()
    with refused("t0_s"):
        bg.fit(data, "leaky_sum", free="+t0_s", **options)


def test_a_threshold_that_is_never_reached_is_said_to_be_open():
    data, evidence, *_ = readings(400, noise=0.4)
    options = {"evidence": evidence, "forced": True, "columns": UPPER}
    texts = told(lambda: bg.fit(data, "leaky_sum", **options))
    assert any("threshold" in each for each in texts)


# Responses that are withheld.


def test_waiting_has_the_probability_of_its_bound_and_of_no_decision():
    trials = bg.read_trials(go_table(), strength="coherence", columns=GO)
    assert trials.withheld == 0
    assert trials.timed
    each = likelihood_of(GapModel(), design_of(trials))
    vector = fixed_at(each, **GIVEN)
    design = each.design
    values = {name: np.full(2 * len(design.side) // 2, v) for name, v in GIVEN.items()}
    every = responded(
        GapModel().decided(values, design.strength, design.grid), design.grid,
        **{name: values[name] for name in ("t0_s", "t0_sd_s", "lapse")},
    )  # fmt: skip
    went = np.where(design.side > 0, every[:, 1].sum(axis=1), every[:, 0].sum(axis=1)) * 0.01
    waited = trials.response == 0
    likelihoods = np.exp(each.each(vector))
    assert np.allclose(likelihoods[waited], (1 - went)[design.observed.cell[waited]])
    # Others have the density that they would have if both responses had times.
    both = likelihood_of(GapModel(), design_of(replace(
        trials, withheld=None, rt_s=np.where(waited, 0.5, trials.rt_s))))  # fmt: skip
    assert np.allclose(likelihoods[~waited], np.exp(both.each(vector))[~waited])


@pytest.mark.parametrize("seed", [3, 4])
def test_a_go_no_go_task_gives_back_its_parameters(seed):
    data = go_table(timed(seed, 1000))
    with unwarned():
        fit = bg.fit(data, "constant_gap", strength="coherence", columns=GO)
    rows = fit.summary()
    for name, value in GIVEN.items():
        assert abs(rows.value[name] - value) < 3.5 * rows.standard_error[name]
    assert min(fit.misfit.p.values()) > 1e-3
    cells = fit.cells()
    assert (cells.answered == cells.trials).all()
    assert cells.correct_s.isna().tolist() == (cells[FAVOURS] == "0").tolist()
    made = bg.simulate("constant_gap", GIVEN, fit.optimum.likelihood.design.choices, seed=1)
    assert made.withheld == 0
    assert np.array_equal(np.isnan(made.rt_s), made.response == 0)


def test_which_response_waits_is_read_from_names_and_codes():
    names = go_table()
    codes = names.assign(response=(names.response == "go").astype(int))
    empty = names.assign(response=names.response.where(names.response == "go", None))
    read = {"strength": "coherence"}
    first = bg.read_trials(names, columns=GO, **read)
    for data, columns in (
        (codes, replace(GO, withheld="0")), (empty, GO), (names, replace(GO, upper="go")),
    ):  # fmt: skip
        assert bg.read_trials(data, columns=columns, **read).checksum == first.checksum
    other = bg.read_trials(names, columns=replace(GO, upper="no"), **read)
    assert other.withheld == 1
    assert np.array_equal(other.response, 1 - first.response)
    assert other.checksum != first.checksum


# What can't be read.


def mixed(participant):
    """Read trials of two people, one of them without times."""
    data = table(people="ab")
    rt = np.where(data.participant_id == "a", 0.6, np.nan)
    return bg.read_trials(data.assign(rt=rt), participant=participant, strength="coherence")


def alone(**changed):
    return bg.read_trials(table().assign(**changed), strength="coherence")


def waiting(change):
    return bg.read_trials(change(go_table()), strength="coherence", columns=GO)


def withheld(rt_s, **more):
    return replace(choices([0.1, -0.1], [1, 0]), withheld=0, rt_s=np.array(rt_s), **more)


test_missing_times_that_are_wrong_are_refused = refusing(
    (lambda: mixed(None), "rt"),
    (lambda: mixed("b"), "rt"),
    (lambda: alone(RT_ms=500.0), "rt"),
    (lambda: bg.read_trials(table(), columns=bg.Columns(deadline_s=1.0)), "deadline_s"),
    (lambda: alone(response=lambda t: t.response.where(t.index > 5)), "response"),
    (lambda: bg.Columns(withheld="no"), "deadline_s"),
    (lambda: bg.Columns(withheld="no", deadline_s=1.0, stimulus="shown"), "stimulus"),
    (lambda: bg.Columns(withheld=0, deadline_s=1.0), "withheld"),
    (lambda: waiting(lambda t: t.fillna({"rt": 1.2})), "rt"),
    (lambda: waiting(lambda t: t.assign(rt=t.rt.where(t.rt > 0.5))), "rt"),
    (lambda: waiting(lambda t: t[t.response == "go"]), "withheld"),
    (lambda: waiting(lambda t: t.replace({"response": {"no": "nogo"}})), "withheld"),
    (lambda: waiting(lambda t: t.assign(rt=np.nan)), "withheld"),
    (lambda: withheld([0.5, np.nan]), "deadline_s"),
    (lambda: withheld([0.5, 0.6], deadline_s=1.0), "rt_s"),
)


def test_a_missing_column_of_times_is_doubted_and_an_empty_one_is_not():
    with pytest.warns(DataWarning, match="no column rt"):
        alone()
    with unwarned():
        alone(rt=np.nan)


def test_without_times_and_responses_the_columns_that_are_there_are_listed():
    table = pd.DataFrame({"who": ["a"] * 20, "key": [0, 1] * 10})
    with refused("rt no column rt or response; there are who, key; name yours"):
        bg.read_trials(table)

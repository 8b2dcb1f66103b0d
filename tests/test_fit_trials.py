"""The front door: every kind of trials, and what is refused."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

import bgmodel as bg
from bgmodel.fit_trials import question
from bgmodel.fitting.hierarchy.group import Scale, priors_of
from bgmodel.fitting.known.known_circuit import KnownCircuit
from bgmodel.fitting.known.known_likelihood import known_likelihood
from bgmodel.fitting.known.models import EXACT
from bgmodel.fitting.known.trials import known_trials
from bgmodel.fitting.person_fit import Fit
from bgmodel.fitting.settings import settings_of
from bgmodel.fitting.stop_race import likelihood as stop_likelihood
from bgmodel.learning.value_models import likelihood
from bgmodel.trials.record import joined
from circuits.declaration.table_writer import write
from circuits.errors import DataWarning, FitWarning
from tests.helpers import refused, refusing
from tests.known_trials import simulated
from tests.stop_trials import table_of as stop_table
from tests.trials.test_timed_readings import tables

DATA, EVIDENCE = tables(simulated(60, 51))


def of_people(count, trials):
    """Return trials and their readings of people in one table each, and those of each person."""
    parts = [tables(simulated(trials, 50 + k)) for k in range(count)]
    data, evidence = (
        pd.concat([part[k].assign(participant_id=f"p{who}") for who, part in enumerate(parts)])
        for k in (0, 1)
    )
    return data, evidence, parts


def test_a_fit_with_evidence_is_of_single_trials():
    fit = bg.fit(DATA, "msprt", evidence=EVIDENCE, fix={"lapse": 0.02}, forced=True)
    assert isinstance(fit, Fit)
    likelihood = fit.optimum.likelihood
    assert likelihood.trials.trials == 60
    assert set(likelihood.values(fit.optimum.vector)["lapse"]) == {0.02}
    assert fit.summary().index.tolist() == likelihood.freedom.names
    assert set(likelihood.freedom.names) <= set(fit.facts())
    figure = fit.plot()
    assert [ax.get_title("left")[:1] for ax in figure.axes] == ["a", "b", "c"]
    plt.close(figure)


@pytest.mark.parametrize(
    ("options", "number"), [({"free": "+gain"}, "gain"), ({"vary": {"gain": "c"}}, r"gain\[c=b\]")]
)
def test_what_two_alternatives_can_not_give_warns(options, number):
    data = DATA.assign(c=np.resize(["a", "b"], len(DATA)))
    with pytest.warns(FitWarning, match=f"hardly identify {number} "):
        bg.fit(data, "msprt", evidence=EVIDENCE, forced=True, **options)


def test_draws_are_of_the_posterior():
    fixed = {"lapse": 0.02, "t0_sd_s": 0.05, "bias_1": 0.0, "t0_s": 0.3}
    asked = {"evidence": EVIDENCE, "forced": True, "fix": fixed, "draws": True}
    fit = bg.fit(DATA, "msprt", **asked)
    spread, error = fit.posterior.draws.std(axis=0), fit.directions.standard_errors
    np.testing.assert_allclose(spread, error, rtol=0.4)


TWO = DATA.assign(x="a", half=np.resize(["a", "b"], len(DATA)))
TWO["gap"] = np.where(np.arange(len(DATA)) == 3, None, "a")
test_options_that_make_no_sense_are_refused = refusing(
    ({"strength": "coherence"}, "strength"),
    ({"mechanism": "dopamine"}, "mechanism"),
    ({"most_draws": 9}, "most_draws"),
    ({"formula": "threshold ~ x"}, "formula needs two values of 'x'"),
    ({"vary": {"speed": "x"}}, "vary must name a parameter"),
    ({"vary": {"noise": "block"}}, "block there is no column block"),
    ({"vary": {"noise": "gap"}}, "gap must be given for every trial, got nothing in row 3"),
    ({"free": ["+speed"]}, "free"),
    ({"free": ["+gain", "leak_hz"]}, "free"),
    ({"fix": {"speed": 1.0}}, "fix"),
    ({"fix": {"lapse": 0.9}}, "lapse"),
    ({"model": "macaque", "runs": 2}, "runs"),
    ({"model": "macaque", "vary": {"leak_hz": "half/b"}}, "free leak_hz of a circuit"),
    ({"step_ms": 50.0}, "step_ms"),
    of=lambda options: bg.fit(TWO, **{"model": "msprt", "evidence": EVIDENCE, **options}),
)


test_options_of_evidence_need_evidence = refusing(
    *((name, name) for name in ("step_ms", "forced", "runs")),
    of=lambda option: bg.fit(DATA, **{option: 9}),
)


def test_models_are_known_by_name_and_circuits_by_their_file(tmp_path):
    asked = settings_of(evidence=EVIDENCE, runs=9, seed=3)
    file = write(bg.load_circuit("spiking_msprt", 2), tmp_path / "own.toml")
    one = question(asked, DATA, ["run", "macaque", str(file)])
    assert one.versions["run"][1].model.name == "run"
    for name, circuit in (("macaque", "macaque"), (str(file), "spiking_msprt")):
        made = one.versions[name][1].model
        assert isinstance(made, KnownCircuit)
        assert (made.circuit.name, made.circuit.channels) == (circuit, 2)
        assert (made.runs, made.seed) == (9, 3)


def test_a_group_with_known_evidence_is_fitted_with_what_differs_between_people():
    data, evidence, parts = of_people(4, 60)
    data = data.assign(group=data["participant_id"].map(lambda who: "ab"[int(who[1]) % 2]))
    asked = {"evidence": evidence, "forced": True, "people": "hierarchical"}
    one = question(settings_of(formula="threshold ~ group", **asked), data, ["msprt"])
    likelihoods = one.likelihoods("msprt")
    assert list(likelihoods) == ["p0", "p1", "p2", "p3"]
    assert one.predictors(likelihoods).names == ("threshold by group[T.b]",)
    scaled = []
    for unit in (1, 100):
        aged = data.assign(age=unit * data["participant_id"].map(lambda who: 20 + int(who[1]) ** 2))
        between = question(settings_of(formula="threshold ~ age", **asked), aged, ["msprt"])
        scaled.append(between.predictors(likelihoods))
    np.testing.assert_allclose(scaled[0].columns, scaled[1].columns)
    assert [float(each.widths[0]) for each in scaled] == [9, 900]
    for who, (rows, readings) in enumerate(parts):
        alone = bg.read_trials(rows, evidence=readings, forced=True)
        made = known_likelihood(EXACT["msprt"], known_trials(alone))
        start = made.freedom.start
        np.testing.assert_array_equal(likelihoods[f"p{who}"].each(start), made.each(start))


def test_trials_that_were_read_are_fitted_as_their_tables_are():
    read = bg.read_trials(DATA, evidence=EVIDENCE, forced=True)
    assert read.kind == "known evidence"
    options = {"free": ["threshold", "noise"], "fix": {"t0_s": 0.3}}
    first = bg.fit(DATA, "msprt", evidence=EVIDENCE, forced=True, **options)
    second = bg.fit(read, "msprt", **options)
    np.testing.assert_array_equal(first.optimum.vector, second.optimum.vector)
    with refused("evidence"):
        bg.fit(read, "msprt", evidence=EVIDENCE)


def test_rewarded_choices_are_fitted_by_learners():
    trials = bg.read_trials("pedersen_frank_2020", participant="3")
    assert trials.kind == "rewarded choices"
    fit = bg.fit(trials, "q", free=["rate", "scale"])
    assert fit.summary().index.tolist() == ["rate", "scale"]
    likely = likelihood("q", trials, free=["rate", "scale"])
    assert fit.log_likelihood == pytest.approx(likely(fit.optimum.vector))
    for options in ({"model": "macaque"}, {"engine": "rate"}, {"people": "pooled"}):
        with refused(next(iter(options))):
            bg.fit(trials, **{"model": "q", **options})


def test_stop_signal_trials_are_fitted_by_their_stop_process():
    """Also by conditions; where a signal of the evidence can hold no place, it is refused."""
    table = stop_table(people=1).assign(drug=lambda t: np.resize(["on", "off"], len(t)))
    table["stimulus"] = np.resize(["left", "left", "right"], len(table))
    table["response"] = table["stimulus"].where(table["rt"].notna())
    fit = bg.fit(table, "constant_gap", vary={"ssrt_ms": "drug"}, fix={"failures": 0.02})
    assert fit.summary().index.tolist() == ["ssrt_ms[drug=off]", "ssrt_ms[drug=on]", "ssrt_sd_ms"]
    likely = stop_likelihood("constant_gap", bg.read_trials(table), fixed={"failures": 0.02})
    alike = bg.fit(table, "constant_gap", fix={"failures": 0.02})
    assert alike.log_likelihood == pytest.approx(likely(alike.optimum.vector))
    assert fit.log_likelihood >= alike.log_likelihood - 0.1
    cells = alike.cells()  # every response is correct in the data, and so in the model
    assert cells["model_wrong_s"].isna().all()
    assert cells["model_correct_s"].between(0.3, 0.6).all()
    for options in ({"engine": "rate"}, {"people": "pooled"}, {"rt_window": (0.1, 2.0)}):
        with refused(next(iter(options))):
            bg.fit(table, "constant_gap", **options)
    with refused("ssd"):
        bg.fit(table[table["ssd"].isna()], "constant_gap")


def test_each_of_several_people_is_fitted_as_alone_and_kept_in_a_folder(tmp_path, monkeypatch):
    """The same call then fits nothing; the tables are those of the command."""
    table, options = stop_table(people=2), {"free": ["ssrt_ms"]}
    asked = {**options, "people": "each", "folder": tmp_path / "fits"}
    fits = bg.fit(table, "constant_gap", **asked)
    alone = bg.fit(table, ["constant_gap"], participant="p1", **options).fits["constant_gap"]["p1"]
    pd.testing.assert_frame_equal(fits.fits["constant_gap"]["p1"].parameters(), alone.parameters())
    written = pd.read_csv(tmp_path / "fits" / "parameters.csv")
    pd.testing.assert_frame_equal(written, fits.to_dataframe(), check_dtype=False)
    assert (tmp_path / "fits" / "p0.png").is_file()
    monkeypatch.setattr("bgmodel.fit_trials.fit_likelihood", None)
    again = bg.fit(table, "constant_gap", **asked)
    pd.testing.assert_frame_equal(again.cells(), fits.cells())
    with refused("compare"):
        bg.fit(table, "constant_gap", **asked, compare=True)
    with refused("folder"):
        bg.fit(table, "constant_gap", **asked, prior={"ssrt_ms": (100, 300)})


def test_people_with_too_few_stop_trials_are_left_out_of_a_group():
    table = stop_table(people=4)
    few = table["participant_id"].eq("p3") & table["ssd"].notna()
    one = question(settings_of(people="hierarchical"), table[~few], ["constant_gap"])
    with pytest.warns(DataWarning, match="p3"):
        assert list(one.likelihoods("constant_gap")) == ["p0", "p1", "p2"]
    assert one.estimates()["participant"].tolist() == ["p0", "p1", "p2", "p3"]


MONKEYS, LEARNERS = "roitman_shadlen_2002", "pedersen_frank_2020"
# Parameters of the models that the command compares by default are none of it.
test_a_fit_without_a_model_asks_of_its_default_alone = refusing(
    (lambda: bg.fit(MONKEYS, participant="b", free=["bound"]), "free"),
    (lambda: bg.fit(LEARNERS, participant="3", free=["drift"]), "free"),
    (lambda: bg.fit(MONKEYS), "participant"),
    (lambda: bg.fit(LEARNERS, model="q", vary={"bound": "day"}), "day"),
)


GAP = {"sensitivity": 12.0, "bound": 0.8, "t0_s": 0.3, "lapse": 0.01, "start": 0.0}
MONKEY = {"strength": "coherence", "participant": "b"}


def test_simulated_choices_have_the_accuracy_and_the_mean_time_of_the_closed_form():
    """1 / (1 + exp(-2 v a)) and (a / v) tanh(v a), for drift v and half the separation a."""
    values = {**GAP, "t0_sd_s": 0.05, "lapse": 0.001}
    made = bg.simulate("constant_gap", values, "roitman_shadlen_2002", seed=1, **MONKEY)
    again = bg.simulate("constant_gap", values, "roitman_shadlen_2002", seed=1, **MONKEY)
    assert made.checksum == again.checksum
    drift = 12.0 * np.abs(made.strength)
    accuracy = 1 / (1 + np.exp(-2 * 0.8 * drift))
    mean_s = 0.3 + np.where(drift > 0, 0.8 / np.maximum(drift, 1e-9) * np.tanh(0.8 * drift), 0.64)
    for strength in np.unique(drift):
        some = drift == strength
        error = np.sqrt(accuracy[some] * (1 - accuracy[some]) / some.sum())[0]
        chosen = np.nanmean(made.correct[some]) if strength else made.response[some].mean()
        assert abs(chosen - accuracy[some][0]) < 4 * error + 0.001
        spread = made.rt_s[some].std() / np.sqrt(some.sum())
        assert abs(made.rt_s[some].mean() - mean_s[some][0]) < 4 * spread + 0.005


def test_a_simulation_has_the_values_that_options_fix_too():
    """The trials are read once: what is fixed is added to what the options fix."""
    table, options = bg.read_trials("roitman_shadlen_2002", **MONKEY), {"fix": {"t0_s": 0.9}}
    values = {"sensitivity": 12.0, "start": 0.2}
    made = bg.simulate("constant_gap", values, table, seed=1, **options)
    assert np.nanquantile(made.rt_s, 0.05) > 0.85  # a few are lapses
    even = made.strength == 0
    assert made.response[even].mean() > 0.5


def test_trials_of_people_one_after_the_other_are_those_that_were_read():
    data, evidence, _ = of_people(2, 40)
    rewarded = bg.read_trials("pedersen_frank_2020")
    for trials in (
        bg.read_trials(data, evidence=evidence, forced=True),
        bg.read_trials(stop_table(2)),
        rewarded.where(np.isin(rewarded.participant, ["3", "4"])),
        bg.read_trials("roitman_shadlen_2002", strength="coherence"),
    ):
        assert joined(list(trials.by_participant().values())).checksum == trials.checksum


def test_every_kind_of_trials_is_simulated_for_every_person():
    data, evidence, _ = of_people(2, 40)
    cautious = {"threshold": 0.02, "noise": 0.02}
    known = {"evidence": evidence, "forced": True}
    both = (cautious, {**cautious, "threshold": 0.3})
    slow, fast = (bg.simulate("msprt", values, data, seed=3, **known) for values in both)
    assert slow.people() == fast.people() == ["p0", "p1"]
    assert np.nanmean(slow.rt_s) > np.nanmean(fast.rt_s)
    assert bg.fit(fast.where(fast.participant == "p0"), "msprt", free=["threshold"])
    learned = bg.simulate("q", {"rate": 0.3}, "pedersen_frank_2020", participant="3", seed=4)
    assert learned.kind == "rewarded choices"
    both = ({"ssrt_ms": ms, "failures": 0.01} for ms in (400.0, 100.0))
    slow, fast = (bg.simulate("constant_gap", each, stop_table(2), seed=5) for each in both)
    assert slow.kind == "stop-signal trials"
    failed = [np.isfinite(each.rt_s[~np.isnan(each.ssd_s)]).mean() for each in (slow, fast)]
    assert failed[0] > failed[1] + 0.3
    with refused("fix"):
        bg.simulate("constant_gap", {"speed": 1.0}, "roitman_shadlen_2002", seed=1, **MONKEY)
    with refused(r"values \(bound 0.1 to 8\), got"):
        bg.simulate("constant_gap", {"bound": 99.0}, "roitman_shadlen_2002", seed=1, **MONKEY)


def derivative(log_density, vector, number):
    step = np.eye(len(vector))[number] * 1e-5 * abs(vector[number])
    return (log_density(vector + step) - log_density(vector - step)) / (2 * step[number])


@pytest.mark.parametrize(
    ("data", "model", "prior", "options"),
    [
        ("roitman_shadlen_2002", "macaque", {"threshold_nats": (0.2, 0.4)},
         {"strength": "coherence"}),
        (DATA, "leaky_sum", {"leak_hz": (0.5, 2.0)}, {"evidence": EVIDENCE, "forced": True}),
        (stop_table(), "constant_gap", {"ssrt_ms": (150.0, 300.0)}, {}),
        ("pedersen_frank_2020", "q", {"rate": (0.05, 0.5)}, {}),
    ],
    ids=["choices", "known evidence", "stop signals", "rewards"],
)  # fmt: skip
@pytest.mark.parametrize("people", ["each", "hierarchical"])
def test_every_kind_of_model_has_priors(data, model, prior, options, people):
    """Those of a fit of one person are those of the median person in a hierarchy."""
    asked = settings_of(prior=prior, people=people, **options)
    one = question(asked, data, [model])
    ((name, interval),) = prior.items()
    for each in one.likelihoods(model).values():
        assert each.freedom.priors[name] == pytest.approx(interval)
        k = each.freedom.names.index(name)
        rows = priors_of(each.freedom, Scale.of(each.freedom))
        # Weak priors of the models are of one person.
        assert np.flatnonzero(rows[:, 6]).tolist() == [k]
        parameter = each.freedom.moved[k].parameter
        assert parameter.scaled(interval).mean() == pytest.approx(rows[k, 3])
        # The slope is that of the log density, with weak priors of other numbers.
        at = np.random.default_rng(3).uniform(0.4, 0.6, len(each.freedom.start))
        at = each.freedom.low + at * (each.freedom.high - each.freedom.low)
        slope = [derivative(each.freedom.log_prior, at, number) for number in range(len(at))]
        assert each.freedom.prior_slope(at)[0] == pytest.approx(np.array(slope), rel=1e-5, abs=1e-7)

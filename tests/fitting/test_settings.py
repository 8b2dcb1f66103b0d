"""A fit from a table, in Python as at the terminal."""

import inspect
import pickle
from dataclasses import fields, replace

import numpy as np
import pandas as pd
import pytest

from bgmodel.fit_trials import fit, question
from bgmodel.fitting.algorithms import GAPS, GapModel
from bgmodel.fitting.design import design_of
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.person_fit import fit_likelihood
from bgmodel.fitting.settings import FitSettings, settings_of
from bgmodel.fitting.simulated.alternatives import MODELS
from bgmodel.fitting.simulated.circuit_model import MECHANISMS
from bgmodel.trials.reader import read_trials
from circuits import anatomy
from tests.helpers import refused, refusing

DATA, WHOSE = "roitman_shadlen_2002", {"strength": "coherence", "participant": "b"}


@pytest.fixture(scope="module")
def made():
    return fit(DATA, "constant_gap", fix={"lapse": 0.01}, **WHOSE)


def test_a_fit_of_a_table_is_that_of_its_likelihood(made):
    choices = read_trials(DATA, **WHOSE)
    likelihood = likelihood_of(GapModel(), design_of(choices), fixed={"lapse": 0.01})
    expected = fit_likelihood(likelihood)
    assert np.array_equal(made.optimum.vector, expected.optimum.vector)
    assert made.optimum.log_likelihood == expected.optimum.log_likelihood


SENT = [*((name, {}) for name in (*GAPS, *MODELS, "macaque")),
        *(("macaque", {"mechanism": mechanism}) for mechanism in MECHANISMS)]  # fmt: skip


@pytest.mark.parametrize(("name", "options"), SENT)
def test_a_model_can_be_sent_to_another_process(name, options):
    alternatives = 2 if name in GAPS or options else 3
    model = FitSettings(trials=100, **options).model(name, alternatives=alternatives)
    sent = pickle.loads(pickle.dumps(model))
    assert sent.identity() == model.identity()
    assert sent.parameters == model.parameters


def test_what_a_reader_is_shown_is_what_was_fitted(made):
    summary = made.summary()
    assert list(summary.index) == list(made.optimum.values)
    assert np.allclose(summary["value"], made.optimum.vector, rtol=1e-3)
    assert "low" not in summary
    assert "2615" in repr(made)
    assert "sensitivity" in made._repr_html_()
    assert made.to_dataframe().equals(made.parameters())
    assert len(made.plot().axes) == 5


def test_python_and_the_command_have_the_same_defaults():
    """All but what Python says as mappings."""
    parameters = inspect.signature(fit).parameters
    for field in fields(FitSettings):
        default = parameters[field.name].default
        if field.name not in ("fix", "prior", "vary", "people"):
            assert default == field.default, field.name


test_what_cannot_be_fitted_is_named = refusing(
    ({"model": "gap"}, "models learners need trials with the columns pair and reward"),
    ({"model": 3}, "circuit"),
    ({"participant": None}, "participant"),
    ({"mechanism": "posterior"}, "mechanism"),
    ({"engine": "nengo"}, "engine"),
    ({"noise_nats": 0}, "noise_nats"),
    ({"fix": {"lapses": 0.1}}, "fix"),
    ({"vary": {"bound": "instruction"}}, "instruction"),
    ({"strength": "contrast"}, "contrast"),
    of=lambda wrong: fit(DATA, **{"model": "constant_gap", **WHOSE, **wrong}),
)


def test_a_circuit_is_taken_as_it_is(tmp_path):
    table = anatomy.load_circuit("bogacz_gurney").lesion("STN", 0.05)
    settings = FitSettings(engine="algebra", trials=16)
    model = settings.model(table, seconds=1.0, folder=tmp_path)
    assert (model.circuit, model.folder) == (table, tmp_path)


@pytest.mark.parametrize(
    ("asked", "free"),
    [
        ({}, ("+bound",)),
        ({"free": ("+start",)}, ("+start", "+bound")),
        ({"free": ("t0_s", "bound")}, ("t0_s", "bound")),
        ({"free": ("t0_s",)}, ("t0_s", "bound")),
    ],
)
@pytest.mark.parametrize("effect", [{"vary": ("bound=side",)}, {"formula": ("bound ~ side",)}])
def test_a_parameter_without_its_effect_stays_free(asked, free, effect):
    others = {"vary": ("lapse=side",), "formula": ("t0_s ~ side",)}
    combined = {name: (*others[name], *effect.get(name, ())) for name in others}
    settings = FitSettings(**asked, **combined).constant("bound")
    assert settings == FitSettings(free=free, **others)


@pytest.mark.parametrize("name", ["bound", "threshold"])
def test_a_parameter_that_varies_with_two_columns_is_refused(name):
    asked = FitSettings(vary=(f"{name}=side", "bound=block"))
    with refused("vary"):
        asked.likelihood(design_of(read_trials(DATA, **WHOSE)), GapModel())


def test_a_parameter_with_a_fixed_level_is_no_effect_to_remove():
    asked = FitSettings(vary=("stn_loss=stimulation/off", "bound=side"), formula=("t0_s ~ side",))
    assert asked.effects == ["bound", "t0_s"]


def of_two(each, **columns):
    """Return the trials of two people, three quarters of them with response 1."""
    who, response = np.repeat(["a", "b"], each), np.arange(2 * each) % 4 < 3
    rt = np.random.default_rng(1).uniform(0.3, 0.9, 2 * each)
    table = pd.DataFrame({"participant_id": who, "rt": rt, "response": response.astype(int)})
    return table.assign(**columns)


def test_a_predictor_between_people_is_named_as_that():
    table = of_two(40, group=np.repeat(["patient", "control"], 40))
    asked = settings_of(formula="bound ~ group")
    with refused("group between people alone"):
        asked.split(asked.read(table))
    pooled = settings_of(formula="bound ~ group", people="pooled")
    assert pooled.split(pooled.read(table)) == (pooled, [])
    together = settings_of(formula="bound ~ group", people="hierarchical")
    within, (between,) = together.split(together.read(table))
    assert (within.formula, between.columns) == ((), ["group"])
    blocks = table.assign(block=np.tile(["x", "y"], 40))
    both = settings_of(formula=["bound ~ block", "bound ~ group"], people="hierarchical")
    within, _ = both.split(both.read(blocks))
    assert within.effects == ["bound"]


def test_a_slope_has_one_range_for_all_people_of_a_hierarchy():
    """It follows from the values of the covariate, which differ: the widest of any person."""
    sd = np.repeat([1.0, 4.0], 80)
    table = of_two(80, theta=sd * np.random.default_rng(5).normal(size=160))
    asked = settings_of(formula="bound ~ theta", people="hierarchical")
    designs = {who: asked.design(some) for who, some in asked.by_person(asked.read(table)).items()}
    alone = [asked.likelihood(each, GapModel()).freedom for each in designs.values()]
    one = question(asked, table, ["constant_gap"])
    shared = [each.freedom for each in one.likelihoods("constant_gap").values()]
    k = shared[0].names.index("bound[theta]")
    assert alone[0].high[k] > 2 * alone[1].high[k]
    for each in shared:
        assert each.high[k] == max(one.high[k] for one in alone)
        assert each.low[k] == min(one.low[k] for one in alone)


TABLE = pd.DataFrame({"rt": 0.5, "response": np.resize([0, 1, 1], 60),
                      "strength": np.resize([0.5, 1.0], 60), "x": np.resize(["a", "b"], 60),
                      "z": np.linspace(0, 1, 60)})  # fmt: skip


GIVEN = {"fix": {"lapse": 0.01}, "formula": "bound ~ z", "strength": "strength"}


test_a_prior_that_cannot_be_is_refused = refusing(
    ({"speed": (1.0, 2.0)}, "prior must name a parameter"),
    ({"lapse": (0.01, 0.02)}, "prior must be of a fitted number"),
    ({"bound": (0.5, 1.0)}, r"prior bound\[Intercept\]"),
    *(
        ({"t0_s": wrong}, "prior within 0.05 to 1.5")
        for wrong in ((0.4, 0.2), (0.3, 0.3), (0.01, 0.4), (np.nan, 0.4))
    ),
    *(({"t0_s": wrong}, "prior two numbers") for wrong in (0.3, (0.1, 0.2, 0.3), "soon")),
    ("t0_s=0.2:0.4", "prior must be a mapping"),
    of=lambda prior: fit(TABLE, "constant_gap", prior=prior, **GIVEN),
)


def test_priors_of_a_parameter_are_of_each_of_its_values_unless_one_has_its_own():
    asked = settings_of(
        vary={"threshold": "x"}, formula="t0_s ~ z",
        prior={"threshold[x=b]": (0.4, 0.5), "threshold": (0.3, 0.9), "t0_s[z]": (-0.1, 0.1)},
    )  # fmt: skip
    one = question(replace(asked, strength="strength"), TABLE, ["constant_gap"])
    (likelihood,) = one.likelihoods("constant_gap").values()
    assert {name: tuple(np.round(x, 9)) for name, x in likelihood.freedom.priors.items()} == {
        "bound[x=a]": (0.3, 0.9), "bound[x=b]": (0.4, 0.5), "t0_s[z]": (-0.1, 0.1)}  # fmt: skip
    # A version without the effect keeps the prior of the parameter alone.
    assert asked.constant("threshold").prior == ("threshold=0.3:0.9", "t0_s[z]=-0.1:0.1")

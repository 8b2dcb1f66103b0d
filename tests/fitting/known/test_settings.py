"""The front door: bg.fit with evidence, and its refusals."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

import bgmodel as bg
from bgmodel.fitting.fit import Fit, fit_likelihood
from bgmodel.fitting.known.circuit import KnownCircuit
from bgmodel.fitting.known.likelihood import known_likelihood
from bgmodel.fitting.known.models import EXACT
from bgmodel.fitting.known.settings import known_model
from bgmodel.fitting.settings import FitSettings
from circuits.errors import FitWarning, InputError
from tests.fitting.known.test_table import tables
from tests.known_trials import simulated

DATA, EVIDENCE = tables(simulated(60, 51))


def test_a_fit_with_evidence_is_of_single_trials():
    fit = bg.fit(DATA, "msprt", evidence=EVIDENCE, fix={"lapse": 0.02}, forced=True)
    assert isinstance(fit, Fit)
    likelihood = fit.optimum.likelihood
    assert likelihood.trials.trials == 60
    assert likelihood.values(fit.optimum.vector)["lapse"] == 0.02
    assert fit.summary().index.tolist() == likelihood.freedom.names
    assert set(likelihood.freedom.names) <= set(fit.facts())
    figure = fit.plot()
    assert [ax.get_title("left")[:1] for ax in figure.axes] == ["a", "b", "c"]
    plt.close(figure)


def test_what_two_alternatives_can_not_give_warns():
    with pytest.warns(FitWarning):
        bg.fit(DATA, "msprt", evidence=EVIDENCE, free="+gain", forced=True)


def test_a_size_that_few_trials_hardly_identify_is_said_once():
    """As one with a large error, or as one at a bound."""
    asked = known_likelihood(EXACT["leaky_sum"], simulated(25, 42))
    with pytest.warns(FitWarning) as told:
        found = fit_likelihood(asked)
    said = [str(each.message) for each in told]
    at_bound = dict(zip(asked.freedom.names, found.optimum.at_bound, strict=True))
    assert at_bound["noise"]
    assert not at_bound["threshold"]
    assert [sum(name in each for each in said) for name in ("noise", "threshold")] == [1, 1]


def test_draws_are_of_the_posterior():
    fixed = {"lapse": 0.02, "t0_sd_s": 0.05, "bias_1": 0.0, "t0_s": 0.3}
    asked = {"evidence": EVIDENCE, "forced": True, "fix": fixed, "draws": True}
    found = bg.fit(DATA, "msprt", **asked)
    spread, error = found.posterior.draws.std(axis=0), found.directions.standard_errors
    np.testing.assert_allclose(spread, error, rtol=0.4)


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"strength": "coherence"}, "strength"),
        ({"draws": 1}, "draws"),
        ({"formula": "threshold ~ x"}, "formula"),
        ({"vary": {"threshold": "x"}}, "vary"),
        ({"model": "ddm"}, "models"),
        ({"free": ["+speed"]}, "free"),
        ({"free": ["+gain", "leak_hz"]}, "free"),
        ({"fix": {"speed": 1.0}}, "fix"),
        ({"fix": {"lapse": 0.9}}, "lapse"),
        ({"model": "macaque", "runs": 2}, "runs"),
        ({"model": "macaque", "engine": "steam"}, "engine"),
        ({"step_ms": 50.0}, "step_ms"),
    ],
)
def test_options_that_make_no_sense_are_refused(options, field):
    with pytest.raises(InputError) as error:
        bg.fit(DATA, **{"model": "msprt", "evidence": EVIDENCE, **options})
    assert error.value.field == field


@pytest.mark.parametrize("option", ["step_ms", "forced", "runs"])
def test_options_of_evidence_need_evidence(option):
    with pytest.raises(InputError) as error:
        bg.fit(DATA, **{option: 9})
    assert error.value.field == option


def test_models_are_known_by_name():
    assert known_model("run", 3, FitSettings()).name == "run"
    made = known_model("macaque", 4, FitSettings(seed=3), runs=9)
    assert isinstance(made, KnownCircuit)
    assert (made.circuit.channels, made.runs, made.seed) == (4, 9, 3)

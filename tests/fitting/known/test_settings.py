"""The front door: bg.fit with evidence, and its refusals."""

import pytest

import bgmodel as bg
from bgmodel.fitting.known.circuit import KnownCircuit
from bgmodel.fitting.known.fit import KnownFit
from bgmodel.fitting.known.settings import known_model
from circuits.errors import InputError
from tests.fitting.known.test_table import tables
from tests.known_trials import simulated

DATA, EVIDENCE = tables(simulated(60, 51))


def test_a_fit_with_evidence_is_of_single_trials():
    fit = bg.fit(DATA, "msprt", evidence=EVIDENCE, fix={"lapse": 0.02}, forced=True)
    assert isinstance(fit, KnownFit)
    assert fit.likelihood.trials.trials == 60
    assert fit.values["lapse"] == 0.02


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"strength": "coherence"}, "strength"),
        ({"draws": True}, "draws"),
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
    assert known_model("run", 3).name == "run"
    made = known_model("macaque", 4, runs=9, seed=3)
    assert isinstance(made, KnownCircuit)
    assert (made.circuit.channels, made.runs, made.seed) == (4, 9, 3)

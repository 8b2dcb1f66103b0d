"""The gain of a circuit: its default, or the largest at which it tracks the evidence."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import bgmodel as bg
from bgmodel.experiments.experiment import Experiment
from bgmodel.integrators import basal_ganglia
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import acts_as, fitting_gain, gain_of, lead_of
from bgmodel.support.files import read_provenance
from bgmodel.sweeps.sweep import Sweep
from circuits.anatomy import load_circuit, macaque
from circuits.errors import RangeWarning
from tests.helpers import run, unwarned

TABLE = macaque(2)
WEAK = bg.gaussian_evidence(60, d_prime=0.5, t_max=20, seed=1)
STRONG = bg.gaussian_evidence(60, d_prime=4, t_max=20, seed=1)


@given(st.floats(0.2, 1), st.floats(0.2, 3), st.floats(-3, 3))
def test_the_gain_is_the_largest_of_two_digits_at_which_the_lead_is_tracked(highest, most, power):
    lead = 10.0**power
    gain = fitting_gain(highest, most, lead)
    if highest * lead <= most:
        assert gain == highest
        return
    assert gain * lead <= most * (1 + 1e-9)
    assert gain == float(f"{gain:.2g}")
    step = 10.0 ** (np.floor(np.log10(gain * (1 + 1e-12))) - 1)
    assert (gain + 1.001 * step) * lead > most


@pytest.mark.parametrize("lead", [0.0, -1.0, np.inf, np.nan])
def test_a_lead_that_is_none_or_infinite_leaves_the_default(lead):
    assert fitting_gain(0.55, 1.2, lead) == 0.55


def test_weak_evidence_has_the_default_gain_and_strong_evidence_the_limit():
    model = BasalGanglia(TABLE)
    assert model.adapted_to(WEAK).gain == TABLE.default_gain
    adapted = model.adapted_to(STRONG)
    assert adapted.gain == fitting_gain(TABLE.default_gain, TABLE.max_lead_nats, lead_of(STRONG))
    assert adapted.gain < 0.6 * TABLE.default_gain
    assert model.lead_nats(STRONG) == adapted.lead_nats(STRONG)
    # What was adapted once stays, whatever part of the evidence it is run on.
    assert adapted.adapted_to(WEAK).gain == adapted.gain


@pytest.mark.parametrize("engine", ["algebra", "rate", "population"])
def test_evidence_ten_times_as_strong_is_decided_alike(engine):
    """The gain falls by what the evidence grows, so that the drive is the same."""
    stronger = replace(STRONG, log_likelihood=10 * STRONG.log_likelihood)
    with unwarned():
        one, other = (
            BasalGanglia(TABLE, engine, seed=3).decide(evidence, posterior=0.8)
            for evidence in (STRONG, stronger)
        )
    np.testing.assert_array_equal(one.choice, other.choice)
    np.testing.assert_allclose(one.time_ms, other.time_ms, atol=1e-6)
    assert other.gain == pytest.approx(one.gain / 10)


def test_the_gain_is_that_of_all_trials_however_they_are_batched(monkeypatch):
    model = BasalGanglia(TABLE, seed=3)
    in_one = model.decide(STRONG, posterior=0.8)
    monkeypatch.setattr(basal_ganglia, "BATCH", 7)
    monkeypatch.setattr(basal_ganglia, "WIDE_BATCH", 7)
    np.testing.assert_array_equal(model.decide(STRONG, posterior=0.8).time_ms, in_one.time_ms)
    part = model.adapted_to(STRONG).decided(STRONG[:5], -np.log(0.8))
    np.testing.assert_array_equal(part.time_ms, in_one.time_ms[:5])
    # The five alone are other evidence.
    assert model.adapted_to(STRONG[:5]).gain != in_one.gain


@pytest.mark.parametrize(
    "edit", ["lesion STN 10%", "dopamine 0.8", "set STN->GPe.delay_ms 6", "scale D1->SNr 0.9"]
)
def test_an_edited_circuit_has_the_gain_of_the_intact_one(edit):
    intact, edited = (BasalGanglia(each).adapted_to(STRONG) for each in (TABLE, TABLE.edited(edit)))
    assert edited.gain == intact.gain < TABLE.default_gain


def test_a_gain_that_is_given_is_used_and_warned_of():
    model = BasalGanglia(TABLE, "rate", gain_of(TABLE))
    assert model.adapted_to(STRONG) is model
    with pytest.warns(RangeWarning, match="too strong"):
        model.run(STRONG)
    with unwarned():
        BasalGanglia(TABLE, "rate").run(STRONG)


def test_python_a_file_and_the_terminal_use_one_gain_and_say_it(tmp_path, capsys):
    task = {"d_prime": 4, "trials": 100, "t_max": 20}
    text = "\n".join(
        ['name = "a"', "seed = 4", 'published = "a"', 'source = "a"', 'note = "a"', "[task]"]
        + [f"{key} = {value}" for key, value in task.items()]
        + ["[manipulation]", 'edits = ["set STN->GPe.delay_ms 4"]']
    )
    (tmp_path / "a.toml").write_text(text)
    outcome = Experiment.from_toml(tmp_path / "a.toml").run()
    gain = BasalGanglia(TABLE).adapted_to(outcome.given.evidence).gain
    assert {model.gain for model in outcome.models} == {gain}
    assert f"; gain {gain:g};" in outcome.text()
    out, terminal = tmp_path / "o.csv", ["--task", "d_prime=4", "trials=100", "t_max=20"]
    assert run("experiment", tmp_path / "a.toml", "--save", out) == 0
    assert read_provenance(out)["parameters"]["experiment"]["gain"] == gain
    for command in (["circuit", "run"], ["compare"]):
        path = tmp_path / f"{command[-1]}.csv"
        capsys.readouterr()
        assert run(*command, "--save", path, *terminal) == 0
        recorded = read_provenance(path)["parameters"]["command"]["gain"]
        assert recorded < TABLE.default_gain
        assert f"gain {recorded:g}" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("edits", "shift"),
    [
        (["lesion STN 10%"], np.log(0.9)),
        (["lesion STN 30%"], np.log(0.7)),
        (["lesion STN 30%", "rebound SNr 0.2"], 0.2),
        (["lesion STN 30%", "compensate"], None),
        (["lesion GPe 10%"], None),
        (["dopamine 0.9"], None),
        ([], None),
    ],
)
def test_an_edit_that_shifts_out_acts_as_a_criterion(edits, shift):
    text = acts_as(TABLE.edited(*edits))
    if shift is None:
        assert text == ""
        return
    assert ("lower" if shift < 0 else "higher") in text
    assert f" {abs(shift):.3g} nats" in text
    assert f" {np.exp(shift):.3g} times the posterior" in text


@pytest.mark.parametrize("name", ["spiking_msprt", "appendix_b"])
def test_a_circuit_without_a_measured_limit_keeps_its_gain(name):
    table = load_circuit(name, 2)
    assert BasalGanglia(table).adapted_to(STRONG).gain == gain_of(table)
    assert BasalGanglia(table).unadapted.gain == gain_of(table)


def test_a_sweep_gives_each_task_its_gain_and_all_edits_of_it_one(tmp_path):
    (tmp_path / "s.toml").write_text(
        "[task]\ntrials = 60\nt_max = 15\n[grid]\n"
        '"task.d_prime" = [0.5, 4.0]\n"set STN->GPe.delay_ms" = [3, 4]\n'
    )
    table = Sweep.from_toml(tmp_path / "s.toml").run().table
    gains = table.groupby("task.d_prime")["gain"].agg(["min", "max"])
    assert (gains["min"] == gains["max"]).all()
    assert gains.loc[0.5, "min"] == TABLE.default_gain
    assert gains.loc[4.0, "min"] < TABLE.default_gain

"""Experiments: files read strictly, written as text, and conditions that are pairs."""

import tomllib
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bgmodel import stream
from bgmodel.experiments.expected import WITHOUT
from bgmodel.experiments.experiment import Experiment, shipped
from bgmodel.experiments.outcomes import outcomes, page
from bgmodel.experiments.record import Changes
from bgmodel.integrators.at_thresholds import behaviour_of
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.simulated_evidence import separated_evidence
from bgmodel.trials.task_trials import EvidenceTable
from circuits import anatomy
from circuits.anatomy import load_circuit
from circuits.declaration.edits import Edits
from circuits.declaration.table_writer import write
from circuits.errors import InputError
from circuits.store import Latest
from tests.helpers import GOOD, behaving, refused, run, told

EFFECT = """[[effects]]
measure = "{}"
unit = "{}"
value = {}
low = -1
high = 1
source = "nobody"
[[pred"""
OWN = EFFECT.format("mean_ms", "own", 0)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (
            "trials = 120",
            "trails = 3",
            "there is no key 'task.trails'.*; there are channels, d_prime, ",
        ),
        ("at_least", "at_last", "no key 'predictions.0.at_last'.*; there are measure, direction, "),
        ("[task]", "gian = 1\n[task]", "there is no key 'gian'.*; there are circuit, edits, "),
        ("trials = 120", 'trials = "3"', "task.trials should be a valid integer, got '3'"),
        ("trials = 120", "trials = 0", "small.toml: task: trials must be at least 1, got 0"),
        ('"down"', '"off"', "direction should be 'up', 'down' or 'none', got 'off'"),
        ('"mean_ms"', '"mean"', "measure must be one of accuracy, choice_0, .*got 'mean'"),
        ('name = "a lesion"', "", "the key 'name' is missing"),
        ('name = "a lesion"', 'nam = "a lesion"', "there is no key 'nam' .*'name'"),
        ("[[pred", "[[effects]]\nvalue = 1\n[[pred", "the key 'effects.0.measure' is missing"),
        ('"nobody"', "2001-01-01", "no key takes a date or a time, got 2001-01-01"),
        ('["lesion STN 20%"]', '"STN"', r'edits = \["lesion STN 10%"\]'),
        ("[task]", "truth = 2\n[task]", "truth must be within 0..1, got 2"),
        ("[task]", "[task", "small.toml is not valid TOML: "),
        ('"lesion STN 20%"', '"lesion GPi 20%"', "has no nucleus 'GPi': ctx, common"),
        ("lesion STN 20%", "set STN->GPe.delay_ms 4", "4' has no effect in the algebra engine"),
        ("trials = 120", "trials = 90", "trials must be 100 or more for an interval, got 90"),
        ("[[pred", OWN.replace('"nobody"', '""'), "effects must have a value and a source"),
        ('direction = "down"\nat_least = 20', "value = -50", "must be up, down or none in a"),
        ("[[pred", OWN.removesuffix("[[pred") + OWN, "must give a measure in one unit once"),
        ("[man", "[control]\nedits = ['lesion STN 90%']\n[man", "decide without"),
    ],
)
def test_a_bad_file_gets_one_clear_sentence(experiment_file, tmp_path, capsys, old, new, says):
    experiment_file.write_text(GOOD.replace(old, new))
    assert run("experiment", experiment_file, "--save", tmp_path / "out.csv") == 2
    *_, error = capsys.readouterr().err.splitlines()
    assert error.startswith("bgmodel: ")
    assert pd.Series([error]).str.contains(says).all(), error
    assert [path.name for path in tmp_path.iterdir()] == ["in"]


def test_a_table_of_evidence_says_how_many_hypotheses_there_are(experiment_file, tmp_path):
    drawn = np.random.default_rng(5).normal(size=(30, 4, 3))
    rows = [
        {"trial": n, "step": t, "ll_a": a, "ll_b": b, "ll_c": c, "truth": "abc"[n % 3]}
        for n, trial in enumerate(drawn)
        for t, (a, b, c) in enumerate(trial)
    ]
    mine = tmp_path / "mine.csv"
    pd.DataFrame(rows).to_csv(mine, index=False)
    from_table = replace(Experiment.from_toml(experiment_file), task=EvidenceTable(mine), truth=2)
    np.testing.assert_array_equal(from_table.given().evidence.log_likelihood, drawn[2::3])
    with refused(r"truth must be within 0..2"):
        replace(from_table, truth=3).given()


@pytest.mark.parametrize(("missed", "warned"), [(5, 0), (6, 2), (80, 2)])
def test_more_than_a_twentieth_of_trials_undecided_in_time_is_warned_of(
    experiment_file, monkeypatch, missed, warned
):
    """Of 100 in both conditions; below 20 decided ones the control is refused."""
    experiment = Experiment.from_toml(experiment_file)
    experiment = replace(experiment, task=replace(experiment.task, trials=100, t_max=4))

    def late(missed):
        times = 9.0 + np.arange(100)
        return lambda model, evidence, *_: behaving(evidence.truth, times, evidence.truth, missed)

    monkeypatch.setattr("bgmodel.integrators.at_thresholds.behaviour_of", late(missed))
    texts = [text for text in told(experiment.run) if "decides in time in" in text]
    assert len(texts) == warned
    assert all(f"decides in time in {100 - missed} of 100 trials" in text for text in texts)
    monkeypatch.setattr("bgmodel.integrators.at_thresholds.behaviour_of", late(81))
    with pytest.raises(ValueError, match="decides in time in 19 of 100 trials, at least 20 are"):
        experiment.run()


def test_intervals_are_those_of_pairs(experiment_file):
    """Conditions are paired: the change is surer than the two apart."""
    table = Experiment.from_toml(experiment_file).run().measures.set_index(["condition", "measure"])
    width = (table["high"] - table["low"]).xs("mean_ms", level="measure")
    assert width["change"] < 0.9 * np.hypot(width["control"], width["manipulation"])
    inside = (table["low"] <= table["value"]) & (table["value"] <= table["high"])
    assert inside[table["value"].notna()].all()
    value = table["value"].unstack("measure")
    assert np.allclose(
        value.loc["change"], value.loc["manipulation"] - value.loc["control"], equal_nan=True
    )


def test_more_alternatives_have_no_diffusion(experiment_file):
    experiment = Experiment.from_toml(experiment_file)
    experiment = replace(experiment, task=replace(experiment.task, channels=4))
    table = experiment.run().measures
    empty = table[table["value"].isna()]
    assert set(empty["measure"]) == {"drift", "boundary_separation", "non_decision_ms"}
    assert "drift" not in page(experiment, table)


def test_a_circuit_at_rest_below_its_threshold_answers_before_the_stimulus():
    """It responds before anything is read: no prediction, right or wrong, is met by that."""
    acute = Changes(Edits(["lesion STN"]))
    chronic = Experiment.from_toml("stn_lesion_chronic")
    with refused("manipulation must be Changes"):
        replace(chronic, manipulation=["lesion STN"])
    with refused("edits must be a list of lines"):
        Changes("lesion STN")
    experiment = replace(chronic, manipulation=acute)
    task = replace(experiment.task, trials=100, t_max=12, d_prime=1.5)
    experiment_file = replace(experiment, task=task)
    measures = experiment_file.run().measures
    table = measures.set_index(["condition", "measure"])["value"]
    assert table["manipulation", "anticipatory"] == 1
    assert table["manipulation", "premature"] == 1
    assert table["control", "anticipatory"] < 0.05
    assert set(outcomes(experiment_file, measures)["outcome"]) == {WITHOUT}


def test_foreperiods_have_noise_of_their_own(monkeypatch):
    """Their trials are numbered after those with evidence."""
    asked = []
    plain = BasalGanglia.run_drive

    def run_drive(model, drive, step_ms, first_trial=0):
        asked.append((len(drive), first_trial))
        return plain(model, drive, step_ms, first_trial)

    monkeypatch.setattr(BasalGanglia, "run_drive", run_drive)
    model = BasalGanglia(anatomy.spiking_msprt(2).with_neurons(20), "spikes", 0.5, 3)
    evidence = separated_evidence(30, 2, 1.0, rng=stream(1, "foreperiod"), step_ms=50.0)
    behaviour_of(model, evidence, 0.3, 20.0)
    first, count = asked[-1][1], asked[-1][0]
    assert (count, first) == (30, 30)


SHIPPED = shipped()


def test_a_posterior_that_out_does_not_read_is_refused_in_both_conditions():
    """The read-out of two alternatives ends at 0.054 nats, a posterior of 0.948."""
    experiment = replace(Experiment.from_toml("accuracy_threshold"), engine="algebra")
    experiment = replace(experiment, circuit="spiking_msprt")
    experiment = replace(experiment, task=replace(experiment.task, trials=100))
    careful = replace(experiment.manipulation, posterior=0.96)
    with refused(r"thresholds resolves no OUT below 0.0539 nats"):
        replace(experiment, manipulation=careful).run()
    with refused(r"thresholds resolves no OUT below 0.0539 nats"):
        replace(experiment, control=Changes(posterior=0.96)).run()


def test_where_something_is_expected_its_foreperiod_counts(experiment_file):
    """Written in a file: a lesion, the rebound, and the ramp of expectancy."""
    text = experiment_file.read_text().replace('lesion STN 20%"', 'lesion STN", "rebound SNr 0.3"')
    text = text.replace("[task]", "[task]\nexpectancy_nats = 5.5\nexpectancy_ms = 800.0")
    experiment_file.write_text(text)
    experiment = replace(
        Experiment.from_toml(experiment_file), engine="population", circuit="macaque", gain=None
    )
    anticipatory = experiment.run().trials.groupby("condition")["anticipatory"].mean()
    assert anticipatory["control"] <= 0.01
    assert anticipatory["manipulation"] >= 0.2


def test_anticipations_are_judged_over_the_foreperiod_in_which_they_are_counted():
    """An informative foreperiod replaces that without evidence, and may last longer."""
    assert SHIPPED["stn_lesion_anticipation"].waited_ms == 800
    assert SHIPPED["stn_lesion_partial"].waited_ms == 500


def test_behaviour_that_is_kept_is_not_computed_again_and_changes_nothing():
    experiment = Experiment.from_text(GOOD)
    kept = Latest(4)
    first = experiment.run(kept=kept)
    before = [*map(id, kept.kinds["behaviour"].values())]
    assert len(before) == 2
    again = experiment.run(kept=kept)
    assert [*map(id, kept.kinds["behaviour"].values())] == before
    assert again.measures.equals(experiment.run().measures)
    assert again.measures.equals(first.measures)
    other = replace(experiment, seed=4)
    assert other.run(kept=kept).measures.equals(other.run().measures)
    assert not other.run(kept=kept).measures.equals(first.measures)
    assert len(kept.kinds["behaviour"]) == 4


def test_behaviour_of_a_file_that_has_changed_is_computed_again(tmp_path):
    file = tmp_path / "mine.toml"
    kept, tables = Latest(4), []
    for edits in ((), ("scale D1->SNr 0.98",)):
        write(load_circuit("spiking_msprt").edited(*edits), file)
        text = GOOD.replace('"spiking_msprt"', f'"{file}"')
        tables.append(Experiment.from_text(text).run(kept=kept).measures)
    assert len(kept.kinds["behaviour"]) == 4
    assert not tables[0].equals(tables[1])


@pytest.mark.parametrize("name", SHIPPED)
def test_a_file_reads_back_as_the_same_experiment(name):
    experiment = SHIPPED[name]
    assert Experiment.from_text(experiment.to_toml()) == experiment


@pytest.mark.parametrize("name", ["stn_conflict", "stop_medication", "accuracy_threshold"])
def test_python_code_makes_the_same_experiment(name):
    names = {}
    made, _, printed = SHIPPED[name].to_python().rpartition("print(")
    exec(made, names)
    assert names["experiment"] == SHIPPED[name]
    assert printed == "experiment.run().summary())\n"


def test_settings_at_their_defaults_are_left_out():
    written = tomllib.loads(Experiment.from_text(GOOD).to_toml())
    assert "foreperiod_ms" not in written
    assert written["task"] == {"trials": 120}


def test_a_prediction_to_fill_in_is_a_comment_that_becomes_one():
    experiment = Experiment.from_text(GOOD.partition("[[predictions]]")[0])
    text = experiment.to_toml()
    assert Experiment.from_text(text) == experiment
    head, _, marked = text.partition("# [[predictions]]")
    filled = head + "[[predictions]]" + marked.replace("\n# ", "\n")
    assert Experiment.from_text(filled).predictions[0].measure == "accuracy"
    assert "# [[predictions]]" not in Experiment.from_text(GOOD).to_toml()


def test_text_that_is_no_experiment_is_refused_by_its_name():
    for text in ("= 3", "name = 'x'", GOOD + "colour = 3"):
        with pytest.raises(InputError, match="mine"):
            Experiment.from_text(text, "mine")

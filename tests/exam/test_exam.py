"""Circuits and tables take the exam: exact circuits, broken controls, and the door for tables."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bgmodel.exam import simulation
from bgmodel.exam.exam import Exam
from bgmodel.exam.measures import Estimate
from bgmodel.exam.numbers import Number
from bgmodel.exam.record import scored, totals
from bgmodel.exam.simulation import Simulation
from bgmodel.exam.tables import Failed, NotApplicable
from bgmodel.experiments.models import DecisionModel, model_of
from circuits.anatomy import load_circuit
from circuits.declaration import table_writer
from tests.helpers import refusing

EXAM = Exam.shipped()
NUMBER = {
    "id": "one", "about": "", "measure": "rate", "of": {}, "unit": "Hz", "species": "rat",
    "source": "", "mark": "read", "how": "", "domain": "d",
}  # fmt: skip
REFERENCE = pd.DataFrame({"task": "reference", "rt_ms": [500.0] * 30})


def outcomes(record):
    return record.table.set_index("id")["outcome"]


def asked(*ids):
    return EXAM.of(ids)


def test_the_exact_circuit_at_its_fixed_point_is_the_optimal_test(monkeypatch):
    monkeypatch.setattr(simulation, "TUNING_TRIALS", 100)
    exam = asked("msprt.same.four", "msprt.times", "msprt.extra")
    two = [replace(one, of=one.of | {"channels": 2}) for one in exam.numbers]
    exam = replace(exam, numbers=tuple(two))
    record = exam.take("bogacz_gurney", engine="algebra", seed=3, share=0.1)
    same, r, extra_ms = record.table["value"]
    # Readings are discrete, so that two grids of thresholds meet an accuracy at different places.
    assert same == pytest.approx(1, abs=0.05)
    assert r == pytest.approx(1, abs=0.03)
    assert abs(extra_ms) < 25


def test_the_exact_circuit_follows_the_optimal_test_on_designed_trials(monkeypatch):
    monkeypatch.setattr(simulation, "TUNING_TRIALS", 100)
    record = asked("msprt.designed").take("bogacz_gurney", engine="algebra", seed=3)
    assert record.table["value"].item() == pytest.approx(0, abs=1e-6)


def test_courses_leave_rest_and_rhythms_as_they_are(monkeypatch):
    """A course of the table begins with the evidence: the exam's rest is before it."""
    monkeypatch.setattr(simulation, "TUNING_TRIALS", 100)
    exam = asked("rest.snr", "beta.stn")
    course = "add SNr amount=-1"
    plain = exam.take("macaque", seed=3, share=0.05)
    with_course = exam.take("macaque", edits=[course], seed=3, share=0.05)
    pd.testing.assert_frame_equal(
        plain.table.drop(columns="set_by"), with_course.table.drop(columns="set_by")
    )


def test_tasks_add_motifs_to_circuits_in_nats_alone():
    tasks = EXAM.tasks
    assert tasks["middle"].motifs == ("urgency", "onset_transient")
    assert tasks["reference"].motifs == ()
    for name, motifs, count in (("macaque", True, 2), ("macaque", False, 0), ("gpr", True, 0)):
        runs = Simulation(model_of(name), tasks, 1, motifs=motifs)
        assert len(runs.circuit(2, tasks["middle"].motifs).courses) == count
        assert not runs.circuit(2, tasks["reference"].motifs).courses


DOMAINS = ("resting rates", "conflict", "stimulation of STN")


@pytest.fixture(scope="module")
def record():
    return EXAM.only(DOMAINS).take("macaque", engine="rate", seed=5, share=0.1)


def test_tables_through_the_door_get_the_marks_of_the_circuit(record, tmp_path):
    simulated = Simulation(model_of("macaque", engine="rate"), EXAM.tasks, 5, share=0.1)
    tasks = {"trials": set(), "rates": set()}
    for one in EXAM.only(DOMAINS).numbers:
        kind = "rates" if "nucleus" in one.of else "trials"
        tasks[kind] |= {task for _, task in one.tasks()}
    trials = pd.concat(map(simulated.trials, sorted(tasks["trials"])))
    seconds = trials.assign(rt_s=trials["rt_ms"] / 1000).drop(columns="rt_ms")
    seconds.to_csv(tmp_path / "trials.csv", index=False)
    rates = pd.concat(map(simulated.rates, sorted(tasks["rates"])))
    rates.to_csv(tmp_path / "rates.csv", index=False)
    outside = EXAM.only(DOMAINS).mark(tmp_path / "trials.csv", tmp_path / "rates.csv", seed=5)
    inside = record.table
    assert (outside.table["outcome"] == inside["outcome"]).all()
    for column in ("value", "se", "z"):
        np.testing.assert_allclose(outside.table[column], inside[column], rtol=1e-6, atol=1e-9)


def test_the_same_seed_gives_the_same_bytes_for_any_number_of_workers(monkeypatch):
    monkeypatch.setattr(simulation, "TUNING_TRIALS", 100)
    few = asked("rest.stn", "conflict.stn")
    one = few.take("macaque", seed=5, share=0.1).to_json()
    assert one == few.take("macaque", seed=5, share=0.1, workers=2).to_json()
    assert one != few.take("macaque", seed=6, share=0.1).to_json()


def deaf(channels):
    circuit = load_circuit("macaque", channels)
    broken = circuit
    for row in circuit.projections:
        if row.source == circuit.input:
            broken = broken.scale(row.pair, 1e-9)
    return broken.compensate(circuit)


@pytest.mark.parametrize(
    "control",
    [
        DecisionModel("no D1", lambda n: load_circuit("macaque", n).clamp("D1"), "rate"),
        DecisionModel("noise alone", deaf, "rate"),
    ],
)
def test_a_circuit_without_evidence_fails_what_is_about_decisions_and_rests_as_before(control):
    verdicts = outcomes(EXAM.only(["resting rates", "conflict"]).take(control, seed=3, share=0.05))
    assert verdicts["rest.gpe"] == "agrees"
    assert verdicts["conflict.cost"] == "fails"
    assert verdicts["conflict.stn"] == "fails"


def test_a_circuit_without_nats_does_not_answer_what_needs_them():
    exam = EXAM.only(["stopping", "beta after dopamine loss", "resting rates"])
    record = exam.take("gpr", seed=3, share=0.05)
    assert (record.table["outcome"] == "not answered").all()
    assert (record.table["reason"].str.len() > 10).all()
    assert np.isnan(record.summary()["share"]).all()


def test_a_circuit_of_four_alternatives_answers_for_four():
    exam = EXAM.only(["resting rates", "number of alternatives"])
    record = exam.take(load_circuit("spiking_msprt", 4), engine="rate", seed=3, share=0.05)
    assert set(record.table["outcome"]) == {"not answered"}
    assert list(record.parameters["circuits"]) == ["4"]


test_bad_input_is_refused_before_anything_runs = refusing(
    (lambda: EXAM.take("macaque", edits=["lesion nobody"]), "nucleus"),
    (lambda: EXAM.take("macaque", share=0.0), "share"),
    (lambda: EXAM.take("macaque", seed=-1), "seed"),
    (lambda: EXAM.take("macaque", workers=0), "workers"),
    (lambda: EXAM.take("macaque", engine="steam"), "engine"),
    (lambda: EXAM.only(["astrology"]), "domains"),
    (lambda: EXAM.only(["resting rates"]).mark(REFERENCE), "trials"),
)


def test_an_answer_is_marked_by_both_variances_or_by_its_interval():
    value = Number(**NUMBER, value=10.0, se=3.0, set_by=("mine",))
    row = scored(value, "mine", Estimate(20.0, 4.0, 50))
    assert (row["z"], row["outcome"], row["set_by"]) == (2.0, "agrees", "set by")
    assert scored(value, "other", Estimate(20.1, 4.0, 50))["outcome"] == "disagrees"
    for reason, outcome in ((Failed(""), "fails"), (NotApplicable(""), "not answered")):
        assert scored(value, "mine", reason)["outcome"] == outcome
    up = Number(**NUMBER, direction="up", at_least=1.0)
    for answer, outcome in ((3.0, "agrees"), (0.0, "disagrees"), (1.5, "left open")):
        row = scored(up, "mine", Estimate(answer, 0.4, 50))
        assert (row["outcome"], row["set_by"]) == (outcome, "predicted")


def test_totals_weigh_numbers_and_leave_out_those_that_are_open():
    rows = [
        {"domain": "d", "outcome": o, "weight": w, "set_by": "predicted", "z": z}
        for o, w, z in (
            ("agrees", 1.0, 1.0), ("agrees", 0.5, np.nan), ("disagrees", 1.0, -3.0),
            ("fails", 0.5, np.nan), ("left open", 1.0, np.nan), ("not answered", 1.0, np.nan),
        )
    ]  # fmt: skip
    (row,) = totals(pd.DataFrame(rows)).to_dict("records")
    assert row["share"] == pytest.approx(1.5 / 3)
    assert (row["agrees"], row["disagrees"], row["fails"], row["not answered"]) == (2, 1, 1, 1)
    assert row["median_z"] == 2.0


def test_stars_follow_the_table_and_not_its_name(tmp_path):
    path = table_writer.write(load_circuit("macaque"), tmp_path / "mine.toml")
    edited = ["dopamine 0.9"]
    for circuit, edits, name in (
        (path, (), "macaque"),
        (load_circuit("macaque"), (), "macaque"),
        ("macaque", edited, ""),
        (load_circuit("macaque").edited(*edited), (), ""),
    ):
        assert Simulation(model_of(circuit, edits), EXAM.tasks, 1).included == name

"""What a prediction is worth: agreement, open, or a decision without evidence."""

import re
import warnings
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bgmodel.deciding.measures import MEASURES, OF_ALL, OF_DECIDED
from bgmodel.experiments.expected import (
    AGREES,
    COMPATIBLE,
    DIFFERS,
    DISAGREES,
    NO_INTERVAL,
    OPEN,
    WITHOUT,
    Expected,
)
from bgmodel.experiments.experiment import Experiment, shipped
from bgmodel.experiments.outcomes import beside_published, outcomes, page
from bgmodel.experiments.record import Changes
from bgmodel.support.seeds import stream
from bgmodel.task import Gaussian
from circuits.declaration.edits import Edits
from circuits.errors import CalibrationWarning, EditWarning
from tests.helpers import behaving

B = "boundary_separation"


def changes(table):
    return table[table["condition"] == "change"].set_index("measure")


@pytest.fixture(scope="module")
def by_threshold():
    """Return an experiment on the threshold at the fixed point, and its measures."""
    experiment = replace(Experiment.from_toml("accuracy_threshold"), engine="algebra")
    experiment = replace(experiment, task=replace(experiment.task, trials=200))
    return experiment, experiment.run().measures


def test_the_threshold_alone_moves_what_it_must(by_threshold):
    """At the fixed point: times, criterion and bound follow the threshold, the drift does not."""
    experiment, table = by_threshold
    verdicts = outcomes(experiment, table).set_index("measure")["outcome"]
    assert dict(verdicts) == {
        "boundary_separation": AGREES,
        "mean_posterior": AGREES,
        "drift": verdicts["drift"],
    }
    assert verdicts["drift"] != DISAGREES
    assert changes(table).loc["mean_ms", "low"] > 0
    shown = page(experiment, table)
    assert re.search(r"boundary_separation up, by 0[.]005 .*the model agrees", shown)
    # No trial is missed: measures of all trials are those of decided ones.
    assert {name for name in MEASURES if name not in shown} == {*OF_ALL}
    for measure, form in (("mean_ms", r"\d+"), ("decided", r"\d+"), ("accuracy", r"0\.\d{3}")):
        assert re.search(rf"^{measure} +{form}( |$)", shown, re.MULTILINE)
    assert "drift: 1/s, boundary_separation: no unit (EZ-diffusion, noise s = 0.1 per √s)" in shown
    few = table.assign(value=table["value"].where(~table["measure"].isin(["drift", B])))
    assert "EZ-diffusion" not in page(experiment, few)


def table_of(rows):
    """Return measures as a table, each of 100 trials."""
    columns = ["condition", "measure", "value", "low", "high"]
    return pd.DataFrame(rows, columns=columns).assign(trials=100)


def judged(shares, foreperiod_ms=500.0, decided=100, measure="mean_ms"):
    """Return the outcome of a change of -100 +- 10 that was predicted, for shares of responses."""
    experiment = shipped()["stn_no_conflict"]
    prediction = Expected(measure, "down", 0.2 if measure == "missed" else 20.0)
    experiment = replace(
        experiment, predictions=(prediction,), effects=(), foreperiod_ms=foreperiod_ms
    )
    values = dict.fromkeys(MEASURES, 0.5) | {"decided": decided, "missed": 0.0} | shares
    both = [(c, values) for c in ("control", "manipulation")]
    rows = [(c, name, v, v, v) for c, values in both for name, v in values.items()]
    rows += [("change", name, -100.0, -110.0, -90.0) for name in MEASURES]
    return outcomes(experiment, table_of(rows))["outcome"].item()


def test_either_share_of_responses_without_evidence_is_enough():
    assert judged({"premature": 0.1, "anticipatory": 0.1}) == AGREES
    assert judged({"premature": 0.6, "anticipatory": 0.1}) == WITHOUT
    assert judged({"premature": 0.1, "anticipatory": 0.6}) == WITHOUT


def test_the_length_of_the_foreperiod_does_not_excuse_a_circuit_that_responds_at_rest():
    """At a constant hazard 0.23 of 50 ms are 0.93 of half a second, and 0.6 of 3 s are 0.14."""
    assert judged({"premature": 0.3, "anticipatory": 0.23}, 50.0) == WITHOUT
    assert judged({"premature": 0.3, "anticipatory": 0.6}, 3000.0) == AGREES


def test_a_handful_of_decided_trials_decides_nothing():
    rest = {"premature": 0.0, "anticipatory": 0.0, "missed": 0.97}
    assert judged(rest, decided=4) == OPEN
    assert judged(rest, decided=4, measure="missed") == AGREES
    assert judged(rest | {"missed": 0.0}, decided=40) == AGREES


def arms(monkeypatch, control, manipulation, predictions, effects=()):
    """Return the outcomes of two conditions of 1000 trials, each with a share right and missed.

    Times of decisions are about 600 ms, those of missed trials 2000 ms.
    """
    experiment = replace(shipped()["stn_no_conflict"], effects=effects)
    task = replace(experiment.task, trials=1000, t_max=2)
    experiment = replace(experiment, predictions=predictions, task=task)
    conditions = iter([control, manipulation])

    def behaviour(model, evidence, *_):
        right, missed, time_ms = next(conditions)
        decided, order = 1000 - round(1000 * missed), stream(4, "arms").permutation(1000)
        choice = np.where(order < right * 1000, evidence.truth, 1 - evidence.truth)
        times = np.where(np.arange(1000) < decided, time_ms + order % 90, 2000.0)
        return behaving(choice, times, evidence.truth, 1000 - decided)

    monkeypatch.setattr("bgmodel.integrators.at_thresholds.behaviour_of", behaviour)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        table = experiment.run().measures
    return experiment, table


def effect(measure, value, low=None, high=None, unit="own"):
    return Expected(measure, value=value, low=low, high=high, unit=unit, source="nobody")


UP = Expected("accuracy", "up", 0.005)
SLOWER = Expected("mean_ms", "up", 30.0)
MOST, LATER = (0.95, 0.0, 600.0), (0.95, 0.0, 601.0)


@pytest.mark.parametrize(
    ("missed", "prediction", "effect", "verdict"),
    [
        # A loss of GPe: more of those that decide are right, far fewer decide.
        ((0.08, 0.36), UP, (0.75, 0.85), OPEN),
        ((0.0, 0.0), UP, (0.75, 0.85), AGREES),
        ((0.08, 0.08), UP, (0.75, 0.85), AGREES),
        ((0.0, 0.005), UP, (0.75, 0.85), AGREES),
        # Fewer are missed: right or wrong, the missed ones of the control could undo it.
        ((0.36, 0.08), UP, (0.8, 0.82), OPEN),
        ((0.08, 0.36), Expected("accuracy", "none", 0.05), (0.8, 0.8), OPEN),
        ((0.08, 0.08), Expected("accuracy", "none", 0.05), (0.8, 0.801), AGREES),
        ((0.0, 0.3), Expected("accuracy", "down", 0.01), (0.85, 0.8), OPEN),
        ((0.08, 0.36), Expected("accuracy_all", "down", 0.05), (0.75, 0.85), AGREES),
        ((0.08, 0.36), Expected("accuracy_best", "up", 0.05), (0.75, 0.85), AGREES),
        ((0.08, 0.36), Expected("missed", "up", 0.05), (0.75, 0.85), AGREES),
        # Missed trials may choose either: 14 % of all trials is half of those missed more.
        ((0.08, 0.36), Expected("choice_0", "none", 0.1), (0.75, 0.85), OPEN),
        ((0.08, 0.36), Expected("choice_0", "none", 0.3), (0.75, 0.85), AGREES),
        ((0.08, 0.08), Expected("choice_0", "none", 0.1), (0.75, 0.85), AGREES),
        # Posteriors at the decision are the same in both.
        ((0.0, 0.01), Expected("mean_posterior", "none", 0.05), (0.75, 0.85), AGREES),
        ((0.0, 0.2), Expected("mean_posterior", "none", 0.05), (0.75, 0.85), OPEN),
        # A median has no such bounds: a hundredth of the trials counts.
        ((0.08, 0.36), Expected("median_ms", "none", 50.0), (0.75, 0.85), OPEN),
        ((0.08, 0.085), Expected("median_ms", "none", 50.0), (0.75, 0.85), AGREES),
    ],
)
def test_a_verdict_holds_whatever_the_missed_trials_would_have_been(
    monkeypatch, missed, prediction, effect, verdict
):
    both = [(right, lost, 600.0) for right, lost in zip(effect, missed, strict=True)]
    experiment, table = arms(monkeypatch, *both, (prediction,))
    row = outcomes(experiment, table).iloc[0]
    assert row["outcome"] == verdict
    assert bool(row["reason"]) == (verdict == OPEN)
    assert (row["control_trials"], row["manipulation_trials"]) == tuple(
        1000 - round(1000 * lost) if prediction.measure in OF_DECIDED else 1000 for lost in missed
    )


@pytest.mark.parametrize(
    ("control", "manipulation", "prediction", "verdict"),
    [
        ((0.8, 0.0, 600.0), (0.8, 0.3, 700.0), SLOWER, AGREES),  # the missed would be later still
        ((0.8, 0.3, 600.0), (0.8, 0.0, 700.0), SLOWER, OPEN),
        ((0.8, 0.0, 600.0), (0.8, 0.3, 500.0), SLOWER, OPEN),
        # Both miss many: those of either might take longer than the deadline by any time.
        ((0.8, 0.1, 600.0), (0.8, 0.1, 500.0), SLOWER, OPEN),
        ((0.8, 0.4, 600.0), (0.8, 0.45, 700.0), SLOWER, OPEN),
        ((0.8, 0.04, 600.0), (0.8, 0.04, 500.0), SLOWER, DISAGREES),
        ((0.8, 0.3, 600.0), (0.8, 0.0, 500.0), SLOWER, DISAGREES),
        # The control leaves no room for the change.
        (MOST, LATER, Expected("accuracy", "up", 0.1), OPEN),
        ((0.8, 0.0, 600.0), (0.8, 0.0, 601.0), Expected("accuracy", "up", 0.1), DISAGREES),
        (MOST, LATER, Expected("accuracy", "down", 0.1), DISAGREES),
        (MOST, LATER, Expected("mean_ms", "down", 700.0), OPEN),
        (MOST, LATER, Expected("mean_ms", "down", 300.0), DISAGREES),
        (MOST, LATER, Expected("mean_ms", "up", 700.0), DISAGREES),
        (MOST, LATER, Expected("missed", "down", 0.1), OPEN),
    ],
)
def test_times_count_missed_trials_and_a_control_without_room_leaves_a_change_open(
    monkeypatch, control, manipulation, prediction, verdict
):
    experiment, table = arms(monkeypatch, control, manipulation, (prediction,))
    row = outcomes(experiment, table).iloc[0]
    assert row["outcome"] == verdict
    assert bool(row["reason"]) == (verdict == OPEN)
    assert ("leaves no room" in row["reason"]) == (verdict == OPEN and control == MOST)


def test_an_effect_is_left_open_where_missed_trials_could_undo_it(monkeypatch):
    effects = (
        effect("accuracy", 0.1, 0.05, 0.15),
        effect("accuracy_all", 0.1, 0.05, 0.15),
        effect("accuracy", 12.0, 5.0, 20.0, "percent"),
    )
    for missed, verdicts in (
        ((0.08, 0.36), [OPEN, DIFFERS, OPEN]),
        ((0.08, 0.08), [COMPATIBLE, COMPATIBLE, COMPATIBLE]),
    ):
        both = [(right, lost, 600.0) for right, lost in zip((0.75, 0.85), missed, strict=True)]
        experiment, table = arms(monkeypatch, *both, (), effects)
        held = beside_published(experiment, table)
        assert list(held["comparison"]) == verdicts
        assert list(held["comparison_reason"] != "") == [word == OPEN for word in verdicts]


def test_a_page_says_what_ran_and_how_many_trials_a_verdict_rests_on(monkeypatch):
    both = ((0.75, 0.08, 600.0), (0.85, 0.36, 600.0))
    experiment, table = arms(monkeypatch, *both, (UP, Expected("missed", "up", 0.05)))
    shown = page(experiment, table)
    first = shown.splitlines()[0]
    assert first.startswith("task gaussian, 2 alternatives, d_prime 0.5; engine population; 1000 ")
    assert first.endswith("gain 0.55; posterior 0.66; circuit macaque; seed 206")
    assert re.search("  920 and 640 +the model leaves it open", shown)
    assert ": agrees on decided trials" in shown
    assert "the control misses 8.0% of trials, the manipulation 36.0%" in shown
    assert "  1000 and 1000  " in shown
    other = replace(
        experiment, gain=0.4, manipulation=replace(experiment.manipulation, posterior=0.7)
    )
    assert "gain 0.4; posterior 0.66 (control), 0.7; circuit" in page(other, table)


def test_an_experiment_without_a_prediction_has_no_verdict(monkeypatch):
    same = (0.8, 0.0, 600.0)
    experiment, table = arms(monkeypatch, same, same, ())
    assert len(outcomes(experiment, table)) == 0
    shown = page(experiment, table)
    assert "no verdict" in shown
    assert "the model" not in shown


@pytest.mark.parametrize(
    ("conflict", "truth", "warned"), [(0.6, None, 1), (0, None, 0), (0.6, 0, 0)]
)
def test_posteriors_that_are_not_accuracies_are_said(conflict, truth, warned):
    experiment = replace(Experiment.from_toml("stn_conflict"), truth=truth)
    task = replace(experiment.task, trials=200, t_max=40, conflict=conflict)
    experiment = replace(experiment, task=task)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        table = experiment.run().measures
    texts = [str(w.message) for w in caught if "posteriors are not calibrated" in str(w.message)]
    assert len(texts) == warned
    assert ("posteriors are not calibrated" in page(experiment, table)) == bool(warned)


SHIPPED = shipped()


def quick(experiment):
    """Return an experiment of fewer trials."""
    trials = 120 if experiment.truth is None else 240
    return replace(experiment, task=replace(experiment.task, trials=trials))


@pytest.mark.parametrize("name", SHIPPED)
def test_the_edit_alone_makes_the_outcome(name):
    """Without it every measure is the control's to the last bit; with it some measure is not."""
    experiment = quick(SHIPPED[name])
    without = replace(experiment, manipulation=experiment.control)
    none = without.run().measures
    assert (changes(none)[["value", "low", "high"]].fillna(0) == 0).all(axis=None)
    verdicts = outcomes(without, none)
    assert (verdicts["outcome"] == OPEN).all()
    assert (changes(experiment.run().measures)["value"].fillna(0) != 0).any()
    held = beside_published(without, none)
    assert (held["value"] == 0).all()


def held_to(published, low, high, value=0.0, **shares):
    """Return the verdict on a model's change of 0 with its interval, compared with an effect."""
    experiment = replace(shipped()["stn_no_conflict"], effects=(published,))
    values = dict.fromkeys(MEASURES, 0.1) | {"decided": 100.0}
    values |= {"accuracy": 0.8, "mean_posterior": 0.8, "missed": 0.0} | shares
    both = ("control", "manipulation")
    rows = [(c, name, one, one, one) for c in both for name, one in values.items()]
    rows += [(c, name, value, low, high) for c in ("change", "percent") for name in MEASURES]
    row = beside_published(experiment, table_of(rows)).iloc[0]
    return row["condition"], row["comparison"]


def test_an_effect_is_compared_in_its_unit():
    """Half-widths of 3 and 4 make one of 5, as of independent samples."""
    for value, verdict in ((4.9, COMPATIBLE), (5.1, DIFFERS), (-4.9, COMPATIBLE), (-5.1, DIFFERS)):
        known = effect("mean_ms", value, value - 4, value + 4, "percent")
        assert held_to(known, -3, 3) == ("percent", verdict)
    assert held_to(effect("mean_ms", 5.0), -3, 3) == ("change", NO_INTERVAL)


def test_an_effect_is_left_open_where_the_model_has_no_number_or_hardly_decides():
    """Measures of decisions alone are left open; the share of missed trials is known."""
    of_times = effect("mean_ms", 1.0, -3.0, 5.0)
    of_missed = effect("missed", 1.0, -3.0, 5.0)
    for known in (of_times, of_missed):
        assert held_to(known, -3, 3) == ("change", COMPATIBLE)
        assert held_to(known, np.nan, np.nan, np.nan) == ("change", OPEN)
        assert held_to(known, -3, 3, premature=0.9) == ("change", WITHOUT)
    assert held_to(of_times, -3, 3, decided=19) == ("change", OPEN)
    assert held_to(of_times, -3, 3, decided=20) == ("change", COMPATIBLE)
    assert held_to(of_missed, -3, 3, decided=19) == ("change", COMPATIBLE)
    assert held_to(of_times, -3, 3, decided=19, premature=0.9) == ("change", WITHOUT)


def test_percent_are_those_of_the_control():
    experiment = quick(shipped()["stn_no_conflict"])
    table = experiment.run().measures
    value = table.set_index(["condition", "measure"])["value"]
    shown = page(experiment, table)
    for measure in ("mean_ms", "accuracy", B):
        of = 100 * value["change", measure] / value["control", measure]
        assert value["percent", measure] == pytest.approx(of)
    assert "mean_ms in %: -6.8 [-18.0, +4.4], the model " in shown
    assert "accuracy: -0.034 [-0.117, +0.048], the model " in shown


@pytest.mark.parametrize("direction", ["up", "down", "none"])
@pytest.mark.parametrize(
    "edit", ["add dopamine amount=0.2 from_ms=90000 to_ms=95000", "add Arky like=GPe"]
)
def test_a_manipulation_that_changes_no_decision_has_no_verdict(edit, direction):
    """A course after the end of all trials, and a nucleus without a pathway."""
    predictions = (Expected("accuracy", direction, 0.01), Expected("missed", direction, 0.01))
    asked = Experiment(
        name="", note="", engine="rate", circuit="macaque", predictions=predictions,
        manipulation=Changes(Edits([edit])), task=Gaussian(trials=100, t_max=40, d_prime=1.0),
    )  # fmt: skip
    with pytest.warns(EditWarning, match="no decision differs"):
        table = asked.run().measures
    verdicts = outcomes(asked, table)
    assert verdicts["outcome"].tolist() == [OPEN, OPEN]
    assert verdicts["reason"].str.len().gt(0).all()


WITHOUT_DOPAMINE = Changes(Edits(["dopamine 0"]))


def test_a_circuit_that_chooses_against_the_evidence_gets_no_verdict():
    """Without dopamine the OUT of the supported channel rises, and another one is chosen."""
    experiment = replace(
        shipped()["stn_no_conflict"], engine="rate", manipulation=WITHOUT_DOPAMINE, effects=()
    )
    experiment = replace(
        experiment,
        task=replace(experiment.task, trials=120, t_max=60),
        predictions=(Expected("accuracy", "down", 0.01), Expected("missed", "none", 0.4)),
    )
    with pytest.warns(
        CalibrationWarning, match="the manipulation's choices go against the evidence"
    ):
        table = experiment.run().measures
    assert table.set_index(["condition", "measure"]).loc[("manipulation", "accuracy"), "high"] < 0.5
    verdicts = outcomes(experiment, table)
    assert (verdicts["outcome"] == OPEN).all()
    assert verdicts["reason"].str.contains("against the evidence").all()
    control = replace(experiment, control=WITHOUT_DOPAMINE, manipulation=Changes())
    with pytest.raises(ValueError, match="the control's choices go against the evidence"):
        control.run()

"""What a prediction is worth: agreement, open, or a decision without evidence."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from bgmodel.experiments.experiment import (
    AGREES,
    DISAGREES,
    OPEN,
    WITHOUT,
    Effect,
    Prediction,
    read_experiment,
    run_experiment,
    shipped,
)
from bgmodel.experiments.measures import MEASURES
from bgmodel.experiments.outcomes import (
    COMPATIBLE,
    DIFFERS,
    NO_INTERVAL,
    beside_published,
    outcomes,
    page,
)


def changes(table):
    return table[table["condition"] == "change"].set_index("measure")


def test_the_threshold_alone_moves_what_it_must():
    """At the fixed point: times, criterion and bound follow the threshold, the drift does not."""
    experiment = replace(read_experiment("accuracy_threshold"), engine="algebra")
    experiment = replace(experiment, task=replace(experiment.task, trials=200))
    table = run_experiment(experiment).measures
    said = outcomes(experiment, table).set_index("measure")["outcome"]
    assert dict(said) == {"bound": AGREES, "criterion": AGREES, "drift": said["drift"]}
    assert said["drift"] != DISAGREES
    assert changes(table).loc["mean_ms", "low"] > 0
    shown = page(experiment, table)
    assert "bound up, by 0.005: the model agrees" in shown
    assert all(name in shown for name in MEASURES)
    for measure, form in (("mean_ms", r"\d+"), ("decided", r"\d+"), ("accuracy", r"0\.\d{3}")):
        assert re.search(rf"^{measure} +{form}( |$)", shown, re.MULTILINE)
    assert "drift: 1/s, bound: no unit (EZ-diffusion, noise s = 0.1 per √s)" in shown
    few = table.assign(value=table["value"].where(~table["measure"].isin(["drift", "bound"])))
    assert "EZ-diffusion" not in page(experiment, few)


def test_a_page_says_why_a_diffusion_is_withheld():
    experiment = replace(read_experiment("accuracy_threshold"), engine="algebra")
    experiment = replace(experiment, task=replace(experiment.task, trials=200))
    table = run_experiment(experiment).measures
    assert "withheld" not in page(experiment, table)
    cut = (table["condition"] == "manipulation") & (table["measure"] == "missed")
    shown = page(experiment, table.assign(value=table["value"].mask(cut, 0.04)))
    assert (
        "non_decision_ms of the manipulation are withheld: the deadline cuts off 4.0% of" in shown
    )
    assert "of the control are withheld" not in shown
    biased = (table["condition"] == "control") & (table["measure"] == "non_decision_ms")
    shown = page(experiment, table.assign(value=table["value"].mask(biased)))
    assert "of the control are withheld: no diffusion that starts half-way" in shown


@pytest.mark.parametrize(
    ("channels", "measure", "told"),
    [(2, "mean_ms", True), (2, "bound", True), (4, "mean_ms", False), (4, "bound", True)],
)
def test_a_page_names_a_withheld_diffusion_of_two_alternatives_or_one_that_was_predicted(
    channels, measure, told
):
    experiment = replace(shipped()["stn_no_conflict"], effects=())
    experiment = replace(
        experiment,
        predictions=(Prediction(measure, "down", 20.0),),
        task=replace(experiment.task, channels=channels),
    )
    values = dict.fromkeys(MEASURES, 0.0) | {"non_decision_ms": np.nan, "decided": 100.0}
    rows = [(c, m, v, v, v) for c in ("control", "change") for m, v in values.items()]
    rows += [("manipulation", m, v, v, v) for m, v in (values | {"non_decision_ms": 9}).items()]
    table = pd.DataFrame(rows, columns=["condition", "measure", "value", "low", "high"])
    assert ("of the control are withheld" in page(experiment, table)) == told
    assert "of the manipulation are withheld" not in page(experiment, table)


def judged(shares, foreperiod_ms=500.0, decided=100, measure="mean_ms"):
    """Return the outcome of a change of -100 +- 10 that was predicted, for shares of responses."""
    experiment = shipped()["stn_no_conflict"]
    prediction = Prediction(measure, "down", 20.0)
    experiment = replace(
        experiment, predictions=(prediction,), effects=(), foreperiod_ms=foreperiod_ms
    )
    values = dict.fromkeys(MEASURES, 0.5) | {"decided": decided} | shares
    rows = [("manipulation", name, value, value, value) for name, value in values.items()]
    rows += [("change", name, -100.0, -110.0, -90.0) for name in MEASURES]
    table = pd.DataFrame(rows, columns=["condition", "measure", "value", "low", "high"])
    return outcomes(experiment, table)["outcome"].item()


def test_either_share_of_responses_without_evidence_is_enough():
    assert judged({"premature": 0.1, "anticipatory": 0.1}) == AGREES
    assert judged({"premature": 0.6, "anticipatory": 0.1}) == WITHOUT
    assert judged({"premature": 0.1, "anticipatory": 0.6}) == WITHOUT


def test_the_length_of_the_foreperiod_does_not_excuse_a_circuit_that_responds_at_rest():
    """At a constant hazard .23 of 50 ms are .93 of half a second, and .6 of 3 s are .14."""
    assert judged({"premature": 0.3, "anticipatory": 0.23}, 50.0) == WITHOUT
    assert judged({"premature": 0.3, "anticipatory": 0.6}, 3000.0) == AGREES


def test_a_handful_of_decided_trials_decides_nothing():
    rest = {"premature": 0.0, "anticipatory": 0.0, "missed": 0.97}
    assert judged(rest, decided=4) == OPEN
    assert judged(rest, decided=4, measure="missed") == AGREES
    assert judged(rest, decided=40) == AGREES


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
    none = run_experiment(without).measures
    assert (changes(none)[["value", "low", "high"]].fillna(0) == 0).all(axis=None)
    said = outcomes(without, none)
    known = none[none["condition"] == "control"].set_index("measure").loc[said["measure"], "low"]
    for known_, row in zip(known, said.itertuples(), strict=True):
        if np.isnan(known_):
            assert row.outcome == OPEN
        else:
            assert row.outcome == (AGREES if row.direction == "none" else DISAGREES)
    assert (changes(run_experiment(experiment).measures)["value"].fillna(0) != 0).any()
    held = beside_published(without, none)
    assert (held["value"] == 0).all()


def held_to(effect, low, high, value=0.0, **shares):
    """Return the verdict on a model's change of 0 with its interval, beside an effect."""
    experiment = replace(shipped()["stn_no_conflict"], effects=(effect,))
    values = dict.fromkeys(MEASURES, 0.1) | {"decided": 100.0} | shares
    rows = [("manipulation", name, one, one, one) for name, one in values.items()]
    rows += [(c, effect.measure, value, low, high) for c in ("change", "percent")]
    table = pd.DataFrame(rows, columns=["condition", "measure", "value", "low", "high"])
    row = beside_published(experiment, table).iloc[0]
    return row["condition"], row["comparison"]


def test_an_effect_is_compatible_where_the_difference_of_both_holds_0():
    """Half-widths of 3 and 4 make one of 5, as of independent samples."""
    for value, said in ((4.9, COMPATIBLE), (5.1, DIFFERS), (-4.9, COMPATIBLE), (-5.1, DIFFERS)):
        effect = Effect("mean_ms", value, "nobody", value - 4, value + 4, "percent")
        assert held_to(effect, -3, 3) == ("percent", said)
    assert held_to(Effect("mean_ms", 5.0, "nobody"), -3, 3) == ("change", NO_INTERVAL)


@pytest.mark.parametrize("sign", [1, -1])
def test_of_an_asymmetric_interval_the_end_that_points_to_the_other_counts(sign):
    """The end between both values, and no other, joins the model's half-width on that side."""

    def said(value, near, far, model_near, model_far=90.0):
        """Return the verdict on an effect and a change of 0, by half-widths of their intervals."""
        ends = sorted((sign * (value - near), sign * (value + far)))
        model = sorted((sign * model_near, -sign * model_far))
        return held_to(Effect("mean_ms", sign * value, "nobody", *ends), *model)[1]

    # Half-widths of 4 and 3 towards each other reach 5; those that point away, of any size, do not.
    for far in (0.1, 30.0):
        for model_far in (0.1, 30.0):
            assert said(4.9, 4.0, far, 3.0, model_far) == COMPATIBLE
            assert said(5.1, 4.0, far, 3.0, model_far) == DIFFERS
    assert said(5.9, 5.0, 0.1, 3.3) == COMPATIBLE
    assert said(6.1, 5.0, 0.1, 3.3) == DIFFERS


WIDTH = st.floats(0, 30)


@given(st.floats(-50, 50), st.floats(-50, 50), WIDTH, WIDTH, WIDTH, WIDTH)
def test_both_ends_of_the_difference_are_those_of_two_independent_samples(
    model, published, low, high, below, above
):
    """Zou & Donner (2008), against their formula in half-widths of both intervals."""
    apart = model - published
    reach = np.hypot(low, above) if apart > 0 else np.hypot(high, below)
    assume(abs(abs(apart) - reach) > 1e-6)
    effect = Effect("mean_ms", published, "nobody", published - below, published + above)
    said = held_to(effect, model - low, model + high, model)
    assert said == ("change", COMPATIBLE if abs(apart) < reach else DIFFERS)


def test_an_effect_is_left_open_where_the_model_has_no_number_or_hardly_decides():
    """Measures of decisions alone are left open; the share of missed trials is known."""
    of_times = Effect("mean_ms", 1.0, "nobody", -3.0, 5.0)
    of_missed = Effect("missed", 1.0, "nobody", -3.0, 5.0)
    for effect in (of_times, of_missed):
        assert held_to(effect, -3, 3) == ("change", COMPATIBLE)
        assert held_to(effect, np.nan, np.nan, np.nan) == ("change", OPEN)
        assert held_to(effect, -3, 3, premature=0.9) == ("change", WITHOUT)
    assert held_to(of_times, -3, 3, decided=19) == ("change", OPEN)
    assert held_to(of_times, -3, 3, decided=20) == ("change", COMPATIBLE)
    assert held_to(of_missed, -3, 3, decided=19) == ("change", COMPATIBLE)
    assert held_to(of_times, -3, 3, decided=19, premature=0.9) == ("change", WITHOUT)


def test_percent_are_those_of_the_control():
    experiment = quick(shipped()["stn_no_conflict"])
    table = run_experiment(experiment).measures
    value = table.set_index(["condition", "measure"])["value"]
    shown = page(experiment, table)
    for measure in ("mean_ms", "accuracy", "bound"):
        of = 100 * value["change", measure] / value["control", measure]
        assert value["percent", measure] == pytest.approx(of)
    assert "mean_ms in %: -6.8 [-18.0, +4.4], the model " in shown
    assert "accuracy: -0.034 [-0.117, +0.048], the model " in shown

"""What a prediction is worth: agreement, open, or a decision without evidence."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bgmodel.experiments.experiment import (
    AGREES,
    DISAGREES,
    OPEN,
    WITHOUT,
    Prediction,
    read_experiment,
    run_experiment,
    shipped,
)
from bgmodel.experiments.measures import MEASURES
from bgmodel.experiments.outcomes import outcomes, page


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


def judged(shares, foreperiod_ms=500.0, decided=100, measure="mean_ms"):
    """Return the outcome of a change of -100 +- 10 that was predicted, for shares of responses."""
    experiment = shipped()["stn_bound"]
    prediction = Prediction(measure, "down", 20.0)
    experiment = replace(experiment, predictions=(prediction,), foreperiod_ms=foreperiod_ms)
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
    """Return an experiment cut short: few cells, evidence that is soon enough."""
    control, manipulation = (
        replace(c, neurons=40) for c in (experiment.control, experiment.manipulation)
    )
    trials = 100 if experiment.truth is None else 200
    task = replace(experiment.task, trials=trials, t_max=8, d_prime=1.5)
    return replace(
        experiment, control=control, manipulation=manipulation, task=task, foreperiod_ms=10.0
    )


@pytest.mark.filterwarnings("ignore:.*decides in time")
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

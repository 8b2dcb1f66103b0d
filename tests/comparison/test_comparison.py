"""A single call gives the same table as its parts, for unedited and edited circuits."""

import re
import warnings

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bgmodel import BasalGanglia, compare, gaussian_evidence, stream
from bgmodel.comparison.page import NOT_REACHED, SHOWN, page, verdicts
from bgmodel.comparison.pairs import by_chance, side_by_side
from bgmodel.comparison.thresholds import GAINS, fastest_gain
from bgmodel.deciding.tradeoff import ChoicesAndTimes
from bgmodel.simulated_evidence import separated_evidence
from circuits.anatomy import load_circuit
from circuits.errors import DeadlineWarning, InputError, RangeWarning
from tests.comparison.deadlines import DeadlineTask, changed, compared
from tests.helpers import refused

EVIDENCE = separated_evidence(120, 40, 1.0, rng=stream(4, "one call"), step_ms=50.0)
GIVEN = {"seed": 3, "accuracies": (0.9,), "resamples": 50}


def test_a_model_and_a_circuit_that_runs_as_this_model_are_compared_alike():
    edited = load_circuit("spiking_msprt").scale("D1->SNr", 0.95)
    comparison = compare(edited, EVIDENCE, **GIVEN)
    again = compare(BasalGanglia(edited, "population", seed=3), EVIDENCE, **GIVEN)
    pd.testing.assert_frame_equal(comparison.table, again.table)
    assert set(comparison.table["model"]) == {"circuit", "cortical decoder"}
    intact = compare("spiking_msprt", EVIDENCE, **GIVEN)
    assert not intact.table.equals(comparison.table)


def test_a_comparison_is_a_short_table_a_long_one_and_a_picture():
    comparison = compare("spiking_msprt", EVIDENCE, baselines="race", **GIVEN)
    short = comparison.summary()
    assert list(short["accuracy"].unique()) == [0.9]
    assert {"agreement", "extra_ms", "accuracy_gap"} <= set(short)
    assert len(short) == len(comparison.table.drop_duplicates(["model", "reference"]))
    assert comparison.to_dataframe() is comparison.table
    assert "agreement" in repr(comparison)
    figure = comparison.plot()
    places = []
    for _ in range(2):  # first drawn as later: before it is laid out, labels may lie outside
        figure.draw_without_rendering()
        places.append(figure.axes[0].get_position().bounds)
    assert places[0] == pytest.approx(places[1], rel=0.01)
    labels = [line.get_label() for line in figure.axes[0].get_lines()]
    assert {"MSPRT", "MSPRT at its gain", "Circuit", "Race"} <= set(labels)
    pairs = comparison.pairs
    assert len(pairs) == EVIDENCE.trials
    (value,) = short.query("model == 'circuit' and reference != 'MSPRT'")["agreement"]
    agree = pairs["test_choice"] == pairs["circuit_choice"]
    assert agree.mean() == pytest.approx(value, abs=1e-3)
    curves = comparison.curves
    assert (curves["low"] <= curves["accuracy"] + 1e-9).all()
    assert (curves["high"] >= curves["accuracy"] - 1e-9).all()
    plt.close(figure)


def test_columns_of_a_page_are_apart_also_where_numbers_are_negative():
    numbers = {"accuracy": 0.9, "value": -0.011, "low": -0.03, "high": -0.002, "model": "a"}
    shown = page(pd.DataFrame([numbers | {"measure": name} for name in SHOWN]))
    assert shown.count("-0.011 [-0.030, -0.002] ") == 2
    assert "]-" not in shown


def test_a_circuit_of_other_channels_is_refused():
    with refused("drive 2 hypotheses, spiking_msprt has 3 channels"):
        compare(load_circuit("spiking_msprt", 3), EVIDENCE, **GIVEN)


@pytest.mark.parametrize("seed", [1, 8, 12])
def test_a_later_deadline_changes_nothing(seed):
    """Strong evidence, populations and rates, cues on a lattice; 100 tasks in `make validate`."""
    both = compared(DeadlineTask.drawn(seed))
    assert both["value_long"].notna().any()
    assert changed(both).empty


def said_of(model, evidence, accuracies):
    """Return a comparison and its warnings, as (category, text)."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        comparison = compare(model, evidence, accuracies=accuracies, resamples=100)
    return comparison, [(one.category, str(one.message)) for one in caught]


RATES = BasalGanglia(load_circuit("macaque"), "rate", seed=1)
REASONS = {
    "one reading": ((3.0, 20), (0.9, 0.97), RangeWarning, "one reading alone gives 0.92"),
    "readings": ((0.5, 10), (0.9, 0.65), DeadlineWarning, "all readings of a trial, 10 at most"),
    "deadline": ((0.5, 10), (0.79, 0.65), DeadlineWarning, "the deadline decides .* readings"),
    "read-out": ((0.5, 200), (0.998, 0.9), RangeWarning, "its read-out resolves no OUT below"),
}
"""d' and readings; an accuracy that can't be compared, and one that can; the warning."""


@pytest.mark.parametrize("reason", REASONS)
def test_what_cannot_be_compared_has_its_reason_also_where_others_can(reason):
    (d_prime, readings), accuracies, category, text = REASONS[reason]
    evidence = gaussian_evidence(200, d_prime=d_prime, t_max=readings, seed=1)
    comparison, warned = said_of(RATES, evidence, accuracies)
    rows = comparison.table.query("model == 'circuit' and measure == 'agreement'")
    known = rows.groupby("accuracy")["value"].agg(lambda values: values.notna().all())
    assert known.to_dict() == dict(zip(accuracies, (False, True), strict=True))
    # Once, at the accuracy that it is about.
    (named,) = [one for one in warned if re.search(rf"accuracy (of )?{accuracies[0]}:", one[1])]
    assert issubclass(named[0], category)
    assert re.search(text, named[1])
    lines = verdicts(comparison.table, [named[1]]).splitlines()
    at = lines.index(f"  at {accuracies[0]:g}: {NOT_REACHED}")
    assert "warning" in lines[at + 1]


def test_without_reason_nothing_is_said():
    evidence = gaussian_evidence(200, d_prime=0.7, t_max=120, seed=1)
    comparison, warned = said_of(RATES, evidence, (0.8, 0.9, 0.95, 0.97))
    assert not warned
    assert NOT_REACHED not in verdicts(comparison.table)


LONGER = gaussian_evidence(200, d_prime=0.5, t_max=100, seed=1)


def test_a_circuit_in_nats_keeps_its_gain_and_another_gets_the_fastest():
    model, _ = fastest_gain(load_circuit("spiking_msprt"), "rate", LONGER, 1)
    assert model.gain == model.circuit.default_gain
    assert fastest_gain(load_circuit("bogacz_gurney"), "rate", LONGER, 1)[0].gain == 1
    model, decided = fastest_gain(load_circuit("gpr"), "rate", LONGER, 1)
    assert model.gain in GAINS
    slow, slower = fastest_gain(load_circuit("gpr"), "rate", LONGER, 1, gain=0.05)
    assert slow.gain == 0.05
    at = [np.interp(0.9, np.sort(one.posterior.mean(axis=1)), np.sort(one.time_ms.mean(axis=1)))
          for one in (decided, slower)]  # fmt: skip
    assert at[0] <= at[1]
    with pytest.raises(InputError):  # it rests below its thresholds
        fastest_gain(load_circuit("linear_gpe"), "rate", LONGER, 1)


@given(st.integers(0, 2**31), st.integers(3, 14))
def test_chance_is_the_mean_over_all_pairs_of_different_trials_of_one_truth(seed, trials):
    rng = np.random.default_rng(seed)
    truth = rng.integers(2, size=trials)
    x, y = rng.integers(0, 3, (2, trials))
    weights = rng.integers(0, 3, (2, trials)).astype(float)
    chance = by_chance(x, y, truth, weights)
    for b in range(2):
        total = counted = 0.0
        for s in (0, 1):
            here = truth == s
            pairs = np.outer(weights[b][here], weights[b][here])
            np.fill_diagonal(pairs, 0)
            if pairs.sum():
                same = x[here][:, None] == y[here]
                total += weights[b][here].sum() * (pairs * same).sum() / pairs.sum()
                counted += weights[b][here].sum()
        wanted = total / counted if counted else np.nan
        np.testing.assert_allclose(chance[b], wanted, rtol=1e-9, atol=1e-9)


def test_without_a_truth_all_trials_are_shuffled():
    """Two alternatives, each chosen in half of the trials: agreement by chance is a half."""
    choice = np.arange(2000) % 2
    one = ChoicesAndTimes(choice, np.arange(2000.0))
    unknown = side_by_side(one, one, None, np.ones((1, 2000)))
    assert unknown["agreement_chance"][0] == pytest.approx(0.5, abs=1e-3)
    known = side_by_side(one, one, choice, np.ones((1, 2000)))
    assert known["agreement_chance"][0] == 1
    assert np.isnan(known["agreement_corrected"][0])


def test_r_by_its_ceiling_is_that_without_noise():
    """Spearman 1904: noise of variance v lowers r by sqrt(1 / (1 + v)), which its copy tells."""
    rng = stream(4, "attenuation")
    exact = rng.normal(0, 1, 20_000)
    noisy, again = exact + rng.normal(0, 0.7, (2, 20_000))
    choice = np.zeros(20_000, dtype=int)
    one, two, three = (ChoicesAndTimes(choice, values) for values in (exact, noisy, again))
    measures = side_by_side(one, two, None, np.ones((1, 20_000)), again=three)
    assert measures["pearson_r"][0] == pytest.approx(np.sqrt(1 / 1.49), abs=0.01)
    assert measures["r_noise_corrected"][0] == pytest.approx(1, abs=0.01)


def test_accuracies_and_times_are_counted_with_the_weights_of_trials():
    truth = np.array([0, 1, 1, 0])
    test = ChoicesAndTimes(np.array([0, 1, 0, 1]), np.array([10.0, 20, 30, 60]))
    other = ChoicesAndTimes(np.array([0, 1, 1, 1]), np.array([15.0, 25, 35, 75]))
    weights = np.array([[1.0, 1, 1, 1], [3, 0, 0, 1]])
    measures = side_by_side(test, other, truth, weights)
    assert measures["test_accuracy"].tolist() == [0.5, 0.75]
    assert measures["accuracy"].tolist() == [0.75, 0.75]
    assert measures["agreement"].tolist() == [0.75, 1]
    assert measures["error_agreement"].tolist() == [0.5, 1]
    assert measures["test_ms"].tolist() == [30, 22.5]

"""A single call gives the same table as its parts, for unedited and edited circuits."""

import matplotlib.pyplot as plt
import pandas as pd
import pytest

from bgmodel import BasalGanglia, compare, stream
from bgmodel.simulated_evidence import separated_evidence
from circuits.anatomy import load_circuit
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
    labels = [line.get_label() for line in figure.axes[0].get_lines()]
    assert {"MSPRT", "MSPRT at its gain", "Circuit", "Race"} <= set(labels)
    pairs = comparison.pairs
    assert len(pairs) == EVIDENCE.trials
    (value,) = short.loc[
        (short["model"] == "circuit") & (short["reference"] != "MSPRT"), "agreement"
    ]
    assert (pairs["test_choice"] == pairs["circuit_choice"]).mean() == pytest.approx(
        value, abs=1e-3
    )
    curves = comparison.curves
    assert (curves["low"] <= curves["accuracy"] + 1e-9).all()
    assert (curves["high"] >= curves["accuracy"] - 1e-9).all()
    plt.close(figure)


def test_an_unknown_baseline_and_a_circuit_of_other_channels_are_refused():
    with refused("baselines"):
        compare("spiking_msprt", EVIDENCE, baselines=["ddm"], **GIVEN)
    with refused("drive 2 hypotheses, spiking_msprt has 3 channels"):
        compare(load_circuit("spiking_msprt", 3), EVIDENCE, **GIVEN)

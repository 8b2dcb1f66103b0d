"""Figure L5 shows what the stored tables of the score say."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from benchmarks.methods.simon import BOTH, QUANTILES
from benchmarks.methods.simon_predictions import CONTROLS, KINDS, ON_OFF, told
from benchmarks.pages import TABLES
from benchmarks.scores.medication import LATER, ONE_DEADLINE, outcomes, power
from bgmodel.support.files import read_table
from figures import figL5
from figures.common import FAST, where

PATHS = [TABLES / f"medication_{part}.csv" for part in ("people", "outcomes", "circuit")]


def test_names_in_the_figure_are_those_of_the_score():
    assert (QUANTILES, BOTH) == (figL5.QUANTILES, figL5.BOTH)
    assert (*KINDS, LATER.kind) == figL5.KINDS
    assert (figL5.CONTROLS, figL5.ON_OFF, figL5.WHO) == (CONTROLS, ON_OFF, ONE_DEADLINE)


def test_figure_l5_has_four_panels_with_the_stored_changes(tmp_path):
    figure = figL5.draw(FAST, *PATHS, output=tmp_path)
    figure.draw_without_rendering()
    plt.close(figure)
    assert len(figure.axes) == 5  # the last one has a second axis
    table = where(read_table(PATHS[1]), who=ONE_DEADLINE, kind="pulse", contrast=ON_OFF)
    names = [f"q{100 * q:.0f}_ms" for q in QUANTILES]
    lines = [line.get_ydata() for line in figure.axes[0].lines if len(line.get_ydata()) == 5]
    for column in ("predicted", "value"):
        expected = table.set_index("measure").loc[names, column].to_numpy()
        assert any(np.allclose(line, expected) for line in lines)


def test_the_stored_outcomes_are_those_of_the_committed_predictions():
    people, stored = (read_table(path) for path in PATHS[:2])
    again = outcomes(people)
    assert again["outcome"].tolist() == stored["outcome"].tolist()
    assert len(stored) == 3 * len(told().predictions)


def test_the_circuit_on_fresh_seeds_is_where_it_was_predicted():
    table = read_table(TABLES / "medication_circuit.csv").set_index(
        ["kind", "contrast", "dopamine", "measure"]
    )
    for each in told().predictions:
        if each.contrast in (CONTROLS, ON_OFF):
            level = 1.0 if each.contrast == CONTROLS else 0.9
            row = table.loc[(each.kind, each.contrast, level, each.measure)]
            # Two independent samples of the same size, more than a hundred comparisons.
            assert abs(row["value"] - each.value) < 4 * np.sqrt(2) * row["error"] + 1e-3


@pytest.mark.parametrize(("value", "expected"), [(0.0, 0.05), (1.96, 0.5), (10.0, 1.0)])
def test_power_is_that_of_a_normal_mean(value, expected):
    assert power(value, -1.96, 1.96) == pytest.approx(expected, abs=1e-3)

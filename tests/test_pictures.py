"""What a reader sees: no text covers another, none is cut off, and colours stay apart."""

import importlib
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest

from bgmodel import plots
from bgmodel.experiments.experiment import shipped
from circuits import anatomy
from figures.common import FULL, STYLE
from figures.rooms import rooms
from tests.pictures import covered, under_legends

TIMES = np.linspace(100, 900, 90) ** 1.1
FORCED = TIMES > 1500


def histogram(ax):
    return plots.choice_times(np.arange(90) % 3 % 2, TIMES, FORCED, np.zeros(90, int), ax)


def of_choices(ax):
    return plots.choice_times(np.arange(90) % 2, TIMES, FORCED, None, ax)


def undecided(ax):
    return plots.choice_times([-1, -1], [np.nan] * 2, [False] * 2, [0, 0], ax)


def tradeoff(ax):
    return plots.tradeoff([200.0, 500.0, 900.0], [70, 80, 95], [100, 99, 98], ax)


def output(ax):
    time_ms = np.arange(-100.0, 1000.0)
    return plots.output(time_ms, np.stack([0.7 + time_ms / 3000, 0.7 - time_ms / 2000], 1), ax)


def posteriors(ax):
    rise = 1 / (1 + np.exp(-np.arange(-5, 30) / 5))
    return plots.posteriors(np.arange(35.0), np.stack([rise, 1 - rise], axis=1), 0, ax)


def ratios(ax):
    return plots.learned_ratios(np.linspace(-2, 2, 50), np.linspace(-1.8, 2.1, 50), ax)


PARTS = (histogram, of_choices, undecided, tradeoff, output, posteriors, ratios)
TITLE = "10 % of STN silenced: 0.87 correct, mean 727 ms"


@pytest.mark.parametrize("draw", PARTS)
def test_in_a_figure_of_its_own_nothing_is_covered(draw):
    assert covered(draw(None)) == []


@pytest.mark.parametrize("first", [True, False], ids=["title first", "title last"])
@pytest.mark.parametrize("draw", PARTS)
def test_on_axes_of_a_user_the_title_of_the_user_is_the_only_one(draw, first):
    figure, axes = plt.subplots(2, sharex=True, layout="constrained")
    for ax in axes:
        if first:
            ax.set_title(TITLE)
        draw(ax)
        if not first:
            ax.set_title(TITLE)
        ax.label_outer()
    assert [ax.get_title(loc) for ax in axes for loc in ("left", "right")] == [""] * 4
    assert covered(figure) == []


def test_texts_that_cover_each_other_are_found():
    figure, ax = plt.subplots()
    ax.set_title("a title in the middle of the Axes")
    ax.set_title("another one, from the left end on", loc="left")
    figure.text(0.99, 0.5, "beyond the edge")
    assert {pair[1] for pair in covered(figure)} == {
        "another one, from the left end on",
        "the edge",
    }


@pytest.mark.parametrize("name", ["stn_conflict", "stop_stn_lesion"])
@pytest.mark.parametrize("long", [False, True])
def test_the_columns_of_an_experiment_stand_apart(name, long):
    one = shipped()[name]
    few = replace(one, engine="population", task=replace(one.task, trials=100))
    named = replace(few, name=few.name + " and one more word" * 5 * long)
    outcome = named.run()
    assert covered(outcome.plot()) == []
    none = replace(outcome, experiment=replace(named, predictions=(), effects=()))
    assert covered(none.plot()) == []


@pytest.mark.parametrize("name", anatomy.CIRCUITS)
def test_the_drawing_of_a_circuit_shows_every_name(name):
    assert covered(anatomy.load_circuit(name).plot()) == []


def from_tables():
    """Yield the figures that are drawn from stored tables alone, and these tables."""
    for room in rooms():
        for module, step, reads, _ in room.steps():
            if step == "draw" and reads and all(path.endswith(".csv") for path in reads):
                name = f"figures.{room.name}.{module}"
                yield pytest.param(name, [Path(path) for path in reads], id=module)


@pytest.mark.parametrize(("script", "tables"), from_tables())
def test_legends_and_texts_of_a_figure_cover_nothing(script, tables, tmp_path):
    draw = importlib.import_module(script).draw
    with plt.style.context(STYLE):
        figure = draw(FULL, *tables, output=tmp_path)
        assert under_legends(figure) == []
        assert covered(figure) == []

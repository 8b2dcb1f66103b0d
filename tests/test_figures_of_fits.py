"""Figure F1: models fitted to monkeys and people, drawn from small tables."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from bgmodel.fitting.exact.algorithms import GapModel
from bgmodel.fitting.fit import cells_of
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.trials.design import design_of
from bgmodel.support.files import read_table
from bgmodel.trials.reading import read_trials
from circuits.anatomy import DEFAULT, load_circuit
from circuits.declaration.table_writer import identity
from figures.common import FAST, FULL
from figures.data import draw_F1 as figF1
from figures.rooms import write

SMALL = {"sensitivity": 15.0, "t0_s": 0.3, "t0_sd_s": 0.05, "lapse": 0.01}
OF = {figF1.TEST: {"bound": 0.6}, figF1.CIRCUIT: {"threshold_nats": 0.3}}
WHO = {figF1.MONKEYS: ["b", "n"], figF1.PEOPLE: ["ah", "eh"]}


def stored(table, path):
    """Write a table as a score does, and return where."""
    circuits = {"2": identity(load_circuit(DEFAULT, 2))}
    return write(table, path, seed=1, trials=10, circuits=circuits)


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    """Return the paths of parameters, cells and predicted of two monkeys and two people."""
    folder = tmp_path_factory.mktemp("fits")
    parameters, cells, better = [], [], []
    for data, people in WHO.items():
        for who in people:
            design = design_of(read_trials(data, strength="coherence", participant=who))
            likelihood = likelihood_of(GapModel(), design)
            rows = cells_of(design, likelihood.density(likelihood.freedom.start))
            for k, (model, changes) in enumerate(OF.items()):
                same = {"data": data, "participant": who, "model": model}
                parameters += [
                    same | {"parameter": name, "value": value}
                    for name, value in (SMALL | changes).items()
                ]
                cells.append(rows.assign(**same))
                better.append(same | {"better_nats": 10.0 * k, "error_nats": 2.0})
    made = {"parameters": pd.DataFrame(parameters), "predicted": pd.DataFrame(better)}
    made["cells"] = pd.concat(cells)
    return {name: stored(table, folder / f"{name}.csv") for name, table in made.items()}


@pytest.fixture(scope="module")
def spreads(tmp_path_factory):
    """Return the path of the standard errors of monkeys' times."""
    path = tmp_path_factory.mktemp("spreads") / "spreads.parquet"
    figF1.spread(FAST, output=path)
    return path


def drawn(figure):
    """Return a figure that was drawn whole."""
    figure.draw_without_rendering()
    plt.close(figure)
    return figure


def heights(ax):
    """Return what the lines of a panel show, a list of arrays."""
    return [np.asarray(line.get_ydata(), float) for line in ax.lines]


def shows(ax, values):
    """Whether a line or the markers of a panel are at given values."""
    return any(len(y) == len(values) and np.allclose(y, values) for y in heights(ax))


def test_resampled_quantiles_scatter_as_those_of_so_many_trials(spreads):
    """The median of n Gaussian times has an error of 1.25 sd / sqrt(n)."""
    table = read_table(spreads)
    assert sorted(table["participant"].unique()) == WHO[figF1.MONKEYS]
    some = read_trials(figF1.MONKEYS, strength="coherence", participant="b")
    design = design_of(some)
    rt = design.observed.rt_s[design.observed.cell == 0]
    error = table[(table["participant"] == "b") & (table["strength"] == 0)]["q50_s"].item()
    assert error == pytest.approx(1.25 * rt.std() / np.sqrt(len(rt)), rel=0.4)
    assert (table[[*figF1.QUANTILES, "sd_s"]] > 0).all(axis=None)


def test_figure_f1_shows_data_and_both_models(tables, spreads, tmp_path):
    figure = drawn(figF1.draw(FULL, tables["cells"], spreads, output=tmp_path))
    cells = read_table(tables["cells"])
    for column, who in enumerate(WHO[figF1.MONKEYS]):
        one = cells[(cells["participant"] == who) & (cells["model"] == figF1.CIRCUIT)]
        for row, name in enumerate(("accuracy", "mean_s", "q90_s")):
            ax = figure.axes[3 * row + column]
            assert shows(ax, one[name])
            assert shows(ax, one[f"model_{name}"])
    people = cells[(cells["data"] == figF1.PEOPLE) & (cells["model"] == figF1.TEST)]
    for _, one in people.groupby("participant"):
        assert shows(figure.axes[5], one["mean_s"])

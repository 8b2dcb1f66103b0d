"""Figure G2, from the stored tables of stopping."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from bgmodel.support.files import read_table
from figures.common import FAST
from figures.rooms import table_path
from figures.stopping import draw_G2 as figG2


def drawn(figure):
    """Draw a figure as when it is saved, and close it."""
    figure.draw_without_rendering()
    plt.close(figure)
    return figure


def stored(*names):
    """Return the paths of tables of the score."""
    return [table_path(f"stopping_{name}") for name in names]


def test_figure_g2_shows_the_race_and_the_circuit_at_one_place(tmp_path):
    paths = stored("inhibition", "relative", "tone")
    figure = drawn(figG2.draw(FAST, *paths, output=tmp_path))
    assert len(figure.axes) == 6
    table = read_table(paths[0])
    by = table.pivot(index="ssd_ms", columns="decider", values="p_respond")
    assert by["circuit, 1 nat"].to_numpy() == pytest.approx(by["race"].to_numpy(), abs=0.01)
    rows = table[table["decider"] == "circuit, 1 nat"]
    assert figG2.relative(rows).is_monotonic_increasing
    assert set(figG2.DECIDERS) | {figG2.RACE} <= set(table["decider"])


def test_common_input_changes_the_extra_channel_and_not_the_circuit():
    tone = read_table(stored("tone")[0])
    assert set(tone["compared"]) == set(figG2.COMPARED)
    by = tone[tone["engine"] == "population"].groupby("compared")["p_respond"].agg(np.ptp)
    assert by["circuit"] < 0.02 < 0.2 < by["extra channel"]

"""Figures of stopping: G1 from a short run, G2 and G3 from the stored tables."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from benchmarks.pages import TABLES
from bgmodel.support.files import read_table
from figures import figG1, figG2, figG3
from figures.common import FAST

TINY = replace(FAST, circuit_trials=12)


def drawn(figure):
    """Draw a figure as when it is saved, and close it."""
    figure.draw_without_rendering()
    plt.close(figure)
    return figure


def stored(*names):
    """Return the paths of tables of the score."""
    return [TABLES / f"stopping_{name}.csv" for name in names]


@pytest.fixture(scope="module")
def followed(tmp_path_factory):
    """Return the path of what figure G1 computes."""
    path = tmp_path_factory.mktemp("G1") / "figG1.parquet"
    figG1.compute(TINY, output=path)
    return path


def test_figure_g1_shows_a_trial_that_a_signal_stops(followed):
    table = read_table(followed)
    level = table.loc[table["panel"] == "level", "value"].item()
    out = table[table["panel"] == "out"].pivot(index="time_ms", columns="name", values="value")
    before, late = out.loc[: figG1.SSD_MS], out.loc[figG1.SSD_MS + 100 :]
    np.testing.assert_array_equal(before[figG1.GO], before[figG1.STOP])
    assert late[figG1.STOP].min() > level > late[figG1.GO].min()
    assert (late[figG1.STOP] - late[figG1.CLOSED]).abs().mean() < 0.1
    response = table.loc[table["panel"] == "response", "time_ms"].item()
    assert figG1.SSD_MS + 50 < response < figG1.SHOWN_MS


def test_figure_g1_counts_in_spikes_what_rates_predict(followed):
    table = read_table(followed)
    for name, (_, nats, lasts) in figG1.SIGNALS.items():
        rows = table[table["name"] == name]
        seen = rows[rows["panel"] == "mean"].sort_values("time_ms")
        c = rows[rows["panel"] == "c"].sort_values("time_ms")
        theory = np.interp(seen["time_ms"], c["time_ms"], c["value"])
        assert np.abs(seen["value"] - theory).mean() < 0.05
        end = 0.0 if lasts < figG1.END_MS else nats
        assert c["value"].iloc[-1] == pytest.approx(end, abs=0.03)


def test_figure_g1_has_three_panels(followed, tmp_path):
    figure = drawn(figG1.draw(TINY, followed, output=tmp_path))
    assert len(figure.axes) == 3
    bands = [text.get_text() for text in figure.axes[1].get_yticklabels()]
    assert bands == ["STN,\nno signal", "STN,\nstop signal", "SNr,\nno signal", "SNr,\nstop signal"]


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


def test_figure_g3_has_a_cell_for_each_pause_and_a_mark_for_each_signal(tmp_path):
    paths = stored("pause", "arky")
    figure = drawn(figG3.draw(FAST, *paths, output=tmp_path))
    pauses, signals = (read_table(path) for path in paths)
    left, right, _ = figure.axes
    assert len(left.texts) == len(pauses[pauses["cancel_ms"] > 0])
    assert len(right.get_yticklabels()) == len(signals)


@pytest.mark.parametrize(
    ("signal", "kind"),
    [
        ("no signal, without Arky", "no signal"),
        ("STN held", "STN"),
        ("Arky 150 ms", "Arky"),
        ("STN 100 ms, Arky held 40 ms later", "both"),
        ("Arky 150 ms, cancel after 80 ms", "cancel"),
    ],
)
def test_a_signal_has_the_colour_of_what_it_involves(signal, kind):
    assert figG3.kind(signal) == kind


def test_a_cell_of_the_map_is_one_pause_and_one_cancel():
    rows = [(50.0, 0.0, 0.4), (50.0, 50.0, 0.2), (100.0, 0.0, 0.5), (100.0, 50.0, 0.3)]
    table = pd.DataFrame(rows, columns=["cancel_ms", "pause_ms", "p_respond"])
    figure, ax = plt.subplots()
    figG3._map(ax, table)
    plt.close(figure)
    shown = {tuple(text.get_position()): text.get_text() for text in ax.texts}
    assert shown == {(0, 0): "40", (1, 0): "20", (0, 1): "50", (1, 1): "30"}

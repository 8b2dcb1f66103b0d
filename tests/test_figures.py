"""The figures' rules hang together, and two of them show what they say; `make figures` draws."""

import os
import re
import subprocess
import sys
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from bgmodel import stream
from bgmodel.support.files import read_table, write_table
from bgmodel.tactile.source import Source
from circuits.anatomy import DEFAULT, load_circuit
from circuits.dynamics.fixed_point import resting_hz
from figures import fig2b, figA2, figC1, figC2, figD5, figR1
from figures.common import FAST
from tests.helpers import ROOT

SCRIPTS = sorted(path.stem for path in (ROOT / "figures").glob("fig*.py"))


def dry_run(recordings):
    command = [sys.executable, "-m", "snakemake", "-s", "figures/Snakefile", "-n", "--cores", "1"]
    # Another folder for the figures would be asked for by an option; a dry run writes nothing.
    done = subprocess.run(
        [*command, "--forceall", "--nolock", "--config", "fast=1"],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env=os.environ | {"BGMODEL_RECORDINGS": recordings},
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def test_every_script_is_drawn():
    planned = dry_run("tests")
    for script in SCRIPTS:
        assert re.search(rf"figures/fast/{script}\.png", planned), script


def test_real_taps_are_drawn_only_where_given():
    assert "figR1" not in dry_run("")


@pytest.mark.parametrize("script", [*SCRIPTS, "prepare", "sweep"])
def test_scripts_are_run_as_modules_and_import_downwards(script):
    text = (ROOT / "figures" / f"{script}.py").read_text()
    assert 'if __name__ == "__main__":\n    run(' in text
    assert "import torch" not in text


@pytest.fixture
def followed():
    """Trials of figure 2b on readings that speak for the truth by 0.5 nats."""
    for_s1, for_s2 = np.array([[0.25, -0.25]]), np.array([[-0.25, 0.25]])
    readings = Source([for_s1, for_s2], ("S1", "S2"), None)
    return fig2b.follow(readings, replace(FAST, t_max=6), trials=60)


def test_evidence_of_figure_2b_rises_for_s2(followed):
    """Z is the log odds of S2: R2 at the upper bound, R1 at the lower (Burguete et al. 2023)."""
    sign = np.where(followed["truth"] == 1, 1, -1)
    assert followed["z"].to_numpy() == pytest.approx(0.5 * sign * followed["step"])
    assert (followed["choice"] == followed["truth"]).all()
    assert (followed["steps"] == 4).all()


def test_figure_2b_draws_the_evidence_of_each_state(followed, tmp_path):
    write_table(followed, tmp_path / "z.parquet")
    figure = fig2b.draw(FAST, tmp_path / "z.parquet", output=tmp_path)
    responses, paths = figure.axes
    plt.close(figure)
    # Columns are responses, rows are states.
    assert np.array_equal(responses.images[0].get_array(), np.eye(2))
    colour = {text.get_text(): line.get_color() for line, text in legend(paths)}
    for name, end in (("S1 (AA)", -2.0), ("S2 (AB)", 2.0)):
        drawn = [x for x in paths.lines if x.get_color() == colour[name] and len(x.get_xdata()) > 1]
        assert len(drawn) == fig2b.SHOWN
        assert {line.get_ydata()[-1] for line in drawn} == {end}


def legend(ax):
    """Pairs of a line and its text."""
    box = ax.get_legend()
    return zip(box.get_lines(), box.get_texts(), strict=True)


def test_figure_r1_scores_every_fold_of_the_taps():
    rng = stream(1, "edges")
    true = np.linspace(-6, 6, 900)
    taps = pd.DataFrame({"yaw_deg": true, "edge_deg": true + rng.normal(0, 1.5, 900)})
    table = figR1.decide(replace(FAST, sweep_trials=400), taps)
    assert set(table["fold"]) == set(range(6))
    # One reading tells more of a wider difference.
    accuracy = table[table["boundary_separation"] == 0].groupby("difference_deg")["accuracy"].mean()
    assert accuracy.is_monotonic_increasing
    assert accuracy.iloc[-1] > 0.9


TINY = replace(FAST, repeats=1, circuit_trials=12, dopamine_trials=4)


def computed_and_drawn(script, folder):
    """Return the table and the figure of a script."""
    data = folder / "data.parquet"
    script.compute(TINY, output=data)
    figure = script.draw(TINY, data, output=folder)
    figure.draw_without_rendering()
    plt.close(figure)
    return read_table(data), figure


@pytest.mark.validate
def test_figure_c1_counts_what_theory_says(tmp_path, monkeypatch):
    monkeypatch.setattr(figC1, "CELLS", 500)
    monkeypatch.setattr(figC1, "HELD_S", 2)
    table, figure = computed_and_drawn(figC1, tmp_path)
    assert len(figure.axes) == 5
    fast = table[table["law_hz"] > 5]
    assert fast["rate_hz"].to_numpy() == pytest.approx(fast["law_hz"].to_numpy(), rel=0.02)
    assert np.ptp(table.loc[table["nucleus"] == "STN", "input_nats"]) > 6


def test_figure_c2_follows_the_first_trial(tmp_path):
    table, figure = computed_and_drawn(figC2, tmp_path)
    assert len(figure.axes) == 2 + 4 * len(figC2.NUCLEI)
    decided = table[table["panel"] == "decision"].set_index("name")
    for name, out in table[table["panel"] == "out"].groupby("name"):
        below = out[(out["value"] <= figC2.THRESHOLD_NATS) & (out["time_ms"] > 0)]
        first = below.sort_values("time_ms").iloc[0]
        assert tuple(first[["channel", "time_ms"]]) == tuple(
            decided.loc[name, ["channel", "time_ms"]]
        )
    counts = table[table["panel"] == "trials"].set_index("name")["value"]
    assert counts["onset"] == 4
    assert 1 <= counts["response"] <= 4


def test_figure_c2_sets_the_chosen_channel_against_the_mean_of_the_others():
    rates = np.array([[[1.0, 4.0, 7.0]], [[1.0, 4.0, 7.0]]])
    pairs = figC2.chosen_and_others(rates, np.array([0, 2]))
    assert pairs.tolist() == [[[1.0, 5.5]], [[7.0, 2.5]]]


@pytest.mark.validate
def test_figure_d5_counts_what_its_closed_form_says(tmp_path, monkeypatch):
    """Less dopamine, more power of 13-30 Hz: doubled at 0.5; nothing that was fitted."""
    monkeypatch.setattr(figD5, "LEVELS", (1.0, 0.7, 0.5))
    table, figure = computed_and_drawn(figD5, tmp_path)
    assert len(figure.axes) == 6
    power = table[(table["measure"] == "band") & table["level"].isin(figD5.LEVELS)]
    by = power.pivot(index=["nucleus", "drive", "level"], columns="by", values="value")
    assert by["spikes"].to_numpy() == pytest.approx(by["closed form"].to_numpy(), rel=0.2)
    for _, one in by["spikes"].groupby(level=["nucleus", "drive"]):
        # Levels rise from 0.5 on.
        assert one.is_monotonic_decreasing
        assert one.iloc[0] > 1.8 * one.xs(1.0, level="level").iloc[0]
    rates = table[table["measure"] == "rate"].pivot(
        index=["nucleus", "drive"], columns="level", values="value"
    )
    leader = rates.filter(like="leader", axis=0)
    assert (leader[0.5] < 1.3 * leader[1.0]).all()


def test_figure_d5_lowers_the_frequency_by_a_slower_loop():
    table = figD5.frequencies(load_circuit(DEFAULT).dopamine(figD5.LOW))
    by = table.pivot(index="at", columns="nucleus", values="value")
    assert (by.diff().iloc[1:] < 0).all(axis=None)
    assert np.ptp(by.loc[1.0]) == 0
    assert (by.loc[2.0, "both"] < by.loc[2.0, ["delays", "time constants"]]).all()


def test_figure_a2_changes_fast_inhibition_and_no_rate_at_rest():
    table = load_circuit(DEFAULT, figA2.CHANNELS)
    assert figA2.with_fast(figA2.DEFAULT_GAIN) == table
    for gain in figA2.GAINS:
        assert resting_hz(figA2.with_fast(gain)) == pytest.approx(resting_hz(table))


def test_conflict_raises_stn_more_without_fast_inhibition_and_less_than_theory_allows():
    few = replace(TINY, circuit_trials=60)
    rises = {}
    for name in figA2.SHOWN:
        rise = figA2.rise(few, name, figA2.circuits()[name], "population", 1.0)
        rises[name] = rise[(rise["nucleus"] == "STN") & rise["time_ms"].isna()]["value"].item()
    default, held, old = rises.values()
    ceiling = figA2.ceiling(few, 1.0).set_index("circuit")["value"]
    assert 3 < default < held < ceiling[figA2.EXACT] < ceiling[figA2.LINEAR]
    assert abs(old) < 2

"""The figures' rules hang together, and one of them shows what it says; `make figures` draws."""

import os
import subprocess
import sys
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest

from bgmodel.support.files import write_table
from bgmodel.tactile.source import Source
from figures.common import FAST
from figures.touch import draw_2b as fig2b
from tests.helpers import ROOT

SCRIPTS = sorted((ROOT / "figures").glob("*/draw_*.py"))


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
        assert f"figures/fast/fig{script.stem.removeprefix('draw_')}.png" in planned


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

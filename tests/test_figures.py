"""The figures' rules hang together, and stored tables of scores show what they must."""

import os
import subprocess
import sys

import numpy as np
import pytest

from bgmodel.support.files import read_table
from figures.rooms import table_path
from figures.stopping import draw_G2 as figG2
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


def stored(name):
    return read_table(table_path(name))


def test_simulated_experiments_have_the_predicted_medians_within_a_fifth():
    table = stored("discriminate_trials").dropna(subset="median")
    # Medians are whole numbers: one trial is within the error where few are needed.
    apart = (table["simulated_median"] - table["median"]).abs()
    near = (apart <= np.maximum(0.2 * table["median"], 1.0)).groupby(table["pair"]).all()
    assert near.sum() >= 3
    # A Bayes factor of 10 is wrong in at most 1 of 11 experiments, within 3 errors of 200 of them.
    assert (table["right"] > 1 - 1 / 11 - 3 * np.sqrt(10 / 11**2 / 200)).all()


def test_the_race_and_the_circuit_stop_at_one_place_and_common_input_moves_the_extra_channel():
    table, tone = stored("stopping_inhibition"), stored("stopping_tone")
    by = table.pivot(index="ssd_ms", columns="decider", values="p_respond")
    assert by["circuit, 1 nat"].to_numpy() == pytest.approx(by["race"].to_numpy(), abs=0.01)
    assert figG2.relative(table[table["decider"] == "circuit, 1 nat"]).is_monotonic_increasing
    by = tone[tone["engine"] == "population"].groupby("compared")["p_respond"].agg(np.ptp)
    assert by["circuit"] < 0.02 < 0.2 < by["extra channel"]


def test_regrets_are_small_where_reversals_are_known():
    table = stored("values_bandit")
    rows = table[(table["better"] == 0.8) & (table["reversals"] == "every 50")]
    assert rows.set_index("learner")["relative_regret"].drop(["ideal", "chance"]).min() < 1.35
    hazard = table[table["reversals"] == "hazard"]
    assert (hazard["relative_regret"] + 3 * hazard["relative_regret_se"].fillna(0) >= 1).all()


def test_times_fall_and_choices_improve_with_the_difference_of_values():
    for _, rows in stored("values_times").groupby("dopamine"):
        assert rows["share"].is_monotonic_increasing
        assert rows["median_ms"].is_monotonic_decreasing

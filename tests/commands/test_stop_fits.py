"""The command `fit` for stop-signal trials, and stop trials that are given as choices."""

import json

import numpy as np
import pandas as pd
import pytest

import bgmodel as bg
from bgmodel.commands.stop_fits import PARAMETERS, PEOPLE
from bgmodel.stopping.people import read_people
from bgmodel.support.files import read_provenance, read_table
from circuits.errors import DataWarning
from tests.helpers import refused, run, unwarned


def table_of(people=4, trials=120):
    """Return a user's table of stop-signal trials, in seconds."""
    rng = np.random.default_rng(1)
    parts = []
    for who in range(people):
        go = 0.3 + rng.gamma(3.0, 0.05, trials)
        ssd = np.where(rng.random(trials) < 0.4, rng.choice([0.1, 0.2, 0.3], trials), np.nan)
        rt = np.where(go < np.nan_to_num(ssd + 0.2, nan=9), go, np.nan)
        right = np.where(rng.random(trials) < 0.95, "left", "right").astype(object)
        right[np.isnan(rt)] = None
        parts.append(pd.DataFrame({"participant_id": f"p{who}", "rt": rt, "ssd": ssd,
                                   "stimulus": "left", "response": right}))  # fmt: skip
    return pd.concat(parts, ignore_index=True)


@pytest.fixture(autouse=True)
def mine(tmp_path, monkeypatch):
    """Write a valid table in a new working folder."""
    monkeypatch.chdir(tmp_path)
    table_of().to_csv("mine.csv", index=False)


def fails(capsys, *arguments):
    """Run a command that must end with one sentence; return it."""
    assert run("fit", "mine.csv", *arguments) == 2
    return capsys.readouterr().err.splitlines()[-1]


def test_stop_trials_are_fitted_by_the_test_and_a_circuit(tmp_path, capsys):
    assert run("fit", "mine.csv", "out", "--task", "stop") == 0
    said = capsys.readouterr().out
    assert "constant_gap: 4 participants" in said
    assert "macaque: 4 participants" in said
    assert "ssrt_ms includes afferent and motor delays" in said
    parameters = read_table(tmp_path / "out" / PARAMETERS)
    assert set(parameters["model"]) == {"constant_gap", "macaque"}
    assert set(parameters["parameter"]) == {"ssrt_ms", "ssrt_sd_ms", "failures"}
    people = read_table(tmp_path / "out" / PEOPLE)
    assert people["participant_id"].tolist() == ["p0", "p1", "p2", "p3"]
    assert people["ssrt_ms"].between(150, 250).all()
    assert people["ssrt_ms_constant_gap"].between(120, 280).all()
    asked = read_provenance(tmp_path / "out" / PARAMETERS)["parameters"]
    assert asked["task"] == "stop"
    assert run("fit", "mine.csv", "out", "--task", "stop", "--models", "constant_gap") == 2
    assert "already exists" in capsys.readouterr().err


def test_results_as_json_and_again_with_force(capsys):
    options = ("--task", "stop", "--models", "constant_gap", "--json", "--force")
    for _ in range(2):
        assert run("fit", "mine.csv", *options) == 0
        records = json.loads(capsys.readouterr().out)["records"]
        assert {each["model"] for each in records} == {"constant_gap"}


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--strength", "coherence"), "strength has no effect with --task stop"),
        (("--columns", "rt_window=0,inf"), "rt_window has no effect with --task stop"),
        (("--models", "falling_gap"), "models must be of constant_gap, or circuits"),
        (("--models", "weibull_gap"), "models must be of constant_gap, or circuits"),
    ],
)
def test_options_without_effect_are_refused(capsys, options, says):
    assert says in fails(capsys, "--task", "stop", *options)


def test_stop_trials_in_a_fit_of_choices_are_refused(capsys):
    assert run("fit", "stop_signal_cnp", "--models", "constant_gap") == 2
    assert "stop-signal trials" in capsys.readouterr().err
    assert "stop-signal trials" in fails(capsys, "--models", "constant_gap")
    with refused("ssd stop-signal trials"):
        bg.fit(table_of(), "constant_gap", participant="p0")
    named = table_of().rename(columns={"ssd": "SSD"})
    with refused("SSD stop-signal delays"):
        bg.fit(named.assign(response=1), "constant_gap", participant="p0")


def test_restoring_delays_hides_no_other_doubt_about_a_table():
    """It silences what it restores; delays in another unit are for the user to see."""
    restore = bg.Columns(restore_delays=True)
    seconds = table_of().assign(ssd=lambda t: t["ssd"] / 1000)
    with pytest.warns(DataWarning, match="in ms, not in seconds"):
        read_people(seconds, columns=restore)
    with unwarned():
        read_people(table_of(), columns=restore)

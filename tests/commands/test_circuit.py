"""The commands `circuit show` and `circuit run`."""

import importlib.util

import numpy as np
import pandas as pd
import pytest

from bgmodel.conditions import Condition
from bgmodel.support.files import read_provenance
from bgmodel.task import Gaussian
from circuits.declaration.edits import Edits
from tests.helpers import long_table, run, some_evidence, words


def test_show_draws_a_table_and_says_that_it_is_not_exact(capsys, tmp_path):
    drawing = tmp_path / "c.svg"
    edits = ["--edits", "lesion STN 50%", "scale D1->SNr 0.9"]
    assert run("circuit", "show", "appendix_b", *edits, "--plot", drawing) == 0
    assert "not exact" in capsys.readouterr().out
    assert drawing.stat().st_size > 1000


@pytest.mark.parametrize("command", ["show", "run --engine algebra --task trials=3"])
def test_a_loss_of_stn_is_said_to_act_as_a_criterion(command, capsys):
    run("circuit", *command.split(), "--edits", "lesion STN 10%")
    assert "lesion STN 10%: acts as a criterion lower by 0.105 nats" in capsys.readouterr().err
    run("circuit", *command.split(), "--edits", "lesion GPe 5%")
    assert "acts as" not in capsys.readouterr().err


def test_rates_at_rest_are_shown_where_they_are_asked_for_and_cells_spike(capsys):
    cells, rest = "this circuit has no spiking cells", "without evidence, 4 trials of 5 s"
    for table, asked, wanted in (
        ("appendix_b", [], ()),
        ("appendix_b", ["--rest"], (cells,)),
        ("spiking_msprt", [], ()),
        ("spiking_msprt", ["--rest", "--edits", "neurons 30"], (rest,)),
    ):
        assert run("circuit", "show", table, *asked) == 0
        printed = capsys.readouterr().out
        assert [each for each in (cells, rest) if each in printed] == list(wanted)


def test_only_nwb_needs_its_library(refusal, tmp_path, monkeypatch):
    find_spec = importlib.util.find_spec
    absent = lambda name, *_: find_spec(name) if name != "pynwb" else None  # noqa: E731
    monkeypatch.setattr(importlib.util, "find_spec", absent)
    options = ["--save", tmp_path / "d.csv", *words("--engine algebra --task trials=2 t_max=2")]
    assert run("circuit", "run", *options, "--save-rates", tmp_path / "r.csv") == 0
    options[1:2] = [tmp_path / "e.csv", "--save-nwb", tmp_path / "r.nwb"]
    assert "NWB needs pynwb" in refusal("circuit", "run", *options)


@pytest.mark.parametrize("engine", ["spikes", "algebra", "rate", "population"])
def test_run_writes_trials_and_rates_alike_for_any_number_of_workers(capsys, tmp_path, engine):
    table, rates, again = (tmp_path / f"{name}.csv" for name in ("d", "r", "again"))
    options = ["--engine", engine, "--task", "trials=6", "t_max=4", "channels=3", "--seed", 3]
    options += ["--edits", "neurons 30"] if engine == "spikes" else []
    assert run("circuit", "run", "--save", table, "--save-rates", rates, *options) == 0
    assert "6 trials, accuracy" in capsys.readouterr().out
    assert len(pd.read_csv(table)) == 6
    assert {"population", "channel", "time_ms", "rate_hz"} <= set(pd.read_csv(rates))
    assert run("circuit", "run", "--save", again, *options, "--workers", 1) == 0
    assert again.read_bytes() == table.read_bytes()


def test_run_writes_the_spikes_of_the_first_trials_and_rates_count_them(tmp_path):
    table, spikes, rates = (tmp_path / f"{name}.csv" for name in "dsr")
    options = [*words("--task trials=3 t_max=2 --edits"), "neurons 30", "--engine", "spikes"]
    options += ["--save-spikes", spikes, "--spike-trials", 2]
    assert run("circuit", "run", "--save", table, *options, "--save-rates", rates) == 0
    fired = pd.read_csv(spikes, comment="#")
    assert list(fired) == ["population", "trial", "channel", "neuron", "time_ms"]
    assert set(fired["trial"]) == {0, 1}
    assert {"ctx", "D1", "D2", "STN", "GPe", "SNr", "FSI"} == set(fired["population"])
    assert run("circuit", "run", "--save", table, *options[:-1], 3, "--force") == 0
    fired, mean = pd.read_csv(spikes, comment="#"), pd.read_csv(rates, comment="#")
    for name in ("STN", "GPe"):
        hz = mean[mean["population"] == name]["rate_hz"].mean()
        # 3 trials, 2 channels of 30 cells, two readings and a step of 50 ms.
        counted = (fired["population"] == name).sum() / (3 * 2 * 30 * 0.15)
        assert counted == pytest.approx(hz, rel=1e-5)


def test_a_posterior_below_a_half_is_allowed_where_a_table_has_three_hypotheses(tmp_path, refusal):
    mine = tmp_path / "mine.csv"
    long_table(some_evidence(trials=30)).to_csv(mine, index=False)
    options = ("--task", mine, "--engine", "algebra", "--circuit", "bogacz_gurney", "--gain", 1)
    out = tmp_path / "out.csv"
    assert run("circuit", "run", "--save", out, *options, "--posterior", 0.45) == 0
    assert read_provenance(out)["parameters"]["command"]["posterior"] == 0.45
    # The same criterion as a threshold: -ln P.
    again = tmp_path / "again.csv"
    assert run("circuit", "run", "--save", again, *options, "--threshold", -np.log(0.45)) == 0
    assert again.read_bytes() == out.read_bytes()
    two = ("circuit", "run", "--save", out, *options[2:], "--posterior", 0.45, "--force")
    assert "posterior must lie between chance, 0.5 with 2" in refusal(*two)


@pytest.mark.parametrize(("engine", "noisy"), [("algebra", False), ("population", True)])
def test_a_result_names_its_seed_where_something_was_drawn_with_it(tmp_path, engine, noisy):
    """Evidence is drawn with it, or noise; a table of evidence at the fixed point has neither."""
    evidence = pd.DataFrame({"trial": [0, 0, 1, 1], "step": [1, 2, 1, 2], "ll_a": [1.0, 1, -1, -1]})
    evidence.assign(ll_b=-evidence["ll_a"]).to_csv(tmp_path / "mine.csv", index=False)
    out = tmp_path / "out.csv"
    asked = ["--engine", engine, "--seed", 5, "--force"]
    assert run("circuit", "run", "--save", out, *asked, "--task", "trials=4", "t_max=4") == 0
    assert (pd.read_csv(out)["seed"] == 5).all()
    assert read_provenance(out)["seed"] == 5
    assert run("circuit", "run", "--save", out, *asked, "--task", tmp_path / "mine.csv") == 0
    assert (read_provenance(out)["seed"] == 5) == noisy
    assert (pd.read_csv(out)["seed"] == 5).all() == noisy


def test_an_exported_trial_is_that_of_the_same_condition_in_python(tmp_path):
    edits = ["neurons 8", "lesion STN 25%"]
    options = [*words("--seed 4 --task trials=3 t_max=2 --gain 0.4 --edits"), *edits]
    for trial in (0, 2):
        path = tmp_path / f"{trial}.py"
        assert run("circuit", "export", "--save", path, "--trial", trial, *options) == 0
        task = Gaussian(trials=3, t_max=2)
        asked = Condition(edits=Edits(edits), engine="brian2", gain=0.4, seed=4, task=task)
        evidence = asked.drawn("circuit run").evidence
        drive = asked.model(2).drive(evidence)[trial : trial + 1]
        key = {"seed": 4, "trial": trial}
        text = asked.table(2).to_brian2_script(drive, step_ms=evidence.step_ms, **key)
        assert path.read_text() == text


def test_a_file_of_chosen_trials_has_their_decisions_and_their_spikes(tmp_path, refusal):
    pynwb = pytest.importorskip("pynwb")
    table, spikes, recording = (tmp_path / name for name in ("d.csv", "s.csv", "r.nwb"))
    options = words("--task trials=4 t_max=2 --engine spikes --circuit spiking_msprt")
    options += ["--edits", "neurons 4", "--save-spikes", spikes, "--task", "step_ms=20"]
    chosen = ["--save-nwb", recording, "--nwb-trials", 3, 1]
    assert run("circuit", "run", "--save", table, *options, *chosen) == 0
    decided, fired = (pd.read_csv(path, comment="#") for path in (table, spikes))
    with pynwb.NWBHDF5IO(str(recording), "r") as file:
        read = file.read()
        trials, units = read.trials.to_dataframe(), read.units.to_dataframe()
    assert trials["trial"].to_list() == [3, 1]
    np.testing.assert_array_equal(trials["rt"], decided["rt"][[3, 1]])
    for start, trial in zip(trials["start_time"], (3, 1), strict=True):
        times = np.sort(np.concatenate(units["spike_times"].to_list())) - start
        here = times[(times > 1e-9) & (times < 0.06 + 1e-9)]
        expected = fired[fired["trial"] == trial]["time_ms"].sort_values() / 1000
        np.testing.assert_allclose(here, expected)
        assert len(here) > 10
    options += ["--nwb-trials", 4, "--force"]
    assert "nwb_trials" in refusal("circuit", "run", "--save", table, *options)

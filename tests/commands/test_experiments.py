"""The command `experiment`."""

import json
import re

import numpy as np
import pandas as pd
import pytest

from bgmodel.experiments.expected import AGREES, WITHOUT
from bgmodel.experiments.experiment import Experiment, shipped
from bgmodel.simulated_evidence import separated_evidence
from bgmodel.support.files import provenance_path, read_provenance
from tests.helpers import GOOD, long_table, run


def test_the_file_of_one_that_is_shipped_is_printed_and_runs_as_its_own(tmp_path, refusal, capsys):
    assert run("experiment", "stn_conflict", "--show") == 0
    mine = tmp_path / "mine.toml"
    mine.write_text(capsys.readouterr().out)
    assert Experiment.from_toml(mine) == Experiment.from_toml("stn_conflict")
    assert "show is for a shipped experiment" in refusal("experiment", mine, "--show")


def test_a_question_that_is_new_has_nothing_published(experiment_file, capsys):
    experiment_file.write_text(re.sub("(published|source) = .*\n", "", DELAY))
    assert run("experiment", experiment_file, "--trials", 100) == 0
    page = capsys.readouterr().out
    assert page.endswith("100 trials\n")  # no file was written
    assert "published" not in page


DELAY = """
name = "A longer delay from STN to GPe"
published = "nothing: a hypothesis"
source = "nobody"
note = "2 ms more, and a pathway that the table has not."
circuit = "spiking_msprt"
engine = "rate"
[task]
d_prime = 0.8
trials = 120
t_max = 40
[control]
edits = ["add D1->GPe weight=-0.05 delay_ms=4 tau_ms=6"]
[manipulation]
edits = ["set STN->GPe.delay_ms 4", "add D1->GPe weight=-0.05 delay_ms=4 tau_ms=6"]
[[predictions]]
measure = "accuracy"
direction = "none"
at_least = 0.05
"""


def test_a_delay_of_a_pathway_is_a_hypothesis_in_a_file(experiment_file, tmp_path, refusal, capsys):
    experiment_file.write_text(DELAY)
    out = tmp_path / "out.csv"
    assert run("experiment", experiment_file, "--save", out) == 0
    row = "add D1->GPe weight=-0.05 delay_ms=4 tau_ms=6"
    page = capsys.readouterr().out
    assert f"control: {row}\nmanipulation: {row}; set STN->GPe.delay_ms 4\n" in page
    assert re.search(r"accuracy none, within 0[.]05 .*the model agrees", page)
    made = read_provenance(out)["parameters"]["experiment"]["manipulation"]
    assert made["edits"] == ["set STN->GPe.delay_ms 4", row]
    experiment_file.write_text(DELAY.replace("GPe.delay_ms 4", "GPe.delay_ms 2"))
    assert "control and manipulation are alike" in refusal("experiment", experiment_file)


def test_json_is_all_that_an_experiment_prints(experiment_file, tmp_path, capsys):
    out = tmp_path / "out.csv"
    assert run("experiment", experiment_file, "--save", out, "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    told = [printed[name] for name in ("name", "trials", "circuit", "engine", "gain", "seed")]
    assert told == ["a lesion", 120, "spiking_msprt", "algebra", 0.7, 3]
    (verdict,) = (r for r in printed["records"] if r["outcome"] is not None)
    told = [verdict[name] for name in ("condition", "measure", "outcome")]
    assert told == ["change", "mean_ms", AGREES]
    assert len(printed["records"]) == len(pd.read_csv(out))
    assert run("experiment", "--json") == 0
    listed = json.loads(capsys.readouterr().out)["records"]
    assert {row["file"] for row in listed} == set(SHIPPED)
    assert run("experiment") == 0
    shown = capsys.readouterr().out
    assert all(name in shown for name in SHIPPED)


def test_options_replace_what_the_file_says(experiment_file, tmp_path):
    out, again = tmp_path / "a.csv", tmp_path / "b.csv"
    options = ("--trials", 100, "--engine", "population", "--seed")
    assert run("experiment", experiment_file, "--save", out, *options, 5) == 0
    kept = read_provenance(out)
    asked = kept["parameters"]["experiment"]
    assert (kept["seed"], asked["task"]["trials"], asked["engine"]) == (5, 100, "population")
    assert set(pd.read_csv(tmp_path / "a_trials.csv")["model"]) == {"spiking_msprt population"}
    assert run("experiment", experiment_file, "--save", again, *options, 6) == 0
    assert out.read_bytes() != again.read_bytes()


@pytest.mark.parametrize("engine", ["spikes", "rate", "algebra"])
def test_an_experiment_that_decides_nothing_does_not_agree(experiment_file, engine, capsys):
    """Half of ctx->STN ends every trial at once, at chance: mean_ms is down, and means nothing."""
    halved = GOOD.replace("lesion STN 20%", "scale ctx->STN 0.5").replace("algebra", engine)
    halved = halved.replace("t_max = 40", "channels = 3\nd_prime = 0.8")
    experiment_file.write_text(halved)
    out = experiment_file.with_name("out.csv")
    assert run("experiment", experiment_file, "--save", out) == 0
    shown = capsys.readouterr().out
    assert re.search(r"mean_ms down, by 20 .*the model decides without evidence", shown)
    assert "agrees" not in shown
    assert list(pd.read_csv(out)["outcome"].dropna()) == [WITHOUT]


def test_the_trials_of_both_conditions_lie_beside_the_outcome(experiment_file, refusal):
    out = experiment_file.with_name("out.csv")
    assert run("experiment", experiment_file, "--save", out) == 0
    trials = pd.read_csv(out.with_name("out_trials.csv"))
    assert read_provenance(out) == read_provenance(out.with_name("out_trials.csv"))
    assert trials["condition"].value_counts().to_dict() == {"control": 120, "manipulation": 120}
    measures = pd.read_csv(out).set_index(["condition", "measure"])["value"]
    for name, part in trials.groupby("condition"):
        assert part["trial"].tolist() == list(range(120))
        decided = part[~part["undecided"]]
        assert (decided["correct"] == (decided["response"] == decided["stimulus"])).all()
        assert measures[name, "accuracy"] == pytest.approx(decided["correct"].mean())
        assert measures[name, "mean_ms"] == pytest.approx(1000 * decided["rt"].mean())
        assert measures[name, "missed"] == pytest.approx(part["undecided"].mean())
        assert measures[name, "anticipatory"] == pytest.approx(part["anticipatory"].mean())
        assert part["rt"].isna().equals(part["undecided"])
    # Nobody named the second file: it is written over only where it is a result.
    trials_file = out.with_name("out_trials.csv")
    trials_file.write_text("mine")
    out.with_name("out_trials.csv.json").unlink()
    asked = ("experiment", experiment_file, "--save", out, "--force")
    assert "out_trials.csv' already exists" in refusal(*asked)
    assert trials_file.read_text() == "mine"


def test_a_stop_signal_alone_is_no_manipulation(experiment_file, refusal):
    stop = "[stop]\nnucleus = 'D2[0]'\ndelays_ms = [50.0]\n[manipulation]"
    text = GOOD.replace("STN 20%", "STN 0").replace("algebra", "rate")
    experiment_file.write_text(text.replace("[manipulation]", stop))
    assert "'add D2[0] amount=-2 from_ms" in refusal("experiment", experiment_file)


def test_an_experiment_on_a_users_table_keeps_its_columns(experiment_file, capsys):
    frame = long_table(separated_evidence(120, 20, 0.4, rng=np.random.default_rng(8)))
    frame["trial"] = "id" + frame["trial"].astype(str)
    frame["condition"] = frame["truth"].map({"a": "dim", "b": "bright"})
    mine = experiment_file.with_name("mine.csv")
    frame.to_csv(mine, index=False)
    task = f'[task]\nevidence = "{mine}"\nstep_ms = 50\n'
    experiment_file.write_text(GOOD.replace("[task]\ntrials = 120\nt_max = 40\n", task))
    out = experiment_file.with_name("out.parquet")
    assert run("experiment", experiment_file, "--save", out) == 0
    assert "hypotheses a, b" in capsys.readouterr().out
    trials = pd.read_parquet(experiment_file.with_name("out_trials.parquet"))
    assert set(trials["condition"]) == {"control", "manipulation"}
    assert set(trials["given_condition"]) == {"dim", "bright"}
    assert trials["trial"][:120].tolist() == [f"id{n}" for n in range(120)]
    # The path is relative to the file that names it, not to the working directory.
    experiment_file.write_text(experiment_file.read_text().replace(str(mine), "mine.csv"))
    assert Experiment.from_toml(experiment_file).given().evidence.trials == 120
    # Whatever is forced, what an experiment was made from is not written over.
    before = mine.read_bytes()
    for out in (mine, mine.with_name("mine")):
        named = mine if out is mine else mine.with_name("mine_trials.csv")
        named.write_bytes(before)
        experiment_file.write_text(experiment_file.read_text().replace("mine.csv", named.name))
        out = out.with_suffix(".csv")
        assert run("experiment", experiment_file, "--save", out, "--force") == 2
        assert re.search("are the same file|already exists", capsys.readouterr().err)
        assert named.read_bytes() == before


SHIPPED = shipped()


def test_the_same_bytes_for_any_number_of_workers_and_any_batch(
    experiment_file, tmp_path, monkeypatch
):
    spiking = GOOD.replace("algebra", "spikes").replace("t_max = 40", "t_max = 9\nd_prime = 2.0")
    cells = '[control]\nedits = ["neurons 40"]\n[manipulation]\nedits = ["neurons 40", '
    spiking = spiking.replace("[manipulation]\nedits = [", cells)
    experiment_file.write_text(spiking)
    files = [tmp_path / f"{name}.csv" for name in "abc"]
    assert run("experiment", experiment_file, "--save", files[0], "--workers", 1) == 0
    assert run("experiment", experiment_file, "--save", files[1], "--workers", 3) == 0
    for name in ("BATCH", "WIDE_BATCH"):
        monkeypatch.setattr(f"bgmodel.integrators.basal_ganglia.{name}", 37)
    assert run("experiment", experiment_file, "--save", files[2], "--workers", 2) == 0
    assert len({path.read_bytes() for path in files}) == 1
    assert len({provenance_path(path).read_bytes() for path in files}) == 1

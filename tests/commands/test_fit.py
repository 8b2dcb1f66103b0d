"""The command `fit`."""

import json
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import bgmodel as bg
from bgmodel.fit_trials import question
from bgmodel.fitting import optimum, person_fit, posterior
from bgmodel.fitting.algorithms import DRIFT_SD, SPREAD, START, GapModel
from bgmodel.fitting.fit_results import EACH, ESTIMATES, FitFolder
from bgmodel.fitting.parameters import RESPONSE
from bgmodel.fitting.settings import settings_of
from bgmodel.fitting.simulated.circuit_model import CircuitModel
from bgmodel.support.files import read_provenance
from bgmodel.trials.files import shipped_table
from bgmodel.trials.reader import Columns
from tests.drawn import drawn
from tests.helpers import refused, run, told, words
from tests.known_trials import simulated
from tests.stop_trials import table_of as stop_table
from tests.trials.test_timed_readings import tables

TABLES = ("parameters.csv", "cells.csv")
GAP = ["--models", "constant_gap"]
COHERENCE = ["--strength", "coherence"]
QUICK = ["--free", "sensitivity", "threshold", "t0_s"]


def table_of(choices):
    """Return choices as a user's table, with two participants."""
    who = np.where(np.arange(choices.trials) % 4 < 2, "a", "b/c")
    drug = np.where(np.arange(choices.trials) % 8 < 4, "on", "off")
    rows = {"participant_id": who, "rt": choices.rt_s, "response": choices.response.astype(int)}
    return pd.DataFrame({**rows, "coherence": choices.strength, "drug": drug})


GOOD = table_of(drawn(GapModel(), [0.05, 0.4], 80, 71, seconds=2.0, sensitivity=12.0, bound=0.6))


@pytest.fixture(autouse=True)
def mine(tmp_path, monkeypatch):
    """Write a valid table in a new working folder; return its path."""
    monkeypatch.chdir(tmp_path)
    GOOD.to_csv("mine.csv", index=False)
    return tmp_path / "mine.csv"


@pytest.fixture
def thorough():
    """Search and draw as for users."""


@pytest.fixture(autouse=True)
def brief(request, monkeypatch):
    """Search coarsely and draw nothing: tests of optima and figures are elsewhere."""
    if "thorough" not in request.fixturenames:
        monkeypatch.setattr(optimum, "TOLERANCE_NATS", 0.5)
        monkeypatch.setattr(optimum, "POPULATION", 8)
        monkeypatch.setattr("bgmodel.fitting.fit_results.save_figure", lambda _, path: path.touch())
        monkeypatch.setattr("bgmodel.fitting.quantiles.draw_fits", lambda *_: None)


def fails(capsys, *arguments):
    """Run a command that must end with one sentence and leave no new file; return the sentence."""
    before = {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}
    assert run("fit", *arguments) == 2
    *_, line = capsys.readouterr().err.splitlines()
    assert line.startswith("bgmodel: ")
    after = {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}
    assert after == before
    return line.removeprefix("bgmodel: ")


def changed(**columns):
    return GOOD.assign(**columns)


def test_a_lean_to_one_response_is_said_of_the_participant_and_condition_that_has_it():
    """Two thirds of b's responses to negative strengths, without the drug, become response 1."""
    rng = np.random.default_rng(72)
    side = np.tile([1, -1], 400)
    rows = {"participant_id": np.repeat(["a", "b"], 400), "rt": 0.4 + rng.exponential(0.2, 800)}
    rows["response"] = ((rng.random(800) < 0.8) == (side > 0)).astype(int)
    drug = np.tile(np.repeat(["on", "off"], 200), 2)
    table = pd.DataFrame({**rows, "coherence": 0.2 * side, "drug": drug})
    leans = (table["participant_id"] == "b") & (table["drug"] == "off") & (side < 0)
    table.loc[leans & (np.arange(800) % 3 > 0), "response"] = 1
    table.to_csv("leans.csv", index=False)
    asked = ["leans.csv", *COHERENCE, *GAP, *QUICK, "--vary", "threshold=drug"]
    (text,) = (text for text in told(run, "fit", *asked) if "sides were alike" in text)
    assert text.startswith("b, drug off: response 1 comes in ")


@pytest.mark.parametrize("absent", ["cma", "emcee"])
def test_without_the_extra_the_command_says_how_to_get_it(capsys, monkeypatch, absent):
    monkeypatch.setitem(sys.modules, absent, None)
    sentence = fails(capsys, "mine.csv", *COHERENCE, *GAP)
    assert 'pip install ".[fit]"' in sentence


def test_a_table_of_somebody_else_is_not_written_over(tmp_path, capsys):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "cells.csv").write_text("dear diary")
    sentence = fails(capsys, "mine.csv", "out", *COHERENCE, *GAP)
    assert "out/cells.csv' exists and is not a result of a fit: give another folder" in sentence


OTHERS = {
    "a.png": "--participant a",
    "comparison.csv": "--models constant_gap falling_gap --compare",
    "comparison.png": "--models constant_gap falling_gap --compare",
    "constant_gap cells.png": "--people hierarchical",
    "constant_gap.nc": "--people hierarchical",
}


@pytest.mark.parametrize("name", OTHERS)
def test_no_file_of_somebody_else_is_written_over(tmp_path, capsys, name):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / name).write_text("dear diary")
    sentence = fails(capsys, "mine.csv", "out", *COHERENCE, *GAP, *words(OTHERS[name]))
    assert f"{name}' exists and is not a result of a fit: give another folder" in sentence


def test_tables_of_other_trials_do_not_share_a_folder(capsys):
    """Those of a group neither, nor does its comparison replace that of each participant."""
    asked = ["out", *COHERENCE, "--models", "constant_gap", "falling_gap", *QUICK[:2]]
    group = ["--people", "hierarchical"]
    for _ in range(2):  # the second time in place of its own files
        assert run("fit", "mine.csv", *asked, "--compare", "--participant", "a") == 0
    capsys.readouterr()
    error = fails(capsys, "mine.csv", *asked, *group, "--compare")
    assert "holds fits that differ in participant, people:" in error
    changed(rt=GOOD["rt"] + 0.01).to_csv("other.csv", index=False)
    assert "holds fits that differ in trials:" in fails(capsys, "other.csv", *asked, *group)


def test_each_participant_gets_a_row_per_number_and_a_figure(thorough, tmp_path, capsys):
    assert run("fit", "mine.csv", *COHERENCE, *GAP, *QUICK) == 0
    shown = capsys.readouterr().out
    for part in ("mine.csv: 160 trials of 2 participants", "parameter trade-offs", "quantiles"):
        assert part in shown
    assert "simulation_error" not in shown  # without simulation
    out = tmp_path / "fits" / "mine"
    parameters, cells = (pd.read_csv(out / f"{name}.csv") for name in ("parameters", "cells"))
    held = parameters[parameters["held"]]
    unasked = (START, SPREAD, DRIFT_SD, *RESPONSE[1:])
    assert held["parameter"].tolist() == [each.name for each in unasked] * 2
    assert held["value"].tolist() == [each.start for each in unasked] * 2
    parameters = parameters[~parameters["held"]]
    assert parameters["participant"].tolist() == ["a"] * 3 + ["b/c"] * 3
    assert parameters["parameter"].tolist() == ["sensitivity", "bound", "t0_s"] * 2
    truth = np.array([12.0, 0.6, 0.3] * 2)
    assert (np.abs(parameters["value"] - truth) < 4 * parameters["standard_error"]).all()
    assert cells["trials"].tolist() == [40, 40] * 2
    assert len(list(out.glob("*.png"))) == 2


def test_names_of_participants_and_levels_stay_as_they_are_written(capsys):
    """01 is not 1, and a fit to one of them is not repeated with both."""
    names = {"participant_id": {"a": "01", "b/c": "1"}, "drug": {"on": "None", "off": "1.50"}}
    GOOD.replace(names).to_csv("named.csv", index=False)
    one = ["named.csv", *COHERENCE, *GAP, *QUICK, "--vary", "bound=drug"]
    assert run("fit", *one) == 0
    assert run("fit", "named.csv", "again", *one[1:], "--participant", "01") == 0
    capsys.readouterr()
    error = fails(capsys, "named.csv", "again", *one[1:], "--participant", "1")
    assert "holds fits that differ in participant: fit it too, give another folder" in error
    assert run("fit", "named.csv", "again", *one[1:], "--participant", "1", "01") == 0
    assert "01, constant_gap: already done" in capsys.readouterr().out
    for table in TABLES:
        assert Path("again", table).read_bytes() == Path("fits/named", table).read_bytes()


def test_fits_of_another_question_are_never_written_over_unasked(capsys):
    one = ["mine.csv", *COHERENCE, *GAP, *QUICK]
    assert run("fit", *one) == 0
    capsys.readouterr()
    error = fails(capsys, *one, "--fix", "lapse=0.02")
    assert error.startswith("'fits/mine' holds fits that differ in fix: give another folder, or")
    for option in ("--vary bound=drug", "--prior bound=0.5:0.51", "--columns rt_window=0.3,2"):
        assert fails(capsys, *one, *words(option)).startswith("'fits/mine' holds fits that differ")
    changed(rt=GOOD["rt"] + 0.01).to_csv("mine.csv", index=False)
    assert "holds fits that differ in trials:" in fails(capsys, *one)
    assert run("fit", *one, "--fix", "lapse=0.02", "--force", "--participant", "a") == 0
    parameters = pd.read_csv("fits/mine/parameters.csv")
    assert set(parameters["participant"]) == {"a"}
    assert parameters.set_index("parameter")["value"]["lapse"] == 0.02
    assert parameters.set_index("parameter")["held"]["lapse"]


def test_a_circuit_that_was_edited_is_another_question(tmp_path):
    """A second circuit with another name is a further model, which leaves none out."""

    def fit(circuits, force=False):
        """Write a table of one row; return the circuits in its provenance."""
        place = FitFolder(tmp_path, {"data": "x"}, ["a"], [*circuits], circuits)
        place.check(EACH, force)
        table = pd.DataFrame({"participant": ["a"]})
        place.write(SimpleNamespace(tables=lambda: {"parameters": table}, figures=dict,
                                    comparison=None), print)  # fmt: skip
        return read_provenance(tmp_path / "parameters.csv")["parameters"]["circuits"]

    fit({"mine": "a"})
    both = {"mine": "a", "other": "b"}
    assert fit(both) == both
    with refused("folder holds fits that differ in model"):
        fit({"other": "b"})
    with refused("folder holds fits that differ in circuit"):
        fit({**both, "mine": "c"})
    assert fit({"mine": "c"}, force=True) == {"mine": "c"}


@pytest.mark.parametrize(
    ("model", "threshold"), [("constant_gap", "bound"), ("macaque", "threshold_nats")]
)
def test_threshold_means_that_of_each_model_and_varies_with_a_column(model, threshold):
    asked = {"strength": "coherence", "people": "pooled", "vary": {"threshold": "drug"}}
    one = question(settings_of(free=QUICK[1:], **asked), GOOD, ["constant_gap", "macaque"])
    levels = [f"{threshold}[drug={level}]" for level in ("off", "on")]
    assert one.likelihoods(model)["all"].freedom.names == ["sensitivity", *levels, "t0_s"]


def test_a_model_without_a_parameter_that_is_freed_is_named(capsys):
    models = ["--models", "constant_gap", "falling_gap"]
    free = ["--free", "sensitivity", "fall_per_s", "threshold"]
    assert run("fit", "mine.csv", *COHERENCE, *models, *free, "--people", "pooled") == 0
    err = capsys.readouterr().err
    assert "constant_gap has no fall_per_s, so all its parameters outside --free are fixed" in err
    assert "falling_gap has no" not in err


@pytest.mark.parametrize("deadline_s", [None, 2.6])
def test_a_circuit_is_simulated_to_the_half_second_after_the_longest_response(deadline_s):
    """No longer than it takes; participants with about as long responses share it."""
    for who, rows in GOOD.groupby("participant_id"):
        own = {"strength": "coherence", "participant": who}
        asked = settings_of(columns=Columns(deadline_s=deadline_s), **own)
        seconds = question(asked, GOOD, ["macaque"]).likelihoods("macaque")[who].model.seconds
        assert 0 <= seconds - (deadline_s or rows["rt"].max()) < 0.5
        assert 2 * seconds == round(2 * seconds)


def test_a_window_leaves_out_what_lies_outside_and_the_tables_say_how_much():
    asked = words("fit mine.csv out --columns rt_window=0.4,2")
    with pytest.warns(UserWarning, match="are excluded from the fit"):
        assert run(*asked, *COHERENCE, *GAP, *QUICK) == 0
    parameters = pd.read_csv("out/parameters.csv")
    left_out = parameters[~parameters["held"]].groupby("participant")["left_out"].first()
    outside = changed(outside=(GOOD["rt"] < 0.4) | (GOOD["rt"] > 2)).groupby("participant_id")
    assert left_out.to_dict() == outside["outside"].sum().to_dict()
    assert read_provenance("out/parameters.csv")["parameters"]["rt_window"] == ["0.4", "2"]


def test_an_optimum_at_a_bound_is_said_and_again_where_the_fit_is_there_already(mine, capsys):
    """Responses by chance: no evidence is heard."""
    rng = np.random.default_rng(1)
    changed(response=rng.integers(0, 2, len(GOOD))).to_csv(mine, index=False)
    asked = ["fit", "mine.csv", *COHERENCE, *GAP, *QUICK, "--people", "pooled"]
    first = told(run, *asked)
    texts = " ".join(first)
    assert "sensitivity ends at a bound of its range, 0.05: its standard error is" in texts
    # Times are those of evidence that is heard.
    assert "the model does not fit" in texts
    assert sum(text.startswith("all, constant_gap: ") for text in first) == 2
    assert told(run, *asked) == first
    assert "all, constant_gap: already done" in capsys.readouterr().out


def test_a_short_chain_is_one_sentence_of_ours(capfd, monkeypatch):
    monkeypatch.setitem(posterior.posterior.__kwdefaults__, "most_steps", 60)
    asked = ["fit", "mine.csv", *COHERENCE, *GAP, *QUICK, "--people", "pooled", "--draws"]
    (sentence,) = told(run, *asked)
    assert not capfd.readouterr().err
    assert sentence.startswith("all, constant_gap: the chain of draws lasts ")
    parameters = pd.read_csv("fits/mine/parameters.csv")
    low, high = parameters.loc[~parameters["held"], ["low", "high"]].to_numpy().T
    assert (low < high).all()


def test_an_interrupted_fit_goes_on_where_it_was(capsys, monkeypatch):
    """One participant is finished and the other's circuit simulated; then somebody stops."""
    asked = ["mine.csv", *COHERENCE, *QUICK, "--models", "constant_gap", "macaque"]
    asked += ["--simulation", "engine=rate", "trials=16"]
    real, done = person_fit.optimum, []

    def searched(likelihood, **options):
        if len(done) == 3:
            likelihood(likelihood.freedom.start)
            raise KeyboardInterrupt
        done.append(likelihood)
        return real(likelihood, **options)

    monkeypatch.setattr(person_fit, "optimum", searched)
    assert run("fit", *asked) == 130
    shown = capsys.readouterr()
    assert "stopped. Finished fits and simulated trials are kept: the same" in shown.err

    done.clear()
    monkeypatch.setattr(CircuitModel, "_simulate", None)
    monkeypatch.setattr(person_fit, "optimum", lambda *a, **k: done.append(a) or real(*a, **k))
    assert run("fit", *asked) == 0
    shown = capsys.readouterr().out
    assert len(done) == 1
    for name in ("a, constant_gap", "a, macaque", "b/c, constant_gap"):
        assert f"{name}: already done" in shown
    parameters = pd.read_csv("fits/mine/parameters.csv")
    assert (~parameters["held"]).sum() == 4 * 3

    done.clear()
    assert run("fit", *asked) == 0
    assert not done
    pd.testing.assert_frame_equal(pd.read_csv("fits/mine/parameters.csv"), parameters)


def test_a_model_is_compared_with_itself_without_an_effect(mine, capsys):
    """Numbers of the full model and of that without are those of two separate fits."""
    trials = pd.read_csv("mine.csv")
    trials["block"] = ["early", "late"] * (len(trials) // 2) + ["early"] * (len(trials) % 2)
    trials.to_csv("mine.csv", index=False)
    asked = [*COHERENCE, "--people", "pooled", *GAP, "--fix", "t0_sd_s=0.05", "lapse=0.01"]
    vary = ["--vary", "bound=block"]
    assert run("fit", "mine.csv", "out", *asked, *vary, "--compare") == 0
    assert "cross-validation" in capsys.readouterr().out
    table = pd.read_csv("out/comparison.csv").set_index("model")
    assert table["difference"].max() == 0
    assert (table["standard_error"] >= 0).all()
    assert set(table.index) == {"constant_gap", "constant_gap, same bound"}
    assert table["log_likelihood"].idxmax() == "constant_gap"
    numbers = pd.read_csv("out/parameters.csv").set_index(["model", "parameter"])["value"]
    assert run("fit", "mine.csv", "full", *asked, *vary) == 0
    assert run("fit", "mine.csv", "null", *asked) == 0
    assert run("fit", "mine.csv", "null", *asked, "--compare") == 2  # of one model
    for folder, label in (("full", "constant_gap"), ("null", "constant_gap, same bound")):
        alone = pd.read_csv(f"{folder}/parameters.csv").set_index("parameter")["value"]
        both = numbers[label]
        assert both[alone.index].to_numpy() == pytest.approx(alone.to_numpy(), rel=1e-9), folder


KINDS = {
    "known evidence": ("--models msprt run --evidence evidence.csv forced=true", {
        "model": ["msprt", "run"], "evidence": "evidence.csv", "forced": True}),
    "rewards": ("--models q --fix stickiness=0", {"model": ["q"], "fix": {"stickiness": 0.0}}),
    "stop signals": ("--models constant_gap --free ssrt_ms --participant p0", {
        "model": ["constant_gap"], "free": ["ssrt_ms"], "participant": "p0"}),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_the_command_and_python_fit_every_kind_of_trials_alike(kind, capsys):
    made, evidence = tables(simulated(60, 61))
    evidence.to_csv("evidence.csv", index=False)
    if kind == "rewards":
        made, _ = shipped_table("pedersen_frank_2020")
        made = made[made["participant_id"] == "3"]
    if kind == "stop signals":
        made = stop_table(people=2)
    made.to_csv("trials.csv", index=False)
    asked, options = KINDS[kind]
    command = ["fit", "trials.csv", *words(asked), "--json"]
    assert run(*command) == 0
    records = pd.DataFrame(json.loads(capsys.readouterr().out)["records"])
    mine = bg.fit("trials.csv", **options, people="each").to_dataframe()
    assert records["parameter"].tolist() == mine["parameter"].tolist()
    assert records["value"].tolist() == pytest.approx(mine["value"].tolist())
    folder = Path("fits/trials")
    written = {path.name for path in folder.iterdir()}
    assert written >= {*TABLES, *([ESTIMATES] if kind == "stop signals" else [])}
    assert run(*command) == 0
    assert "already done" in capsys.readouterr().err
    if kind == "stop signals":
        (folder / ESTIMATES).write_text("mine")
        (folder / f"{ESTIMATES}.json").unlink()
        assert "is not a result of a fit" in fails(capsys, *command[1:])

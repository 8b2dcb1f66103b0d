"""The command `fit`."""

import json
import sys
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bgmodel.fitting import optimum
from bgmodel.fitting.algorithms import DRIFT_SD, SPREAD, START, GapModel
from bgmodel.fitting.fit_results import EACH, ESTIMATES, FitFolder
from bgmodel.fitting.parameters import RESPONSE
from bgmodel.fitting.simulated.circuit_model import CircuitModel
from bgmodel.support.files import read_provenance, read_table
from circuits.errors import FitWarning
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


@pytest.mark.parametrize(
    ("option", "says"),
    [
        ("fix lapse", "fix is a name, =, and a value, such as lapse=0.02"),
        ("fix lapse=", "fix is a name, =, and a value, such as lapse=0.02"),
        ("vary bound=", "vary is a name, =, and a value, such as threshold=instruction"),
        ("vary mood=drug", "vary must name a parameter, one of "),
    ],
)
def test_a_pair_of_a_name_and_a_value_that_is_wrong_is_one_sentence(capsys, option, says):
    assert fails(capsys, "mine.csv", *COHERENCE, *GAP, *words(f"--{option}")).startswith(says)


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
    with pytest.warns(UserWarning, match="sides were alike") as caught:
        assert run("fit", "leans.csv", *COHERENCE, *GAP, *QUICK, "--vary", "threshold=drug") == 0
    texts = [str(each.message) for each in caught if "sides were alike" in str(each.message)]
    assert len(texts) == 1
    assert texts[0].startswith("b, drug off: response 1 comes in ")
    table[table["participant_id"] == "a"].to_csv("even.csv", index=False)
    with warnings.catch_warnings():
        warnings.filterwarnings("error", ".*sides were alike")
        assert run("fit", "even.csv", *COHERENCE, *GAP, *QUICK) == 0


def test_what_can_not_be_told_apart_is_warned_of_and_kept(capsys):
    """At one strength dopamine and the threshold move choices and times alike."""
    some = GOOD[GOOD["coherence"].abs() == 0.4]
    some.to_csv("one.csv", index=False)
    free = ["--free", "sensitivity", "threshold_nats", "dopamine", "t0_s"]
    asked = ["one.csv", *COHERENCE, *words("--people pooled --models macaque --mechanism dopamine")]
    small = ["--simulation", "engine=rate", "trials=200", "--fix", "t0_sd_s=0.1"]
    with pytest.warns(FitWarning, match="hardly distinguish threshold_nats from dopamine"):
        assert run("fit", *asked, *free, *small) == 0
    assert set(pd.read_csv("fits/one/parameters.csv")["parameter"]) > {"dopamine", "t0_s"}


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


def test_each_participant_gets_a_row_per_number_and_a_figure(thorough, tmp_path, capsys):
    assert run("fit", "mine.csv", *COHERENCE, *GAP, *QUICK) == 0
    shown = capsys.readouterr().out
    assert "mine.csv: 160 trials of 2 participants" in shown
    assert "parameter trade-offs" in shown
    assert "largest differences between quantiles" in shown
    assert "fewer than 20 errors" in shown
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


def test_names_of_participants_and_levels_stay_as_they_are_written():
    """01 is not 1, and fits to one of them leave those to the other in the table."""
    names = {"participant_id": {"a": "01", "b/c": "1"}, "drug": {"on": "None", "off": "1.50"}}
    GOOD.replace(names).to_csv("named.csv", index=False)
    one = ["named.csv", *COHERENCE, *GAP, *QUICK, "--vary", "bound=drug"]
    assert run("fit", *one) == 0
    for who in ("01", "1"):
        assert run("fit", "named.csv", "again", *one[1:], "--participant", who) == 0
    for table in TABLES:
        assert Path("again", table).read_bytes() == Path("fits/named", table).read_bytes()


def test_fits_of_another_question_are_never_written_over_unasked(capsys):
    one = ["mine.csv", *COHERENCE, *GAP, *QUICK]
    assert run("fit", *one) == 0
    capsys.readouterr()
    error = fails(capsys, *one, "--fix", "lapse=0.02")
    assert error.startswith("'fits/mine' holds fits with another fix: give another folder, or --f")
    assert fails(capsys, *one, "--vary", "bound=drug").startswith("'fits/mine' holds fits with ano")
    changed(rt=GOOD["rt"] + 0.01).to_csv("mine.csv", index=False)
    assert "holds fits with another trials:" in fails(capsys, *one)
    assert run("fit", *one, "--fix", "lapse=0.02", "--force", "--participant", "a") == 0
    parameters = pd.read_csv("fits/mine/parameters.csv")
    assert set(parameters["participant"]) == {"a"}
    assert parameters.set_index("parameter")["value"]["lapse"] == 0.02
    assert parameters.set_index("parameter")["held"]["lapse"]


def test_a_circuit_that_was_edited_is_another_question(tmp_path):
    """Rows of both would have the same name; a second circuit with another name is allowed."""

    def fit(who, model, circuit, force=False):
        """Write a table of one fit."""
        place = FitFolder(tmp_path, {"data": "x"}, {model: circuit})
        place.check(EACH, force)
        place.add("parameters", pd.DataFrame({"participant": [who], "model": [model]}))
        return pd.read_csv(tmp_path / "parameters.csv").to_numpy().tolist()

    fit("a", "mine", "a")
    fit("a", "other", "b")
    assert len(fit("b", "mine", "a")) == 3
    behind = read_provenance(tmp_path / "parameters.csv")["parameters"]
    assert behind["circuits"] == {"mine": "a", "other": "b"}
    with refused("folder holds fits with another circuit"):
        fit("b", "mine", "c")
    assert fit("b", "mine", "c", force=True) == [["b", "mine"]]


@pytest.mark.parametrize("drop", [False, True])
def test_strengths_without_a_sign_are_seen(mine, capsys, drop):
    """Taken for signed, they make every response to the left an error."""
    changed(coherence=GOOD["coherence"].abs()).to_csv(mine, index=False)
    if drop:
        with pytest.warns(UserWarning, match=r"coherence \(2 values, .* may hold it"):
            assert run("fit", "mine.csv", *GAP, *QUICK, "--people", "pooled") == 0
    else:
        sentence = fails(capsys, "mine.csv", *COHERENCE, *GAP)
        assert sentence.startswith("mine.csv: strength must be signed, positive where it favours")


def test_strengths_without_a_sign_are_right_where_responses_say_right_and_wrong(mine):
    right = (GOOD["response"] == 1) == (GOOD["coherence"] > 0)
    table = changed(coherence=GOOD["coherence"].abs(), response=right.astype(int))
    table.to_csv(mine, index=False)
    assert run("fit", "mine.csv", *COHERENCE, *GAP, *QUICK, "--people", "pooled") == 0


def test_threshold_means_that_of_each_model_and_varies_with_a_column(capsys):
    small = words("--simulation engine=rate --simulation trials=16 --json --people pooled")
    models = ["--models", "constant_gap", "macaque"]
    assert run("fit", "mine.csv", *COHERENCE, *models, *QUICK, *small,
               "--vary", "threshold=drug", "--fix", "lapse=0.02") == 0  # fmt: skip
    records = pd.DataFrame(json.loads(capsys.readouterr().out)["records"])
    for name, threshold in (("constant_gap", "bound"), ("macaque", "threshold_nats")):
        levels = [f"{threshold}[drug={level}]" for level in ("off", "on")]
        mine = records[(records["model"] == name) & ~records["held"]]
        assert mine["parameter"].tolist() == ["sensitivity", *levels, "t0_s"]
        assert set(mine["participant"]) == {"all"}


def test_a_model_without_a_parameter_that_is_freed_is_named(capsys):
    models = ["--models", "constant_gap", "falling_gap"]
    free = ["--free", "sensitivity", "fall_per_s", "threshold"]
    assert run("fit", "mine.csv", *COHERENCE, *models, *free, "--people", "pooled") == 0
    err = capsys.readouterr().err
    assert "constant_gap has no fall_per_s, so all its parameters outside --free are fixed" in err
    assert "falling_gap has no" not in err


@pytest.mark.parametrize("deadline", [None, 2.6])
def test_a_circuit_is_simulated_to_the_half_second_after_the_longest_response(
    monkeypatch, deadline
):
    """No longer than it takes; participants with about as long responses share it."""
    simulated = []

    def simulate(model, point, bias):
        simulated.append(model.seconds)
        raise KeyboardInterrupt

    monkeypatch.setattr(CircuitModel, "_simulate", simulate)
    columns = [] if deadline is None else ["--columns", f"deadline_s={deadline!s}"]
    for who, rows in GOOD.groupby("participant_id"):
        asked = ["mine.csv", "out", *COHERENCE, *QUICK, "--models", "macaque", *columns]
        assert run("fit", *asked, "--participant", who) == 130
        longest = deadline or rows["rt"].max()
        assert 0 <= simulated[-1] - longest < 0.5
        assert 2 * simulated[-1] == round(2 * simulated[-1])
    assert len(simulated) == 2


def test_a_window_leaves_out_what_lies_outside_and_the_tables_say_how_much(mine, capsys):
    late = GOOD["rt"].where(GOOD.index != 3, 45.0)
    changed(rt=late).to_csv(mine, index=False)
    one = ["mine.csv", *COHERENCE, *GAP, *QUICK]
    with pytest.warns(UserWarning, match=r"b/c: 1 of 80 response times .* the longest 45 s"):
        assert run("fit", *one) == 0
    parameters = pd.read_csv("fits/mine/parameters.csv")
    fitted = parameters[~parameters["held"]].groupby("participant")["left_out"].first()
    assert fitted.to_dict() == {"a": 0, "b/c": 1}
    capsys.readouterr()
    sentence = fails(capsys, *one, "--columns", "rt_window=0.3,2")
    assert sentence.startswith("'fits/mine' holds fits with another rt_window: give another folder")
    outside = (late < 0.4) | (late > 2)
    pooled = words("fit mine.csv out --people pooled --columns rt_window=0.4,2")
    with pytest.warns(UserWarning, match="are excluded from the fit"):
        assert run(*pooled, *one[1:]) == 0
    parameters = pd.read_csv("out/parameters.csv")
    assert (parameters.loc[~parameters["held"], "left_out"] == outside.sum()).all()
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
    from bgmodel.fitting import posterior

    monkeypatch.setitem(posterior.posterior.__kwdefaults__, "most_steps", 60)
    # A fit without draws is another one.
    assert run("fit", "mine.csv", *COHERENCE, *GAP, *QUICK, "--people", "pooled") == 0
    capfd.readouterr()
    asked = ["fit", "mine.csv", *COHERENCE, *GAP, *QUICK, "--people", "pooled", "--draws"]
    (sentence,) = told(run, *asked)
    assert not capfd.readouterr().err
    assert sentence.startswith("all, constant_gap: the chain of draws lasts ")
    assert "of its autocorrelation times, not 50: its effective sample size is below" in sentence
    parameters = pd.read_csv("fits/mine/parameters.csv")
    low, high = parameters.loc[~parameters["held"], ["low", "high"]].to_numpy().T
    assert (low < high).all()


def test_an_interrupted_fit_goes_on_where_it_was(capsys, monkeypatch):
    """One participant is finished and the other's circuit simulated; then somebody stops."""
    import bgmodel.fitting.person_fit as module

    asked = ["mine.csv", *COHERENCE, *QUICK, "--models", "constant_gap", "macaque"]
    asked += ["--simulation", "engine=rate", "trials=16"]
    real, done = module.optimum, []

    def searched(likelihood, **options):
        if len(done) == 3:
            likelihood(likelihood.freedom.start)
            raise KeyboardInterrupt
        done.append(likelihood)
        return real(likelihood, **options)

    monkeypatch.setattr(module, "optimum", searched)
    assert run("fit", *asked) == 130
    shown = capsys.readouterr()
    assert "stopped. Finished fits and simulated trials are kept: the same" in shown.err

    done.clear()
    monkeypatch.setattr(CircuitModel, "_simulate", None)
    monkeypatch.setattr(module, "optimum", lambda *a, **k: done.append(a) or real(*a, **k))
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


KNOWN = ["trials.csv", "--models", "msprt", "run", "--evidence", "evidence.csv"]


@pytest.fixture
def known():
    """Write trials and their readings."""
    for name, table in zip(("trials", "evidence"), tables(simulated(60, 61)), strict=True):
        table.to_csv(f"{name}.csv", index=False)


def test_fits_on_known_evidence_write_the_same_tables_and_their_own_figure(known, thorough, capsys):
    asked = [*KNOWN, "forced=true", "--compare"]
    assert run("fit", *asked, "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    assert {row["model"] for row in printed["records"]} == {"msprt", "run"}
    folder = Path("fits/trials")
    names = {*TABLES, "comparison.csv", "all.png"}
    assert {path.name for path in folder.iterdir()} >= names
    behind = read_provenance(folder / TABLES[0])["parameters"]
    assert behind["forced"] is True
    assert run("fit", *asked) == 0
    assert "already done" in capsys.readouterr().out
    assert run("fit", *KNOWN) == 2  # the last reading forces nothing here


def test_learners_are_fitted_to_rewarded_choices(thorough, capsys):
    asked = ["pedersen_frank_2020", "--participant", "3", "--models", "q", "no learning"]
    assert run("fit", *asked, "--compare", "--json") == 0
    records = json.loads(capsys.readouterr().out)["records"]
    learned = {row["parameter"] for row in records if row["model"] == "q"}
    assert learned == {"rate", "scale", "bound", "t0_s", "stickiness"}
    assert fails(capsys, *asked, "--fix", "speed=1").startswith("fix must name a parameter")
    assert fails(capsys, asked[0], "--models", "q", "--strength", "x").endswith("leave it out")


def test_stop_signal_trials_are_fitted_by_their_stop_process(mine, capsys):
    stop_table(people=2).to_csv(mine, index=False)
    brief = ["mine.csv", "out", "--free", "ssrt_ms"]
    assert run("fit", *brief, "--participant", "p0") == 0
    assert run("fit", *brief, "--models", "constant_gap") == 0
    assert "p0, constant_gap: already done" in capsys.readouterr().out
    parameters = read_table("out/parameters.csv").set_index(["participant", "model"])
    whom = [("p0", "constant_gap"), ("p0", "macaque"), ("p1", "constant_gap")]
    assert sorted(set(parameters.index)) == whom
    ssrt = parameters.loc[parameters["parameter"] == "ssrt_ms", "value"]
    assert ssrt.between(120, 280).all()
    estimates = read_table(f"out/{ESTIMATES}").set_index("participant")
    assert estimates["ssrt_ms"].between(150, 250).all()
    assert list(read_provenance("out/parameters.csv")["parameters"]["circuits"]) == ["macaque"]
    for options in (["--strength", "stimulus"], ["--columns", "rt_window=0,inf"]):
        assert fails(capsys, "mine.csv", *options).endswith("leave it out")
    assert "constant_gap" in fails(capsys, "mine.csv", "--models", "falling_gap")
    Path("out", ESTIMATES).write_text("mine")
    Path("out", f"{ESTIMATES}.json").unlink()
    assert "already exists" in fails(capsys, "mine.csv", "out")

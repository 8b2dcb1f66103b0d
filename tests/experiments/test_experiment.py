"""Experiments: files read strictly, measures with oracles, outcomes that the edit alone makes."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bgmodel import stream
from bgmodel.cli import main
from bgmodel.edits import Edits
from bgmodel.evidence import gaussian_evidence
from bgmodel.experiments.experiment import (
    AGREES,
    DISAGREES,
    OPEN,
    WITHOUT,
    Condition,
    Prediction,
    behaviour_of,
    read_experiment,
    run_experiment,
    shipped,
)
from bgmodel.experiments.measures import DIFFUSION_S, MEASURES, ez_diffusion, mean, median
from bgmodel.experiments.outcomes import outcomes, page
from bgmodel.files import provenance_path, read_provenance
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.stimuli import Stimuli
from circuits import anatomy

GOOD = """
name = "a lesion"
published = "faster, more errors"
source = "nobody"
note = "a test"
engine = "algebra"
seed = 3
[task]
trials = 120
t_max = 40
[manipulation]
without = ["STN=0.2"]
[[predictions]]
measure = "mean_ms"
direction = "down"
at_least = 20
"""


@pytest.fixture
def small(tmp_path):
    path = tmp_path / "in" / "small.toml"
    path.parent.mkdir()
    path.write_text(GOOD)
    return path


def run(*arguments):
    return main([str(a) for a in arguments])


def changes(table):
    return table[table["condition"] == "change"].set_index("measure")


# ---- files


def test_a_file_says_what_is_run(small):
    experiment = read_experiment(small)
    assert experiment.manipulation == Condition(without=("STN=0.2",))
    assert experiment.control == Condition()
    assert experiment.predictions == (Prediction("mean_ms", "down", 20.0),)
    assert (experiment.task.trials, experiment.posterior) == (120, 0.82)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("trials = 120", "trails = 3", "there is no key 'task.trails'; there are evidence, task, "),
        ("at_least", "at_last", "no key 'predictions.0.at_last'; there are measure, direction, "),
        ("[task]", "gian = 1\n[task]", "there is no key 'gian'; there are name, published, "),
        ("trials = 120", 'trials = "3"', "task.trials should be a valid integer, got '3'"),
        ("trials = 120", "trials = true", "task.trials should be a valid integer, got True"),
        ("trials = 120", "trials = 0", "small.toml: trials must be at least 1, got 0"),
        ("trials = 120", "conflict = 2", "conflict must lie in 0..1, below 1, got 2"),
        ('"down"', '"off"', "direction should be 'up', 'down' or 'none', got 'off'"),
        ('"mean_ms"', '"mean"', "measure must be one of accuracy, mean_ms, .*got 'mean'"),
        ("= 20", "= -1", "at_least must be >= 0, got -1"),
        ("= 20", "= nan", "at_least must be >= 0, got nan"),
        ('"down"\nat_least = 20', '"none"\nat_least = 0', 'must be > 0 where the direction is "no'),
        ('name = "a lesion"', "", "the key 'name' is missing"),
        ('"nobody"', "2001-01-01", "no key takes a date or a time, got 2001-01-01"),
        ('["STN=0.2"]', '"STN"', "manipulation.without should be a valid array, got 'STN'"),
        (
            "[task]",
            "posterior = 1.5\n[task]",
            "posterior must lie between chance, 0.5 with 2 hypotheses, and 1, got 1.5",
        ),
        ("[task]", "foreperiod_ms = 0\n[task]", "foreperiod_ms must be > 0, got 0"),
        (
            '"algebra"',
            '"pen"',
            "engine must be one of algebra, rate, .*got 'pen'",
        ),
        ("[task]", "truth = 2\n[task]", "truth must lie in 0..1, got 2"),
        ("[task]", "[task", "small.toml is no TOML: "),
        ('["STN=0.2"]', '["GPi=0.2"]', "has no nucleus 'GPi': ctx, common"),
        ('without = ["STN=0.2"]', 'scale = ["ctx->D1[2]=1"]', "channel must lie in 0..1, got 2"),
        (
            'without = ["STN=0.2"]',
            'change = ["STN.bias_nat=1"]',
            "'STN.bias_nat=1': STN has no 'bias_nat': cell, baseline_hz, ",
        ),
        (
            'without = ["STN=0.2"]',
            'add = ["D1->GPe weight=0.1"]',
            "'D1->GPe weight=0.1': D1->GPe: D1 releases GABA, so the weight must be <= 0, got 0.1",
        ),
        (
            'without = ["STN=0.2"]',
            'change = ["STN->GPe.delay_ms=4"]',
            "'STN->GPe.delay_ms=4' says nothing to the algebra engine",
        ),
        ("trials = 120", "trials = 90", "an interval needs 100 trials or more, got 90"),
        ("[manipulation]", "[control]\nwithout = ['STN=0.9']\n[manipulation]", "decide without"),
    ],
)
def test_a_bad_file_gets_one_clear_sentence(small, tmp_path, capsys, old, new, says):
    small.write_text(GOOD.replace(old, new))
    assert run("experiment", small, tmp_path / "out.csv") == 2
    error = capsys.readouterr().err
    assert error.startswith("bgmodel: ")
    assert error.count("\n") == 1
    assert pd.Series([error]).str.contains(says).all(), error
    assert [path.name for path in tmp_path.iterdir()] == ["in"]


def test_a_table_of_evidence_says_how_many_hypotheses_there_are(small, tmp_path):
    drawn = np.random.default_rng(5).normal(size=(30, 4, 3))
    rows = [
        {"trial": n, "step": t, "ll_a": a, "ll_b": b, "ll_c": c, "truth": "abc"[n % 3]}
        for n, trial in enumerate(drawn)
        for t, (a, b, c) in enumerate(trial)
    ]
    mine = tmp_path / "mine.csv"
    pd.DataFrame(rows).to_csv(mine, index=False)
    own = replace(read_experiment(small), task=Stimuli(evidence=mine), truth=2)
    np.testing.assert_array_equal(own.trials().evidence.log_likelihood, drawn[2::3])
    with pytest.raises(ValueError, match=r"truth must lie in 0\.\.2, got 3"):
        replace(own, truth=3).trials()


def test_a_file_that_is_not_there(tmp_path, capsys):
    assert run("experiment", tmp_path / "no.toml") == 2
    assert "can't be read" in capsys.readouterr().err
    assert run("experiment", "stn") == 2
    assert "a .toml file or one of accuracy_dopamine, " in capsys.readouterr().err
    assert run("experiment", "stn_conflict", tmp_path / "out.txt") == 2
    assert "output must end in .parquet or .csv" in capsys.readouterr().err


@pytest.mark.parametrize("written", ["ctx->D1[=2", "ctx->D1[x]=2", "ctx->D1[-1]=2", "ctx->D1[0=2"])
def test_a_channel_is_a_number_in_brackets(written):
    with pytest.raises(ValueError, match="a channel is a number in brackets"):
        Edits(scale=(written,)).apply(anatomy.spiking_msprt())


def test_one_channel_is_edited_as_written():
    circuit = anatomy.spiking_msprt(4)
    edited = Edits(scale=("ctx->D1[2]=1.1", "STN->GPe=0.5")).apply(circuit)
    assert edited == circuit.scaled("ctx", "D1", 1.1, channel=2).scaled("STN", "GPe", 0.5)


DELAY = """
name = "A longer delay from STN to GPe"
published = "nothing: a hypothesis"
source = "nobody"
note = "2 ms more, and a pathway that the table has not."
engine = "rate"
[task]
d_prime = 0.8
trials = 120
t_max = 40
[control]
add = ["D1->GPe weight=-0.05 delay_ms=4 tau_ms=6"]
[manipulation]
add = ["D1->GPe weight=-0.05 delay_ms=4 tau_ms=6"]
change = ["STN->GPe.delay_ms=4"]
[[predictions]]
measure = "accuracy"
direction = "none"
at_least = 0.05
"""


def test_a_delay_of_a_pathway_is_a_hypothesis_in_a_file(small, tmp_path, capsys):
    small.write_text(DELAY)
    out = tmp_path / "out.csv"
    assert run("experiment", small, out) == 0
    page = capsys.readouterr().out
    row = "add D1->GPe weight=-0.05 delay_ms=4 tau_ms=6"
    assert f"control: {row}\nmanipulation: {row}; change STN->GPe.delay_ms=4\n" in page
    assert "accuracy none, to within 0.05: the model agrees" in page
    made = read_provenance(out)["parameters"]["experiment"]["manipulation"]
    assert made["applied"] == f"{row}; change STN->GPe.delay_ms=4"
    small.write_text(DELAY.replace('delay_ms=4"]\n[[', 'delay_ms=2"]\n[['))
    assert run("experiment", small) == 2
    assert "control and manipulation are alike" in capsys.readouterr().err


# ---- measures


@given(st.integers(0, 2**31), st.integers(1, 12))
def test_weights_stand_for_repeated_trials(seed, trials):
    """Mean and median of weighted trials are NumPy's of trials written out."""
    rng = np.random.default_rng(seed)
    values = rng.integers(0, 6, trials).astype(float)
    among = rng.random(trials) < 0.8
    weights = np.concatenate([np.ones((1, trials)), rng.integers(0, 3, (3, trials))])
    for row, m, mid in zip(
        weights, mean(values, among, weights), median(values, among, weights), strict=True
    ):
        written = np.repeat(values, (row * among).astype(int))
        if len(written):
            assert (m, mid) == (pytest.approx(written.mean()), np.median(written))
        else:
            assert np.isnan([m, mid]).all()


def test_ez_is_that_of_its_paper():
    """Wagenmakers, van der Maas & Grasman 2007: P .802, VRT .112, MRT .723."""
    found = ez_diffusion(0.802, 0.723, 0.112, 1000)
    np.testing.assert_allclose(found, (0.0999, 0.1400, 0.3000), atol=5e-5)


@given(st.floats(-0.4, 0.4), st.floats(0.05, 0.3), st.floats(0, 0.6))
def test_ez_inverts_the_exact_moments(drift, bound, other_s):
    """Accuracy, mean and variance of a diffusion in closed form give its parameters back."""
    if abs(drift) < 0.01:
        return
    y = -drift * bound / DIFFUSION_S**2
    accuracy = 1 / (1 + np.exp(y))
    mean_s = bound / (2 * drift) * (1 - np.exp(y)) / (1 + np.exp(y)) + other_s
    shape = 2 * y * np.exp(y) - np.exp(2 * y) + 1
    variance = bound * DIFFUSION_S**2 / (2 * drift**3) * shape / (np.exp(y) + 1) ** 2
    found = ez_diffusion(accuracy, mean_s, variance, 1e12)
    np.testing.assert_allclose(found, (drift, bound, other_s), rtol=1e-3, atol=1e-4)


def test_ez_recovers_a_simulated_diffusion():
    """A walk in steps of .5 ms; its bounds, crossed between steps, lie .5826 steps further out."""
    drift, bound, other_s, dt = 0.15, 0.12, 0.3, 5e-4
    rng = stream(8, "ez")
    sd = DIFFUSION_S * np.sqrt(dt)
    edge = bound / 2 - 0.5826 * sd
    at, alive = np.zeros(5000), np.ones(5000, dtype=bool)
    time_s, right = np.zeros(5000), np.zeros(5000, dtype=bool)
    for step in range(1, 20_000):
        at[alive] += drift * dt + sd * rng.standard_normal(alive.sum())
        out = alive & (np.abs(at) >= edge)
        time_s[out], right[out] = step * dt, at[out] > 0
        alive &= ~out
    assert not alive.any()
    times = time_s[right] + other_s
    found = ez_diffusion(right.mean(), times.mean(), times.var(), 5000)
    np.testing.assert_allclose(found, (drift, bound, other_s), rtol=0.05)


def test_ez_at_the_edges_is_moved_by_half_a_trial():
    for accuracy, moved in ((1, 1 - 1 / 200), (0, 1 / 200), (0.5, 0.5 + 1 / 200)):
        found = ez_diffusion(accuracy, 0.7, 0.1, 100)
        np.testing.assert_allclose(found, ez_diffusion(moved, 0.7, 0.1, 100))
        assert np.isfinite(found).all()
    assert np.isnan(ez_diffusion(0.9, 0.7, 0.0, 100)).all()


def test_a_rival_rises_and_nothing_else():
    """Means of the readings: the true channel's, its fraction in the next one, 0 in the others."""
    given = {"rng": stream(1, "r"), "hypotheses": 4}
    drawn = gaussian_evidence(4000, 5, 0.8, conflict=0.5, **given)
    turned = [
        np.roll(x.mean(axis=0), -k) for x, k in zip(drawn.log_likelihood, drawn.truth, strict=True)
    ]
    np.testing.assert_allclose(np.mean(turned, axis=0) / 0.8, [0.8, 0.4, 0, 0], atol=0.03)
    plain = gaussian_evidence(10, 5, 0.8, rng=stream(1, "r"))
    same = gaussian_evidence(10, 5, 0.8, rng=stream(1, "r"), conflict=0.0)
    np.testing.assert_array_equal(plain.log_likelihood, same.log_likelihood)
    with pytest.raises(ValueError, match="conflict is for Gaussian evidence"):
        Stimuli(task="orientation", conflict=0.5).check()


# ---- outcomes


@pytest.mark.parametrize(
    ("direction", "at_least", "interval", "outcome"),
    [
        ("up", 1, (1.1, 2), AGREES),
        ("up", 1, (0.9, 2), OPEN),
        ("up", 1, (-3, 0.9), DISAGREES),
        ("up", 1, (0.2, 0.9), DISAGREES),
        ("up", 0, (0, 0), OPEN),
        ("up", 1, (0, 0), DISAGREES),
        ("down", 1, (-2, -1.1), AGREES),
        ("down", 1, (-2, -0.9), OPEN),
        ("down", 1, (-0.9, 3), DISAGREES),
        ("down", 1, (0, 0), DISAGREES),
        ("none", 1, (-0.9, 0.9), AGREES),
        ("none", 1, (0, 0), AGREES),
        ("none", 1, (-0.9, 1.1), OPEN),
        ("none", 1, (1.1, 2), DISAGREES),
        ("none", 1, (-2, -1.1), DISAGREES),
        ("up", 1, (np.nan, np.nan), OPEN),
    ],
)
def test_the_interval_decides(direction, at_least, interval, outcome):
    assert Prediction("accuracy", direction, at_least).outcome(*interval) == outcome


def test_the_threshold_alone_moves_what_it_must():
    """At the fixed point: times, criterion and bound follow the threshold, the drift does not."""
    experiment = replace(read_experiment("accuracy_threshold"), engine="algebra")
    experiment = replace(experiment, task=replace(experiment.task, trials=200))
    table = run_experiment(experiment).measures
    said = outcomes(experiment, table).set_index("measure")["outcome"]
    assert dict(said) == {"bound": AGREES, "criterion": AGREES, "drift": said["drift"]}
    assert said["drift"] != DISAGREES
    assert changes(table).loc["mean_ms", "low"] > 0
    shown = page(experiment, table)
    assert "bound up, by 0.005: the model agrees" in shown
    assert all(name in shown for name in MEASURES)


def test_intervals_are_those_of_pairs(small):
    """Conditions are paired: the change is surer than the two apart."""
    table = run_experiment(read_experiment(small)).measures.set_index(["condition", "measure"])
    width = (table["high"] - table["low"]).xs("mean_ms", level="measure")
    assert width["change"] < 0.9 * np.hypot(width["control"], width["manipulation"])
    inside = (table["low"] <= table["value"]) & (table["value"] <= table["high"])
    assert inside[table["value"].notna()].all()
    value = table["value"].unstack("measure")
    assert np.allclose(
        value.loc["change"], value.loc["manipulation"] - value.loc["control"], equal_nan=True
    )


def test_more_alternatives_have_no_diffusion(small):
    experiment = read_experiment(small)
    table = run_experiment(replace(experiment, task=replace(experiment.task, channels=4))).measures
    empty = table[table["value"].isna()]
    assert set(empty["measure"]) == {"drift", "bound", "non_decision_ms"}
    assert "drift" not in page(experiment, table)


def test_a_circuit_at_rest_below_its_threshold_answers_before_the_stimulus():
    """It responds before anything is read: no prediction, right or wrong, is met by that."""
    experiment = read_experiment("stn_lesion_whole")
    task = replace(experiment.task, trials=100, t_max=12, d_prime=1.5)
    small = replace(experiment, task=task)
    found = run_experiment(small).measures
    table = found.set_index(["condition", "measure"])["value"]
    assert table["manipulation", "anticipatory"] == 1
    assert table["manipulation", "premature"] == 1
    assert table["control", "anticipatory"] < 0.05
    assert set(outcomes(small, found)["outcome"]) == {WITHOUT}


HALVED = """
[task]
channels = 3
d_prime = 0.8
trials = 120
[manipulation]
scale = ["ctx->STN=0.5"]
"""


@pytest.mark.parametrize("engine", ["ensemble", "rate", "algebra"])
def test_an_experiment_that_decides_nothing_does_not_agree(small, engine, capsys):
    """Half of ctx->STN ends every trial at once, at chance: mean_ms is down, and means nothing."""
    head, rest = GOOD.replace("algebra", engine).split("[task]")
    small.write_text(head + HALVED + rest.split('without = ["STN=0.2"]')[1])
    out = small.with_name("out.csv")
    assert run("experiment", small, out) == 0
    shown = capsys.readouterr().out
    assert "mean_ms down, by 20: the model decides without evidence" in shown
    assert "agrees" not in shown
    said = pd.read_csv(out)["outcome"].dropna()
    assert list(said) == [WITHOUT]


@pytest.mark.parametrize("engine", ["ensemble", "rate", "algebra"])
def test_a_control_that_decides_nothing_is_refused(small, engine, capsys):
    both = HALVED + 'without = ["D2=0.1"]\n[control]\nscale = ["ctx->STN=0.5"]\n'
    head, rest = GOOD.replace("algebra", engine).split("[task]")
    small.write_text(head + both + rest.split('without = ["STN=0.2"]')[1])
    assert run("experiment", small) == 2
    assert "it would decide without evidence" in capsys.readouterr().err


def test_a_threshold_below_chance_is_refused(small, capsys):
    small.write_text("posterior = 0.5\n" + GOOD)
    assert run("experiment", small) == 2
    assert "posterior must lie between chance, 0.5 with 2 hypotheses" in capsys.readouterr().err


def test_the_trials_of_both_conditions_lie_beside_the_outcome(small, capsys):
    out = small.with_name("out.csv")
    assert run("experiment", small, out) == 0
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
    assert run("experiment", small, out) == 2
    out.unlink()
    assert run("experiment", small, out) == 2
    assert "out_trials.csv' is there already" in capsys.readouterr().err


def judged(shares, foreperiod_ms=500.0, decided=100, measure="mean_ms"):
    """Return the outcome of a change of -100 +- 10 that was predicted, for shares of responses."""
    experiment = shipped()["stn_bound"]
    prediction = Prediction(measure, "down", 20.0)
    experiment = replace(experiment, predictions=(prediction,), foreperiod_ms=foreperiod_ms)
    values = dict.fromkeys(MEASURES, 0.5) | {"decided": decided} | shares
    rows = [("manipulation", name, value, value, value) for name, value in values.items()]
    rows += [("change", name, -100.0, -110.0, -90.0) for name in MEASURES]
    table = pd.DataFrame(rows, columns=["condition", "measure", "value", "low", "high"])
    return outcomes(experiment, table)["outcome"].item()


def test_either_share_of_responses_without_evidence_is_enough():
    assert judged({"premature": 0.1, "anticipatory": 0.1}) == AGREES
    assert judged({"premature": 0.6, "anticipatory": 0.1}) == WITHOUT
    assert judged({"premature": 0.1, "anticipatory": 0.6}) == WITHOUT


def test_the_length_of_the_foreperiod_does_not_excuse_a_circuit_that_responds_at_rest():
    """At a constant hazard .23 of 50 ms are .93 of half a second, and .6 of 3 s are .14."""
    assert judged({"premature": 0.3, "anticipatory": 0.23}, 50.0) == WITHOUT
    assert judged({"premature": 0.3, "anticipatory": 0.6}, 3000.0) == AGREES


def test_a_handful_of_decided_trials_decides_nothing():
    rest = {"premature": 0.0, "anticipatory": 0.0, "missed": 0.97}
    assert judged(rest, decided=4) == OPEN
    assert judged(rest, decided=4, measure="missed") == AGREES
    assert judged(rest, decided=40) == AGREES


def test_conditions_that_say_nothing_are_refused(small, capsys):
    text = small.read_text()
    small.write_text(text.replace("STN=0.2", "STN=0"))
    assert run("experiment", small) == 2
    assert "the manipulation changes nothing" in capsys.readouterr().err
    small.write_text(text.replace("t_max = 40", "t_max = 1"))
    assert run("experiment", small) == 2
    assert "the control decides in time in" in capsys.readouterr().err
    small.write_text(text.replace('without = ["STN=0.2"]', "neurons = 20"))
    assert run("experiment", small) == 2
    assert "neurons is of cells, it says nothing to the algebra engine" in capsys.readouterr().err


def test_foreperiods_have_noise_of_their_own(monkeypatch):
    """Their trials are numbered after those with evidence."""
    asked = []
    plain = BasalGanglia.run_drive

    def run_drive(model, drive, step_ms, first_trial=0):
        asked.append((len(drive), first_trial))
        return plain(model, drive, step_ms, first_trial)

    monkeypatch.setattr(BasalGanglia, "run_drive", run_drive)
    model = BasalGanglia(anatomy.spiking_msprt(2).with_neurons(20), "ensemble", 0.5, 3)
    evidence = gaussian_evidence(30, 2, 1.0, rng=stream(1, "foreperiod"), step_ms=50.0)
    behaviour_of(model, evidence, 0.3, 20.0)
    first, count = asked[-1][1], asked[-1][0]
    assert (count, first) == (30, 30)


def test_an_experiment_on_a_users_table_keeps_its_columns(small, capsys):
    rng = np.random.default_rng(8)
    evidence = gaussian_evidence(120, 20, 0.4, rng=rng)
    frame = pd.DataFrame(evidence.log_likelihood.reshape(-1, 2), columns=["ll_a", "ll_b"])
    frame["trial"] = np.repeat([f"id{n}" for n in range(120)], 20)
    frame["step"] = np.tile(np.arange(20), 120)
    frame["truth"] = np.repeat(np.array(["a", "b"])[evidence.truth], 20)
    frame["condition"] = np.repeat(np.array(["dim", "bright"])[evidence.truth], 20)
    mine = small.with_name("mine.csv")
    frame.to_csv(mine, index=False)
    task = f'[task]\nevidence = "{mine}"\nstep_ms = 50\n'
    small.write_text(GOOD.replace("[task]\ntrials = 120\nt_max = 40\n", task))
    assert run("experiment", small, small.with_name("out.parquet")) == 0
    assert "hypotheses a, b" in capsys.readouterr().out
    trials = pd.read_parquet(small.with_name("out_trials.parquet"))
    assert set(trials["condition"]) == {"control", "manipulation"}
    assert set(trials["given_condition"]) == {"dim", "bright"}
    assert trials["trial"][:120].tolist() == [f"id{n}" for n in range(120)]
    # The file is looked for beside the one that names it, wherever the command is called.
    small.write_text(small.read_text().replace(str(mine), "mine.csv"))
    assert read_experiment(small).trials().evidence.trials == 120
    # Whatever is forced, what an experiment was made from is not written over.
    before = mine.read_bytes()
    for out in (mine, mine.with_name("mine")):
        named = mine if out is mine else mine.with_name("mine_trials.csv")
        named.write_bytes(before)
        small.write_text(small.read_text().replace("mine.csv", named.name))
        out = out.with_suffix(".csv")
        assert run("experiment", small, out, "--force") == 2
        assert re.search("are one file|is there already", capsys.readouterr().err)
        assert named.read_bytes() == before


# ---- what is shipped

SHIPPED = shipped()


def quick(experiment):
    """Return an experiment cut short: few cells, evidence that is soon enough."""
    control, manipulation = (
        replace(c, neurons=40) for c in (experiment.control, experiment.manipulation)
    )
    trials = 100 if experiment.truth is None else 200
    task = replace(experiment.task, trials=trials, t_max=8, d_prime=1.5)
    return replace(
        experiment, control=control, manipulation=manipulation, task=task, foreperiod_ms=10.0
    )


@pytest.mark.parametrize("name", SHIPPED)
def test_the_edit_alone_makes_the_outcome(name):
    """Without it every measure is the control's to the last bit; with it some measure is not."""
    experiment = quick(SHIPPED[name])
    without = replace(experiment, manipulation=experiment.control)
    none = run_experiment(without).measures
    assert (changes(none)[["value", "low", "high"]].fillna(0) == 0).all(axis=None)
    said = outcomes(without, none)
    known = none[none["condition"] == "control"].set_index("measure").loc[said["measure"], "low"]
    for known_, row in zip(known, said.itertuples(), strict=True):
        if np.isnan(known_):
            assert row.outcome == OPEN
        else:
            assert row.outcome == (AGREES if row.direction == "none" else DISAGREES)
    assert (changes(run_experiment(experiment).measures)["value"].fillna(0) != 0).any()


def test_what_is_shipped_names_its_source():
    assert len(SHIPPED) >= 10
    for name, one in SHIPPED.items():
        assert one.source.endswith(("abstract only", "a model's prediction", "no experiment")), name
        assert "our choice" in " ".join(one.note.split())
        assert one.task.trials >= 1000


def test_experiment_command(small, tmp_path, capsys):
    assert run("experiment") == 0
    shown = capsys.readouterr().out
    assert all(name in shown for name in SHIPPED)
    out, again = tmp_path / "a.csv", tmp_path / "b.csv"
    assert run("experiment", small, out, "--trials", 100, "--seed", 5) == 0
    assert "mean_ms down, by 20: the model agrees" in capsys.readouterr().out
    table = pd.read_csv(out)
    said = table.set_index(["condition", "measure"])["outcome"].dropna()
    assert dict(said) == {("change", "mean_ms"): AGREES}
    kept = read_provenance(out)
    assert kept["seed"] == 5
    assert kept["parameters"]["experiment"]["task"]["trials"] == 100
    assert kept["parameters"]["experiment"]["manipulation"]["without"] == ["STN=0.2"]
    assert run("experiment", small, again, "--trials", 100, "--seed", 6) == 0
    assert out.read_bytes() != again.read_bytes()


def test_the_same_bytes_for_any_number_of_workers_and_any_batch(small, tmp_path, monkeypatch):
    spiking = GOOD.replace("algebra", "ensemble").replace("t_max = 40", "t_max = 9\nd_prime = 2.0")
    edits = "neurons = 40\n"
    spiking = spiking.replace("[manipulation]\n", f"[control]\n{edits}[manipulation]\n{edits}")
    small.write_text(spiking)
    files = [tmp_path / f"{name}.csv" for name in "abc"]
    assert run("experiment", small, files[0], "--workers", 1) == 0
    assert run("experiment", small, files[1], "--workers", 3) == 0
    bridge, runner = "integrators.basal_ganglia", "experiments.experiment"
    for name in (f"{bridge}.BATCH", f"{bridge}.WIDE_BATCH", f"{runner}.BATCH"):
        monkeypatch.setattr(f"bgmodel.{name}", 37)
    assert run("experiment", small, files[2], "--workers", 2) == 0
    assert len({path.read_bytes() for path in files}) == 1
    assert len({provenance_path(path).read_bytes() for path in files}) == 1

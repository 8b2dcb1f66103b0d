"""What most users do, each in three lines from ``import bgmodel as bg``."""

import importlib.util
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import bgmodel as bg
from circuits.declaration.edits import Edits
from circuits.errors import RangeWarning
from tests.helpers import ROOT, refused, refusing, run

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")


@pytest.fixture(scope="module")
def evidence():
    return bg.gaussian_evidence(200, d_prime=0.7, t_max=60, seed=1)


def test_what_is_visible_is_what_is_meant():
    assert dir(bg) == sorted(bg.__all__)
    assert all(getattr(bg, name) is not None for name in bg.__all__)
    with pytest.raises(AttributeError, match="no attribute 'Brain'"):
        bg.Brain  # noqa: B018


def test_there_are_few_names_and_pages_show_each():
    assert len(bg.__all__) <= 42
    pages = [ROOT / "README.md", *(ROOT / "docs" / "guides").glob("*.md")]
    pages += [*(ROOT / "docs" / "tutorials").glob("*.ipynb"), ROOT / "docs" / "extending.md"]
    text = "\n".join(page.read_text(encoding="utf-8") for page in pages)
    # What functions return or raise is shown where it is used, without its name.
    returned = {"Circuit", "Decision", "Trace", "BgmodelWarning", "__version__"}
    shown = {name for name in bg.__all__ if re.search(rf"\b{name}\b", text)}
    assert set(bg.__all__) - shown <= returned


def test_one_reading_separates_two_hypotheses_by_d_prime():
    """The difference of log likelihoods has mean d'^2 / 2 and variance d'^2."""
    drawn = bg.gaussian_evidence(4000, d_prime=0.6, t_max=25, seed=3)
    apart = drawn.log_likelihood[..., 1] - drawn.log_likelihood[..., 0]
    signed = np.where(drawn.truth[:, None] == 1, apart, -apart)
    assert signed.mean() == pytest.approx(0.36 / 2, abs=4 * 0.6 / np.sqrt(signed.size))
    assert signed.var() == pytest.approx(0.36, rel=4 * np.sqrt(2 / signed.size))


@pytest.mark.parametrize("model", [bg.Sprt(), bg.Msprt(), None], ids=["SPRT", "MSPRT", "circuit"])
def test_every_model_decides_alike(model, evidence):
    model = model or bg.BasalGanglia(bg.load_circuit("macaque"), "population", seed=1)
    decision = model.decide(evidence, posterior=0.8)
    table = decision.to_dataframe()
    assert decision.accuracy == table.correct[table.choice >= 0].mean()
    assert decision.summary().loc[0, "accuracy"] == decision.accuracy
    assert decision.summary().loc[0, "mean_ms"] == pytest.approx(table.time_ms.mean())
    assert len(table) == evidence.trials
    assert decision.plot() is not None


def test_accuracy_needs_the_truth_and_a_decision():
    blind = bg.Evidence(np.ones((3, 4, 2)))
    decision = bg.Msprt().decide(blind, posterior=0.9, forced=False)
    with refused("truth"):
        _ = decision.accuracy
    assert "correct" not in decision.to_dataframe()
    seen = bg.Evidence(np.ones((3, 4, 2)), truth=[0, 1, 0])
    assert np.isnan(bg.Msprt().decide(seen, posterior=0.9, forced=False).accuracy)


def test_several_thresholds_have_a_row_each(evidence):
    decision = bg.Msprt().decide(evidence, posterior=[0.7, 0.9])
    assert list(decision.to_dataframe().columns[:2]) == ["threshold", "trial"]
    assert len(decision.to_dataframe()) == 2 * evidence.trials
    assert list(decision.summary().accuracy) == list(decision.accuracy)
    assert decision.accuracy[1] > decision.accuracy[0]


SHORT = bg.gaussian_evidence(5, seed=1)
TRIALS = pd.DataFrame({"coherence": [0.1, 0.2] * 20, "rt": 0.5, "response": [1, 0] * 20})


def fitted(table=TRIALS, **options):
    return bg.fit(table, "constant_gap", strength="coherence", **options)


def decided(*thresholds, **options):
    return bg.BasalGanglia("macaque", "algebra").decide(SHORT, *thresholds, **options)


test_what_newcomers_try_is_refused_with_the_next_step = refusing(
    (lambda: Edits("lesion STN"), r'edits a list of lines, such as \["lesion STN"\]'),
    (lambda: bg.BasalGanglia("macaque").activity("ev.csv"), "evidence"),
    (lambda: fitted(fix="lapse=0.02"), 'fix .*{"lapse": 0.02}'),
    (lambda: fitted(vary={"drift": "coherence"}), "vary .*'drift'"),
    (lambda: fitted(TRIALS.rename(columns={"response": "correct"})), "response .*rename it"),
    (decided, "posterior posterior=0.82"),
    (lambda: decided(0.2, posterior=0.8), "posterior not both"),
    (lambda: bg.Msprt().decide(SHORT), "posterior posterior=0.82"),
    (lambda: bg.load_circuit("macaque").plot(3), "ax"),
    (lambda: SHORT.plot(ax="x"), "ax"),
    (lambda: bg.load_circuit("macaque").cut("GPe", "STN"), 'pathway "GPe->STN"'),
    (lambda: bg.load_circuit("macaque").edited(["lesion STN 10%"]), "edits unpack"),
    (lambda: bg.BasalGanglia("macaque").activity(SHORT).spike_table(), "spikes Spikes"),
)


def test_a_warning_points_at_the_line_that_called():
    strong = bg.gaussian_evidence(40, d_prime=4, seed=1)
    model = bg.BasalGanglia("macaque", gain=0.55, seed=1)
    for call in (model.activity, model.run):
        with pytest.warns(RangeWarning) as caught:
            call(strong)
        assert {each.filename for each in caught} == {__file__}


def test_a_condition_decides_as_the_command_and_refuses_what_it_refuses(tmp_path):
    out = tmp_path / "a.csv"
    options = ("--task", "trials=40", "t_max=20", "--edits", "lesion STN 5%", "--seed", 3)
    assert run("circuit", "run", "--save", out, *options) == 0
    task, edits = bg.Gaussian(trials=40, t_max=20), Edits(["lesion STN 5%"])
    asked = bg.Condition(edits=edits, seed=3, task=task)
    told = pd.read_csv(out, comment="#")
    assert np.allclose(told.rt * 1000, asked.decide().time_ms)
    salience = replace(asked, circuit="gpr", gain=0.2, engine="rate", edits=Edits())
    with refused("posterior"):
        salience.decide()
    assert run("circuit", "run", "--save", out, "--circuit", "gpr", "--gain", 0.2, "--force") == 2


@pytest.mark.parametrize("name", sorted(set(bg.__all__) - {"engines", "__version__"}))
def test_no_name_of_the_front_door_is_that_of_a_module(name):
    """Importing the module would replace the function."""
    assert importlib.util.find_spec(f"bgmodel.{name}") is None


KINDS = {"experiment": bg.Experiment, "sweep": bg.Sweep}


@pytest.fixture(params=KINDS)
def command(request):
    return request.param


def test_the_file_is_written_as_shown_and_runs(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "mine.toml"
    assert run(command, path, "--template") == 0
    assert path.read_text() == KINDS[command].template()
    assert KINDS[command].from_toml(path)
    path.write_text(re.sub(r"trials = \d+", "trials = 100", path.read_text()))
    assert run(command, path, "--workers", "1") == 0


@pytest.mark.parametrize("name", ["mine.toml", "mine.txt", "", "none/mine.toml"])
def test_no_file_is_written_over(command, name, tmp_path, monkeypatch, refusal):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text("mine")
    force = ["--force"] if command == "experiment" else []
    sentence = refusal(command, name, "--template", *force)
    assert "must be a new .toml file" in sentence or "none" in sentence
    assert [path.read_text() for path in tmp_path.iterdir()] == ["mine"]

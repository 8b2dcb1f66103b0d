"""Records are saved and loaded as what they were; nothing else is loaded at all."""

import json
from dataclasses import dataclass

import numpy as np
import pytest
from matplotlib.figure import Figure

import bgmodel as bg
from bgmodel.deciding.decision import Decision
from bgmodel.fitting.known.known_likelihood import known_likelihood
from bgmodel.fitting.known.models import EXACT
from bgmodel.fitting.person_fit import fit_likelihood
from bgmodel.learning.deciders import WeightLearner
from bgmodel.learning.reinforce import Learner
from bgmodel.support.saved import TREE, Facts, save, span
from tests.helpers import refused
from tests.known_trials import simulated

QUICK = Learner(500)
CIRCUIT = bg.load_circuit("macaque").edited("lesion STN 10%", "dopamine 0.95")
MODEL = bg.BasalGanglia(CIRCUIT, seed=1)
TASK = bg.SameDifferent(period_mm=2)
EVIDENCE = bg.gaussian_evidence(200, seed=1)
EXPERIMENT = """
name = "a loss"
note = "of a tenth"
[task]
name = "gaussian"
trials = 120
[manipulation]
edits = ["lesion STN 10%"]
[[predictions]]
measure = "mean_ms"
direction = "down"
at_least = 5.0
"""
RESULTS = {
    "evidence": lambda: EVIDENCE,
    "model": lambda: MODEL,
    "model at its gain": lambda: MODEL.adapted_to(EVIDENCE),
    "decision": lambda: MODEL.decide(EVIDENCE, posterior=0.8),
    "trace": lambda: bg.Msprt().run(EVIDENCE[:3]),
    "comparison": lambda: bg.compare(MODEL, EVIDENCE, accuracies=[0.8], resamples=20),
    "learned by the test": lambda: bg.learn(TASK, runs=2, learner=QUICK),
    "learned dopamine": lambda: bg.learn(TASK, MODEL, runs=2, trials=200, learner=QUICK),
    "learned weights": lambda: bg.learn(
        bg.Gaussian(), what="weights", runs=2, learner=WeightLearner(200)
    ),
    "experiment": lambda: bg.Experiment.from_text(EXPERIMENT).run(),
    "exam": lambda: bg.Exam.shipped().only(["resting rates"]).take("macaque", share=0.05),
    "fit on known evidence": lambda: fit_likelihood(
        known_likelihood(EXACT["msprt"], simulated(40, t_max=10))
    ),
    "touch": lambda: bg.touch(TASK, values=(2, 4), folds=3, trials=100, learner=QUICK),
}


@pytest.mark.filterwarnings("ignore::circuits.errors.BgmodelWarning")
@pytest.mark.parametrize("kind", RESULTS)
def test_a_loaded_result_is_the_result(kind, tmp_path):
    """Saved again it has the same bytes, and what it derives is the same."""
    result = RESULTS[kind]()
    path = result.save(tmp_path / "a.npz")
    again = bg.load(path)
    assert type(again) is type(result)
    assert again.save(tmp_path / "b.npz").read_bytes() == path.read_bytes()
    assert repr(again) == repr(result)
    for name in ("summary", "to_dataframe", "text"):
        if hasattr(result, name):
            assert str(getattr(again, name)()) == str(getattr(result, name)())
    if hasattr(result, "plot") and kind not in ("evidence", "trace"):
        again.plot()


def test_a_file_is_replaced_only_if_asked_and_never_lost(tmp_path):
    path = EVIDENCE.save(tmp_path / "a.npz")
    with refused("path already exists"):
        MODEL.save(path)
    MODEL.save(path, force=True)
    assert isinstance(bg.load(path), bg.BasalGanglia)
    before = path.read_bytes()

    @dataclass
    class Own:
        x: int = 1

    for record in (Own(), {"a": EVIDENCE, "b": Own()}, print, bg.Evidence):
        with refused("record this can't be saved"):
            save(record, path, force=True)
    assert path.read_bytes() == before
    assert [*tmp_path.iterdir()] == [path]
    with refused("path must end in .npz"):
        EVIDENCE.save(tmp_path / "a.json")
    with refused("path must end in .npz: to_dataframe"):
        bg.Msprt().decide(EVIDENCE, posterior=0.9).save(tmp_path / "a.csv")


def rewritten(path, change):
    """Write a saved file again with other JSON."""
    arrays = dict(np.load(path))
    tree = json.loads(arrays[TREE].tobytes())
    text = json.dumps(change(tree))
    np.savez(path, **{**arrays, TREE: np.frombuffer(text.encode(), np.uint8)})


def named(name):
    return lambda tree: {**tree, "value": {**tree["value"], "record": name}}


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (named("os:system"), "is no record"),
        (named("bgmodel.__main__:main"), "is no record"),
        (named("bgmodel.evidence:check_evidence"), "is no record"),
        (named("bgmodel.evidence:np"), "is no record"),
        (named("bgmodel.evidence:Gone"), "its records differ"),
        (named("bgmodel.gone:Gone"), "its records differ"),
        (named("bgmodel.task:Gaussian"), "fields"),
        (lambda tree: {**tree, "value": {"array": 99, "of": "ndarray"}}, "99"),
        (lambda tree: {**tree, "value": {"lambda": 1}}, "unknown kind"),
    ],
)
def test_a_file_makes_no_other_object_than_a_record(change, says, tmp_path):
    path = EVIDENCE.save(tmp_path / "a.npz")
    rewritten(path, change)
    with refused(f"path .*{says}"):
        bg.load(path)


def test_what_is_no_saved_result_is_refused(tmp_path):
    with refused("path there is no file"):
        bg.load(tmp_path / "absent.npz")
    np.savez(tmp_path / "other.npz", x=np.ones(3))
    with refused("path is not a result"):
        bg.load(tmp_path / "other.npz")
    path = EVIDENCE.save(tmp_path / "a.npz")
    path.write_bytes(path.read_bytes()[:-200])
    with refused("path can't be read"):
        bg.load(path)


def test_a_table_of_facts_is_escaped():
    class Odd(Facts):
        def facts(self):
            return {"<b>": "a & b"}

    assert "<th>&lt;b&gt;</th><td>a &amp; b</td>" in Odd()._repr_html_()
    assert span([np.nan, 2, 1]) == "1 to 2"
    assert span([3.0, 3.0]) == "3"


def test_speed_and_accuracy_are_those_of_decided_trials():
    """Three thresholds: two of three trials decided, none of them, one alone."""
    nan = np.nan
    decision = Decision(
        choice=np.array([[0, 1, -1], [-1, -1, -1], [0, -1, -1]]),
        time_ms=np.array([[20.0, 40.0, nan], [nan, nan, nan], [10.0, nan, nan]]),
        forced=np.zeros((3, 3), bool),
        premature=np.zeros((3, 3), bool),
        step_ms=10.0,
        deadline_ms=np.full(3, 50.0),
    )
    line = decision.plot(Figure().subplots(), np.zeros(3, int)).axes[0].lines[0]
    assert line.get_xdata().tolist() == [10, 30]
    assert line.get_ydata().tolist() == [1, 0.5]
    facts = decision.facts()
    assert (facts["thresholds"], facts["trials"]) == ("3", "3")
    assert (facts["mean_time_ms"], facts["undecided"]) == ("10 to 30", "1 to 3")

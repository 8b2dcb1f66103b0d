"""Experiments as text."""

import tomllib

import pytest

from bgmodel.experiments.experiment import Experiment, shipped
from circuits.errors import InputError
from tests.helpers import GOOD

EXPERIMENTS = shipped()


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_a_file_reads_back_as_the_same_experiment(name):
    experiment = EXPERIMENTS[name]
    assert Experiment.from_text(experiment.to_toml()) == experiment


@pytest.mark.parametrize("name", ["stn_conflict", "stop_medication", "accuracy_threshold"])
def test_python_code_makes_the_same_experiment(name):
    names = {}
    made, _, printed = EXPERIMENTS[name].to_python().rpartition("print(")
    exec(made, names)
    assert names["experiment"] == EXPERIMENTS[name]
    assert printed == "experiment.run().summary())\n"


def test_settings_at_their_defaults_are_left_out():
    written = tomllib.loads(Experiment.from_text(GOOD).to_toml())
    assert "foreperiod_ms" not in written
    assert written["task"] == {"trials": 120}


def test_a_prediction_to_fill_in_is_a_comment_that_becomes_one():
    experiment = Experiment.from_text(GOOD.partition("[[predictions]]")[0])
    text = experiment.to_toml()
    assert Experiment.from_text(text) == experiment
    head, _, marked = text.partition("# [[predictions]]")
    filled = head + "[[predictions]]" + marked.replace("\n# ", "\n")
    assert Experiment.from_text(filled).predictions[0].measure == "accuracy"
    assert "# [[predictions]]" not in Experiment.from_text(GOOD).to_toml()


def test_text_that_is_no_experiment_is_refused_by_its_name():
    for text in ("= 3", "name = 'x'", GOOD + "colour = 3"):
        with pytest.raises(InputError, match="mine"):
            Experiment.from_text(text, "mine")

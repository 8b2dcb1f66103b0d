"""The command `fit` with more than two alternatives."""

import pandas as pd
import pytest

from bgmodel.commands import fitted
from bgmodel.fitting import optimum
from bgmodel.fitting.alternatives.msprt import MsprtModel
from bgmodel.support.files import read_provenance
from tests.fitting.alternatives.drawn import table
from tests.helpers import run

QUICK = ["--free", "sensitivity", "threshold", "--simulation", "trials=160"]


@pytest.fixture(autouse=True)
def mine(tmp_path, monkeypatch):
    """Write a table of three alternatives, and search coarsely."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(optimum, "TOLERANCE_NATS", 0.5)
    monkeypatch.setattr(optimum, "POPULATION", 6)
    monkeypatch.setattr(fitted, "save_figure", lambda figure, path: path.touch())
    table(MsprtModel(3, 500, 99), 3, 100, strengths=(0.5, 1.5)).to_csv("search.csv", index=False)


def test_models_are_fitted_and_recorded(tmp_path):
    options = ["search.csv", "--columns", "stimulus=shown", "--strength", "contrast"]
    run("fit", *options, "--models", "msprt", "race", *QUICK)
    written = pd.read_csv(tmp_path / "fits/search/parameters.csv")
    assert set(written["model"]) == {"msprt", "race"}
    behind = read_provenance(tmp_path / "fits/search/parameters.csv")["parameters"]
    assert behind["columns"]["stimulus"] == "shown"
    cells = pd.read_csv(tmp_path / "fits/search/cells.csv")
    assert sorted(cells["strength"].unique()) == [0.5, 1.5]

"""A user's own decoded taps, in every command and record that names a tactile task."""

import json

import numpy as np
import pandas as pd
import pytest

import bgmodel as bg
from bgmodel.support.files import checksum, read_provenance, read_table
from bgmodel.tactile.source import held_out_taps
from tests.helpers import refused, run

ALGEBRA = ("--engine", "algebra")
FEW = ("--task", "trials=60", "t_max=12")
EDGES = ("--task", "edge-turn", "step_deg=5")
DOPAMINE = ("--what", "dopamine", *FEW, "--runs", 1, "--levels", 3, "--learner", "episodes=500")
GRATINGS = ("--task", "same-different", "period_mm=2")


@pytest.fixture
def edges(tmp_path):
    """Write a decoded table of an edge as other programs do: without provenance."""
    rng = np.random.default_rng(71)
    true = np.linspace(-180, 180, 1500, endpoint=False)
    path = tmp_path / "edges.csv"
    table = pd.DataFrame({"yaw_deg": true, "edge_deg": true + 3.0 * rng.normal(size=1500)})
    table.to_csv(path, index=False)
    return path


@pytest.fixture
def gratings(tmp_path):
    """Write the built-in table as a user's file."""
    path = tmp_path / "gratings.parquet"
    held_out_taps().to_parquet(path)
    return path


@pytest.mark.parametrize(
    ("command", "extra"),
    [
        (("decide",), FEW),
        (("circuit", "run"), (*FEW, *ALGEBRA)),
        (("compare",), ("--task", "trials=120", "t_max=20", "--accuracies", 0.8, *ALGEBRA)),
        (("learn",), ("--runs", 1, "--learner", "episodes=500")),
        (("learn",), DOPAMINE),
    ],
)
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_own_taps_are_decided_on_and_named_in_provenance(command, extra, edges, gratings, tmp_path):
    """A copy of the shipped table decides as the shipped table does, byte by byte."""
    outs = [tmp_path / f"{name}.csv" for name in ("turned", "own", "shipped")]
    assert run(*command, "--save", outs[0], *extra, *EDGES, "--task", f"taps={edges}") == 0
    assert run(*command, "--save", outs[1], *extra, *GRATINGS, "--task", f"taps={gratings}") == 0
    assert run(*command, "--save", outs[2], *extra, *GRATINGS) == 0
    assert outs[1].read_bytes() == outs[2].read_bytes()
    made = json.dumps(read_provenance(outs[0])["parameters"])
    assert checksum(edges) in made
    assert "edge-turn" in made


def test_taps_that_the_decoder_was_trained_on_are_refused(edges, tmp_path):
    table = read_table(edges)
    table["trained_on"] = np.arange(len(table)) < 7
    table.to_csv(tmp_path / "known.csv", index=False)
    for taps in (tmp_path / "known.csv", str(tmp_path / "known.csv"), table):
        with refused("taps trained on 7 of its 1500"):
            bg.EdgeTurn().evidence(taps=taps, seed=1)
    with refused("taps trained on 7 of its 1500"):
        bg.EdgeTurn(taps=tmp_path / "known.csv").evidence(seed=1)

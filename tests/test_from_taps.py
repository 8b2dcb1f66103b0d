"""From a sensor's taps to decisions, and a user's own decoded taps in every command."""

import json
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm

import bgmodel as bg
from bgmodel import from_taps
from bgmodel.from_taps import Touched, page, touch
from bgmodel.learning.dopamine_learner import POPULATIONS, SPIKES, TEST, criteria
from bgmodel.learning.reinforce import Learner
from bgmodel.support.files import checksum, read_provenance, read_table
from bgmodel.tactile.decoder import EDGE
from bgmodel.tactile.source import held_out_taps
from bgmodel.tactile.task import EdgeDirection, EdgeTurn
from tests.helpers import refused, run
from tests.tactile.recorded import MM_PER_PX, edge_taps, record

pytestmark = pytest.mark.usefixtures("no_check_of_noise")
SD_DEG = 3.0
TAPS = edge_taps(2400, SD_DEG, seed=81)


def told(taps, task=EdgeDirection, count=2, step=5.0, model=None):
    with pytest.MonkeyPatch.context() as few:
        few.setattr(from_taps, "TO_LEARN", 1000)
        few.setattr(from_taps, "TO_SPIKE", 30)
        return touch(
            task(count, step), taps, model, values=(2.0, step, 20.0), trials=240, seed=1,
            learner=Learner(episodes=500),
        )  # fmt: skip


@pytest.fixture(scope="module")
def touched():
    return told(TAPS)


def test_one_reading_is_right_as_often_as_the_errors_of_the_decoder_let_it(touched):
    curve = touched.psychometric.set_index("stimulus")
    for step in (2.0, 5.0, 20.0):
        assert curve["accuracy"][step] == pytest.approx(norm.cdf(step / 2 / SD_DEG), abs=0.03)
        assert curve["low"][step] <= curve["accuracy"][step] <= curve["high"][step]


def test_test_and_circuit_decide_alike_and_the_circuit_later(touched):
    assert touched.numbers["test_accuracy"] >= 0.88
    assert touched.numbers["agreement"] > 0.9
    assert 20 < touched.numbers["extra_ms"] < 100
    assert 0 < touched.numbers["optimal_gap_nats"] < 8
    assert not any("too rough" in remark for remark in touched.remarks)
    decided = touched.decided.set_index("who")
    assert (decided["choice"] >= 0).all()  # which is first in a single trial, noise may decide


def test_a_circuit_of_ones_own_decides_and_leaves_the_test_as_it_is(touched):
    circuit = bg.load_circuit("macaque_small", 2).edited("dopamine 0.6")
    own = told(TAPS, model=bg.BasalGanglia(circuit, "rate", gain=0.3, seed=9))
    assert own.numbers["gain"] == 0.3
    rows, usual = (each.learned.set_index(["who", "measure"])["value"] for each in (own, touched))
    assert rows[TEST].equals(usual[TEST])
    assert not rows[SPIKES].equals(usual[SPIKES])
    with refused("model must have 2 channels, as the task"):
        told(TAPS, model=bg.BasalGanglia(bg.load_circuit("macaque", 3)))


def test_a_circuit_of_saliences_is_refused_in_python_and_by_the_command(tmp_path):
    with refused("unit not nats"):
        told(TAPS, model=bg.BasalGanglia(bg.load_circuit("gpr", 2), gain=0.5))
    asked = ["touch", tmp_path / "out", "--circuit", "gpr", "--gain", 0.5]
    assert run(*asked) == 2
    assert not (tmp_path / "out").exists()


def test_a_circuit_that_can_be_read_down_to_0_has_criteria():
    """Its OUT is -ln P at any P: the surest criterion is one of 0.999."""
    levels = criteria(bg.BasalGanglia(bg.load_circuit("bogacz_gurney", 2), gain=0.5))
    assert np.isfinite(levels).all()
    assert (np.diff(levels) > 0).all()
    assert levels[-1] == pytest.approx(np.log(999), abs=0.01)


def test_reward_sets_the_criteria_at_which_test_and_spikes_decide(touched):
    rows = touched.learned.set_index(["who", "measure"])["value"]
    assert set(rows.index.get_level_values("who")) == {TEST, POPULATIONS, SPIKES}
    assert rows[SPIKES, "criterion"] == rows[POPULATIONS, "criterion"]
    gap = touched.numbers["learned_gap_nats"]
    assert rows[TEST, "criterion"] == pytest.approx(np.log1p(np.exp(-gap / 2)))
    # The example trial is decided in spikes at the learned threshold.
    shown = touched.courses[touched.courses["who"] == SPIKES]
    choice, time_ms = touched.decided.set_index("who").loc[SPIKES, ["choice", "time_ms"]]
    out = shown[shown["channel"] == choice].set_index("time_ms")["out_nats"]
    assert out[time_ms] <= rows[SPIKES, "criterion"] < out[out.index < time_ms].min()
    # What populations learned is drawn as the gap that it corresponds to.
    drawn = touched.learning[touched.learning["who"] == POPULATIONS]
    ends = drawn.groupby("run").tail(Learner.last).groupby("run")["mean_separation"].mean()
    threshold = np.log1p(np.exp(-touched.numbers["gain"] * ends.mean() / 2))
    assert threshold == pytest.approx(rows[SPIKES, "criterion"])


def test_readings_claim_what_they_reach_and_spread_as_the_decoder_errs(touched):
    curve = touched.psychometric
    np.testing.assert_allclose(curve["claimed"], curve["accuracy"], atol=0.03)
    np.testing.assert_allclose(curve["spread_deg"], SD_DEG, rtol=0.05)


def test_a_result_comes_back_from_its_table(touched):
    again = Touched.from_dataframe(touched.to_dataframe(), touched.axis, touched.step_ms)
    assert again.numbers == touched.numbers
    pd.testing.assert_frame_equal(again.to_dataframe(), touched.to_dataframe(), check_like=True)


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_decoder_of_nothing_decides_at_chance_and_says_so():
    taps = edge_taps(900, SD_DEG, seed=81)
    taps["edge_deg"] = np.random.default_rng(82).permutation(taps["edge_deg"])
    touched = told(pd.concat([taps, taps[:60]]), EdgeTurn)
    for said in ("60 of 960 taps are copies", "does not distinguish the 2 hypotheses"):
        assert any(said in remark for remark in touched.remarks)
    assert not any("1 of 1 trials" in remark for remark in touched.remarks)
    assert touched.numbers["one_reading_accuracy"] == pytest.approx(0.5, abs=0.05)
    assert touched.numbers["test_accuracy"] == pytest.approx(0.5, abs=0.12)
    assert not len(touched.learning)
    assert not len(touched.learned)
    # What it states is what it reaches: no choice is surer than chance.
    assert "test_accuracy" in page(touched, "nothing", "")


@dataclass(frozen=True)
class BriefLearner(Learner):
    """A class, as the types of arguments name it."""

    episodes: int = 500


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_folder_of_recordings_becomes_a_page_and_nothing_is_made_twice(
    tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr("bgmodel.from_taps.Learner", BriefLearner)
    monkeypatch.setattr("bgmodel.from_taps.TO_LEARN", 1000)
    monkeypatch.setattr("bgmodel.from_taps.TO_SPIKE", 20)
    monkeypatch.setattr("bgmodel.commands.touch_steps.EDGE", replace(EDGE, epochs=8))
    folders = []
    for name, count in (("train", 320), ("held", 360)):
        yaws = np.linspace(-180, 179, count) + 0.3 * (name == "held")
        folders.append(record(tmp_path / name, yaws))
    mine = tmp_path / "mine"
    asked = ["touch", mine, "--recordings", folders[0], "--held-out", folders[1]]
    asked += ["--mm-per-px", MM_PER_PX, "--task", "edge-direction", "step_deg=20"]
    asked += ["--trials", 120]
    assert run(*asked) == 0
    assert "test_accuracy" in capsys.readouterr().out
    made = {name: checksum(mine / name) for name in ("decoder.safetensors", "decoded.parquet")}
    assert {"yaw_deg", "edge_deg"} <= set(read_table(mine / "decoded.parquet"))
    assert run(*asked, "--circuit", "macaque_small", "--gain", 0.3, "--force") == 0
    assert capsys.readouterr().err.count("already exists") == 2
    assert "macaque_small" in (mine / "index.html").read_text(encoding="utf-8")
    assert made == {name: checksum(mine / name) for name in made}


ALGEBRA = ("--engine", "algebra")
FEW = ("--task", "trials=100", "t_max=12")
EDGES = ("--task", "edge-turn", "step_deg=5")
DOPAMINE = ("--what", "dopamine", *FEW, "--runs", 1, "--levels", 3, "--learner", "episodes=500")
GRATINGS = ("--task", "same-different", "period_mm=2")


@pytest.fixture
def edges(tmp_path):
    """Write a decoded table of an edge as other programs do: without provenance."""
    path = tmp_path / "edges.csv"
    edge_taps(1500, SD_DEG, seed=71).to_csv(path, index=False)
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

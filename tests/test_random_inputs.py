"""Random inputs are tried: each gives a result that an oracle confirms, or one sentence."""

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import tomlkit
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from scipy.special import log_softmax, logsumexp

from bgmodel import Msprt, first_crossing
from bgmodel.cli import main
from bgmodel.experiments.experiment import Experiment
from bgmodel.support.files import read_table
from bgmodel.trials.evidence_table import trials_from_table
from bgmodel.trials.named_evidence import trial_table
from tests.strategies import experiments, numbers, tables
from tests.strategies.edits import driven, edited_circuits

FOLDER, FILE = Path("here"), Path("mine.toml")
SENTENCE = r"^[^\n]{10,}$"
SAME = ("trial", "row", "response", "forced", "steps")


def counted(few):
    """Try as many inputs in `make test`, a hundred times as many in `make validate`."""
    many = pytest.param(100 * few, marks=pytest.mark.validate)
    return pytest.mark.parametrize("count", [few, many])


def tried(count, test, *strategies):
    """Run a test with a number of random inputs; shrinking failures would take too long."""
    once = {"phases": [Phase.generate], "suppress_health_check": list(HealthCheck)}
    settings(max_examples=count, **once)(given(*strategies)(test))()


@pytest.fixture
def typed(tmp_path, monkeypatch, capsys):
    """Return what runs a command in a folder: its status, and what it said."""
    monkeypatch.chdir(tmp_path)
    return lambda arguments: (main(arguments), capsys.readouterr().err)


def emptied():
    shutil.rmtree(FOLDER, ignore_errors=True)
    FOLDER.mkdir()


def assert_refused(typed, arguments):
    """Hold a command to one sentence, and to writing nothing."""
    before = sorted(FOLDER.rglob("*"))
    status, printed = typed(arguments)
    assert status == 2, (arguments, printed)
    assert "Traceback" not in printed
    last = printed.strip().splitlines()[-1]
    assert last.startswith("bgmodel: "), printed
    assert 20 < len(last) < 400, printed
    assert sorted(FOLDER.rglob("*")) == before


@counted(5)
def test_an_experiments_file_is_run_as_it_is_written(count, typed):
    def one(file):
        emptied()
        FILE.write_text(tomlkit.dumps(file))
        read = Experiment.from_toml(FILE)
        assert (read.name, read.seed, read.note) == (file["name"], file["seed"], file["note"])
        assert read.predictions[0].at_least == file["predictions"][0]["at_least"]
        assert list(read.manipulation.edits) == file["manipulation"]["edits"]
        asked = ["experiment", str(FILE), "--save", f"{FOLDER}/out.csv", "--trials", "220"]
        assert typed(asked)[0] == 0
        assert len(read_table(FOLDER / "out_trials.csv")) in (220, 440)
        assert read_table(FOLDER / "out.csv")["outcome"].notna().sum() == 1

    tried(count, one, experiments.files())


@counted(20)
def test_an_experiments_file_with_one_thing_wrong_gets_one_sentence(count, typed):
    def one(text):
        FILE.write_text(text)
        with pytest.raises(ValueError, match=SENTENCE):
            Experiment.from_toml(FILE)

    tried(count, one, experiments.wrong_files())


@counted(12)
def test_a_circuit_that_was_edited_runs_and_treats_its_channels_alike(count):
    def one(circuit, seed):
        rng = np.random.default_rng(seed)
        drive = rng.uniform(-0.7, 0.7, (3, 1, circuit.channels))
        drive -= drive.mean(axis=2, keepdims=True)
        out = driven(circuit, drive).output_nats
        assert out.shape == drive.shape
        assert np.isfinite(out).all()
        order = rng.permutation(circuit.channels)
        turned = driven(circuit, drive[:, :, order]).output_nats
        assert np.abs(turned - out[:, :, order]).max() < 1e-6
        if circuit.exact:
            plain = logsumexp(drive, axis=2, keepdims=True) - drive
            assert np.abs(out - plain).max() < 1e-6

    tried(count, one, edited_circuits(), st.integers(0, 2**31))


def decided(table, posterior):
    trials = trials_from_table(table, step_ms=50.0)
    decision = first_crossing(Msprt().run(trials.evidence), -np.log(posterior))
    return trial_table(decision, trials, model="m")


@counted(10)
def test_a_table_is_decided_as_its_trials_are_one_by_one(count):
    def one(table, posterior):
        names = [name.removeprefix("ll_") for name in table if name.startswith("ll_")]
        rows_decided = decided(table, posterior).to_dict("records")
        for (key, rows), trial in zip(tables.trials_of(table), rows_decided, strict=True):
            total = rows[[f"ll_{name}" for name in names]].to_numpy(dtype=float).cumsum(axis=0)
            out = -log_softmax(total, axis=1)
            met = (out <= -np.log(posterior) + 1e-10).any(axis=1)
            k = int(np.argmax(met)) if met.any() else len(out) - 1
            assert (trial["trial"], trial["steps"], trial["forced"]) == (key, k + 1, not met.any())
            assert trial["rt"] == pytest.approx(0.05 * (k + 1))
            assert out[k, names.index(trial["response"])] <= out[k].min() + 1e-9
            if "truth" in table:
                assert trial["correct"] == (trial["response"] == rows["truth"].iloc[0])

    tried(count, one, tables.tables(), numbers(0.55, 0.99))


@counted(8)
@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_a_command_decides_a_table_as_python_does_or_says_what_is_wrong(ending, count, typed):
    path, out = Path(f"mine{ending}"), FOLDER / f"out{ending}"
    circuit = "circuit run", "--engine", "algebra", "--circuit", "bogacz_gurney", "--gain"

    def one(table, wrong, gain, posterior):
        emptied()
        words = ["decide"] if gain == 1 else [*circuit[0].split(), *circuit[1:], str(gain)]
        words += ["--save", str(out), "--task", str(path), "--task", "step_ms=50"]
        words += ["--posterior", str(posterior)]
        tables.write(wrong(table), path)
        assert_refused(typed, words)
        tables.write(table, path)
        assert typed(words)[0] == 0
        as_text = {"dtype": str, "keep_default_na": False}
        decisions = pd.read_csv(out, **as_text) if ending == ".csv" else read_table(out)
        scaled = {name: gain * table[name] for name in table if name.startswith("ll_")}
        expected = decided(table.assign(**scaled), posterior)
        for name in expected.columns.intersection([*SAME, *tables.OWN]):
            assert decisions[name].astype(str).tolist() == expected[name].astype(str).tolist(), name

    choices = st.sampled_from(tables.WRONG), st.sampled_from([1, 0.7]), numbers(0.55, 0.99)
    tried(count, one, tables.tables(), *choices)

"""Places of results: refused, or written over only by force, before anything runs."""

import warnings
from pathlib import Path
from unittest.mock import Mock

import pytest

from bgmodel.cli import _plain_warnings, main
from bgmodel.commands import output
from bgmodel.commands.output import say_before, stages
from bgmodel.fitting.fit_results import stem
from bgmodel.integrators.basal_ganglia import BasalGanglia
from circuits.anatomy import load_circuit
from tests.helpers import run, some_evidence


@pytest.mark.parametrize(
    "arguments",
    [
        ["decide", "--save", "mine.csv", "--task", "./mine.csv", "--posterior", ".9"],
        ["circuit", "run", "--save", "mine.csv", "--task", "mine.csv"],
        ["circuit", "run", "--save", "out.csv", "--save-rates", "out.csv"],
    ],
)
def test_no_result_goes_over_another_file_of_the_command(tmp_path, monkeypatch, capsys, arguments):
    monkeypatch.chdir(tmp_path)
    Path("mine.csv").write_text("mine")
    assert main(arguments) == 2
    assert "are the same file" in capsys.readouterr().err
    assert Path("mine.csv").read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["mine.csv"]


def test_places_that_cannot_take_a_result_are_known_before_the_run(tmp_path, refusal, monkeypatch):
    monkeypatch.setattr("bgmodel.commands.decide.trials_of", lambda *arguments, **more: 1 / 0)
    dangling, foreign = tmp_path / "dangling.csv", tmp_path / "foreign.csv"
    dangling.symlink_to(tmp_path / "nowhere.csv")
    (tmp_path / "foreign.csv.json").write_text("[]")
    (tmp_path / "taps").mkdir()
    for path, says, force in (
        (dangling, "already exists", ()),
        (foreign, "is not a file of parameters", ("--force",)),
        (tmp_path / ("y" * 230 + ".csv"), "has at most 200 bytes", ()),
    ):
        assert says in refusal("decide", "--save", path, *force)
    monkeypatch.setattr("bgmodel.commands.touch_steps.load_decoder", lambda *arguments: 1 / 0)
    taps = tmp_path / "taps"
    asked = ("touch", "decode", "d.safetensors", taps, "--save", taps / "targets.csv", "--force")
    assert "folder that is read" in refusal(*asked)


def test_a_result_is_written_over_only_by_force(tmp_path, refusal):
    out = tmp_path / "out.csv"
    short = ("--task", "trials=10", "t_max=3")
    assert run("decide", "--save", out, *short) == 0
    before = out.read_bytes(), out.with_name("out.csv.json").read_bytes()
    assert "already exists: give another" in refusal("decide", "--save", out, *short, "--seed", 4)
    assert before == (out.read_bytes(), out.with_name("out.csv.json").read_bytes())
    assert run("decide", "--save", out, *short, "--seed", 4, "--force") == 0
    assert out.read_bytes() != before[0]


def test_a_refused_command_makes_no_folder(tmp_path):
    out = tmp_path / "new" / "out.csv"
    assert run("decide", "--save", out, "--task", "period_mm=7") == 2
    assert not out.parent.exists()
    assert run("decide", "--save", out, "--task", "trials=5") == 0


def test_a_folder_that_cannot_be_written_is_called_by_its_name(tmp_path, monkeypatch, refusal):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("tempfile.TemporaryFile", Mock(side_effect=OSError(30, "Read-only")))
    assert f"folder '{tmp_path}' can't be written" in refusal("decide", "--save", "out.csv")


def test_a_warning_is_shown_as_one_sentence_without_its_place():
    with _plain_warnings():
        assert warnings.formatwarning("so it is", UserWarning, "a.py", 3) == "bgmodel: so it is\n"


@pytest.mark.parametrize(("name", "channels"), [("bogacz_gurney", 50), ("macaque", 12)])
def test_what_runs_and_its_memory_are_said_but_no_time_that_it_takes(
    capsys, monkeypatch, name, channels
):
    """No estimate holds for circuits of any size on any machine: a bar shows how far a run is."""
    model = BasalGanglia(load_circuit(name, channels), "rate", 0.5)
    evidence = some_evidence(trials=1000, steps=39, hypotheses=channels, step_ms=50.0, baseline=0.0)
    announced = f"bgmodel: trying {name} on rate, {{}}1000 trials of up to 2 s{{}}\n"
    say_before("trying", model, evidence)
    say_before("trying", model, evidence, runs=3)
    monkeypatch.setattr(BasalGanglia, "memory_gb", lambda *arguments: 2.5)
    say_before("trying", model, evidence)
    expected = [("", ""), ("3 circuits, ", ""), ("", ", 2.5 GB of memory")]
    assert capsys.readouterr().err == "".join(announced.format(*each) for each in expected)


def test_a_baseline_above_0_is_said_where_channels_get_their_own_evidence(capsys):
    for name, baseline, announced in (
        ("macaque", 0.5, True),
        ("macaque", 0.0, False),
        ("spiking_msprt", 0.5, False),
    ):
        evidence = some_evidence(trials=2, hypotheses=2, baseline=baseline)
        say_before("trying", BasalGanglia(load_circuit(name), "algebra", 0.5), evidence)
        told = capsys.readouterr().err
        assert ("minus the baseline of a reading: 0.5 nats" in told) == announced


def test_compiling_is_announced_by_engines_that_compile_and_once_they_do(capsys, monkeypatch):
    later = []
    monkeypatch.setattr("bgmodel.support.compiling.on_compiling", later.append)
    evidence = some_evidence(trials=2, hypotheses=2, baseline=0.0)
    for engine, compiles in (("spikes", True), ("algebra", False)):
        later.clear()
        say_before("trying", BasalGanglia(load_circuit("macaque"), engine, 0.5), evidence)
        assert "compiling" not in capsys.readouterr().err
        assert bool(later) == compiles
        for call in later:
            call()
        assert ("bgmodel: compiling, once for" in capsys.readouterr().err) == compiles


@pytest.mark.parametrize(
    ("line", "starts", "announced"),
    [
        ("learn --what dopamine --save a.csv", "learning.dopamine_learner.level_outcomes",
         "macaque on rate learns dopamine, same-different, 2 alternatives, period_mm 2, in 10 "),
        ("experiment stn_conflict", "experiments.experiment.Experiment.run",
         "an experiment with macaque on population, 2 circuits, 2000 trials of up to "),
        ("compare --task channels=4", "commands.decide.comparing.compare",
         "comparing macaque on population, "),
        ("touch simulate --save t.npz --taps 2", "tactile.library.contact_library",
         "solving 36 contacts, once for all runs, and simulating 16 taps\n"),
    ],
)  # fmt: skip
def test_a_command_says_before_it_starts_what_runs(
    tmp_path, monkeypatch, capsys, line, starts, announced
):
    monkeypatch.setenv("BGMODEL_CACHE", str(tmp_path))
    monkeypatch.setattr(f"bgmodel.{starts}", Mock(side_effect=ValueError("started")))
    monkeypatch.chdir(tmp_path)
    assert main(line.split()) == 2
    out, told = capsys.readouterr()
    assert "read " not in out
    assert told.index(announced) < told.index("started")


def test_stages_are_told_in_a_log_soon_and_then_not_more_than_once_a_minute(monkeypatch, capsys):
    times = iter([0.0, 9.0, 30.0, 61.0, 95.0, 100.0, 160.0])
    monkeypatch.setattr(output.time, "monotonic", lambda: next(times))
    with stages("fit") as tell:
        for stage in "abcdef":
            tell(stage)
    told = capsys.readouterr().err.splitlines()
    assert [line[-1] for line in told] == ["b", "d", "f"]
    assert [line.split("after ")[1][:-3] for line in told] == ["30 s", "2 min", "3 min"]
    assert all("fit" in line for line in told)


def test_a_terminal_shows_the_stage_in_one_line(monkeypatch, capsys):
    monkeypatch.setattr(output.sys.stderr, "isatty", lambda: True, raising=False)
    with stages("fit") as tell:
        tell("optimum")
    assert "optimum" in capsys.readouterr().err


def test_files_of_a_model_and_of_its_versions_have_names_of_their_own():
    assert stem("folder/my.v2.toml") == "my.v2"
    for name in ("my.v2, constant threshold", "constant_gap"):
        assert stem(name) == name

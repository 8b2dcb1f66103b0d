"""The command line as a whole: tables of a user in every command, refusals, help."""

import hashlib
import io
import os
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import tyro

import bgmodel
from bgmodel import Evidence, Msprt, first_crossing
from bgmodel.cli import choices, main, parsed
from bgmodel.commands.table import CIRCUIT, COMMANDS
from bgmodel.support.files import read_provenance, read_table
from bgmodel.tactile.decoder import Training
from tests.helpers import GOOD, run


def own_table(path, flat=False, truth=True, trials=30):
    """Write a table of unequal trials, ids of text and an extra column; return it."""
    rng = np.random.default_rng(5)
    rows = [
        {"trial": f"t{n:03d}", "step": t, "ll_left": a, "ll_up": b, "ll_right": c, "truth": "up"}
        | {"session": f"00{n % 3}"}
        for n in range(trials)
        for t, (a, b, c) in enumerate(rng.normal([0, 1, 0], 0.5, (1 + n % 12, 3)) * (not flat))
    ]
    table = pd.DataFrame(rows).drop(columns=[] if truth else "truth")
    table.to_csv(path, index=False)
    return table


ALGEBRA = ("--engine", "algebra", "--circuit", "bogacz_gurney", "--gain", 1)


@pytest.mark.parametrize("command", [("decide",), ("circuit", "run")])
def test_a_users_own_table_comes_back_with_its_ids_and_columns(tmp_path, capsys, command):
    mine, out = tmp_path / "mine.csv", tmp_path / "out.csv"
    table = own_table(mine)
    more = ALGEBRA if command != ("decide",) else ()
    assert run(*command, out, "--evidence", mine, "--posterior", 0.95, *more) == 0
    said = capsys.readouterr().out
    assert "read 30 trials of 1 to 12 readings, hypotheses left, up, right" in said
    found = pd.read_csv(out, dtype=str)
    assert found["trial"].tolist() == [f"t{n:03d}" for n in range(30)]
    assert found["session"].tolist() == [f"00{n % 3}" for n in range(30)]
    assert (table["trial"].iloc[found["row"].astype(int)] == found["trial"].to_numpy()).all()
    about = read_provenance(out)
    kept = about["parameters"]["command"]
    options = kept["task"]
    digest = hashlib.sha256(mine.read_bytes()).hexdigest()
    assert options["evidence"] == {"file": "mine.csv", "sha256": digest}
    idle = {"trials", "t_max", "d_prime", "delta", "fold", "workers", "output", "force"}
    assert not idle & (set(kept) | set(options))
    assert about["seed"] is None


@pytest.mark.parametrize("command", [("decide",), ("circuit", "run")])
def test_a_table_that_says_nothing_is_shared_out_alike_by_test_and_circuit(tmp_path, command):
    mine, out = tmp_path / "mine.csv", tmp_path / "out.csv"
    own_table(mine, flat=True, trials=300)
    more = ALGEBRA if command != ("decide",) else ()
    with pytest.warns(UserWarning, match="300 of 300 trials never meet the threshold"):
        assert run(*command, out, "--evidence", mine, "--posterior", 0.95, *more) == 0
    found = read_table(out)
    assert found["forced"].all()
    share = found["response"].value_counts(normalize=True)
    assert set(share.index) == {"left", "up", "right"}
    assert share.max() < 0.45
    expected = first_crossing(Msprt().run(Evidence(np.zeros((300, 1, 3)))), 0.1).choice
    assert (found["response"] == np.array(["left", "up", "right"])[expected]).all()


BAD_USE = {
    "decide out.xlsx": "output must end in .parquet or .csv",
    "decide out.csv --delta -1": "delta must be finite and >= 0",
    "decide out.csv --posterior 1.5": "posterior must lie between chance",
    "decide out.csv --posterior 0.5": "posterior must lie between chance, 0.5",
    "decide out.csv --posterior 0.9 --delta 1": "give one of them",
    "decide out.csv --task orientation --channels 3 --delta 1": "with 3, give --posterior",
    "decide out.csv --evidence x.csv --fold 3": "fold is for evidence that is drawn",
    "decide out.csv --evidence absent.csv": "there is no table",
    "decide out.csv --evidence x.csv --seed -1": "seed must be a whole",
    "decide out.csv --prior 0.5 0.6": "prior must sum to 1",
    "decide out.csv --prior 0.95 0.05 --delta 1": "prior is past the threshold",
    "decide out.csv --period-mm 7": "period_mm must be one of",
    "decide file/out.csv": "output folder",
    "decide out.csv --seed -1": "seed must be a whole number >= 0",
    "decide out.csv --onset-ms 5": "onset_ms is for your own table",
    "decide out.csv --channels 3": "same-different has 2 alternatives",
    "decide out.csv --trials 1e12": "of memory",
    "decide out.csv --trials many": "must be a whole number, got 'many'",
    "decide out.csv --trials 1.5": "must be a whole number, got '1.5'",
    "decide out.csv --trials": "Missing value for argument '--trials'",
    "decide out.csv --no-such-thing": "Unrecognized options",
    "no-such-thing": "Available subcommands: demo, touch",
    "decide": "Missing from bgmodel decide",
    "decide .": "is a folder",
    "learn out.csv --xi -2": "xi must be",
    "learn out.csv --start 9": "start_delta must be within 0..8",
    "learn out.csv --runs 0": "runs must be a whole number >= 1",
    "learn out.csv --runs 1e9": "of memory",
    "learn out.csv --learner.episodes 200": "--learner: episodes must be at least",
    "train absent.npz d.safetensors": "there are no taps",
    "train file d.safetensors": "does not hold taps",
    "decode absent.safetensors file out.csv": "there is no decoder",
    "simulate taps.csv": "output must end in .npz",
    "simulate taps.npz --taps 0": "taps must be at least 1",
    "simulate taps.npz --taps 1e12": "of memory",
    "figures": "figures are drawn in a checkout",
    "compare a.txt": "output must end in .parquet or .csv",
    "compare a.csv --evidence x.csv --trials 9": "trials is for evidence",
    "compare a.csv --task same-different --d-prime 1": "d_prime is for gaussian",
    "compare a.csv --task same-different --channels 3": "2 alternatives",
    "compare a.csv --trials 50": "trials must be 100 or more for an interval, got 50",
    "compare a.csv --accuracies 1.2": "accuracies must lie above chance",
    "circuit compare-edits a.csv 'lesion GPi'": "has no nucleus 'GPi'",
    "circuit compare-edits a.csv 'lesion SNr'": "SNr is the read-out",
    "circuit run d.txt": "output must end in .parquet or .csv",
    "circuit run d.csv --evidence x.csv --channels 4": "channels is for evidence that is drawn",
    "circuit run d.csv --period-mm 1.5": "period_mm is for same-different, orientation",
    "circuit run d.csv --engine rate --edits 'neurons 3'": "has no effect in the rate engine",
    "circuit run d.csv --engine population --spikes s.csv": "engine has no spikes: leave --spikes",
    "circuit run d.csv --trials 1e12": "of memory",
    "circuit run d.csv --edits 'neurons 1e9' --engine ensemble": "of memory",
    "circuit run d.csv --edits 'neurons 1e12'": "neurons must be within 1",
    "circuit run d.csv --edits 'heterogeneity 5'": "heterogeneity must be within 0..1, got 5",
    "circuit run d.csv --edits 'lesion STN 50%'": "rests at OUT = 0.00, which is not above",
    "circuit run d.csv --gain 0": "gain must be > 0",
    "circuit run d.csv --gain inf": "gain must be > 0 and finite",
    "circuit run d.csv --posterior 1": "posterior must lie between chance",
    "circuit run d.csv --posterior 0.4": "posterior must lie between chance",
    "circuit run d.csv --circuit spiking_msprt --posterior 0.501": "would decide without evidence",
    "circuit run d.csv --threshold nan": "threshold must be finite, got nan",
    "circuit run d.csv --threshold 0.3 --posterior 0.8": "posterior or threshold, not",
    "circuit run d.csv --channels 0": "channels must be at least 2, got 0",
    "circuit run d.csv --d-prime 0": "d_prime must be > 0",
    "circuit run d.csv --workers 0": "workers must be at least 1, got 0",
    "circuit run d.csv --spike-trials 0": "spike_trials must be at least 1, got 0",
    "circuit show --channels 0": "channels must be a whole number >= 2, got 0",
    "circuit show spiking_msprt --edits 'lesion GPi'": "has no nucleus 'GPi': ctx, ",
    "circuit show spiking_msprt --edits 'scale STN 2'": "written as in 'scale STN->GPe 0.5'",
    "circuit show spiking_msprt --edits 'neurons 0'": "neurons must be within 1",
    "circuit show spiking_msprt --noise 0.99": "that spiking_msprt reads, 0.52 to 0.95",
    "circuit show spiking_msprt --noise 0.8 --edits 'connections 0.5'": "ctx->D1 connects 50%",
    "circuit show macaque --edits 'dopamine 0.9' --edits 'lesion D1'": "--edits is given twice",
    "circuit designed --thresholds 0.05": "macaque resolves no OUT below 0.0798 nats",
    "circuit designed --thresholds nan": "thresholds must be finite",
    "circuit designed --circuit spiking_msprt --thresholds 0.7": "would decide without evidence",
    "circuit designed --channels 2": "designed trials need 3 channels or more, got 2",
    "circuit designed --trials 0": "trials must be at least 1",
    "circuit designed --trials 1": "trials must be at least 2 for an engine with noise",
    "circuit show gpr --save mine.csv": "save must end in .toml, got 'mine.csv'",
    "circuit designed --circuit gpr --engine rate": "gpr has no default gain",
    "circuit designed --output a.txt": "output must end in .parquet or .csv",
    "data roitman": "name must be one of roitman_shadlen_2002, palmer",
    "data --out out.csv": "out needs the name of a set: one of roitman",
    "data cavanagh_2011 --out out.xlsx": "out must end in .parquet or .csv",
    "experiment stn_conflict out.txt": "output must end in .parquet or .csv",
    "experiment stn": "a .toml file or one of accuracy_dopamine, ",
    "experiment stn --show": "a .toml file or one of accuracy_dopamine, ",
    "experiment no.toml": "can't be read",
    "demo demo.txt": "drawing must end in .png or .pdf or .svg",
    "demo one.svg --alternatives 1": "alternatives must be at least 2, got 1",
}
"""Command lines, and what the one sentence says with which each is refused."""


@pytest.mark.parametrize("line", BAD_USE)
def test_bad_use_is_one_sentence_and_writes_nothing(tmp_path, monkeypatch, refusal, line):
    monkeypatch.chdir(tmp_path)
    Path("file").write_text("")
    said = refusal(*shlex.split(line))
    assert BAD_USE[line] in said
    assert said.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_options_say_what_they_are():
    """Every field of every parameter class has a docstring, with a source or "assumed"."""
    import inspect

    from bgmodel.learning.policies import BernoulliPolicy, GaussianPolicy
    from bgmodel.learning.reinforce import Learner
    from bgmodel.tactile.decoder import Training
    from bgmodel.tactile.likelihood import Density
    from bgmodel.tactile.pressing import LibraryPlan
    from bgmodel.tactile.sensor import Nuisance
    from bgmodel.tactile.skin import Skin
    from bgmodel.tactile.tips import Tip

    sourced = ("assumed", "our choice", "19", "20")
    for kind in (Nuisance, Skin, Tip, LibraryPlan, Training, Density, Learner):
        text = inspect.getsource(kind)
        for field in fields(kind):
            after = text.split(f"    {field.name}: ", 1)[1].split('"""')[1]
            after = " ".join(after.split())
            if field.name not in ("network", "tol", "stored_dx_mm", "skin"):
                assert any(word in after for word in sourced), f"{kind.__name__}.{field.name}"
    plain = [kind for kind in COMMANDS.values() if not isinstance(kind, tuple)]
    kinds = (*plain, *CIRCUIT.values(), GaussianPolicy, BernoulliPolicy)
    assert all(is_dataclass(kind) for kind in kinds)


GAUSSIAN = "channels=2 d_prime=0.5 conflict=0"
GRATING = "fold=0 period_mm=2 a_deg=-45 b_deg=45"
LEARNER = "episodes=40000 rate=0.04 half_episodes=1000 baseline_rate=0.01 carried=0 last=500"
WEIGHTS = (
    "trials=10000 rate=0.5 half_trials=3000 gain_plus=1 gain_minus=1 trace_decay=1 averaged=0.25 "
    "keep=100 right=1 wrong=0 valid=1 given=1"
)
MANY = "trials=1000 t_max=110 step_ms=50"
SENSOR = (
    "pitch_mm=1.2 pin_mm=1.5 radius_mm=20 camera_height_mm=45 skin_mm=1 skin_shear_mpa=0.333333 "
    "gel_mm=15 gel_shear_mpa=0.01 force_n=1.2,1.8 offset_sd_mm=0.3 shear_sd_mm=0.03 "
    "marker_noise_um=9.5 frames=15"
)
EXPECTED = "expectancy_nats=0 expectancy_ms=0"


def numbers(options):
    """Yield each number of the options, and of groups of options, as "name=value"."""
    for field in fields(options):
        value = getattr(options, field.name)
        if is_dataclass(value):
            yield from numbers(value)
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield f"{field.name}={value:g}"
        elif isinstance(value, tuple) and value and not isinstance(value[0], str):
            yield f"{field.name}={','.join(f'{each:g}' for each in value)}"


@pytest.mark.parametrize(
    ("command", "says"),
    [
        ("demo", "seed=1 alternatives=3"),
        (
            "simulate a.npz",
            f"taps=1000 periods_mm=0,1,1.5,2,2.5,3,4,5 channels=2 {SENSOR} workers=1 seed=0",
        ),
        ("train a.npz b.safetensors", "seed=0"),
        (
            "touch",
            "channels=2 period_mm=2 step_deg=5 taps=1000 held_out_taps=1200 trials=1200 "
            f"folds=10 step_ms=50 workers=2 seed=0 {SENSOR}",
        ),
        (
            "watch camera a.csv --decoder b --taps c --mm-per-px 1",
            "channels=2 period_mm=2 step_deg=5 mm_per_px=1 first_deg=0 posterior=0.82 step_ms=100 "
            "t_max=60 idle_s=10 seed=0",
        ),
        (
            "decide a.csv",
            f"trials=1000 t_max=30 step_ms=500 {EXPECTED} {GRATING} onset_ms=0 inner_folds=10 "
            "seed=0",
        ),
        (
            "learn a.csv",
            f"seed=0 trials=4000 t_max=40 step_ms=50 {EXPECTED} {GRATING} xi=50 runs=10 levels=16 "
            f"units=16 {LEARNER} {WEIGHTS}",
        ),
        (
            "compare a.csv",
            f"seed=0 {MANY} {EXPECTED} {GAUSSIAN} accuracies=0.9,0.95,0.97 workers=2",
        ),
        ("fit mine.csv", "noise_nats=2 trials=16000 seed=24001 workers=2"),
        ("experiment", "workers=2"),
        ("sweep mine.toml", "workers=2 parts=10"),
        ("figures", "cores=2"),
        ("circuit show", ""),
        (
            "circuit run a.csv",
            f"seed=0 trials=100 t_max=40 step_ms=50 {EXPECTED} {GAUSSIAN} workers=2 "
            "spike_trials=10 nwb_trials=0",
        ),
        (
            "circuit compare-edits a.csv",
            f"seed=0 {MANY} {EXPECTED} {GAUSSIAN} accuracies=0.9,0.95,0.97 workers=2",
        ),
        ("circuit designed", "seed=0 thresholds=0.35,0.25,0.15 trials=200 workers=2"),
    ],
)
def test_no_default_of_an_option_changes_by_accident(command, says):
    """With another default the same command line would give another result."""
    assert " ".join(numbers(parsed(command.split()))) == says


def test_no_default_of_training_changes_by_accident():
    assert " ".join(numbers(Training())) == (
        "width=0.25 epochs=8 patience=20 batch=64 learning_rate=0.003 dropout=0 l2=0.005 "
        "validation=0.25"
    )


@dataclass(frozen=True)
class Show:
    name: tyro.conf.Positional[str] = "all"


@dataclass(frozen=True)
class Alone:
    number: int = 1


def test_a_group_of_commands_is_one_level_more(capsys):
    group = choices({"alone": Alone, "circuit": ("Of circuits.", {"show": Show, "run": Alone})})
    assert tyro.cli(group, args=["circuit", "show", "STN"]) == Show("STN")
    assert tyro.cli(group, args=["circuit", "run", "--number", "3"]) == Alone(3)
    assert tyro.cli(group, args=["alone"]) == Alone()
    for asked in (["--help"], ["circuit", "--help"]):
        with pytest.raises(SystemExit):
            tyro.cli(group, args=asked)
        assert "Of circuits." in capsys.readouterr().out


def test_the_package_runs_as_the_command_does():
    done = subprocess.run(
        [sys.executable, "-m", "bgmodel", "decide"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert done.stderr.startswith("bgmodel: Missing from bgmodel decide")


def test_the_version_is_printed(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"bgmodel {bgmodel.__version__}\n"


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_a_shell_gets_a_script_that_completes_every_command(shell, capsys):
    with pytest.raises(SystemExit) as stop:
        main(["--tyro-print-completion", shell])
    assert stop.value.code in (0, None)
    script = capsys.readouterr().out
    assert all(name in script for name in (*COMMANDS, *CIRCUIT))
    assert "--posterior" in script
    if shell == "bash" and shutil.which("bash"):
        subprocess.run(["bash", "-n"], input=script, text=True, check=True)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (
            ["circuit", "decide", "--help"],
            "there is no command `bgmodel circuit decide` (but there is `bgmodel decide`); there "
            "are `bgmodel circuit show`",
        ),
        (["decided", "-h"], "there is no command `bgmodel decided`; there are `bgmodel demo`"),
    ],
)
def test_help_on_a_command_that_there_is_not_says_so(capsys, arguments, says):
    assert main(arguments) == 2
    told = capsys.readouterr()
    assert says in told.err
    assert not told.out


@pytest.mark.parametrize("arguments", [["--help"], ["circuit", "--help"], ["decide", "x", "-h"]])
def test_help_on_what_there_is_is_shown(capsys, arguments):
    with pytest.raises(SystemExit):
        main(arguments)
    assert "usage: bgmodel" in capsys.readouterr().out


@pytest.mark.parametrize("encoding", ["cp1252", "latin-1", "ascii", "utf-8"])
def test_a_terminal_of_any_encoding_shows_a_result(tmp_path, monkeypatch, encoding):
    file = tmp_path / "mine.toml"
    file.write_text(GOOD.replace('name = "a lesion"', 'name = "läsion ≈ √"'), encoding="utf-8")
    shown = io.TextIOWrapper(io.BytesIO(), encoding)
    monkeypatch.setattr(sys, "stdout", shown)
    assert run("experiment", file) == 0
    assert run("bench") == 0
    shown.flush()
    text = shown.buffer.getvalue().decode(encoding)
    assert ("√" in text) == (encoding == "utf-8")
    assert ("ä" in text) == (encoding != "ascii")


@pytest.mark.parametrize("text", ["\udcff", "√"])
def test_text_that_no_encoding_has_is_printed(text):
    command = "import sys; from bgmodel.cli import main; sys.argv[1:] = ['--version']; main()"
    done = subprocess.run(
        [sys.executable, "-c", f"{command}; print({text!a})"],
        env={**os.environ, "PYTHONIOENCODING": "ascii"},
        capture_output=True,
        check=True,
    )
    assert ascii(text).strip("'").encode() in done.stdout

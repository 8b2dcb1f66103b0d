"""The command line as a whole: tables of a user in every command, refusals, help."""

import hashlib
import inspect
import io
import re
import shlex
import shutil
import sys
from functools import cache
from inspect import signature
from pathlib import Path

import pytest

import bgmodel as bg
from bgmodel.cli import main
from bgmodel.commands.options import record_of, task_of
from bgmodel.support.files import read_provenance
from bgmodel.task import Task
from bgmodel.trials.reader import OURS
from bgmodel.trials.task_trials import EvidenceTable
from tests.helpers import GOOD, ROOT, long_table, program_run, run, some_evidence


@pytest.mark.parametrize("command", ["decide", "circuit run --engine algebra"])
def test_a_users_own_table_is_recorded_in_place_of_idle_settings(tmp_path, capsys, command):
    mine, out = tmp_path / "mine.csv", tmp_path / "out.csv"
    long_table(some_evidence(trials=30, hypotheses=2)).to_csv(mine, index=False)
    assert run(*command.split(), "--save", out, "--task", mine, "--posterior", 0.9) == 0
    assert "read 30 trials of 20 readings, hypotheses a, b" in capsys.readouterr().out
    about = read_provenance(out)
    kept = about["parameters"]["command"]
    options = kept["task"]
    digest = hashlib.sha256(mine.read_bytes()).hexdigest()
    assert options["evidence"] == {"file": "mine.csv", "sha256": digest}
    idle = {"trials", "t_max", "d_prime", "boundary_separation", "fold", "workers", "save", "force"}
    assert not idle & (set(kept) | set(options))
    assert about["seed"] is None


RECORDED = "--recordings . --held-out . --mm-per-px 0.3"
WATCHED = ". --decoder d --taps t --mm-per-px 0.3"
FIT = "fit roitman_shadlen_2002 --strength coherence"
BAD_USE = {
    "decide --save out.xlsx": "save",
    "decide --posterior 0.9 --boundary-separation 1 --save out.csv": "boundary_separation",
    "decide --task orientation channels=3 --boundary-separation 1": "boundary_separation",
    "decide --task x.csv fold=3 --save out.csv": "task.fold",
    "decide --task absent.csv --save out.csv": "path",
    "decide --save file/out.csv": "folder",
    "decide --task channels=3 --save out.csv": "task.channels",
    "decide --task trials=many --save out.csv": "task.trials",
    "decide --task trials": "task",
    "decide --no-such-thing --save out.csv": "arguments",
    "no-such-thing": "arguments",
    "decide out.csv": "arguments",
    "touch train": "arguments",
    "decide --save .": "save",
    "learn --runs 1000000000 --save out.csv": "runs",
    "touch train file --save d.safetensors": "path",
    "touch simulate --save taps.csv": "save",
    "touch simulate --save taps.npz --taps 1000000000000": "trials",
    "figures": "ValueError",
    "compare --save a.txt": "save",
    "compare --task x.csv trials=9 --save a.csv": "task.trials",
    "circuit run --save d.txt": "save",
    "circuit run --task x.csv channels=4 --save d.csv": "task.channels",
    "circuit run --engine rate --edits 'neurons 3' --save d.csv": "edits",
    "circuit run --engine population --save-spikes s.csv --save d.csv": "save_spikes",
    "circuit run --threshold 0.3 --posterior 0.8 --save d.csv": "posterior",
    "circuit run --spike-trials 0 --save d.csv": "spike_trials",
    "circuit run --stop share=0.5 --workers 0 --save d.csv": "workers",
    "circuit show macaque --edits 'dopamine 0.9' --edits 'lesion D1'": "arguments",
    "circuit show gpr --save mine.csv": "save",
    "experiment stn_conflict --save out.txt": "save",
    "experiment stn": "file",
    "experiment stn --show": "file",
    "experiment no.toml": "path",
    "learn --what weights --rule hebb": "rule",
    "learn --what weights --learner trials=0": "trials",
    "learn --what dopamine --levels 10000000": "trials",
    "learn --task orientation channels=3": "channels",
    "learn --plot weights.txt": "plot",
    "learn --edits 'lesion STN'": "edits",
    "learn --gain 0.3": "gain",
    "learn --posterior 0.9": "posterior",
    "learn --rule chosen": "rule",
    "learn --levels 4": "levels",
    "touch mine --task edge-turn": "task",
    "touch mine --recordings .": "held_out",
    "exam nobody": "circuit",
    "exam macaque --save exam.txt": "save",
    "exam --numbers none.toml": "path",
    "explore --port 70000": "port",
    "explore nobody --no-browser": "file",
    "explore no.toml --no-browser": "path",
    "explore gpr --no-browser": "unit",
    "compare --engine quill": "engine",
    "circuit run --circuit gpr --gain 0.1 --engine rate": "posterior",
    "circuit run --circuit gpr --threshold 0.1 --engine rate": "gain",
    "circuit export --save t.py --trial 100 --task trials=100": "trial",
    "circuit export --save t.py --posterior 0.9": "posterior",
    "circuit export --save t.py --threshold 0.1": "threshold",
    "circuit export --save t.py --engine rate": "engine",
    "touch simulate --save out.npz --task orientation trials=7": "trials",
    "touch train taps.npz --save d.onnx --mm-per-px 0.3": "mm_per_px",
    "touch mine --mm-per-px 0.3": "mm_per_px",
    "touch mine --task trials=7": "trials",
    "touch mine --task step_ms=7": "step_ms",
    f"touch mine {RECORDED} --taps 7": "taps",
    f"touch mine {RECORDED} --held-out-taps 7": "held_out_taps",
    f"touch mine {RECORDED} --task same-different": "task",
    f"touch watch {WATCHED} --by test --engine rate": "engine",
    f"touch watch {WATCHED} --plot a.png": "plot",
    f"touch watch {WATCHED}": "path",
    f"touch watch nowhere{WATCHED[1:]}": "folder",
    "circuit export --save a.py --plot a.png": "plot",
    "exam --save a.csv": "save",
    "experiment --plot a.png": "plot",
    "sweep file found --workers 0": "workers",
    "fit no.csv": "path",
    f"{FIT} --people hierarchical --draws": "draws",
    f"{FIT} --columns rt_window=5,9": "rt_window",
    f"{FIT} --fix lapse=much": "fix",
    f"{FIT} --fix lapse": "fix",
    f"{FIT} --fix lapse=": "fix",
    f"{FIT} --vary bound=": "vary",
    f"{FIT} --simulation trials=0": "trials",
    "demo --plot demo.txt": "plot",
    "demo --plot one.svg --alternatives 1": "arguments",
}
"""Command lines, and the field that is refused, or the class of the error."""


@pytest.mark.parametrize("line", BAD_USE)
def test_bad_use_is_one_sentence_and_writes_nothing(tmp_path, monkeypatch, refusal, line):
    monkeypatch.chdir(tmp_path)
    Path("file").write_text("")
    with pytest.raises(ValueError) as caught:  # noqa: PT011
        bg.cli.run(shlex.split(line))
    assert getattr(caught.value, "field", type(caught.value).__name__) == BAD_USE[line]
    # The memory that is free changes from one moment to the next.
    *_, last = refusal(*shlex.split(line)).splitlines()
    assert last[:40] == f"bgmodel: {caught.value}"[:40]
    assert "\n" not in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_an_unknown_command_of_a_group_is_answered_with_those_of_the_group(refusal):
    assert "(bgmodel learn is one); there are show, run, export;" in refusal("circuit", "learn")
    assert "did you mean 'show'?" in refusal("circuit", "shwo")


@cache
def every_option():
    """Return the options of each command: name, and what its help says, by its parser."""
    named = {}
    for name, app in bg.cli.commands():
        arguments = app.assemble_argument_collection(parse_docstring=True)
        named[name] = {a.names[0]: a for a in arguments if a.names and a.names[0].startswith("--")}
    return named


def test_an_option_of_a_function_has_its_default_and_its_words():
    """Signature and docstring of the function are the only declaration."""
    from bgmodel.commands.options import described

    for command, function, names in (
        ("compare", bg.compare, ("accuracies", "noise_ceiling")),
        ("learn", bg.learn, ("xi", "runs", "start", "posterior")),
        ("touch", bg.touch, ("trials", "folds")),
        ("touch simulate", bg.simulate_taps, ("taps", "periods_mm")),
        ("touch train", bg.train_decoder, ("edge", "mm_per_px")),
        ("exam", bg.Exam.take, ("gain", "share")),
    ):
        for name in names:
            argument = every_option()[command][f"--{name.replace('_', '-')}"]
            assert argument.field_info.default == signature(function).parameters[name].default
            assert argument.parameter.help == described(function)[name]


DEFAULTS = {
    "decide --task": "same-different trials=1000 t_max=30 step_ms=500.0 period_mm=2.0",
    "learn --task": "same-different trials=4000 t_max=40 step_ms=50.0 period_mm=2.0",
    "compare --task": "gaussian trials=1000 t_max=110 step_ms=50.0 d_prime=0.5",
    "touch watch --task": "edge-direction trials=100 t_max=60 step_ms=100.0 step_deg=5.0",
    "learn --runs": 10, "learn --xi": 50.0, "exam --seed": 98_001, "touch --trials": 1200,
    "touch --folds": 10, "touch simulate --taps": 1000, "circuit run --nwb-trials": (0,),
    "touch simulate --periods-mm": (0.0, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0),
}  # fmt: skip


@pytest.mark.parametrize("option", DEFAULTS)
def test_no_default_of_an_option_changes_by_accident(option):
    command, _, name = option.rpartition(" ")
    usual = every_option()[command][name].field_info.default
    if not isinstance(usual, Task):
        assert usual == DEFAULTS[option]
        return
    kind, *settings = DEFAULTS[option].split()
    assert usual.name == kind
    known = usual.settings()
    assert settings == [f"{each.partition('=')[0]}={known[each.partition('=')[0]]}"
                        for each in settings]  # fmt: skip


def test_a_task_is_its_name_and_settings_in_any_order(tmp_path):
    assert task_of(bg.Gaussian(), ["d_prime=2", "trials=7"]) == bg.Gaussian(d_prime=2, trials=7)
    usual = bg.SameDifferent(trials=9, period_mm=3)
    task = task_of(usual, ["channels=3", "orientation"])
    assert task == bg.Orientation(channels=3, trials=9, period_mm=3)
    assert task_of(usual, ["mine.csv", "step_ms=20"]) == EvidenceTable(Path("mine.csv"), step_ms=20)
    for words in (["walk"], ["gaussian", "orientation"], ["period_mm=2"], ["trials"], ["=3"]):
        with pytest.raises(bg.InputError):
            task_of(bg.Gaussian(), words)


def test_a_whole_number_is_written_in_any_way_and_is_never_rounded():
    for words, name, number in (
        (["circuit", "run", "--workers", "1e0"], "workers", 1),
        (["experiment", "x", "--trials", "2e3"], "trials", 2000),
        (["learn", "--runs", "5"], "runs", 5),
    ):
        assert bg.cli.parsed(words).keywords[name] == number
    assert bg.cli.parsed(["experiment", "x", "--trials=2e3"]).keywords["trials"] == 2000
    for words in (["circuit", "run", "--workers", "1.5"], ["circuit", "run", "--seed=2.5"],
                  ["experiment", "x", "--trials", "many"]):  # fmt: skip
        with pytest.raises(bg.InputError, match="must be a whole number"):
            bg.cli.parsed(words)


def test_text_of_a_setting_stays_as_it_is_written():
    task = task_of(bg.SameDifferent(), ["taps=a,b.parquet"])
    assert task.taps == Path("a,b.parquet")
    columns = record_of(OURS, ["upper=2", "rt=2024-01-01", "alternatives=4"])
    assert (columns.upper, columns.rt, columns.alternatives) == ("2", "2024-01-01", 4)


def test_an_option_that_a_page_or_a_message_names_exists():
    known = {name for _, app in bg.cli.commands() for argument in app.assemble_argument_collection()
             for name in argument.names} | {"--help", "--version", "--completion"}  # fmt: skip
    pages = [ROOT / "README.md", *(ROOT / "docs" / "guides").glob("*.md")]
    code = [*(ROOT / "bgmodel").rglob("*.py"), *(ROOT / "circuits").rglob("*.py")]
    # Of Snakemake, SLURM and a script of another project.
    others = {"--cores", "--rerun-incomplete", "--force-use-threads", "--quiet", "--config",
              "--array", "--cpus-per-task", "--mem", "--time", "--table"}  # fmt: skip
    for path in [*pages, *code]:
        named = set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", path.read_text(encoding="utf-8")))
        assert named <= known | others, path


def test_a_record_has_the_types_of_its_fields():
    task = record_of(bg.StopTask(), ["delays_ms=100,200", "share=1e-1", "staircases=2"])
    assert task == bg.StopTask(delays_ms=(100.0, 200.0), share=0.1, staircases=2)
    assert record_of(bg.StopTask(), []) == bg.StopTask()
    for words in (["pace=3"], ["share=x"], ["staircases=1.5"], ["share=.1", "share=.2"]):
        with pytest.raises(bg.InputError):
            record_of(bg.StopTask(), words)


def test_the_package_runs_as_the_command_does():
    done = program_run(sys.executable, "-m", "bgmodel", "touch", "decode")
    assert done.returncode == 2
    assert done.stderr.startswith("bgmodel: ")
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_shell_gets_a_script_that_completes_every_command(shell, capsys):
    assert main(["--completion", shell]) == 0
    script = capsys.readouterr().out
    assert all(word in script for name, _ in bg.cli.commands() for word in name.split())
    assert "posterior" in script
    if shell == "bash" and shutil.which("bash"):
        assert program_run("bash", "-n", input=script).returncode == 0


def test_help_of_every_command_has_an_example_that_its_parser_takes(capsys):
    """Examples are those of the docstring; what they name may be missing here."""
    for name, app in [*bg.cli.commands()]:
        assert main([*name.split(), "--help"]) == 0
        shown = " ".join(capsys.readouterr().out.split())
        assert "Usage: bgmodel" in shown
        text = inspect.getdoc(app.default_command)
        listed = re.search(r"Examples?: (.*?)(?:\n\n|$)", text, re.DOTALL)[1]
        for line in " ".join(listed.split()).split("; "):
            words = shlex.split(line)
            assert words[0] == "bgmodel"
            bg.cli.parsed(words[1:])


@pytest.mark.parametrize(("words", "code"), [(["--save", "x.csv"], 2), ([], 0)])
def test_a_reader_that_stops_is_told_if_a_file_may_be_missing(words, code):
    text = """
import sys
from bgmodel import cli
def run(words): raise BrokenPipeError
cli.run = run
sys.exit(cli.main(sys.argv[1:]))"""
    done = program_run(sys.executable, "-c", text, *words)
    assert (done.returncode, done.stderr.count("read no further")) == (code, code / 2)


@pytest.mark.parametrize("encoding", ["cp1252", "latin-1", "ascii", "utf-8"])
def test_a_terminal_of_any_encoding_shows_a_result(tmp_path, monkeypatch, encoding):
    file = tmp_path / "mine.toml"
    file.write_text(GOOD.replace('name = "a lesion"', 'name = "läsion ≈ √"'), encoding="utf-8")
    shown = io.TextIOWrapper(io.BytesIO(), encoding)
    monkeypatch.setattr(sys, "stdout", shown)
    assert run("experiment", file) == 0
    assert run("exam") == 0
    shown.flush()
    text = shown.buffer.getvalue().decode(encoding)
    assert ("√" in text) == (encoding == "utf-8")
    assert ("ä" in text) == (encoding != "ascii")

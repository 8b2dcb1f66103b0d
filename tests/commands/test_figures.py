"""The command `figures`: names that are no figure, and what it asks Snakemake for."""

import json
import subprocess

import pytest

from bgmodel.cli import main
from bgmodel.commands import one_run
from bgmodel.commands.figures import MINUTES
from tests.helpers import ROOT


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["fig99"], "figR1, figS1 or files in figures/out, got 'fig99'"),
        (["fig3", "all_of_them", "--fast"], "files in figures/fast, got 'all_of_them'"),
        (["figures/out/fig3.png", "--fast"], "files in figures/fast, got 'figures/out/fig3.png'"),
    ],
)
def test_what_is_no_figure_is_refused_before_snakemake_starts(monkeypatch, capsys, arguments, says):
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(subprocess, "Popen", None)
    assert main(["figures", *arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith("bgmodel: targets must be among fig1, fig2b, fig3, ")
    assert error.endswith(f"{says}\n")
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "asked", "count"),
    [
        ([], ["all"], 3),
        (["fig2"], ["fig2"], 1),
        (["fig3", "figures/fast/fig2.png", "--fast"], ["fig3", "figures/fast/fig2.png"], 2),
    ],
)
def test_what_is_asked_for_is_drawn_and_nothing_else_and_all_without_a_word(
    tmp_path, monkeypatch, capsys, arguments, asked, count
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("BGMODEL_RECORDINGS", raising=False)
    (tmp_path / "figures").mkdir()
    for name in ("Snakefile", "fig2.py", "fig3.py", "fig4.py", "figR1.py"):
        (tmp_path / "figures" / name).touch()
    ran = []
    monkeypatch.setattr(one_run, "run_to_end", lambda make, jobs: ran.append(make(0)) or 0)
    assert main(["figures", *arguments]) == 0
    (command,) = ran
    assert command[command.index("--") + 1 :] == asked
    settings = json.loads((tmp_path / command[command.index("--configfile") + 1]).read_text())
    assert settings == {"fast": int("--fast" in arguments), "recordings": ""}
    said = capsys.readouterr().out
    assert f": {count}, there already: 0" in said
    # How long all of them take; of a part nothing is known.
    assert ("about 18 minutes of CPU" in said) == (not arguments)
    folder = tmp_path / "figures" / ("fast" if "--fast" in arguments else "out")
    folder.mkdir()
    (folder / "fig2.png").touch()
    assert main(["figures", *arguments]) == 0
    said = capsys.readouterr().out
    assert f": {count}, there already: 1" in said
    assert "minutes" not in said


@pytest.mark.parametrize("folder", ["010", "1e3", "true", "a' b"])
def test_a_folder_of_recordings_reaches_snakemake_as_it_is_named(tmp_path, monkeypatch, folder):
    """Its own reading of a configuration makes 10 of 010: what it reads is looked at here."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / folder).mkdir()
    (tmp_path / "figures").mkdir()
    read = tmp_path / "read.txt"
    (tmp_path / "figures" / "figR1.py").touch()
    (tmp_path / "figures" / "Snakefile").write_text(
        f"open({str(read)!r}, 'w').write(repr(config['recordings']))\nrule all:\n"
    )

    def plan(make, jobs):
        command = make(0)
        at = command.index("--")
        return subprocess.run([*command[:at], "--dry-run", *command[at:]], check=True).returncode

    monkeypatch.setattr(one_run, "run_to_end", plan)
    assert main(["figures", "--recordings", folder]) == 0
    assert read.read_text() == repr(folder)


def test_the_readme_says_how_long_all_figures_take():
    said = f"({MINUTES[False]:g} minutes of CPU, FAST=1: coarse, {MINUTES[True]:g})"
    assert said in (ROOT / "README.md").read_text()

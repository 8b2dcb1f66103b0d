"""The command `figures`: names that are no figure."""

import subprocess

import pytest

from bgmodel.cli import main
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

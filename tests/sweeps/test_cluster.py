"""Checks of SLURM before jobs are submitted, with programs of the same names in its place."""

import pytest

from bgmodel.sweeps.cluster import check_slurm
from tests.helpers import refused


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Return a function that puts a program alone on the path, with its exit status."""
    monkeypatch.setenv("PATH", str(tmp_path))

    def installed(name, status):
        (tmp_path / name).write_text(f"#!/bin/sh\necho no database >&2\nexit {status}\n")
        (tmp_path / name).chmod(0o755)

    return installed


@pytest.mark.parametrize("sinfo", [None, 1])
def test_a_machine_that_reaches_no_slurm_is_refused(install, tmp_path, sinfo):
    if sinfo is not None:
        install("sinfo", sinfo)
    install("sacct", 0)
    with refused("on sinfo"):
        check_slurm(tmp_path)


def test_a_slurm_without_accounts_is_refused_with_its_own_words(install, tmp_path):
    """Jobs would be submitted, and waited for without end."""
    install("sinfo", 0)
    install("sacct", 1)
    with refused("on sacct: no database"):
        check_slurm(tmp_path)


def test_a_slurm_that_answers_is_accepted(install, tmp_path):
    install("sinfo", 0)
    install("sacct", 0)
    check_slurm(tmp_path)


@pytest.mark.parametrize("name", ["a'b", 'a"b', "$(touch x)", "`touch x`", "a\\b"])
def test_a_folder_that_a_shell_would_interpret_is_refused(install, tmp_path, name):
    install("sinfo", 0)
    install("sacct", 0)
    check_slurm(tmp_path / "a folder")
    with refused("folder"):
        check_slurm(tmp_path / name)

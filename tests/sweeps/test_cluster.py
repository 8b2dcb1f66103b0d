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


@pytest.mark.parametrize(
    ("sinfo", "sacct", "says"), [(None, 0, "sinfo"), (1, 0, "sinfo"), (0, 1, "sacct: no database")]
)
def test_a_machine_without_slurm_or_its_accounts_is_refused(install, tmp_path, sinfo, sacct, says):
    """Without accounts, jobs would be submitted and waited for without end."""
    if sinfo is not None:
        install("sinfo", sinfo)
    install("sacct", sacct)
    with refused(f"on {says}"):
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

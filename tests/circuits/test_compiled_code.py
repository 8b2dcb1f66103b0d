"""Compiled code: where it is kept, and that nothing depends on it."""

import os
import shutil
import subprocess
import sys
import warnings

import numba
import pytest
from numba.core.dispatcher import Dispatcher

import bgmodel.support.compiling
from bgmodel.deciding import kernel as deciding
from bgmodel.fitting.simulated import crossings
from bgmodel.tactile import library
from circuits.compiled_code import compile_cached, sources_hash
from circuits.engines import compiling
from circuits.engines.population import kernel as population
from circuits.engines.spikes import kernel
from tests.helpers import ROOT

DECIDES = """
import circuits.engines.compiling
from bgmodel import Msprt, first_crossing
from bgmodel.simulated_evidence import separated_evidence
from bgmodel.support.seeds import stream
evidence = separated_evidence(50, 20, 1.0, rng=stream(1, "cache"), hypotheses=3)
print(first_crossing(Msprt().run(evidence), 0.05).time_ms.sum())
"""


@pytest.mark.parametrize("module", [deciding, kernel, population, library, crossings])
def test_compiled_code_is_kept_under_a_hash_of_all_sources(module):
    ours = module.__name__.startswith("bgmodel.")
    expected = bgmodel.support.compiling.SOURCES if ours else compiling.SOURCES
    kernels = [f for f in vars(module).values() if isinstance(f, Dispatcher) and f.stats.cache_path]
    assert kernels
    assert all(f"/compiled/{expected}/" in function.stats.cache_path for function in kernels)


def test_the_hash_follows_an_edit_of_any_source(tmp_path):
    (tmp_path / "inner").mkdir()
    before = sources_hash(tmp_path)
    (tmp_path / "inner" / "a.py").write_text("a = 1")
    after = sources_hash(tmp_path)
    (tmp_path / "inner" / "a.py").write_text("a = 2")
    assert len({before, after, sources_hash(tmp_path)}) == 3


@pytest.mark.filterwarnings("ignore:compiled code is not cached")
@pytest.mark.parametrize("kept", [True, False])
def test_compiling_leaves_the_filters_of_warnings_alone(kept, tmp_path, monkeypatch):
    """They are those of all threads: a warning of another one would be lost meanwhile."""
    enter, changed = warnings.catch_warnings.__enter__, []

    def counted(self):
        changed.append(self)
        return enter(self)

    def plus(x):
        return x + 1

    folder = tmp_path if kept else tmp_path / "file"
    (tmp_path / "file").touch()
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(folder))
    made = compile_cached(plus, "sources")
    monkeypatch.setattr(warnings.catch_warnings, "__enter__", counted)
    assert made(1) == 2
    assert changed == []
    assert numba.njit(lambda x: x + 1)(1) == 2  # Numba's own way stays for others
    assert changed


@pytest.fixture
def installed(tmp_path):
    """Copy the packages to a folder; return a function that runs code there with settings."""
    place = tmp_path / "site-packages"
    for package in ("bgmodel", "circuits"):
        no_caches = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / package, place / package, ignore=no_caches)
    kept = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}

    def start(**settings):
        return subprocess.Popen(
            [sys.executable, "-c", DECIDES], cwd=tmp_path, text=True,
            env={**kept, "PYTHONPATH": str(place), **settings},
            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip

    return place, start


def compiled_files(folder):
    return sorted(path for path in folder.rglob("*.nb[ic]"))


def test_processes_at_once_keep_their_code_outside_of_the_package(installed, tmp_path):
    place, start = installed
    runs = [start(XDG_CACHE_HOME=str(tmp_path / "cache")) for _ in range(2)]
    outputs = [run.communicate() for run in runs]
    assert outputs[0] == outputs[1]
    assert float(outputs[0][0]) > 0
    assert outputs[0][1] == ""
    kept = compiled_files(tmp_path / "cache" / "bgmodel")
    assert kept
    assert compiled_files(place) == []
    dates = [path.stat().st_mtime_ns for path in kept]
    assert start(XDG_CACHE_HOME=str(tmp_path / "cache")).communicate() == outputs[0]
    assert compiled_files(tmp_path / "cache") == kept
    assert [path.stat().st_mtime_ns for path in kept] == dates, "compiled again"


def test_of_processes_at_once_one_compiles(installed, tmp_path):
    _, start = installed
    told = {"XDG_CACHE_HOME": str(tmp_path / "cache"), "NUMBA_DEBUG_CACHE": "1"}
    outputs = [run.communicate()[0] for run in [start(**told) for _ in range(2)]]
    lines = [line for text in outputs for line in text.splitlines() if "data saved to" in line]
    assert lines
    assert len(lines) == len(set(lines))


@pytest.mark.parametrize(
    "setting",
    [
        pytest.param("HOME", marks=pytest.mark.validate),
        "XDG_CACHE_HOME",
        pytest.param("NUMBA_CACHE_DIR", marks=pytest.mark.validate),
    ],
)
def test_without_a_folder_that_can_be_written_code_compiles_and_is_not_kept(
    installed, tmp_path, setting
):
    _, start = installed
    (tmp_path / "file").touch()
    run = start(**{"XDG_CACHE_HOME": "", setting: str(tmp_path / "file" / "below")})
    decided, warned = run.communicate()
    assert float(decided) > 0
    assert warned.count("RuntimeWarning") == 1
    assert "NUMBA_CACHE_DIR" in warned
    assert compiled_files(tmp_path) == []

"""The wheel and the sdist, built, looked into, installed anew and tried: ``make dist``.

Each Python gets two fresh environments with the core's dependencies alone: one with the wheel and
the newest of what it asks for, one with the sdist and the versions in ``constraints.txt``.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
PACKAGES = ("bgmodel", "circuits")
NOT_CORE = ("torch", "cv2", "safetensors", "pynwb", "snakemake")
"""What extras bring: the core must run without."""
COMMANDS = (
    "--version",
    "demo --plot demo.png",
    "circuit show spiking_msprt",
    "circuit show bogacz_gurney --channels 4 --save mine.toml",
    "circuit run --task trials=20 --save spikes.csv",
    "circuit run --task trials=9 channels=4 --engine algebra --gain 1 --circuit mine.toml "
    "--save mean.csv",
    "decide --task trials=100 --save decisions.csv",
    "fit",
    "experiment",
    "experiment stn_lesion_partial --engine population --trials 200 --save outcome.csv",
    "sweep sweep.toml",
)
"""Every package of data is read by one of them: tables, taps, experiments."""
SWEEP = """name = "a sweep"
[task]
trials = 50
[grid]
"lesion STN" = [0.0, 0.05]
"""
IMPORTS = f"""
import importlib, pkgutil, sys
import bgmodel, circuits
from bgmodel import BasalGanglia, Msprt, compare, first_crossing
for package in (bgmodel, circuits):
    assert {str(ROOT)!r} not in package.__file__, package.__file__
    for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        if module.name.endswith("__main__"):
            continue
        try:
            importlib.import_module(module.name)
        except ModuleNotFoundError as error:
            assert error.name in {NOT_CORE!r}, error
from importlib.resources import files
assert (files("bgmodel.sweeps") / "template.toml").is_file()
assert len(list((files("bgmodel.experiments") / "shipped").iterdir())) == {{shipped}}
assert not [name for name in {NOT_CORE!r} if importlib.util.find_spec(name)]
"""


def build(folder: Path) -> tuple[Path, Path]:
    """Build a folder's sdist, and the wheel from it; return the wheel and the sdist."""
    shutil.rmtree(folder, ignore_errors=True)
    _run([sys.executable, "-m", "build", "--outdir", str(folder), str(ROOT)])
    (wheel,), (sdist,) = folder.glob("*.whl"), folder.glob("*.tar.gz")
    return wheel, sdist


def tracked() -> list[str]:
    """Return the files of the packages that git knows."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", *PACKAGES], cwd=ROOT, check=True, capture_output=True, text=True
    )
    return [name for name in listed.stdout.split("\0") if name]


def check_contents(wheel: Path, sdist: Path) -> None:
    """Raise SystemExit if an archive lacks a file of the packages, or the licence."""
    with zipfile.ZipFile(wheel) as archive:
        held = archive.namelist()
    with tarfile.open(sdist) as archive:
        # The first folder is the name and the version.
        packed = [name.partition("/")[2] for name in archive.getnames()]
    more = {"README.md", "LICENSE", "pyproject.toml"}
    for path, names, wanted in ((wheel, held, set()), (sdist, packed, more)):
        if files := sorted({*tracked(), *wanted}.difference(names)):
            raise SystemExit(f"{path.name} lacks {', '.join(files)}")
        print(f"{path.name}: every file of {' and '.join(PACKAGES)} is in", flush=True)


def try_out(python: str, archive: Path, *constraints: str) -> float:
    """Install an archive in a fresh environment and run what a user would; return seconds."""
    started = time.monotonic()
    with tempfile.TemporaryDirectory() as place:
        environment, work = Path(place) / "venv", Path(place) / "work"
        work.mkdir()
        _run([python, "-m", "venv", str(environment)])
        # Nothing of the checkout, nothing compiled before.
        kept = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
        there = {**kept, "XDG_CACHE_HOME": str(work / "cache"), "MPLBACKEND": "Agg"}
        there.pop("NUMBA_CACHE_DIR", None)
        there["PATH"] = f"{environment / 'bin'}{os.pathsep}{kept['PATH']}"
        pip = [str(environment / "bin" / "python"), "-m", "pip", "install", "-q"]
        _run([*pip, *constraints, str(archive)], work, there)
        shipped = len([n for n in tracked() if n.startswith("bgmodel/experiments/shipped/")])
        code = IMPORTS.replace("{shipped}", str(shipped))
        _run([str(environment / "bin" / "python"), "-c", code], work, there)
        (work / "sweep.toml").write_text(SWEEP)
        for command in COMMANDS:
            _run([str(environment / "bin" / "bgmodel"), *command.split()], work, there)
        for name in ("demo.png", "outcome.csv", "mine.toml"):
            if not (work / name).stat().st_size:
                raise SystemExit(f"{name} is empty")
        names = "import numpy, numba, brian2; print(*map(lambda m: m.__version__, (numpy, numba,"
        names += " brian2)))"
        shown = [str(environment / "bin" / "python"), "-c", names]
        text = subprocess.check_output(shown, cwd=work, env=there, text=True)
        numpy, numba, brian2 = text.split()
        check_replaced(environment, pip, work, there)
    seconds = time.monotonic() - started
    print(
        f"{_version(python)}, {archive.name}{' with constraints.txt' if constraints else ''}: "
        f"works (numpy {numpy}, numba {numba}, Brian2 {brian2}; {seconds:.0f} s)",
        flush=True,
    )
    return seconds


def check_replaced(venv: Path, pip: Sequence[str], work: Path, environment: dict[str, str]) -> None:
    """Raise SystemExit unless an editable installation takes the place of one that was used."""
    left = [str(path) for path in venv.rglob("*.nb[ic]") if {*path.parts} & {*PACKAGES}]
    if left:
        raise SystemExit(f"the installed package contains compiled code: {', '.join(left)}")
    _run([*pip, "--no-deps", "-e", str(ROOT)], work, environment)
    code = f"import bgmodel; bgmodel.Msprt; assert {str(ROOT)!r} in bgmodel.__file__"
    _run([str(venv / "bin" / "python"), "-c", code], work, environment)


def interpreters(names: Sequence[str]) -> Iterator[str]:
    """Yield the Pythons that run; say which do not."""
    for name in names:
        try:
            _version(name)
        except (OSError, subprocess.CalledProcessError):
            print(f"{name}: there is none, not tried", flush=True)
        else:
            yield name


def _version(python: str) -> str:
    ran = subprocess.run([python, "--version"], check=True, capture_output=True, text=True)
    return ran.stdout.strip()


def _run(
    command: Sequence[str], folder: Path | None = None, environment: dict[str, str] | None = None
) -> None:
    streams: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    done = subprocess.run(command, cwd=folder, env=environment, text=True, **streams)
    if done.returncode:
        words = " ".join(command)[:400]
        raise SystemExit(f"{words} ended with {done.returncode}\n{done.stdout[-4000:]}")


def main() -> None:
    """Build, look into both archives, and try them on every Python that is named and there."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("pythons", nargs="+")
    parser.add_argument("--folder", type=Path, default=ROOT / "dist")
    asked_for = parser.parse_args()
    wheel, sdist = build(asked_for.folder.resolve())
    check_contents(wheel, sdist)
    there = list(interpreters(asked_for.pythons))
    if not there:
        raise SystemExit("no Python is there to try them on: PYTHONS=...")
    for python in there:
        try_out(python, wheel)
        try_out(python, sdist, "-c", str(ROOT / "constraints.txt"))


if __name__ == "__main__":
    main()

"""One C++ program of a circuit, built by Brian2 and run many times."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy.typing as npt

from circuits.activity import Activity, checked_drive, warn_beyond_range
from circuits.engines.brian2.layout import Layout
from circuits.engines.brian2.network import Network
from circuits.engines.brian2.noise import load_brian
from circuits.fixed_point import wired
from circuits.spec import Circuit
from circuits.ticks import Clock, Scheme

EXACT = ("-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math")
"""Instead of -ffast-math, which lets a compiler add in another order: spikes would differ."""
HEADER = "objects.h"
"""What every file of a program includes."""


class Standalone:
    """One C++ program for a number of trials and steps, built once and run many times.

    Use it in a ``with``, or ``close`` it.

    Parameters
    ----------
    circuit : Circuit
        The table.
    trials, steps : int
        Size of the drive.
    step_ms, dt_ms, sample_ms, settle_ms, spikes, explicit
        As in ``spiking.run``.
    directory : path, optional
        Where to build it, to look at; without one it goes when it is closed.

    Raises
    ------
    ValueError
        If a time or a name does not fit the circuit.
    OSError
        If there is no compiler.
    """

    def __init__(
        self,
        circuit: Circuit,
        trials: int,
        *,
        steps: int,
        step_ms: float,
        dt_ms: float = 0.1,
        sample_ms: float = 1.0,
        settle_ms: float = 300.0,
        spikes: Iterable[str] = (),
        explicit: bool = False,
        directory: str | os.PathLike[str] | None = None,
    ) -> None:
        need_compiler("standalone")
        load_brian()
        from brian2.devices.cpp_standalone.device import CPPStandaloneDevice

        self.circuit, self.device = circuit, CPPStandaloneDevice()
        self.clock = Clock(steps, step_ms, dt_ms, sample_ms, settle_ms)
        self.layout = Layout(Scheme(wired(circuit), dt_ms), trials, explicit)
        self._temporary = directory is None
        self.directory = Path(directory or tempfile.mkdtemp(prefix="circuits_")).absolute()
        try:
            with self._active():
                self.network = Network(self.layout, self.clock, spikes)
                self.device.apply_run_args()
                self.network.run()
                where = str(self.directory)
                self.device.build(directory=where, run=False, compile=False, with_output=False)
            _compile(self.directory)
        except BaseException:
            self.close()
            raise

    def run(
        self,
        drive: npt.ArrayLike,
        *,
        seed: int,
        first_trial: int = 0,
        weights: Mapping[str, float] | None = None,
    ) -> Activity:
        """Run the program.

        Parameters
        ----------
        drive : array (trials, steps, channels), nats
            Accumulated evidence.
        seed, first_trial : int
            As in ``spiking.run``.
        weights : mapping, optional
            Weights of pathways other than the circuit's, such as ``{"STN->GPe": 0.3}``.

        Raises
        ------
        ValueError
            If the drive has not the size that the program was built for, or a weight does not fit.
        """
        drive = checked_drive(self.circuit, drive)
        size = self.layout.trials, self.clock.steps
        if drive.shape[:2] != size:
            raise ValueError(
                f"this program is for {size[0]} trials of {size[1]} steps, got {drive.shape[:2]}"
            )
        circuit = self.circuit
        for name, weight in (weights or {}).items():
            source, _, target = name.partition("->")
            circuit = circuit.with_projection(source, target, weight=weight)
        warn_beyond_range(circuit, drive)
        layout = replace(self.layout, scheme=Scheme(wired(circuit), self.clock.dt_ms))
        with self._active():
            given = {self.network.reading: self.network.readings(drive)}
            for (group, variable), value in layout.start(seed, first_trial).items():
                given[getattr(self.network.groups[group], variable)] = value
            try:
                self.device.run(run_args=given, with_output=False)
                return replace(self.network.activity(seed, first_trial), circuit=circuit)
            finally:
                self.device.delete(code=False, data=False, directory=False)

    def close(self) -> None:
        """Remove what was built in a temporary place."""
        if self._temporary:
            shutil.rmtree(self.directory, ignore_errors=True)

    def __enter__(self) -> Standalone:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @contextmanager
    def _active(self) -> Iterator[None]:
        from brian2.devices.device import reset_device, set_device

        set_device(self.device, build_on_run=False)
        try:
            with exact_sums():
                yield
        finally:
            reset_device()


@contextmanager
def exact_sums() -> Iterator[None]:
    """Have C++ compiled so that it adds and rounds in the order of the text."""
    cpp = load_brian().prefs.codegen.cpp
    before = cpp.extra_compile_args_gcc
    cpp.extra_compile_args_gcc = [flag for flag in before if flag != "-ffast-math"] + list(EXACT)
    try:
        yield
    finally:
        cpp.extra_compile_args_gcc = before


def _compile(directory: Path) -> None:
    """Build a program that Brian2 wrote; what they all include first, or each would parse it."""
    makefile = (directory / "makefile").read_text()
    flags = next(line for line in makefile.splitlines() if line.startswith("OPTIMISATIONS"))
    fast = flags.split("=", 1)[1].strip() + " -funroll-loops"
    once = ["objects.cpp", "main.cpp"]
    once += [f"code_objects/{path.name}" for path in directory.glob("*/before_run_*.cpp")]
    objects = " ".join(name.replace(".cpp", ".o") for name in once)
    make = f"make -j{os.cpu_count()} DEPS=/dev/null"
    commands = (
        f"{_compiler()} -x c++-header -Wno-write-strings {fast} -I. {HEADER} -o {HEADER}.gch",
        f"{make} {objects} 'OPTIMISATIONS={fast} -O1 -include {HEADER}'",
        f"{make} 'OPTIMISATIONS={fast} -include {HEADER}'",
    )
    for command in commands:
        done = subprocess.run(command, shell=True, cwd=directory, capture_output=True)
        if done.returncode:
            said = done.stderr.decode(errors="replace").strip()[-2000:]
            raise OSError(f"the C++ program of the circuit was not built:\n{said}")


def _compiler() -> str | None:
    found = (os.environ.get("CXX"), "g++")
    return next((c for c in found if c and shutil.which(c.split()[0])), None)


def need_compiler(target: str) -> None:
    """Raise OSError if what a target needs is not installed."""
    missing = [] if _compiler() else ["a C++ compiler (g++)"]
    if target == "standalone" and not shutil.which("make"):
        missing.append("make")
    if missing:
        raise OSError(
            f"target {target!r} needs {' and '.join(missing)}: install it, or take target='numpy'"
        )

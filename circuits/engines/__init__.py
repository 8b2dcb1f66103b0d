"""One call for all engines: the same table, exactly, as rates, or as spikes."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy.typing as npt

from circuits.circuit import Circuit

if TYPE_CHECKING:
    from circuits.activity import Activity

ENGINES = {
    "algebra": "the fixed point, exact",
    "rate": "rates with time constants and delays, without noise",
    "population": "rates with the noise of a finite number of cells, by the cells' own laws",
    "ensemble": "spikes, compiled, for thousands of trials",
    "brian2": "spikes in Brian2",
    "plain": "spikes in plain NumPy, the readable reference",
}
"""Names of the engines, and what each is."""
MODULES = {
    "algebra": "algebra",
    "rate": "population.run",
    "population": "population.run",
    "ensemble": "ensemble.run",
    "brian2": "brian2.run",
    "plain": "plain",
}
"""Where each engine's ``run`` is; one that is not asked for is not imported."""
SETTINGS: dict[str, dict[str, Any]] = {"rate": {"laws": "lines", "noise": False}}
"""Options by which one engine goes by two names."""
SPIKING = ("ensemble", "brian2", "plain")
NOISY = ("population", *SPIKING)
"""Engines with noise, which needs a seed."""
DROPPING = ("rate", "population", "ensemble")
"""Engines that can drop a trial once it is decided, and can leave rates out."""
THREADED = ("population", "ensemble")
"""Engines that can use several threads."""


def check_options(engine: str, options: Iterable[str]) -> None:
    """Raise ValueError, with the options that there are, for a name that an engine doesn't take."""
    module = importlib.import_module(f"circuits.engines.{MODULES[engine]}")
    noise = () if engine in NOISY else ("seed", "first_trial")
    hidden = {"circuit", "drive", *SETTINGS.get(engine, {}), *noise}
    known = [name for name in inspect.signature(module.run).parameters if name not in hidden]
    for name in options:
        if name not in known:
            raise ValueError(f"the {engine} engine takes no {name!r}: {', '.join(known)}")


def run(
    circuit: Circuit,
    drive: npt.ArrayLike,
    *,
    engine: str,
    step_ms: float,
    seed: int | None = None,
    **options: Any,
) -> Activity:
    """Run a circuit on one of the engines.

    Parameters
    ----------
    circuit : Circuit
        The table.
    drive : array (trials, steps, channels), nats
        Accumulated evidence; 0 is rest.
    engine : str
        A name in ``ENGINES``.
    step_ms : float
        Time from one reading to the next, ms.
    seed : int, optional
        Key of the noise; required by the engines that have noise.
    **options
        Passed on: see the ``run`` of each engine's module.

    Raises
    ------
    ValueError
        For an unknown engine, one with noise and no seed, or an option that it does not take.
    """
    if not isinstance(circuit, Circuit):
        raise ValueError(
            f"circuit must be a Circuit, as from circuits.anatomy.circuit, got {circuit!r}"
        )
    if not isinstance(engine, str) or engine not in ENGINES:
        raise ValueError(f"engine must be one of {', '.join(ENGINES)}, got {engine!r}")
    check_options(engine, options)
    module = importlib.import_module(f"circuits.engines.{MODULES[engine]}")
    given: dict[str, Any] = {"step_ms": step_ms, **options}
    if engine in NOISY and options.get("noise", True):
        if seed is None:
            raise ValueError(f"the {engine} engine needs a seed")
        given["seed"] = seed
    activity: Activity = module.run(circuit, drive, **given, **SETTINGS.get(engine, {}))
    return replace(activity, engine=engine)

"""One call for all engines: the same table, exactly, as rates, or as spikes."""

from __future__ import annotations

import importlib
import inspect
from typing import TYPE_CHECKING, Any

import numpy.typing as npt

from circuits.spec import Circuit

if TYPE_CHECKING:
    from circuits.activity import Activity

ENGINES = {
    "algebra": "the fixed point, exact",
    "rate": "rates with time constants and delays",
    "ensemble": "spikes, compiled, for thousands of trials",
    "brian2": "spikes in Brian2",
    "plain": "spikes in plain NumPy, the readable reference",
}
"""Names of the engines, and what each is."""
MODULES = {
    "algebra": "algebra",
    "rate": "rate",
    "ensemble": "ensemble.run",
    "brian2": "brian2.run",
    "plain": "plain",
}
"""Where each engine's ``run`` is; one that is not asked for is not imported."""
SPIKING = ("ensemble", "brian2", "plain")
DROPPING = ("rate", "ensemble")
"""Engines that can drop a trial once it is decided, and can leave rates out."""


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
        Key of the noise; required by the engines that spike.
    **options
        Passed on: see the ``run`` of each engine's module.

    Raises
    ------
    ValueError
        For an unknown engine, a spiking one without a seed, or an option that it does not take.
    """
    if engine not in ENGINES:
        raise ValueError(f"engine must be one of {', '.join(ENGINES)}, got {engine!r}")
    module = importlib.import_module(f"circuits.engines.{MODULES[engine]}")
    known = inspect.signature(module.run).parameters
    given: dict[str, Any] = {"step_ms": step_ms, **options}
    if engine in SPIKING:
        if seed is None:
            raise ValueError(f"the {engine} engine needs a seed")
        given["seed"] = seed
    for name in given:
        if name not in known:
            takes = ", ".join(p for p in known if p not in ("circuit", "drive"))
            raise ValueError(f"the {engine} engine takes no {name!r}: {takes}")
    activity: Activity = module.run(circuit, drive, **given)
    return activity

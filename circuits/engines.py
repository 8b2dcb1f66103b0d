"""One call for all engines: the same table, exactly, as rates, or as spikes."""

from __future__ import annotations

from typing import Any

import numpy.typing as npt

from circuits.activity import Activity
from circuits.spec import Circuit

ENGINES = {
    "algebra": "the fixed point, exact",
    "rate": "rates with time constants and delays",
    "ensemble": "spikes, compiled, for thousands of trials",
    "brian2": "spikes in Brian2, the readable reference",
}
"""Names of the engines, and what each is."""
SPIKING = ("ensemble", "brian2")
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
        For an unknown engine, or a spiking one without a seed.
    """
    if engine not in ENGINES:
        raise ValueError(f"engine must be one of {', '.join(ENGINES)}, got {engine!r}")
    if engine == "algebra":
        from circuits import algebra

        return algebra.run(circuit, drive, step_ms=step_ms, **options)
    if engine == "rate":
        from circuits import rate

        return rate.run(circuit, drive, step_ms=step_ms, **options)
    if seed is None:
        raise ValueError(f"the {engine} engine needs a seed")
    if engine == "ensemble":
        from circuits import ensemble

        return ensemble.run(circuit, drive, step_ms=step_ms, seed=seed, **options)
    from circuits import spiking

    return spiking.run(circuit, drive, step_ms=step_ms, seed=seed, **options)

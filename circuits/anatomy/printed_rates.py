"""Rates at rest that are printed for an animal, to be shown beside those of a table."""

from __future__ import annotations

from circuits.declaration.spec import Circuit
from circuits.dynamics.fixed_point import rest_rates, wired

MACAQUE = {
    "FSI": (7.8, 14.0),
    "D1": (0.0, 1.0),
    "D2": (0.0, 1.0),
    "STN": (15.2, 22.8),
    "GPe": (55.7, 74.5),
    "SNr": (59.1, 79.5),
}
"""Lowest and highest tonic rate, Hz: Lienard & Girard 2014, D1 and D2 as MSN, SNr as GPi/SNr."""
PRINTED: dict[str, dict[str, tuple[float, float]]] = {"macaque": MACAQUE}
"""The species' rates by the name of its table."""


def outside(circuit: Circuit) -> str:
    """Return a sentence on the populations that rest outside their species' rates, or nothing.

    Raises
    ------
    ValueError
        If the circuit has no state of rest.
    """
    printed = PRINTED.get(circuit.name, {})
    found = []
    for name, hz in at_rest(circuit).items():
        low, high = printed.get(name, (hz, hz))
        if not low <= hz <= high:
            found.append(f"{name} {hz:.0f} ({low:.0f} to {high:.0f})")
    if not found:
        return ""
    return f"outside what is printed for the {circuit.name}, Hz: {', '.join(found)}"


def at_rest(circuit: Circuit) -> dict[str, float]:
    """Return the mean rate of every population at rest, Hz; errors are those of ``outside``."""
    wiring = wired(circuit)
    rates = rest_rates(wiring)
    return {p.name: float(rates[wiring.blocks_of(p.name)].mean()) for p in circuit.populations}

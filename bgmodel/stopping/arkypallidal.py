"""Arkypallidal cells of GPe, a second place where a stop signal can arrive (Mallet et al. 2016).

They project to striatum and not to STN or SNr, and respond to stop cues earlier and more strongly
than the other cells of GPe. A stop signal to them lowers D1, so that OUT rises, and lowers D2.
"""

from __future__ import annotations

from circuits.cells import Phase
from circuits.circuit import Circuit
from circuits.declaration.rows import GABA, Population, Projection

NAME = "Arky"
"""Name of the nucleus, for ``StopSignal(NAME)``."""
DODSON = "rate and irregularity Dodson et al. 2015, awake mouse"
ASSUMED = "Mallet et al. 2012, 2016, rat; weight and times assumed"


def with_arkypallidal(circuit: Circuit, weight: float = 0.5, neurons: int = 300) -> Circuit:
    """Return a circuit with arkypallidal cells that inhibit D1 and D2 of their channel.

    At rest they send nothing, as pathways transmit deviations from resting rates, so that nothing
    but the noise of OUT changes until a signal reaches them. ``weight`` is the fall of the input of
    D1 and D2 per nat of their activity; it and the number of cells per channel are assumed. The
    fewer cells, the noisier is D1.
    """
    cells = Population(
        NAME, Phase(1.0), neurons=neurons, baseline_hz=9.8, gain_hz_per_nat=9.8, transmitter=GABA,
        cite=f"{DODSON}; number and gain assumed",
    )  # fmt: skip
    paths = [
        Projection(NAME, target, -weight, delay_ms=6, tau_ms=6, cite=ASSUMED)
        for target in ("D1", "D2")
    ]
    return circuit.add(cells, *paths)

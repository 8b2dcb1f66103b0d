"""Motifs: rows that are added to a circuit under one name: nuclei with pathways, or courses."""

from __future__ import annotations

from collections.abc import Callable

from circuits.cells import Phase
from circuits.declaration.courses import Course
from circuits.declaration.rows import GABA, Population, Projection
from circuits.declaration.table import CircuitTable

Row = Population | Projection | Course

LIENARD = "Lienard & Girard 2014"
FSI = f"rate {LIENARD}, macaque; CV, gain, cells, heterogeneity assumed"
DRIVEN = f"cortex drives them, Mallet et al. 2005, rat; delay as ctx->D1, {LIENARD}; rest assumed"
FEEDFORWARD = (
    "inhibit D1 and D2, Koos & Tepper 1999, Planert et al. 2010, rats; D1 more than D2, "
    "Gittis et al. 2010, mouse; strength, reach, delay, tau assumed"
)
TO_D1, TO_D2 = 0.15, 0.1
"""Inhibition of D1 and D2 by FSI, nats per nat: assumed, stronger onto D1 as in mice."""


def striatal_fsi(circuit: CircuitTable) -> tuple[Row, ...]:
    """Return the striatal fast-spiking interneurons: cortex -> FSI -> D1 and D2.

    At rest they fire at their baseline, the middle of the macaque's published range (8 to 14 Hz),
    so that adding them leaves all other resting rates unchanged. The FSI of a channel receive its
    cortical input ("ctx") and inhibit D1 and D2 of all channels equally, which removes common
    input. The circuit's unit must be nats, in which the pathway weights are given.
    """
    circuit.check_nats("striatal_FSI, whose weights are nats,")
    cells = Population(
        "FSI",
        Phase(0.5),
        baseline_hz=11.0,
        gain_hz_per_nat=5.0,
        transmitter=GABA,
        neurons=300,
        bias_nats=-circuit.drive_gain * circuit.rest_drive,
        heterogeneity=0.3,
        cite=FSI,
        published_hz=(7.8, 14.0),
    )
    pathways = [Projection("ctx", "FSI", 1.0, delay_ms=7, tau_ms=4, cite=DRIVEN)]
    for target, weight in (("D1", TO_D1), ("D2", TO_D2)):
        one = -weight / circuit.channels
        row = Projection("FSI", target, one, "diffuse", delay_ms=1, tau_ms=4, cite=FEEDFORWARD)
        pathways.append(row)
    return (cells, *pathways)


FELL = (
    "the criterion of monkeys falls by a factor e within 0.5 s, that of people within 1 to 3 s "
    "(fits of a falling gap); size assumed"
)
URGENCY_RISE_MS = 1000.0
"""Time constant of the fall of OUT with urgency."""
ONSET = "cortex responds to the onset of a stimulus, whatever its direction; size and times assumed"


def urgency(circuit: CircuitTable) -> tuple[Row, ...]:
    """Return a fall of OUT in all channels by 0.5 nats, with a time constant of 1 s.

    A falling criterion is the optimal policy where trials differ in difficulty (Drugowitsch et al.
    2012). With two alternatives the fall exceeds what separates a posterior of 0.8 from chance, so
    that in the end any lead decides. The circuit's unit must be nats.
    """
    circuit.check_nats("urgency, a course in nats,")
    return (Course(circuit.readout, -0.5, rise_ms=URGENCY_RISE_MS, cite=FELL),)


def onset_transient(circuit: CircuitTable) -> tuple[Row, ...]:
    """Return a burst of 1.2 nats in the input of every channel at the onset of the evidence.

    Being common to all channels, it moves no -ln P. The circuit's unit must be nats.
    """
    circuit.check_nats("onset_transient, a course in nats,")
    burst = Course(circuit.input, 1.2, to_ms=120.0, rise_ms=20.0, decay_ms=120.0, cite=ONSET)
    return (burst,)


MOTIFS: dict[str, Callable[[CircuitTable], tuple[Row, ...]]] = {
    "striatal_FSI": striatal_fsi,
    "urgency": urgency,
    "onset_transient": onset_transient,
}
"""All motifs by name; each takes the circuit that it is added to."""

"""Motifs: courses that are added to a circuit under one name."""

from __future__ import annotations

from collections.abc import Callable

from circuits.declaration.courses import Course
from circuits.declaration.table import CircuitTable

FELL = (
    "the criterion of monkeys falls by a factor e within 0.5 s, that of people within 1 to 3 s "
    "(fits of a falling gap); size assumed"
)
URGENCY_RISE_MS = 1000.0
"""Time constant of the fall of OUT with urgency."""
ONSET = "cortex responds to the onset of a stimulus, whatever its direction; size and times assumed"


def urgency(circuit: CircuitTable) -> tuple[Course, ...]:
    """Return a fall of OUT in all channels by 0.5 nats, with a time constant of 1 s.

    A falling criterion is the optimal policy where trials differ in difficulty (Drugowitsch et al.
    2012). With two alternatives the fall exceeds what separates a posterior of 0.8 from chance, so
    that in the end any lead decides. The circuit's unit must be nats.
    """
    circuit.check_nats("urgency, a course in nats,")
    return (Course(circuit.readout, -0.5, rise_ms=URGENCY_RISE_MS, cite=FELL),)


def onset_transient(circuit: CircuitTable) -> tuple[Course, ...]:
    """Return a burst of 1.2 nats in the input of every channel at the onset of the evidence.

    Being common to all channels, it moves no -ln P. The circuit's unit must be nats.
    """
    circuit.check_nats("onset_transient, a course in nats,")
    burst = Course(circuit.input, 1.2, to_ms=120.0, rise_ms=20.0, decay_ms=120.0, cite=ONSET)
    return (burst,)


MOTIFS: dict[str, Callable[[CircuitTable], tuple[Course, ...]]] = {
    "urgency": urgency,
    "onset_transient": onset_transient,
}
"""All motifs by name; each takes the circuit that it is added to."""

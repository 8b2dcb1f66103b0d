"""From a tactile tap to a learned decision.

A tap becomes evidence, evidence becomes an output trace, the trace crosses a threshold, and the
reward moves the threshold.  Importing this package loads neither torch, brian2 nor matplotlib.
"""

from bgmodel.decision import Decision, Trace, first_crossing, tally
from bgmodel.evidence import Evidence
from bgmodel.integrators.sprt import (
    Msprt,
    Sprt,
    criterion_from_gap,
    criterion_from_posterior,
    threshold_from_gap,
)
from bgmodel.moved import tell_old_names
from bgmodel.seeds import stream
from bgmodel.version import __version__

tell_old_names()

__all__ = [
    "Decision",
    "Evidence",
    "Msprt",
    "Sprt",
    "Trace",
    "__version__",
    "criterion_from_gap",
    "criterion_from_posterior",
    "first_crossing",
    "stream",
    "tally",
    "threshold_from_gap",
]

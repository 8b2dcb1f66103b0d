"""A circuit as an integrator beside ``Msprt``: the one bridge to ``circuits``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from bgmodel.decision import Trace
from bgmodel.evidence import Evidence

try:
    from circuits.anatomy import CIRCUITS, circuit
    from circuits.engines import ENGINES, SPIKING
    from circuits.engines import run as run_engine
    from circuits.nwb import write_nwb
    from circuits.show import draw, text
    from circuits.spec import Circuit
except ImportError as error:  # pragma: no cover - another distribution has that name too
    raise ImportError(
        "the package 'circuits' that was found is not bgmodel's: another distribution of that "
        "name is installed beside it; use an environment of its own"
    ) from error

if TYPE_CHECKING:
    from circuits.activity import Activity

__all__ = [
    "CIRCUITS",
    "ENGINES",
    "SPIKING",
    "BasalGanglia",
    "Circuit",
    "circuit",
    "draw",
    "drive_of",
    "text",
    "write_nwb",
]


@dataclass(frozen=True)
class BasalGanglia:
    """A basal ganglia circuit that integrates evidence; ``run`` gives OUT as ``Msprt`` does.

    Parameters
    ----------
    circuit : Circuit
        The table.
    engine : str
        "algebra", "rate", "ensemble" or "brian2".
    gain : float
        Nats of drive a nat of evidence, kappa: OUT is then ``-ln softmax(kappa L)``.
    seed : int
        Key of the noise of the engines that spike.
    options : dict
        Passed on to the engine.
    """

    circuit: Circuit
    engine: str = "algebra"
    gain: float = 1.0
    seed: int = 0
    options: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.engine not in ENGINES:
            raise ValueError(f"engine must be one of {', '.join(ENGINES)}, got {self.engine!r}")
        if not self.gain > 0:
            raise ValueError(f"gain must be > 0, got {self.gain}")

    def run(self, evidence: Evidence) -> Trace:
        """Return OUT (trials, ticks, hypotheses) in kappa-nats, from the onset of evidence.

        Readings come at ``onset_ms + k step_ms``; each is held, and the last one for a step more,
        so that the circuit can answer it.
        """
        return self.trace(self.activity(evidence), evidence)

    @staticmethod
    def trace(activity: Activity, evidence: Evidence) -> Trace:
        """Return the OUT of an activity as a trace on the evidence's clock."""
        time_ms = evidence.onset_ms + activity.time_ms
        return Trace(activity.output_nats, time_ms, evidence.onset_ms, evidence.step_ms)

    def activity(self, evidence: Evidence) -> Activity:
        """Return all that the circuit did."""
        given: dict[str, Any] = {"seed": self.seed} if self.engine in SPIKING else {}
        return run_engine(
            self.circuit,
            drive_of(evidence, self.gain),
            engine=self.engine,
            step_ms=evidence.step_ms,
            **given,
            **self.options,
        )


def drive_of(evidence: Evidence, gain: float = 1.0) -> npt.NDArray[np.float64]:
    """Return the drive of a circuit, (trials, steps + 1, hypotheses) nats.

    Parameters
    ----------
    evidence : Evidence
        Readings; before the first there is the prior alone.
    gain : float
        kappa.

    Notes
    -----
    ``kappa (L_i - mean_j L_j)`` with L the log prior plus all readings so far: a common input
    changes nothing (Bogacz & Gurney 2007), and without the mean no rate would have to be negative.
    """
    start = np.broadcast_to(np.log(evidence.prior), (evidence.trials, 1, evidence.hypotheses))
    readings = np.asarray(evidence.log_likelihood, dtype=np.float64)
    total = np.cumsum(np.concatenate([start, readings], axis=1), axis=1)
    return gain * (total - total.mean(axis=2, keepdims=True))

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
except ImportError as error:
    if not (error.name or "").startswith("circuits"):
        raise
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
    "check_threshold",
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
    seed : int, optional
        Key of the noise; the engines that spike need one.
    options : dict
        Passed on to the engine.
    """

    circuit: Circuit
    engine: str = "algebra"
    gain: float = 1.0
    seed: int | None = None
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


def check_threshold(circuit: Circuit, threshold_nats: float) -> None:
    """Refuse a threshold that the circuit is past before any evidence, or never reads.

    Parameters
    ----------
    circuit : Circuit
        The table.
    threshold_nats : float
        OUT at which it decides.

    Raises
    ------
    ValueError
        With the OUT at rest.
    """
    try:
        silence = np.zeros((1, 1, circuit.channels))
        at_rest = run_engine(circuit, silence, engine="algebra", step_ms=1.0).output_nats.min()
    except ValueError:
        return  # Without a state of rest there is nothing to compare with.
    if at_rest <= threshold_nats:
        raise ValueError(
            f"{circuit.name} rests at OUT = {at_rest:.2f}, which is not above the threshold of "
            f"{threshold_nats:.2f} nats: it would decide without evidence"
        )
    if threshold_nats < circuit.readable_nats[0]:
        raise ValueError(
            f"{circuit.name} reads no OUT below {circuit.readable_nats[0]:g}, the threshold is "
            f"{threshold_nats:.2f} nats"
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

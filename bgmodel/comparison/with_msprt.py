"""One call: a circuit, as it is or edited, against the optimal test."""

from __future__ import annotations

from collections.abc import Sequence

import numpy.typing as npt
import pandas as pd

from bgmodel.bootstrap import RESAMPLES
from bgmodel.comparison.circuits import compare_with_msprt, sample_ms
from bgmodel.comparison.compare import ACCURACIES
from bgmodel.evidence import Evidence, check_evidence
from bgmodel.integrators.basal_ganglia import (
    BasalGanglia,
    checked_circuit,
    gain_of,
)
from bgmodel.integrators.rivals import RIVALS
from circuits.declaration.spec import Circuit
from circuits.engines import engine_of


def compare(
    circuit: Circuit | str,
    evidence: Evidence,
    *,
    seed: int,
    engine: str = "ensemble",
    gain: float | None = None,
    workers: int = 2,
    rivals: Sequence[str] | str = (),
    accuracies: Sequence[float] | float = ACCURACIES,
    resamples: int = RESAMPLES,
    intact: Circuit | str | None = None,
    ceiling: bool = False,
    groups: npt.ArrayLike | None = None,
) -> pd.DataFrame:
    """Compare a circuit with the MSPRT on the same evidence, decision by decision.

    Parameters
    ----------
    circuit : Circuit or str
        The table, as it is or edited; or a name or a .toml file, with a channel per hypothesis.
    evidence : Evidence
        What both are given; 100 trials or more.
    seed : int
        Of the circuit's noise and of the bootstrap.
    engine : str
        A name in ``circuits.engines.ENGINES``: "ensemble" runs spikes, "population" the noise of a
        finite number of cells, fifty times as fast.
    gain : float, optional
        Nats in the circuit per nat of evidence, kappa; the circuit's default unless given.
    workers : int
        Threads of the engines that can use several; they change no byte.
    rivals : sequence of str
        Which of ``RIVALS`` are compared too. "race" and "LCA" need evidence whose zero means that
        nothing was seen, as that of ``separated_evidence``.
    accuracies : sequence of float, or float
        Expected accuracies at which thresholds are matched.
    resamples : int
        Of the bootstrap.
    intact : Circuit or str, optional
        The circuit before it was edited: the differences from it, with intervals, become rows of
        the model "circuit minus intact".
    ceiling : bool
        Whether the circuit decides a second time, with noise of another seed: how far it agrees
        with itself, the most that anything can agree with it. Rows of the reference "circuit with
        other noise", and the measure pearson_r_of_ceiling.
    groups : array (trials,), optional
        A number or name per trial, where trials are not independent: the bootstrap draws whole
        groups, as of trials that share taps.

    Returns
    -------
    DataFrame
        As from ``bgmodel.comparison.circuits.compare_with_msprt``: one row per model, reference,
        accuracy and measure, with value, low and high (95 % interval).

    Raises
    ------
    ValueError
        For an unknown name, too few trials, a circuit of another number of channels, or one that
        would decide without evidence.
    """
    channels = check_evidence(evidence).hypotheses
    rivals = [rivals] if isinstance(rivals, str) else list(rivals)
    for name in rivals:
        if name not in RIVALS:
            raise ValueError(f"rivals must be among {', '.join(RIVALS)}, got {name!r}")
    table = checked_circuit(circuit, channels)
    if intact is not None:
        intact = checked_circuit(intact, channels)
    model = model_of(table, evidence, engine=engine, gain=gain, seed=seed, workers=workers)
    return compare_with_msprt(
        model,
        evidence,
        seed=seed,
        rivals=rivals,
        accuracies=accuracies,
        resamples=resamples,
        intact=intact,
        ceiling=ceiling,
        groups=groups,
    )


def model_of(
    circuit: Circuit,
    evidence: Evidence,
    *,
    engine: str,
    gain: float | None,
    seed: int,
    workers: int,
) -> BasalGanglia:
    """Return a circuit as an integrator whose samples of OUT suit a comparison.

    Parameters
    ----------
    circuit : Circuit
        The table.
    evidence : Evidence
        What it will be given: its readings say how often OUT is sampled.
    engine, gain, seed, workers :
        As for ``compare``.
    """
    chosen = engine_of(engine).threads(workers).sampled(sample_ms(evidence.step_ms))
    return BasalGanglia(circuit, chosen, gain_of(circuit, gain), seed)

"""The command that decides by the sequential test."""

from __future__ import annotations

from typing import Annotated, Any

import pandas as pd

from bgmodel.commands.options import FLAT, MANY, OFF, record, task
from bgmodel.commands.output import Output, options_of
from bgmodel.integrators.sprt import Msprt, Sprt, threshold_from_posterior
from bgmodel.support.processes import check_evidence_memory
from bgmodel.support.seeds import stream
from bgmodel.tables import named as tables
from bgmodel.tables.given import trials_of
from bgmodel.tactile.likelihood import Density
from bgmodel.tactile.source import Tactile
from bgmodel.tactile.task import SameDifferent
from bgmodel.task import Task
from circuits.errors import InputError, require

SEPARATION_NATS = 4.0
"""Default boundary separation, nats."""
TAPPED = SameDifferent(trials=1000, t_max=30, step_ms=500.0)
"""Default evidence: taps of the paper's task, one every half second."""


def decide(
    *,
    task: Annotated[Task, task(TAPPED)] = TAPPED,
    boundary_separation: float | None = None,
    posterior: float | None = None,
    prior: Annotated[tuple[float, ...] | None, MANY] = None,
    onset_ms: float = 0.0,
    forced: Annotated[bool, OFF] = True,
    density: Annotated[
        Density, record(Density(), "How likelihoods are estimated from held-out taps.")
    ] = Density(),  # noqa: B008
    seed: int = 0,
    output: Annotated[Output, FLAT] = Output(),  # noqa: B008
) -> None:
    """Decide by the sequential test, on tactile evidence or on your own evidence table.

    A table has one row per reading with the columns trial, step, `ll_<hypothesis>` (natural log
    likelihoods; two or more such columns) and, if known, truth. Trials may differ in length: each
    is forced, or left undecided, at its own last reading. Other columns are kept in the result.

    Examples: bgmodel decide --task period_mm=2 --boundary-separation 4 --save decisions.csv;
    bgmodel decide --task orientation channels=4 taps=decoded.parquet --posterior 0.9;
    bgmodel decide --task mine.csv --posterior 0.95 --save decisions.parquet

    Parameters
    ----------
    boundary_separation
        Boundary separation (gap) of the SPRT, nats (two hypotheses); 4 unless posterior is given.
    posterior
        Posterior probability at which the MSPRT stops, instead of a boundary separation.
    prior
        Prior probabilities; equal by default.
    onset_ms
        Time from the start of a trial to the onset of evidence, ms; for your own table.
    forced
        Whether the leading hypothesis is chosen at the last reading of an undecided trial.
    seed
        Seed of all random numbers.
    """
    output.unused("plot")
    output.check(task=task)
    if posterior is not None and boundary_separation is not None:
        reason = "boundary_separation and posterior both set the threshold: give one of them"
        raise InputError(reason, "boundary_separation")
    stream(seed)
    from_file, tactile = task.file is not None, isinstance(task, Tactile)
    must = "is for your own table, given by --task: leave it out"
    require(from_file or not onset_ms, "onset_ms", must, onset_ms)
    if not tactile and density != Density():
        raise InputError("density is for tactile evidence and has no effect here", "density")
    if task.file is not None:
        from bgmodel.tables.evidence import read_evidence_table

        trials = read_evidence_table(
            task.file, prior=prior, onset_ms=onset_ms, step_ms=task.step_ms
        )
        output.note(trials.summary())
    else:
        check_evidence_memory(task.trials, task.t_max, task.channels)
        _test(task.channels, boundary_separation, posterior)
        more = {"density": density} if tactile else {}
        trials = trials_of(task, seed, "decide", prior=prior, **more)
    evidence = trials.evidence
    test, threshold, about = _test(evidence.hypotheses, boundary_separation, posterior)
    decision = test.decide(evidence, threshold, forced=forced)
    result = tables.trial_table(decision, trials, seed=None if from_file else seed, model=about)
    options: dict[str, Any] = {"task": task, "prior": prior, "forced": forced}
    separation = SEPARATION_NATS if boundary_separation is None else boundary_separation
    level = {"boundary_separation": separation} if posterior is None else {"posterior": posterior}
    options |= level
    options |= {"onset_ms": onset_ms} if from_file else {}
    options |= {"density": density} if tactile else {}
    output.show(_shown(about, result, forced), result, **_facts(result))
    output.write(result, None if from_file else seed, command=options_of(**options))


def _test(
    hypotheses: int, separation: float | None, posterior: float | None
) -> tuple[Sprt | Msprt, float, str]:
    """Return the test, its threshold on OUT, and its name."""
    if posterior is not None:
        threshold = float(threshold_from_posterior(posterior, hypotheses))
        return Msprt(), threshold, f"msprt posterior={posterior:g}"
    nats = SEPARATION_NATS if separation is None else separation
    level = float(Sprt.threshold(nats))
    if hypotheses != 2:
        raise InputError(
            f"a boundary separation is for 2 hypotheses: with {hypotheses}, give --posterior",
            "boundary_separation",
        )
    return Sprt(), level, f"sprt boundary_separation={nats:g}"


def _facts(table: pd.DataFrame) -> dict[str, Any]:
    """Return the numbers of decisions, and their accuracy where the truth is known."""
    known = table["correct"] if "correct" in table else pd.Series(dtype=float)
    right = known.dropna().astype(float)
    return {
        "trials": len(table),
        "accuracy": float(right.mean()) if len(right) else None,
        "forced": int(table["forced"].sum()),
        "undecided": int(table["undecided"].sum()),
    }


def _shown(name: str, table: pd.DataFrame, forced: bool) -> str:
    """Return a one-line summary of the decisions."""
    measures = _facts(table)
    accuracy = "no trial decided" if measures["undecided"] == len(table) else "no truth given"
    if measures["accuracy"] is not None:
        of = "" if forced else " of those decided"
        accuracy = f"accuracy {measures['accuracy']:.3f}{of}"
    return (
        f"{name}: {len(table)} trials, {accuracy}, mean readings {table['steps'].mean():.2f}, "
        f"forced {measures['forced']}, undecided {measures['undecided']}"
    )

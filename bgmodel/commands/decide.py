"""The command that decides by the sequential test."""

from __future__ import annotations

from typing import Annotated

import pandas as pd

from bgmodel.commands.options import FLAT, MANY, OFF, task
from bgmodel.commands.output import Output, options_of
from bgmodel.integrators.sprt import Msprt, Sprt, threshold_from_posterior
from bgmodel.support.checks import whole
from bgmodel.support.processes import check_evidence_memory
from bgmodel.tables import named as tables
from bgmodel.tables.given import trials_of
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
    forced: Annotated[bool, OFF] = True,
    seed: int = 0,
    output: Annotated[Output, FLAT] = Output(),  # noqa: B008
) -> None:
    """Decide by the sequential test, on tactile evidence or on your own evidence table.

    A table has one row per reading with the columns trial, step, `ll_<hypothesis>` (natural log
    likelihoods; two or more such columns) and, if known, truth. Trials may differ in length: each
    is forced, or left undecided, at its own last reading. Other columns are kept in the result.

    Examples: bgmodel decide --task period_mm=2 --boundary-separation 4 --save decisions.csv;
    bgmodel decide --task mine.csv --posterior 0.95

    Parameters
    ----------
    boundary_separation
        Boundary separation (gap) of the SPRT, nats (two hypotheses); 4 unless posterior is given.
    posterior
        Posterior probability at which the MSPRT stops, instead of a boundary separation.
    prior
        Prior probabilities; equal by default.
    forced
        Whether the leading hypothesis is chosen at the last reading of an undecided trial.
    seed
        Seed of all random numbers.
    """
    output.unused("plot")
    output.check(task=task)
    given = {"boundary_separation": boundary_separation, "posterior": posterior}
    whole("seed", seed, 0)
    if posterior is not None and boundary_separation is not None:
        reason = "boundary_separation and posterior both set the threshold: give one of them"
        raise InputError(reason, "boundary_separation")
    separation = SEPARATION_NATS if boundary_separation is None else boundary_separation
    if posterior is None:
        given["boundary_separation"] = separation
    check_evidence_memory(task.trials, task.t_max, task.channels)
    test: Sprt | Msprt = Sprt() if posterior is None else Msprt()
    if posterior is not None:
        threshold = float(threshold_from_posterior(posterior, task.channels))
    else:
        threshold = float(Sprt.threshold(separation))
        must = "is for 2 alternatives: give --posterior"
        require(task.channels == 2, "boundary_separation", must, task.channels)
    trials = trials_of(task, seed, "decide", prior=prior)
    drawn = seed if task.file is None else None
    if drawn is None:
        output.note(trials.summary())
    decision = test.decide(trials.evidence, threshold, forced=forced)
    ((level, nats),) = ((name, value) for name, value in given.items() if value is not None)
    about = f"{'sprt' if posterior is None else 'msprt'} {level}={nats:g}"
    result = tables.trial_table(decision, trials, seed=drawn, model=about)
    known = result["correct"].dropna() if "correct" in result else pd.Series(dtype=float)
    facts = {
        "trials": len(result),
        "accuracy": float(known.astype(float).mean()) if len(known) else None,
        "forced": int(result["forced"].sum()),
        "undecided": int(result["undecided"].sum()),
    }
    scored = "no trial decided" if facts["undecided"] == len(result) else "no truth given"
    if len(known):
        scored = f"accuracy {facts['accuracy']:.3f}{'' if forced else ' of those decided'}"
    text = (f"{about}: {len(result)} trials, {scored}, mean readings {result['steps'].mean():.2f}, "
            f"forced {facts['forced']}, undecided {facts['undecided']}")  # fmt: skip
    output.show(text, result, **facts)
    behind = options_of(task=task, prior=prior, forced=forced, **given)
    output.write(result, drawn, command=behind)

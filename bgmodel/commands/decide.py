"""Commands that decide by the sequential test, and compare a circuit with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any

import pandas as pd

from bgmodel.bootstrap import check_trials
from bgmodel.commands.options import FLAT, MANY, OFF, Workers, like, task
from bgmodel.commands.output import (
    Output,
    bar,
    made_with,
    options_of,
    say,
    say_before,
    say_of_edits,
)
from bgmodel.comparison import compare as comparing
from bgmodel.comparison.matched import checked_accuracies
from bgmodel.comparison.page import page, verdicts
from bgmodel.conditions import Setup
from bgmodel.integrators.baselines import BASELINES, baselines_on
from bgmodel.integrators.deciding import sample_ms
from bgmodel.integrators.sprt import Msprt, Sprt, threshold_from_posterior
from bgmodel.support.checks import whole
from bgmodel.support.processes import check_evidence_memory
from bgmodel.tables import named as tables
from bgmodel.tables.given import trials_of
from bgmodel.tactile.task import SameDifferent
from bgmodel.task import Gaussian, Task
from circuits.declaration.table import NATS
from circuits.errors import InputError, collected, require

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


MANY_TRIALS = Gaussian(trials=1000, t_max=110)
"""Default task."""


@like(comparing.compare, "accuracies", "noise_ceiling", accuracies=Sequence[float])
def compare(
    *,
    setup: Annotated[Setup, FLAT] = Setup(),  # noqa: B008
    task: Annotated[Task, task(MANY_TRIALS)] = MANY_TRIALS,
    workers: Workers = 2,
    output: Annotated[Output, FLAT] = Output(),  # noqa: B008
    **options: Any,
) -> None:
    """Compare decisions of a circuit and of the MSPRT on the same evidence, trial by trial.

    Thresholds are matched to equal accuracy. The references are the MSPRT at the circuit's gain and
    at full gain. A decoder of the circuit's cortical spikes and baseline models are compared too,
    and each agreement comes with its chance level, from shuffled trials. For an edited circuit, the
    difference of each measure from the intact circuit is reported too.

    Examples: bgmodel compare --task same-different period_mm=1.5 --noise-ceiling --plot a.png;
    bgmodel compare --task channels=4 --edits "clamp GPe" --save agreement.csv
    """
    output.check(setup=setup, task=task)
    trials = trials_of(task, setup.seed, "compare")
    evidence = trials.evidence
    if task.file is not None:
        output.note(trials.summary())
    check_trials(evidence.trials)
    checked_accuracies(options["accuracies"], evidence.hypotheses)
    say_of_edits(setup.edits)
    model = setup.model(
        evidence.hypotheses, workers=workers, sample_ms=sample_ms(evidence.step_ms)
    ).adapted_to(evidence)
    if (unit := model.circuit.unit) != NATS:
        say(
            f"{model.circuit.name} works in {unit}, not nats: its thresholds are in {unit}, "
            "matched to accuracies expected from the posterior, and compared with the full MSPRT"
        )
    # Other evidence has an arbitrary zero.
    baselines = baselines_on(zero_is_nothing=isinstance(task, Gaussian))
    if left := [name for name in BASELINES if name not in baselines]:
        say(f"{' and '.join(left)} are left out: the zero of this evidence is arbitrary")
    original = setup.intact(evidence.hypotheses)
    intact = None if model.circuit == original else original
    runs = 1 + (intact is not None) + (options["noise_ceiling"] and model.engine.noisy)
    say_before("comparing", model, evidence, runs=runs)
    settings: dict[str, Any] = {"seed": setup.seed, "baselines": baselines, "intact": intact}
    with bar(runs * evidence.trials), collected() as cautions:
        comparison = comparing.compare(model, evidence, **settings, **options)
    if output.json:
        for text in cautions:
            say(text)
    about = (
        f"{model.circuit.name} on {model.engine}, gain {model.gain:g}, seed {setup.seed}, "
        f"{evidence.trials} trials; [95 % intervals: bootstrap over trials]"
    )
    text = f"{about}\n{verdicts(comparison.table, cautions)}\n\n{page(comparison.table)}"
    output.show(text, comparison.table, trials=evidence.trials)
    behind = made_with(model, setup=replace(setup, gain=model.gain), task=task, **options)
    output.write(comparison.table, setup.seed, **behind)
    output.draw(comparison.plot)

"""The command that compares a circuit with the optimal test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any

from bgmodel.bootstrap import check_trials
from bgmodel.commands.options import FLAT, Workers, like, task
from bgmodel.commands.output import Output, bar, made_with, say, say_before, say_of_edits
from bgmodel.comparison import compare as comparing
from bgmodel.comparison.matched import checked_accuracies
from bgmodel.comparison.page import page, verdicts
from bgmodel.conditions import Setup
from bgmodel.integrators.baselines import BASELINES, baselines_on
from bgmodel.integrators.deciding import sample_ms
from bgmodel.tables.given import trials_of
from bgmodel.task import Gaussian, Task
from circuits.declaration.table import NATS
from circuits.errors import collected

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

"""Commands that compare: circuit with algorithm, lesioned circuit with intact one."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tyro.conf import OmitArgPrefixes, Positional

from bgmodel.commands.checks import (
    Shows,
    bar,
    check_ending,
    check_whole,
    made_with,
    save_figure,
    say,
    say_before,
    say_of_edits,
)
from bgmodel.conditions import Setup
from bgmodel.evidence import Evidence
from bgmodel.integrators.baselines import BASELINES, baselines_on
from bgmodel.support import files
from bgmodel.tables.given import trials_of
from bgmodel.task import Gaussian, Task
from circuits.declaration.edits import Edits
from circuits.errors import collected

if TYPE_CHECKING:
    from bgmodel.integrators.basal_ganglia import BasalGanglia

LESIONS = (
    "lesion STN 20%", "lesion GPe 20%", "lesion D2", "scale ctx->STN 0.9", "scale D1->SNr 0.9"
)  # fmt: skip
"""Default edits of `circuit compare-edits`."""
MANY = Gaussian(trials=1000, t_max=110)


@dataclass(frozen=True)
class Comparison(Shows):
    """Common options of commands that compare."""

    output: Positional[Path]
    """File for the table of measures, .parquet or .csv."""
    setup: OmitArgPrefixes[Setup] = field(default_factory=Setup)
    task: OmitArgPrefixes[Task] = MANY
    accuracies: tuple[float, ...] = (0.90, 0.95, 0.97)
    """Expected accuracies at which thresholds are matched."""
    workers: int = 2
    """Threads, for engines that can use several; the results do not depend on it."""

    def _about(self, evidence: Evidence) -> dict[str, Any]:
        """Return the JSON values other than the rows."""
        return {"trials": evidence.trials, "output": self.output}


@dataclass(frozen=True)
class Compare(Comparison):
    """Compare decisions of a circuit and of the MSPRT on the same evidence, trial by trial.

    Thresholds are matched to equal accuracy. The references are the MSPRT at the circuit's gain and
    at full gain. A decoder of the circuit's cortical spikes and baseline models are compared too,
    and each agreement comes with its chance level, from shuffled trials. For an edited circuit, the
    difference of each measure from the intact circuit is reported too.

    Examples: bgmodel compare agreement.csv --channels 4;
    bgmodel compare ceiling.csv --engine population --noise-ceiling;
    bgmodel compare tactile.csv --task same-different --period-mm 1.5;
    bgmodel compare clamped.csv --channels 4 --edits "clamp GPe"
    """

    drawing: Path | None = None
    """File for a figure of speed and accuracy, decision times and same choices, .pdf, .svg or .png.
    """
    noise_ceiling: bool = False
    """Whether to run the circuit again with noise of another seed: its agreement with itself is the
    highest that can be expected."""

    def __call__(self) -> None:
        """Run the command."""
        from bgmodel.comparison.compare import compare
        from bgmodel.comparison.page import page, verdicts

        if self.drawing is not None:
            check_ending("drawing", self.drawing, ".pdf", ".svg", ".png")
        model, evidence = _model(self)
        # Other evidence has an arbitrary zero.
        baselines = baselines_on(zero_is_nothing=isinstance(self.task, Gaussian))
        if left := [name for name in BASELINES if name not in baselines]:
            say(f"{' and '.join(left)} are left out: the zero of this evidence is arbitrary")
        whole = self.setup.intact(evidence.hypotheses)
        intact = None if model.circuit == whole else whole
        again = self.noise_ceiling and model.engine.noisy
        runs = 1 + (intact is not None) + again
        say_before("comparing", model, evidence, runs=runs)
        given: dict[str, Any] = {"seed": self.setup.seed, "accuracies": self.accuracies}
        with bar(runs * evidence.trials), collected() as cautions:
            found = compare(
                model,
                evidence,
                baselines=baselines,
                intact=intact,
                noise_ceiling=self.noise_ceiling,
                **given,
            )
        table = found.table
        files.write_table(table, self.output, seed=self.setup.seed, **_behind(self, model))
        about = (
            f"{model.circuit.name} on {model.engine}, gain {model.gain:g}, seed "
            f"{self.setup.seed}, {evidence.trials} trials; [95 % intervals: bootstrap over trials]"
        )
        if self.json:
            for text in cautions:
                say(text)
        self.show(
            f"{about}\n{verdicts(table, cautions)}\n\n{page(table)}",
            table,
            **self._about(evidence),
        )
        if self.drawing is not None:
            save_figure(found.plot(), self.drawing)
            self.note(f"figure -> {self.drawing}")
        self.note(f"{evidence.trials} trials -> {self.output}")


@dataclass(frozen=True)
class CircuitCompareEdits(Comparison):
    """Compare edited circuits with the unedited circuit, on the same evidence and noise.

    Each edit is applied to a separate copy: "lesion STN 20%", "clamp GPe", "cut GPe->STN 30%",
    "scale D1->SNr 0.9", "set STN->GPe.delay_ms 4", "add D1->GPe weight=-0.1", "dopamine 0.9". Those
    of --edits are made first, in all copies, and the circuit with these alone is called "as
    edited"; with --edits compensate, nuclei also return to their resting rates after each edit.
    Behaviour is shown at the threshold of the circuit before the edits, and with thresholds
    matched again. The effects of lesions are predictions of the model, not data.

    Example: bgmodel circuit compare-edits lesions.csv "lesion STN 20%" "set STN->GPe.delay_ms 4"
    --channels 4
    """

    lesions: Positional[tuple[str, ...]] = LESIONS
    """Edits, each made separately."""

    def __call__(self) -> None:
        """Run the command."""
        from bgmodel.comparison.edited import AS_EDITED, INTACT, compare_edits
        from bgmodel.comparison.page import behaviour, page
        from circuits.ignored import check_edits

        model, evidence = _model(self)
        whole = self.setup.intact(evidence.hypotheses)
        before = INTACT if model.circuit == whole else AS_EDITED
        compensate = ["compensate"] * self.setup.edits.compensates
        asked = {line: Edits([line]).replacing(compensate) for line in self.lesions}
        for edits in asked.values():
            check_edits(edits, self.setup.engine)
        edited = {line: model.circuit.edited(*edits) for line, edits in asked.items()}
        say_of_edits(*asked.values())
        if self.lesions == LESIONS:
            say(f"no edits given, running the default ones: {', '.join(LESIONS)}")
        circuits = 1 + len(edited)
        say_before("lesioning", model, evidence, runs=circuits)
        given: dict[str, Any] = {"seed": self.setup.seed, "accuracies": self.accuracies}
        with bar(circuits * evidence.trials):
            table = compare_edits(model, edited, evidence, before=before, **given)
        files.write_table(table, self.output, seed=self.setup.seed, **_behind(self, model))
        text = (
            f"at the threshold of the circuit {before} (a prediction):\n{behaviour(table)}\n\n"
            "against the MSPRT, thresholds matched again [95 % intervals]:\n"
            f"{page(table[table['kind'] == 'value'].drop(columns='kind'))}"
        )
        self.show(text, table, **self._about(evidence))
        self.note(f"{evidence.trials} trials -> {self.output}")


def _behind(asked_for: Comparison, model: BasalGanglia) -> dict[str, Any]:
    """Return the options and the circuit of a result, for its provenance."""
    return made_with(asked_for, model, setup=replace(asked_for.setup, gain=model.gain))


def _model(asked_for: Comparison) -> tuple[BasalGanglia, Evidence]:
    """Check the options; return the model and the evidence."""
    from bgmodel.bootstrap import check_trials
    from bgmodel.comparison.matched import checked_accuracies
    from bgmodel.integrators.deciding import sample_ms
    from circuits.declaration.table import NATS

    setup, task = asked_for.setup, asked_for.task
    check_ending("output", asked_for.output, ".parquet", ".csv")
    check_whole(workers=asked_for.workers)
    trials = trials_of(task, setup.seed, "compare")
    if task.file is not None:
        asked_for.note(trials.summary())
    evidence = trials.evidence
    check_trials(evidence.trials)
    checked_accuracies(asked_for.accuracies, evidence.hypotheses)
    say_of_edits(setup.edits)
    model = setup.model(
        evidence.hypotheses, workers=asked_for.workers, sample_ms=sample_ms(evidence.step_ms)
    ).adapted_to(evidence)
    table = model.circuit
    if table.unit != NATS:
        say(
            f"{table.name} works in {table.unit}, not nats: its thresholds are in {table.unit}, "
            "matched to accuracies expected from the posterior, and compared with the full MSPRT"
        )
    return model, evidence

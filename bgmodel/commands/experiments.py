"""The command that runs an experiment and tests its predictions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib.resources import files as resources
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from tyro.conf import Positional

from bgmodel.commands.checks import (
    Shows,
    bar,
    check_apart,
    check_ending,
    check_whole,
    recorded,
    say_before,
    showing,
    write_template,
)
from bgmodel.names import EngineName
from bgmodel.support import files
from circuits.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

    from bgmodel.experiments.experiment import Experiment, Outcome

SHIPPED = resources("bgmodel.experiments") / "shipped"
WHOLE = (SHIPPED / "stn_lesion_partial.toml").read_text(encoding="utf-8")


@showing(WHOLE)
@dataclass(frozen=True)
class ExperimentRun(Shows):
    """Run an experiment, control and manipulation, and test its published predictions.

    Without a file it lists the shipped experiments. Predictions are in the file, written before
    the run; the 95 % interval of the change decides whether each agrees, disagrees or stays open.
    Without predictions, there is a report and no verdict.

    Examples: bgmodel experiment; bgmodel experiment stn_lesion_partial --show;
    bgmodel experiment mine.toml --template;
    bgmodel experiment mine.toml outcome.csv --trials 200 --engine population
    """

    file: Positional[str] = ""
    """A TOML file, or the name of a shipped experiment."""
    output: Positional[Path | None] = None
    """File for the table of measures, .parquet or .csv; the table of trials, both conditions, goes
    to the same folder, with _trials at the end of its name."""
    trials: int | None = None
    """Number of trials, instead of that in the file."""
    seed: int | None = None
    """Seed, instead of that in the file."""
    engine: EngineName | None = None
    """Engine, instead of that in the file: population takes a second where spikes take minutes."""
    workers: int = 2
    """Threads, for engines that can use several; the results do not depend on it."""
    shown: Annotated[bool, tyro.conf.arg(name="show")] = False
    """Print the file of a shipped experiment, and run nothing."""
    template: bool = False
    """Write the file above to FILE, to start from, and run nothing."""

    def __call__(self) -> None:
        """Run the command."""
        if not self.file and not self.template:
            self._list()
            return
        if self.template:
            write_template(WHOLE, self.file)
            return
        if self.shown:
            self._print()
            return
        self._check()
        experiment = self._experiment()
        experiment.check_differs()
        self._check_apart(experiment.task.file)
        done = self._run(experiment)
        rows = self._outcomes(experiment, done)
        if self.output is not None:
            self._write(experiment, done, rows)
        if experiment.task.file is not None:
            self.note(done.given.summary())
        self._show(experiment, done, rows)

    def _list(self) -> None:
        """List the shipped experiments."""
        import pandas as pd

        from bgmodel.experiments.experiment import shipped

        found = shipped()
        width = max(map(len, found)) + 2
        text = "\n".join(f"{name:<{width}}{one.name} ({one.source})" for name, one in found.items())
        rows = [(file, one.name, one.source) for file, one in found.items()]
        self.show(text, pd.DataFrame(rows, columns=["file", "name", "source"]))

    def _print(self) -> None:
        """Print the file of a shipped experiment."""
        from bgmodel.experiments.experiment import Experiment, shipped_text

        if Path(self.file).suffix == ".toml":
            raise InputError.of("show", "is for a shipped experiment", self.file)
        Experiment.from_toml(self.file)  # its error lists the names
        print(shipped_text(self.file), end="")

    def _experiment(self) -> Experiment:
        """Return the experiment of the file, with the changes by options."""
        from bgmodel.experiments.experiment import Experiment

        experiment = Experiment.from_toml(self.file)
        if self.trials is not None:
            experiment = replace(experiment, task=experiment.task.changed(trials=self.trials))
        if self.seed is not None:
            experiment = replace(experiment, seed=self.seed)
        if self.engine is not None:
            experiment = replace(experiment, engine=self.engine)
        return experiment

    def _run(self, experiment: Experiment) -> Outcome:
        """Announce the experiment and run it."""
        from bgmodel.bootstrap import check_trials

        given = experiment.given()
        evidence = given.evidence
        check_trials(evidence.trials)
        control = experiment.conditions[0].model(
            evidence.hypotheses, workers=self.workers, rates=False
        )
        say_before("an experiment on", control, evidence, runs=2)
        with bar(2 * evidence.trials):
            return experiment.run(workers=self.workers, given=given)

    @staticmethod
    def _outcomes(experiment: Experiment, done: Outcome) -> pd.DataFrame:
        """Return the measures, and the outcome of each prediction or published effect."""
        found = done.verdicts().assign(condition="change")
        kept = ["condition", "measure", "direction", "at_least", "outcome", "reason"]
        rows = done.measures.merge(found[kept], how="left", on=["condition", "measure"])
        if not experiment.effects:
            return rows
        held = done.published()
        held = held.drop(columns=["value", "low", "high"])
        return rows.merge(held, how="left", on=["condition", "measure"])

    def _write(self, experiment: Experiment, done: Outcome, rows: pd.DataFrame) -> None:
        """Write measures and trials."""
        from bgmodel.integrators.given import identity

        assert self.output is not None
        control, manipulation = done.models
        behind = {
            "seed": experiment.seed,
            "experiment": recorded(replace(experiment, gain=control.gain)),
            "control": identity(control.circuit),
            "manipulation": identity(manipulation.circuit),
        }
        files.write_table(rows, self.output, **behind)
        files.write_table(done.trials, self._trials_path(), **behind)

    def _show(self, experiment: Experiment, done: Outcome, rows: pd.DataFrame) -> None:
        """Show measures and outcomes of predictions."""
        trials = len(done.trials) // 2
        about: dict[str, Any] = {"name": experiment.name, "source": experiment.source}
        about |= {"published": experiment.published}
        model, posterior = done.models[0], experiment.stopping
        about |= {"circuit": model.circuit.name, "engine": model.engine.id, "gain": model.gain}
        about |= {"posterior": posterior, "seed": experiment.seed}
        where = {"trials": trials, "output": self.output}
        self.show(done.text(), rows, **about, **where)
        written = "" if self.output is None else f", measures -> {self.output}"
        self.note(f"{trials} trials{written and f' -> {self._trials_path()}'}{written}")

    def _check_apart(self, evidence: Path | None) -> None:
        """Refuse to overwrite the evidence that the experiment's file names."""
        inputs = [] if evidence is None else [("task.evidence", evidence)]
        outputs = [] if self.output is None else [("output", self.output)]
        check_apart([*inputs, *outputs, *(("trials", path) for path in self.more_outputs())])

    def more_outputs(self) -> list[Path]:
        """Return the path of the table of trials, in the folder of the output."""
        return [] if self.output is None else [self._trials_path()]

    def _trials_path(self) -> Path:
        assert self.output is not None
        return self.output.with_stem(f"{self.output.stem}_trials")

    def _check(self) -> None:
        """Refuse invalid options before long work starts."""
        check_whole(workers=self.workers)
        if self.output is not None:
            check_ending("output", self.output, ".parquet", ".csv")

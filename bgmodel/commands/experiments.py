"""The command that runs an experiment and holds it to its prediction."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from tyro.conf import Positional

from bgmodel import files
from bgmodel.commands.checks import Writes, check_apart, check_ending, check_whole, recorded
from bgmodel.commands.names import EngineName


@dataclass(frozen=True)
class ExperimentRun(Writes):
    """Run an experiment, control and manipulation, and hold it to what was published.

    Without a file it lists the experiments that come with the package. The prediction stands in
    the file, written before the run; each part is said to agree, to disagree or to be left open by
    the 95 % interval of the change.

    Examples: bgmodel experiment; bgmodel experiment stn_lesion_partial;
    bgmodel experiment mine.toml outcome.csv --trials 200 --engine population
    """

    file: Positional[str] = ""
    """A TOML file, or the name of an experiment that is shipped."""
    output: Positional[Path | None] = None
    """Where the table of measures goes, .parquet or .csv; that of trials, both conditions, goes
    beside it, with _trials at the end of its name."""
    trials: int | None = None
    """Trials, if not those of the file."""
    seed: int | None = None
    """Seed, if not that of the file."""
    engine: EngineName | None = None
    """Engine, if not that of the file: population takes a second where spikes take minutes."""
    workers: int = 2
    """Threads of the engines that can use several; they change no byte."""

    def __call__(self) -> None:
        """Run the command."""
        from bgmodel.experiments import experiment as experiments
        from bgmodel.experiments.outcomes import outcomes, page
        from bgmodel.integrators.basal_ganglia import identity

        if not self.file:
            for name, one in experiments.shipped().items():
                print(f"{name:<24}{one.name} ({one.source})")
            return
        self._check()
        experiment = experiments.read_experiment(self.file)
        if self.trials is not None:
            experiment = replace(experiment, task=replace(experiment.task, trials=self.trials))
        if self.seed is not None:
            experiment = replace(experiment, seed=self.seed)
        if self.engine is not None:
            experiment = replace(experiment, engine=self.engine)
        experiment.check_differs()
        self._check_apart(experiment.task.evidence)
        done = experiments.run_experiment(experiment, workers=self.workers)
        table = done.measures
        if self.output is not None:
            said = outcomes(experiment, table).assign(condition="change")
            kept = ["condition", "measure", "direction", "at_least", "outcome"]
            whole = table.merge(said[kept], how="left", on=["condition", "measure"])
            control, manipulation = done.models
            ran = replace(experiment, gain=control.gain)
            behind = {
                "seed": experiment.seed,
                "experiment": recorded(ran),
                "control": identity(control.circuit),
                "manipulation": identity(manipulation.circuit),
            }
            files.write_table(whole, self.output, **behind)
            files.write_table(done.trials, self._trials_path(), **behind)
        if experiment.task.evidence is not None:
            print(done.given.said())
        print(page(experiment, table))
        where = f" -> {self.output}" if self.output is not None else ""
        print(f"{len(done.trials) // 2} trials{where}")

    def _check_apart(self, evidence: Path | None) -> None:
        """Refuse to write over the evidence that the experiment's file names."""
        inputs = [] if evidence is None else [("task.evidence", evidence)]
        outputs = [] if self.output is None else [("output", self.output)]
        check_apart([*inputs, *outputs, *(("trials", path) for path in self.more_outputs())])

    def more_outputs(self) -> list[Path]:
        """Return the table of trials, which goes beside the output."""
        return [] if self.output is None else [self._trials_path()]

    def _trials_path(self) -> Path:
        assert self.output is not None
        return self.output.with_stem(f"{self.output.stem}_trials")

    def _check(self) -> None:
        """Refuse what makes no sense, before long work starts."""
        check_whole(workers=self.workers)
        if self.output is not None:
            check_ending("output", self.output, ".parquet", ".csv")

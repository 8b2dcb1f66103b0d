"""The command that runs an experiment and tests its predictions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import pandas as pd

from bgmodel.bootstrap import check_trials
from bgmodel.commands.options import FLAT, Workers
from bgmodel.commands.output import Output, bar, say_before, write_template
from bgmodel.experiments.experiment import Experiment, shipped, shipped_text
from bgmodel.names import EngineName
from bgmodel.support import files
from circuits.declaration.table_writer import identity
from circuits.errors import require


def experiment(
    file: str = "",
    /,
    *,
    trials: int | None = None,
    seed: int | None = None,
    engine: EngineName | None = None,
    show: bool = False,
    template: bool = False,
    workers: Workers = 2,
    output: Annotated[Output, FLAT] = Output(),  # noqa: B008
) -> None:
    """Run an experiment, control and manipulation, and test its predictions.

    Without a file it lists the shipped experiments. Predictions are in the file, written before
    the run; the 95 % interval of the change decides whether each agrees, disagrees or stays open.
    Without predictions, there is a report and no verdict. With --save, the table of trials of both
    conditions goes to the same folder, with _trials at the end of its name.

    Examples: bgmodel experiment; bgmodel experiment mine.toml --template;
    bgmodel experiment mine.toml --save outcome.csv --trials 200 --engine population

    Parameters
    ----------
    file
        A TOML file, or the name of a shipped experiment.
    trials
        Number of trials, instead of that in the file.
    seed
        Seed, instead of that in the file.
    engine
        Engine, instead of that in the file: population takes a second where spikes take minutes.
    show
        Print the file of a shipped experiment, and run nothing.
    template
        Write a whole file to FILE, to start from, and run nothing.
    """
    if template:
        write_template(Experiment.template(), file)
        return
    if not file:
        output.unused("save", "plot")
        known = shipped()
        width = max(map(len, known)) + 2
        lines = [f"{name:<{width}}{one.name} ({one.source})" for name, one in known.items()]
        rows = [(name, one.name, one.source) for name, one in known.items()]
        output.show("\n".join(lines), pd.DataFrame(rows, columns=["file", "name", "source"]))
        return
    if show:
        require(Path(file).suffix != ".toml", "show", "is for a shipped experiment", file)
        Experiment.from_toml(file)  # its error lists the names
        print(shipped_text(file), end="")
        return
    trials_file = output.save and output.save.with_stem(f"{output.save.stem}_trials")
    asked = Experiment.from_toml(file)
    if trials is not None:
        asked = replace(asked, task=asked.task.changed(trials=trials))
    asked = replace(asked, seed=asked.seed if seed is None else seed, engine=engine or asked.engine)
    asked.check_differs()
    read: dict[str, Any] = {"file": Path(file), "task.evidence": asked.task.file}
    output.check(more={"trials": trials_file} if trials_file else {}, **read)
    given = asked.given()
    evidence = given.evidence
    check_trials(evidence.trials)
    control = asked.conditions[0].model(evidence.hypotheses, workers=workers, rates=False)
    say_before("an experiment on", control, evidence, runs=2)
    with bar(2 * evidence.trials):
        done = asked.run(workers=workers, named=given)
    if asked.task.file is not None:
        output.note(given.summary())
    control, manipulation = done.models
    facts: dict[str, Any] = {
        "name": asked.name, "source": asked.source, "published": asked.published,
        "circuit": control.circuit.name, "engine": control.engine.id, "gain": control.gain,
        "posterior": asked.stopping, "seed": asked.seed, "trials": evidence.trials,
    }  # fmt: skip
    output.show(done.text(), done.rows(), **facts)
    output.note(f"{evidence.trials} trials")
    if trials_file is not None:
        behind = {
            "seed": asked.seed,
            "experiment": files.recorded(replace(asked, gain=control.gain)),
            "control": identity(control.circuit),
            "manipulation": identity(manipulation.circuit),
        }
        output.write(done.rows(), **behind)
        files.write_table(done.trials, trials_file, **behind)
        output.note(f"-> {trials_file}")
    output.draw(done.plot)

"""The command that runs an experiment and tests its predictions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import pandas as pd

from bgmodel.bootstrap import check_trials
from bgmodel.commands.options import FLAT, Workers
from bgmodel.commands.output import (
    Output,
    bar,
    check_apart,
    check_whole,
    say_before,
    write_template,
)
from bgmodel.experiments.experiment import Experiment, Outcome, shipped, shipped_text
from bgmodel.names import EngineName
from bgmodel.support import files
from circuits.declaration.table_writer import identity
from circuits.errors import InputError


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

    Examples: bgmodel experiment; bgmodel experiment stn_lesion_partial --show;
    bgmodel experiment mine.toml --template;
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
        _list(output)
        return
    if show:
        _print(file)
        return
    check_whole(workers=workers)
    more = [] if output.save is None else [_trials_path(output.save)]
    output.check(more=more, file=Path(file))
    asked = Experiment.from_toml(file)
    if trials is not None:
        asked = replace(asked, task=asked.task.changed(trials=trials))
    replaced: dict[str, Any] = {"seed": seed, "engine": engine}
    asked = replace(asked, **{k: v for k, v in replaced.items() if v is not None})
    asked.check_differs()
    read = [] if asked.task.file is None else [("task.evidence", asked.task.file)]
    written = [] if output.save is None else [("save", output.save), ("trials", more[0])]
    check_apart(written, read)
    done = _run(asked, workers)
    if asked.task.file is not None:
        output.note(done.given.summary())
    _finish(asked, done, output)


def _list(output: Output) -> None:
    """List the shipped experiments."""
    known = shipped()
    width = max(map(len, known)) + 2
    text = "\n".join(f"{name:<{width}}{one.name} ({one.source})" for name, one in known.items())
    rows = [(file, one.name, one.source) for file, one in known.items()]
    output.show(text, pd.DataFrame(rows, columns=["file", "name", "source"]))


def _print(file: str) -> None:
    """Print the file of a shipped experiment."""
    if Path(file).suffix == ".toml":
        raise InputError.of("show", "is for a shipped experiment", file)
    Experiment.from_toml(file)  # its error lists the names
    print(shipped_text(file), end="")


def _run(asked: Experiment, workers: int) -> Outcome:
    """Announce the experiment and run it."""
    trials = asked.given()
    evidence = trials.evidence
    check_trials(evidence.trials)
    control = asked.conditions[0].model(evidence.hypotheses, workers=workers, rates=False)
    say_before("an experiment on", control, evidence, runs=2)
    with bar(2 * evidence.trials):
        return asked.run(workers=workers, named=trials)


def _finish(asked: Experiment, done: Outcome, output: Output) -> None:
    """Print measures and outcomes of predictions, write them and the trials, draw them."""
    rows, trials = done.rows(), len(done.trials) // 2
    control, manipulation = done.models
    facts: dict[str, Any] = {
        "name": asked.name, "source": asked.source, "published": asked.published,
        "circuit": control.circuit.name, "engine": control.engine.id, "gain": control.gain,
        "posterior": asked.stopping, "seed": asked.seed, "trials": trials,
    }  # fmt: skip
    output.show(done.text(), rows, **facts)
    output.note(f"{trials} trials")
    if output.save is not None:
        behind = {
            "seed": asked.seed,
            "experiment": files.recorded(replace(asked, gain=control.gain)),
            "control": identity(control.circuit),
            "manipulation": identity(manipulation.circuit),
        }
        output.write(rows, **behind)
        path = _trials_path(output.save)
        files.write_table(done.trials, path, **behind)
        output.note(f"-> {path}")
    output.draw(done.plot)


def _trials_path(save: Path) -> Path:
    return save.with_stem(f"{save.stem}_trials")

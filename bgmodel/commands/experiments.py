"""Commands that run an experiment, a sweep of many, and the exam."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import pandas as pd

from bgmodel.bootstrap import check_trials
from bgmodel.commands.options import FLAT, MANY, OFF, Edited, Workers, like
from bgmodel.commands.output import (
    Output,
    bar,
    check_whole,
    options_of,
    say,
    say_before,
    say_of_edits,
    write_template,
)
from bgmodel.exam.exam import Exam
from bgmodel.experiments.experiment import Experiment, shipped, shipped_text
from bgmodel.names import EngineName
from bgmodel.support import files
from circuits.declaration.edits import Edits
from circuits.declaration.table_writer import identity
from circuits.errors import InputError, require


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
        Engine, instead of that in the file: population takes a second where spikes take a minute.
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
    say_before("an experiment with", control, evidence, runs=2)
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


def sweep(
    file: Path,
    folder: Path | None = None,
    /,
    *,
    part: str | None = None,
    dry_run: bool = False,
    template: bool = False,
    workers: Workers = 2,
) -> None:
    """Run a circuit at every point of a grid or a list, and gather the results.

    A TOML file defines what is run and what changes: any number or edit of the circuit, dopamine,
    the task, the engine, the posterior at which it decides. Finished parts are never computed
    again; the same command resumes after it was stopped or killed.

    Examples: bgmodel sweep mine.toml --template; bgmodel sweep mine.toml --workers 8;
    bgmodel sweep mine.toml --part 3/40

    Parameters
    ----------
    file
        A TOML file.
    folder
        Folder for shards, outcome.csv and outcome.png; by default sweeps/NAME, after the file.
    part
        K/N: compute only the K-th of N parts, without gathering: for jobs on a cluster.
    dry_run
        Print what would be done, and do nothing.
    template
        Write a whole file to FILE, to start from, and run nothing.
    """
    from bgmodel.sweeps.sweep import OUTCOME, Sweep

    if template:
        write_template(Sweep.template(), file)
        return
    check_whole(workers=workers)
    asked = Sweep.from_toml(file)
    folder = folder or Path("sweeps") / file.stem
    asked.check(folder)
    status, missing = asked.status(folder, part)
    print(status, flush=True)
    say_of_edits(*(point.edits for point in asked.points))
    if dry_run:
        return
    try:
        with bar(sum(shard.trials for shard in missing)):
            if part is not None:
                asked.compute(folder, workers=workers, part=part)
                return
            outcome = asked.run(folder, workers=workers)
    except KeyboardInterrupt:
        raise KeyboardInterrupt("The same command resumes where it stopped.") from None
    axes = len(asked.plan.axes)
    if len(asked.points) <= 40:
        print(outcome.summary().to_string())
    drawn = f"drawn: {folder / 'outcome.png'}"
    print(drawn if axes <= 2 else f"no figure: it can show one key or two, got {axes}")
    print(f"-> {folder / OUTCOME}")


@like(Exam.take, "engine", "gain", "seed", "share", "motifs", engine=EngineName | None,
      motifs=Annotated[bool, OFF])  # fmt: skip
def exam(
    circuit: str = "",
    /,
    *,
    edits: Edited = Edits(),  # noqa: B008
    data: Path | None = None,
    rates: Path | None = None,
    numbers: Annotated[tuple[Path, ...], MANY] = (),
    domains: Annotated[tuple[str, ...], MANY] = (),
    tasks: bool = False,
    workers: Workers = 2,
    output: Annotated[Output, FLAT] = Output(),  # noqa: B008
    **options: Any,
) -> None:
    """Let a circuit take an exam of published numbers, or score tables of trials and rates.

    Prints each number with the circuit's answer, and the totals of each domain. There is no total
    over domains. Without a circuit and without tables it lists the numbers with their sources.

    Examples: bgmodel exam; bgmodel exam mine.toml --save exam.json --plot exam.pdf;
    bgmodel exam --data trials.csv --rates rates.csv

    Parameters
    ----------
    circuit
        Name of a circuit, or the path of a .toml file.
    data
        Table of trials from another tool or a recording, .csv, .tsv or .parquet.
    rates
        Table of rates from another tool or a recording.
    numbers
        TOML files with further numbers, in the form of the shipped ones.
    domains
        Domains that are asked; all by default.
    tasks
        List the tasks, and the columns of tables from elsewhere, and run nothing.
    """
    check_whole(workers=workers)
    if circuit and (data is not None or rates is not None):
        raise InputError("give a circuit, or tables from elsewhere, not both", "circuit")
    output.check((".json", ".csv", ".parquet"), circuit=circuit, data=data, rates=rates)
    asked = Exam.shipped()
    asked = asked.with_numbers(*numbers) if numbers else asked
    asked = asked.only(domains) if domains else asked
    if tasks or not (circuit or data or rates):
        output.unused("save", "plot")
        text, table = asked.listed_tasks() if tasks else asked.listed()
        output.show(text, table, version=asked.version, sha256=asked.sha256)
        return
    if circuit:
        asked.check(circuit, edits)
        listed = f"{len(asked.numbers)} numbers, list {asked.version}"
        say(f"an exam of {listed}; the whole list takes about a minute")
        marked = asked.take(circuit, edits=edits, workers=workers, **options)
    else:
        marked = asked.mark(data, rates, seed=options["seed"])
    domain = marked.summary().to_dict("records")
    facts = {"examinee": marked.examinee, "seed": marked.seed, "domains": domain}
    output.show(marked.text(), marked.table, **facts, **marked.parameters)
    if output.save is not None and output.save.suffix == ".json":
        marked.to_json(output.save)
        output.note(f"-> {output.save}")
    else:
        more = [files.recorded(path) for path in numbers]
        behind = options_of(circuit=circuit, edits=edits, data=data, rates=rates, domains=domains,
                            numbers=more, **options)  # fmt: skip
        output.write(marked.table, marked.seed, command=behind, **marked.parameters)
    output.draw(marked.plot)

"""The command that lets a circuit take the exam, or scores tables from elsewhere."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import pandas as pd

from bgmodel.commands.options import FLAT, MANY, OFF, Edited, Workers, like
from bgmodel.commands.output import Output, check_whole, options_of, say
from bgmodel.exam.exam import Exam
from bgmodel.exam.tables import OF_RATES, OF_TRIALS, WINDOWS
from bgmodel.names import EngineName
from bgmodel.support import files
from circuits.declaration.edits import Edits
from circuits.errors import InputError


@like(Exam.take, "gain", "seed", "share")
def exam(
    circuit: str = "",
    /,
    *,
    edits: Edited = Edits(),  # noqa: B008
    engine: EngineName | None = None,
    data: Path | None = None,
    rates: Path | None = None,
    numbers: Annotated[tuple[Path, ...], MANY] = (),
    domains: Annotated[tuple[str, ...], MANY] = (),
    tasks: bool = False,
    motifs: Annotated[bool, OFF] = True,
    workers: Workers = 2,
    output: Annotated[Output, FLAT] = Output(),  # noqa: B008
    **options: Any,
) -> None:
    """Let a circuit take an exam of published numbers, or score tables of trials and rates.

    Prints each number with the circuit's answer, and the totals of each domain. There is no total
    over domains. Without a circuit and without tables it lists the numbers with their sources.

    Examples: bgmodel exam; bgmodel exam macaque;
    bgmodel exam mine.toml --save exam.json --plot exam.pdf;
    bgmodel exam --data trials.csv --rates rates.csv; bgmodel exam --tasks

    Parameters
    ----------
    circuit
        Name of a circuit, or the path of a .toml file.
    engine
        Engine; by default populations, or rates without noise where connections are sparse.
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
    motifs
        Circuits have the motifs of each task, such as a criterion that falls where difficulties are
        interleaved.
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
        _list(asked, tasks, output)
        return
    if circuit:
        asked.check(circuit, edits)
        count, version = len(asked.numbers), asked.version
        say(f"an exam of {count} numbers, list {version}; the whole list takes about a minute")
        marked = asked.take(
            circuit, edits=edits, engine=engine, motifs=motifs, workers=workers, **options
        )
    else:
        marked = asked.mark(data, rates, seed=options["seed"])
    domain = marked.summary().to_dict("records")
    facts = {"examinee": marked.examinee, "seed": marked.seed, "domains": domain}
    output.show(marked.text(), marked.table, **facts, **marked.parameters)
    if output.save is not None and output.save.suffix == ".json":
        marked.to_json(output.save)
        output.note(f"-> {output.save}")
    else:
        settings = {"circuit": circuit, "edits": edits, "engine": engine, "data": data,
                    "rates": rates, "domains": domains, "motifs": motifs,
                    "numbers": [files.recorded(path) for path in numbers], **options}  # fmt: skip
        output.write(marked.table, marked.seed, command=options_of(**settings), **marked.parameters)
    output.draw(marked.plot)


def _list(asked: Exam, tasks: bool, output: Output) -> None:
    """List the numbers with their sources, or the tasks and the columns of tables."""
    if tasks:
        rows = [(task.id, task.about) for task in asked.tasks.values()]
        text = [f"{name}: {about}" for name, about in rows]
        for title, columns in (
            ("columns of --data", OF_TRIALS),
            ("columns of --rates", OF_RATES),
            ("windows", WINDOWS),
        ):
            text += ["", title, *(f"  {name}: {about}" for name, about in columns.items())]
        table = pd.DataFrame(rows, columns=["task", "about"])
    else:
        names = ["id", "domain", "about", "unit", "species", "mark", "source", "how"]
        table = pd.DataFrame([[getattr(one, n) for n in names] for one in asked.numbers],
                             columns=names)  # fmt: skip
        table.insert(3, "published", [one.published() for one in asked.numbers])
        text = []
        for domain, part in table.groupby("domain", sort=False):
            text.append(str(domain))
            text += [
                f"  {row.about}: {row.published} {row.unit} ({row.source}, {row.mark}; {row.id})"
                for row in part.itertuples()
            ]
    output.show("\n".join(text), table, version=asked.version, sha256=asked.sha256)

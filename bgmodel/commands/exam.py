"""The command that lets a circuit take the exam, or scores tables from elsewhere."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from bgmodel.commands.options import FLAT, MANY, OFF, Edited, Workers, like
from bgmodel.commands.output import Output, check_whole, options_of, say
from bgmodel.exam.exam import Exam
from bgmodel.names import EngineName
from bgmodel.support import files
from circuits.declaration.edits import Edits
from circuits.errors import InputError


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

"""The command that lets a circuit, or results from elsewhere, take the exam."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import Positional

from bgmodel.commands.checks import (
    Shows,
    check_ending,
    check_whole,
    options_of,
    save_figure,
    say,
)
from bgmodel.exam.numbers import SEED
from bgmodel.names import EngineName
from bgmodel.support import files
from circuits.declaration.edits import Edits
from circuits.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

    from bgmodel.exam.exam import Exam
    from bgmodel.exam.record import ExamRecord


@dataclass(frozen=True)
class BenchRun(Shows):
    """Let a circuit take an exam of published numbers, or mark trials and rates from elsewhere.

    Prints each number with the circuit's answer, and the totals of each domain. There is no total
    over domains. Without a circuit and without tables it lists the numbers.

    Examples: bgmodel bench; bgmodel bench macaque; bgmodel bench mine.toml exam.json --drawing
    exam.pdf; bgmodel bench --trials trials.csv --rates rates.csv; bgmodel bench --tasks
    """

    reads = ("rates",)

    circuit: Positional[str] = ""
    """Name of a circuit, or the path of a .toml file."""
    output: Positional[Path | None] = None
    """File for the result: .json has all of it, .csv or .parquet the table of numbers."""
    drawing: Path | None = None
    """File for a picture of one page, .pdf, .svg or .png."""
    edits: Edits = field(default_factory=Edits)
    """Edits of the circuit: "lesion STN 10%", "dopamine 0.9"."""
    engine: EngineName | None = None
    """Engine; by default populations, or rates without noise where connections are sparse."""
    gain: float | None = None
    """Nats in the circuit per nat of evidence; by default the circuit's, or the fastest of five."""
    seed: int = SEED
    """Seed of evidence and noise."""
    share: float = 1.0
    """Share of the usual numbers of trials; totals are comparable at 1."""
    trials: Path | None = None
    """Table of trials from another tool or a recording, .csv, .tsv or .parquet."""
    rates: Path | None = None
    """Table of rates from another tool or a recording."""
    numbers: tuple[Path, ...] = ()
    """TOML files with further numbers, in the form of the shipped ones."""
    domains: tuple[str, ...] = ()
    """Domains that are asked; all by default."""
    tasks: Annotated[bool, tyro.conf.arg(name="tasks")] = False
    """List the tasks, and the columns of tables from elsewhere, and run nothing."""
    workers: int = 2
    """Threads, for engines that can use several; the results do not depend on it."""

    def __call__(self) -> None:
        """Run the command."""
        from bgmodel.exam.exam import examinee

        self._check()
        exam = self._exam()
        if self.tasks:
            self._list_tasks(exam)
            return
        if not self.circuit and self.trials is None and self.rates is None:
            self._list(exam)
            return
        if self.circuit:
            examinee(self.circuit, self.edits, self.engine, self.gain)  # refuses unknown names
            count, version = len(exam.questions.numbers), exam.questions.version
            say(f"an exam of {count} numbers, list {version}; the whole list takes about a minute")
        record = self._record(exam)
        if self.output is not None:
            self._write(record)
        if self.drawing is not None:
            save_figure(record.plot(), self.drawing)
        written = [str(path) for path in (self.output, self.drawing) if path is not None]
        text = record.text() + (f"\n-> {', '.join(written)}" if written else "")
        totals = record.summary().to_dict("records")
        about = {"examinee": record.examinee, "seed": record.seed, "domains": totals}
        self.show(text, record.table, **about, **record.parameters)

    def _check(self) -> None:
        """Refuse contradictory options before long work starts."""
        check_whole(workers=self.workers)
        if self.circuit and (self.trials is not None or self.rates is not None):
            raise InputError("give a circuit, or tables from elsewhere, not both", "circuit")
        if self.output is not None:
            check_ending("output", self.output, ".json", ".csv", ".parquet")
        if self.drawing is not None:
            check_ending("drawing", self.drawing, ".pdf", ".svg", ".png")

    def _exam(self) -> Exam:
        from bgmodel.exam.exam import Exam

        exam = Exam.shipped()
        exam = exam.with_numbers(*self.numbers) if self.numbers else exam
        return exam.only(self.domains) if self.domains else exam

    def _record(self, exam: Exam) -> ExamRecord:
        if not self.circuit:
            return exam.mark(self.trials, self.rates, seed=self.seed)
        return exam.take(
            self.circuit, edits=self.edits, engine=self.engine, gain=self.gain, seed=self.seed,
            share=self.share, workers=self.workers,
        )  # fmt: skip

    def _write(self, record: ExamRecord) -> None:
        assert self.output is not None
        if self.output.suffix == ".json":
            record.to_json(self.output)
            return
        behind = {"command": options_of(self), **record.parameters}
        files.write_table(record.table, self.output, seed=record.seed, **behind)

    def _list(self, exam: Exam) -> None:
        """List the numbers."""
        import pandas as pd

        rows = [
            (one.id, one.domain, one.about, one.published(), one.unit, one.species, one.mark,
             one.source, one.how)
            for one in exam.questions.numbers
        ]  # fmt: skip
        names = ["id", "domain", "about", "published", "unit", "species", "mark", "source", "how"]
        table = pd.DataFrame(rows, columns=names)
        lines = []
        for domain, part in table.groupby("domain", sort=False):
            lines.append(str(domain))
            lines += [
                f"  {row.id:22} {row.published} {row.unit}: {row.about} ({row.source}, {row.mark})"
                for row in part.itertuples()
            ]
        self._show_list("\n".join(lines), table, exam)

    def _list_tasks(self, exam: Exam) -> None:
        """List the tasks, and the columns of tables."""
        import pandas as pd

        from bgmodel.exam.tables import OF_RATES, OF_TRIALS, WINDOWS

        rows = [(task.name, task.about) for task in exam.questions.tasks.values()]
        text = [f"{name}: {about}" for name, about in rows]
        for title, columns in (
            ("columns of --trials", OF_TRIALS),
            ("columns of --rates", OF_RATES),
            ("windows", WINDOWS),
        ):
            text += ["", title, *(f"  {name}: {about}" for name, about in columns.items())]
        self._show_list("\n".join(text), pd.DataFrame(rows, columns=["task", "about"]), exam)

    def _show_list(self, text: str, table: pd.DataFrame, exam: Exam) -> None:
        self.show(text, table, version=exam.questions.version, sha256=exam.questions.sha256)

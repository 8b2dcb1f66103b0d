"""The exam: a list of published numbers that any circuit, or the results of one, can take."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pandas as pd

from bgmodel.exam import measures, of_circuit
from bgmodel.exam.measures import MEASURES, Results, check_asked
from bgmodel.exam.numbers import SEED, ExamTask, Number, read_numbers, read_tasks
from bgmodel.exam.record import COLUMNS, ExamRecord, scored
from bgmodel.exam.simulation import Simulation
from bgmodel.exam.tables import (
    OF_RATES,
    OF_TRIALS,
    WINDOWS,
    Failed,
    NotApplicable,
    read_tables,
)
from bgmodel.experiments.expected import UNANSWERED
from bgmodel.experiments.models import DecisionModel, model_of
from bgmodel.support.checks import check_range, whole
from bgmodel.support.files import checksum
from bgmodel.support.references import cited, sources_of
from circuits.circuit import Circuit
from circuits.declaration.table_writer import identity
from circuits.errors import InputError, require

__all__ = ["SEED", "Exam", "measures", "of_circuit", "take_exam"]


@dataclass(frozen=True)
class Exam:
    """A list of published numbers and the tasks by which they are answered.

    Parameters
    ----------
    version : str
        Version of the list; scores are comparable within one.
    numbers : tuple of Number
        Published numbers.
    tasks : dict
        Tasks by name.

    Raises
    ------
    ValueError
        If a number names an unknown measure or task, has another unit than its measure, is always
        0, or has the id of another one.
    """

    version: str
    numbers: tuple[Number, ...]
    tasks: dict[str, ExamTask] = field(repr=False)

    def __post_init__(self) -> None:
        ids = [one.id for one in self.numbers]
        twice = sorted({one for one in ids if ids.count(one) > 1})
        require(not twice, "id", "must differ from those of all other numbers", twice)
        for one in self.numbers:
            check_asked(one)
            for key, name in one.tasks():
                must = f"must be one of {', '.join(self.tasks)}"
                require(name in self.tasks, key, must, name, owner=one.id)

    @classmethod
    def shipped(cls) -> Exam:
        """Return the exam that ships with the package."""
        version, tasks = read_tasks()
        return cls(version, read_numbers(), tasks)

    @property
    def sha256(self) -> str:
        """Hash of all numbers and tasks."""
        text = repr((self.version, self.numbers, sorted(self.tasks.items())))
        return hashlib.sha256(text.encode()).hexdigest()

    @property
    def domains(self) -> list[str]:
        """Domains, in the order of the list."""
        return list(dict.fromkeys(one.domain for one in self.numbers))

    def with_numbers(self, *files: str | Path) -> Exam:
        """Return the exam with further numbers, one TOML file per domain.

        The version of the list is scored with "+": scores are comparable by number, not in total.
        """
        numbers = (*self.numbers, *read_numbers(*files))
        return replace(self, numbers=numbers, version=f"{self.version}+")

    def only(self, domains: Iterable[str]) -> Exam:
        """Return the exam with some of its domains."""
        chosen = list(domains)
        for name in chosen:
            must = f"must be among {', '.join(self.domains)}"
            require(name in self.domains, "domains", must, name)
        return self.of(one.id for one in self.numbers if one.domain in chosen)

    def of(self, ids: Iterable[str]) -> Exam:
        """Return the exam with some of its numbers."""
        chosen = set(ids)
        unknown = sorted(chosen - {one.id for one in self.numbers})
        require(not unknown, "id", "must be those of numbers", unknown)
        return replace(self, numbers=tuple(one for one in self.numbers if one.id in chosen))

    def check(self, circuit: Circuit | str | Path, edits: Iterable[str] = ()) -> None:
        """Raise ValueError for an unknown circuit, or an edit that cannot be applied to it."""
        model_of(circuit, edits).circuits(sorted({t.channels for t in self.tasks.values()}))

    def listed(self) -> tuple[str, pd.DataFrame]:
        """Return all numbers with their sources and references, as text and as a table."""
        names = ["id", "domain", "about", "unit", "species", "mark", "source", "how"]
        table = pd.DataFrame([[getattr(one, name) for name in names] for one in self.numbers],
                             columns=names)  # fmt: skip
        table.insert(3, "published", [one.published() for one in self.numbers])
        references = [cited((one.source, one.how)) for one in self.numbers]
        table["reference"] = ["; ".join(map(str, each)) for each in references]
        lines = []
        for domain, part in table.groupby("domain", sort=False):
            lines.append(str(domain))
            for row in part.itertuples():
                where = f"{row.source}, {row.mark}; {row.id}"
                lines.append(f"  {row.about}: {row.published} {row.unit} ({where})")
        return "\n".join(lines) + sources_of([*table["source"], *table["how"]]), table

    def listed_tasks(self) -> tuple[str, pd.DataFrame]:
        """Return tasks and the columns of tables from elsewhere as text, and a table of tasks."""
        rows = [(task.id, task.about) for task in self.tasks.values()]
        lines = [f"{name}: {about}" for name, about in rows]
        for title, columns in (("columns of --data", OF_TRIALS), ("columns of --rates", OF_RATES),
                               ("windows", WINDOWS)):  # fmt: skip
            lines += ["", title, *(f"  {name}: {about}" for name, about in columns.items())]
        return "\n".join(lines), pd.DataFrame(rows, columns=["task", "about"])

    def take(
        self,
        circuit: Circuit | DecisionModel | str | Path,
        *,
        edits: Iterable[str] = (),
        engine: str | None = None,
        gain: float | None = None,
        seed: int = SEED,
        share: float = 1.0,
        motifs: bool = True,
        workers: int = 1,
    ) -> ExamRecord:
        """Let a circuit take the exam.

        Parameters
        ----------
        circuit : str, path, Circuit or Model
            A name or a .toml file, which is built for each number of alternatives, or a circuit,
            which answers for its own number of alternatives alone.
        edits : sequence of str
            Edits of the circuit, as in ``Circuit.edited``.
        engine : str, optional
            Engine; by default populations, or rates without noise for sparse connections.
        gain : float, optional
            Nats in the circuit per nat of evidence; by default the circuit's, or the fastest of
            five.
        seed : int
            Seed of evidence and noise.
        share : float
            Share of the usual numbers of trials, 0.05 to 10; totals are comparable at 1.
        motifs : bool
            Whether circuits have the motifs of each task, such as a criterion that falls where
            difficulties are interleaved.
        workers : int
            Threads; results do not depend on them.

        Raises
        ------
        ValueError
            For an unknown circuit, engine or edit, or a number out of range.
        """
        check_range(0.05, 10, share=share)
        whole("workers", workers, 1)
        model = (
            circuit
            if isinstance(circuit, DecisionModel)
            else model_of(circuit, edits, engine, gain)
        )
        simulation = Simulation(model, self.tasks, whole("seed", seed, 0), share, workers, motifs)
        included = simulation.included  # an unknown name or edit raises here
        results = Results(simulation, self.tasks, seed)
        rows = [_row(number, included, results) for number in self.numbers]
        circuits = {str(channels): identity(one) for channels, one in simulation.circuits.items()}
        about = {
            "circuits": circuits,
            "share": share,
            "motifs": motifs,
            **_operating_point(simulation),
        }
        return self._record(model.name, rows, seed, about)

    def mark(
        self,
        trials: str | Path | pd.DataFrame | None = None,
        rates: str | Path | pd.DataFrame | None = None,
        *,
        name: str = "from elsewhere",
        seed: int = SEED,
    ) -> ExamRecord:
        """Mark trials and rates that were recorded, or simulated by another tool.

        Parameters
        ----------
        trials, rates : path or DataFrame, optional
            Their columns are those of ``bgmodel.exam.tables``, with units in their names.
        name : str
            Name of the results.
        seed : int
            Seed of the bootstrap.

        Raises
        ------
        ValueError
            As for ``read_tables``, or if they answer none of the numbers.
        """
        tables = read_tables(trials, rates, self.tasks)
        results = Results(tables, self.tasks, seed)
        rows = [_row(number, "", results) for number in self.numbers]
        record = self._record(name, rows, seed, {"trials": _file(trials), "rates": _file(rates)})
        if (record.table["outcome"] == UNANSWERED).all():
            raise InputError(
                "the tables answer none of the numbers: name tasks, nuclei and windows as "
                "`bgmodel exam --tasks` lists them",
                "trials",
            )
        return record

    def _record(
        self, name: str, rows: list[dict[str, Any]], seed: int, about: dict[str, Any]
    ) -> ExamRecord:
        table = pd.DataFrame(rows)[[*COLUMNS]]
        origin = {"version": self.version, "sha256": self.sha256}
        return ExamRecord(name, table, seed, {"list": origin, **about})


def _file(source: str | Path | pd.DataFrame | None) -> dict[str, str] | None:
    """Return the name and the checksum of a file."""
    if source is None or isinstance(source, pd.DataFrame):
        return None
    return {"file": Path(source).name, "sha256": checksum(source)}


def take_exam(circuit: Circuit | DecisionModel | str | Path, **options: Any) -> ExamRecord:
    """Let a circuit take the shipped exam; arguments are those of ``Exam.take``."""
    return Exam.shipped().take(circuit, **options)


def _row(number: Number, included: str, results: Results) -> dict[str, Any]:
    """Return the row of a number; of a circuit, only the tasks that it needs are run."""
    results = replace(results, in_hz=number.unit == "Hz" and number.direction is None)
    try:
        return scored(number, included, MEASURES[number.measure](results, **number.of))
    except (NotApplicable, Failed) as reason:
        return scored(number, included, reason)


def _operating_point(simulation: Simulation) -> dict[str, Any]:
    """Return the engine, gain and threshold with two alternatives; nothing if it has none."""
    try:
        model, _ = simulation.tuned(2)
        level = simulation.level(2, simulation.tasks["reference"].accuracy)
    except (Failed, NotApplicable):
        return {}
    return {"engine": model.engine.id, "gain": model.gain, "threshold": level}

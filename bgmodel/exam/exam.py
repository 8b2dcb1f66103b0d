"""The exam: a list of published numbers that any circuit, or the results of one, can take."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd

from bgmodel.exam import measures, of_circuit
from bgmodel.exam.measures import MEASURES, Results
from bgmodel.exam.numbers import SEED, Number, NumberList, read_numbers, shipped_list
from bgmodel.exam.record import COLUMNS, ExamRecord, scored
from bgmodel.exam.simulation import Simulation
from bgmodel.exam.tables import Failed, NotApplicable, read_tables
from bgmodel.experiments.models import Model, model_of
from bgmodel.support.checks import check_range, whole
from bgmodel.support.files import checksum
from circuits.circuit import Circuit
from circuits.declaration.table_writer import identity
from circuits.errors import InputError, require

__all__ = ["SEED", "Exam", "Model", "measures", "model_of", "of_circuit", "take_exam"]


@dataclass(frozen=True)
class Exam:
    """A list of published numbers and the tasks by which they are answered.

    Parameters
    ----------
    questions : NumberList
        Numbers and tasks.

    Raises
    ------
    ValueError
        If a number names an unknown measure.
    """

    questions: NumberList

    def __post_init__(self) -> None:
        known = ", ".join(MEASURES)
        for one in self.questions.numbers:
            must = f"must be one of {known}"
            require(one.measure in MEASURES, "measure", must, one.measure, owner=one.id)

    @classmethod
    def shipped(cls) -> Exam:
        """Return the exam that ships with the package."""
        return cls(shipped_list())

    def with_numbers(self, *files: str | Path) -> Exam:
        """Return the exam with further numbers, one TOML file per domain.

        The version of the list is scored with "+": scores are comparable by number, not in total.
        """
        added = [one for file in files for one in read_numbers(file)]
        numbers = (*self.questions.numbers, *added)
        return Exam(replace(self.questions, numbers=numbers, version=f"{self.questions.version}+"))

    def only(self, domains: Iterable[str]) -> Exam:
        """Return the exam with some of its domains."""
        chosen = list(domains)
        for name in chosen:
            known = self.questions.domains
            require(name in known, "domains", f"must be among {', '.join(known)}", name)
        numbers = tuple(one for one in self.questions.numbers if one.domain in chosen)
        return Exam(replace(self.questions, numbers=numbers))

    def check(self, circuit: Circuit | str | Path, edits: Iterable[str] = ()) -> None:
        """Raise ValueError for an unknown circuit, or an edit that cannot be applied to it."""
        model_of(circuit, edits).circuits(
            sorted({t.channels for t in self.questions.tasks.values()})
        )

    def take(
        self,
        circuit: Circuit | Model | str | Path,
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
        model = circuit if isinstance(circuit, Model) else model_of(circuit, edits, engine, gain)
        simulation = Simulation(
            model, self.questions.tasks, whole("seed", seed, 0), share, workers, motifs
        )
        included = simulation.included  # an unknown name or edit raises here
        results = Results(simulation, self.questions.tasks, seed)
        rows = [_row(number, included, results) for number in self.questions.numbers]
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
        tables = read_tables(trials, rates, self.questions.tasks)
        results = Results(tables, self.questions.tasks, seed)
        rows = [_row(number, "", results) for number in self.questions.numbers]
        record = self._record(name, rows, seed, {"trials": _file(trials), "rates": _file(rates)})
        if (record.table["outcome"] == "not answered").all():
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
        origin = {"version": self.questions.version, "sha256": self.questions.sha256}
        return ExamRecord(name, table, seed, {"list": origin, **about})


def _file(source: str | Path | pd.DataFrame | None) -> dict[str, str] | None:
    """Return the name and the checksum of a file."""
    if source is None or isinstance(source, pd.DataFrame):
        return None
    return {"file": Path(source).name, "sha256": checksum(source)}


def take_exam(circuit: Circuit | Model | str | Path, **options: Any) -> ExamRecord:
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

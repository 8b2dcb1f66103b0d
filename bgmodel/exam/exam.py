"""The exam: a list of published numbers that any circuit, or the results of one, can take."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd

from bgmodel.exam import measures, of_circuit
from bgmodel.exam.examinee import Examinee, examinee
from bgmodel.exam.measures import MEASURES, Answer, Asked
from bgmodel.exam.numbers import SEED, Number, NumberList, read_numbers, shipped_list
from bgmodel.exam.record import COLUMNS, ExamRecord, marked
from bgmodel.exam.sitting import Sitting
from bgmodel.exam.tables import Failed, Unanswered, read_tables
from bgmodel.integrators.given import identity
from bgmodel.support.checks import check_range, whole
from bgmodel.support.files import checksum
from circuits.circuit import Circuit
from circuits.errors import InputError, require

__all__ = ["SEED", "Exam", "Examinee", "examinee", "measures", "of_circuit", "take_exam"]


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

        The version of the list is marked with "+": scores are comparable by number, not in total.
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

    def take(
        self,
        circuit: Circuit | Examinee | str | Path,
        *,
        edits: Iterable[str] = (),
        engine: str | None = None,
        gain: float | None = None,
        seed: int = SEED,
        share: float = 1.0,
        workers: int = 1,
    ) -> ExamRecord:
        """Let a circuit take the exam.

        Parameters
        ----------
        circuit : str, path, Circuit or Examinee
            A name or a .toml file, which is built for each number of alternatives, or a circuit,
            which answers for its own number of alternatives alone.
        edits : sequence of str
            Edits of the circuit, as in ``Circuit.edited``.
        engine : str, optional
            As for ``Examinee``.
        gain : float, optional
            Nats in the circuit per nat of evidence; by default the circuit's, or the fastest of
            five.
        seed : int
            Seed of evidence and noise.
        share : float
            Share of the usual numbers of trials, 0.05 to 10; totals are comparable at 1.
        workers : int
            Threads; results do not depend on them.

        Raises
        ------
        ValueError
            For an unknown circuit, engine or edit, or a number out of range.
        """
        check_range(0.05, 10, share=share)
        whole("workers", workers, 1)
        given = circuit
        if not isinstance(circuit, Examinee):
            circuit = examinee(circuit, edits, engine, gain)
        sitting = Sitting(circuit, self.questions.tasks, whole("seed", seed, 0), share, workers)
        rows = [self._row(one, sitting) for one in self.questions.numbers]
        hashes = _identities(sitting)
        if not hashes:
            raise InputError(f"the circuit cannot be built: {given}", "circuit")
        about = {"circuits": hashes, "share": share, **_operating_point(sitting)}
        return self._record(circuit.name, rows, seed, about)

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
            Name of the examinee.
        seed : int
            Seed of the bootstrap.

        Raises
        ------
        ValueError
            As for ``read_tables``, or if they answer none of the numbers.
        """
        tables = read_tables(trials, rates, self.questions.tasks)
        rows = []
        for one in self.questions.numbers:
            asked = Asked(tables, self.questions.tasks, seed)
            rows.append(_answered(one, "", asked))
        record = self._record(name, rows, seed, {"trials": _file(trials), "rates": _file(rates)})
        if (record.table["outcome"] == "not answered").all():
            raise InputError(
                "the tables answer none of the numbers: name tasks, nuclei and windows as "
                "`bgmodel exam --tasks` lists them",
                "trials",
            )
        return record

    def _row(self, number: Number, sitting: Sitting) -> dict[str, Any]:
        """Return the row of a number of a circuit: only the tasks that it needs are run."""
        names = [task for _, task in self.questions.tasks_of(number)]
        kind = "rates" if "nucleus" in number.of else "trials"
        try:
            tables, undone = sitting.tables(**{"trials": [], "rates": [], kind: names})
            if undone:
                raise next(iter(undone.values()))
        except (Unanswered, Failed) as reason:
            return marked(number, sitting.examinee.table, reason, isinstance(reason, Failed))
        asked = Asked(tables, sitting.tasks, sitting.seed, sitting)
        return _answered(number, sitting.examinee.table, asked)

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


def take_exam(circuit: Circuit | Examinee | str | Path, **options: Any) -> ExamRecord:
    """Let a circuit take the shipped exam; arguments are those of ``Exam.take``."""
    return Exam.shipped().take(circuit, **options)


def _answered(number: Number, table: str, asked: Asked) -> dict[str, Any]:
    in_hz = number.unit == "Hz" and number.direction is None
    answer: Answer | Exception
    failed = False
    try:
        answer = MEASURES[number.measure](replace(asked, in_hz=in_hz), **number.of)
    except Unanswered as reason:
        answer = reason
    except Failed as reason:
        answer, failed = reason, True
    return marked(number, table, answer, failed)


def _identities(sitting: Sitting) -> dict[str, dict[str, str]]:
    """Return the name and hash of the circuit for each number of alternatives that was built."""
    found = {}
    for channels in sorted({task.channels for task in sitting.tasks.values()}):
        try:
            found[str(channels)] = identity(sitting.circuit(channels))
        except Unanswered:
            continue
    return found


def _operating_point(sitting: Sitting) -> dict[str, Any]:
    """Return the engine, gain and threshold with two alternatives; nothing if it has none."""
    try:
        model, _ = sitting.tuned(2)
        level = sitting.level(2, sitting.tasks["reference"].accuracy)
    except (Failed, Unanswered):
        return {}
    return {"engine": model.engine.id, "gain": model.gain, "threshold": level}

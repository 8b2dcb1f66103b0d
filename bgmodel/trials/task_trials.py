"""Trials of a task: drawn, or read from a table of evidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar

from bgmodel.evidence import checked_prior
from bgmodel.support.seeds import stream
from bgmodel.task import Drawn, Task
from bgmodel.trials.named_evidence import NamedEvidence
from circuits.errors import require


@dataclass(frozen=True)
class EvidenceTable(Task):
    """Your own evidence, in a table of log-likelihoods as for ``read_evidence_table``."""

    evidence: Path
    """The file, .csv or .parquet."""
    step_ms: float = 50.0
    """Time between readings, ms."""

    name: ClassVar[str] = "table"

    def __post_init__(self) -> None:
        if isinstance(self.evidence, str):
            object.__setattr__(self, "evidence", Path(self.evidence))
        require(isinstance(self.evidence, Path), "evidence", "must be a path", self.evidence)
        super().__post_init__()

    @property
    def channels(self) -> int:
        """Number of alternatives."""
        return read_once(self).evidence.hypotheses

    @property
    def trials(self) -> int:
        """Number of trials."""
        return read_once(self).evidence.trials

    @property
    def t_max(self) -> int:
        """Number of readings of the longest trial."""
        return read_once(self).evidence.steps

    @property
    def file(self) -> Path:
        """Path of the table."""
        return self.evidence

    @property
    def text(self) -> str:
        """The name of the file."""
        return self.evidence.name


def read_once(task: EvidenceTable) -> NamedEvidence:
    """Return the trials of an evidence table, which is read again only if it has changed."""
    return _read(task, task.evidence.stat().st_mtime_ns if task.evidence.is_file() else 0)


@lru_cache(maxsize=4)
def _read(task: EvidenceTable, changed_ns: int) -> NamedEvidence:
    from bgmodel.trials.evidence_table import read_evidence_table

    return read_evidence_table(task.evidence, step_ms=task.step_ms)


def trials_of(
    task: Task, seed: int, name: str, *, prior: Sequence[float] | None = None, **more: Any
) -> NamedEvidence:
    """Return a task's trials: drawn with the stream of ``seed`` and ``name``, or of a table."""
    if isinstance(task, EvidenceTable):
        read = read_once(task)
        if prior is None:
            return read
        checked = checked_prior(prior, read.evidence.hypotheses)
        return replace(read, evidence=replace(read.evidence, prior=checked))
    assert isinstance(task, Drawn)
    ahead = stream(seed, name, "expectancy")
    evidence = task.drawn_with(stream(seed, name), ahead, prior, **more)
    return NamedEvidence(evidence, list(task.names))

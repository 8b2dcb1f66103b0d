"""Who takes the exam: a circuit for any number of alternatives, its engine and its gain."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar, cast

from bgmodel.exam.tables import Failed, Unanswered
from circuits.anatomy import is_included, load_circuit
from circuits.circuit import Circuit
from circuits.declaration.edits import Edits
from circuits.errors import InputError


@dataclass(frozen=True)
class Examinee:
    """A circuit that takes the exam."""

    name: str
    build: Callable[[int], Circuit]
    engine: str | None = None
    gain: float | None = None
    table: str = ""

    def engine_for(self, circuit: Circuit) -> str:
        """Return the name of the engine for a circuit."""
        if self.engine is not None:
            return self.engine
        sparse = any(row.probability < 1 for row in circuit.projections)
        return "rate" if sparse else "population"


def examinee(
    circuit: Circuit | str | Path,
    edits: Iterable[str] = (),
    engine: str | None = None,
    gain: float | None = None,
) -> Examinee:
    """Return a circuit, given as such, by name or as a file, as an examinee."""
    if isinstance(circuit, Circuit):
        fixed = circuit.edited(*edits)

        def build(channels: int) -> Circuit:
            if channels == fixed.channels:
                return fixed
            raise Unanswered(
                f"the circuit has {fixed.channels} alternatives, {channels} are needed: give its "
                "name or file, from which others are built"
            )

        return Examinee(fixed.name, build, engine, gain, _table(fixed))
    lines = Edits(edits)
    name = Path(circuit).stem if str(circuit).endswith(".toml") else str(circuit)

    def built(channels: int) -> Circuit:
        return load_circuit(circuit, channels).edited(*lines)

    whole = load_circuit(circuit).edited(*lines)  # an unknown name or edit raises here
    title = f"{name}, {'; '.join(lines)}" if lines else name
    return Examinee(title, built, engine, gain, _table(whole))


def _table(circuit: Circuit) -> str:
    """Return the name of the included circuit that a circuit is, or ""."""
    return circuit.name if is_included(circuit) else ""


@contextmanager
def refused() -> Iterator[None]:
    """Turn the refusal of a task into an answer: it cannot be asked, or an impossible run fails."""
    try:
        yield
    except InputError as error:
        raise Unanswered(str(error)) from None
    except ValueError as error:
        raise Failed(str(error)) from None


Result = TypeVar("Result")


def once(method: Callable[..., Result]) -> Callable[..., Result]:
    """Compute a method once for its arguments; an error is raised again at each call."""

    @wraps(method)
    def kept(self: Any, *given: Any) -> Result:
        key = (method.__name__, *given)
        if key not in self.kept:
            try:
                self.kept[key] = method(self, *given)
            except (Unanswered, Failed) as reason:
                self.kept[key] = reason
        found = self.kept[key]
        if isinstance(found, Exception):
            raise found
        return cast(Result, found)

    return kept

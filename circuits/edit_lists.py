"""Edits of a circuit as a person writes them: at the terminal or in an experiment's file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass, fields, replace
from itertools import combinations
from typing import TYPE_CHECKING, Any

from circuits.edit_places import RowEdit, channel_of, overlapping, tidied

if TYPE_CHECKING:
    from circuits.circuit import Circuit
    from circuits.engines import Engine

CUT = "cut "
"""How an edit by itself begins that cuts axons."""
SCALED = (
    "scale multiplies what a pathway signals and leaves its tone, the effect of its source's "
    "steady firing; axons that are lost take both with them: cut"
)
AXONS_CUT = (
    "cut takes a fraction of a pathway's axons, with what they signal and their tone, the effect "
    "of its source's steady firing; scale changes what a pathway signals and leaves its tone"
)
REBOUND = "rebound "
"""How an edit by itself begins that lets a nucleus rebound."""
ROWS = ("add", "change", "without", "cut", "scale", "rebound")
"""Edits of which there can be several."""


@dataclass(frozen=True)
class Edits:
    """Differences from the table: the hypothesis.

    Edits are made in this order: first every row, then new and single rows, then factors on what
    is there; what recovers, recovers from all of them. Examples are those of an experiment's file.
    At the terminal they are written
    `--edits.change "STN->GPe.delay_ms=4" "STN.bias_nats=-0.2"`.
    """

    neurons: int | None = None
    """Cells per channel of every spiking nucleus: `neurons = 100`."""
    connections: float | None = None
    """Connection probability between spiking nuclei, fixed in-degree: `connections = 0.25`."""
    spread: float | None = None
    """Spread of cell constants, as a fraction: `spread = 0.1`."""
    add: tuple[str, ...] = ()
    """New pathways and nuclei, as they are, like others or by the name of a motif (striatal_FSI),
    and what changes within a trial: `add = ["D1->GPe weight=-0.1 delay_ms=4",
    "TRN like=STN bias_nats=-1", "striatal_FSI", "dopamine amount=0.2 to_ms=300"]`."""
    keep_rest: bool = False
    """Whether what was there keeps its rates at rest when rows are added: `add = ["TRN like=STN",
    "TRN->GPe weight=0.1"]`, `keep_rest = true`."""
    change: tuple[str, ...] = ()
    """Fields of a pathway, a nucleus or its cells, all changed at once:
    `change = ["STN->GPe.delay_ms=4", "STN.bias_nats=-0.2", "STN.cell.cv=0.2"]`."""
    without: tuple[str, ...] = ()
    """Nuclei to lesion, whole or by a fraction, in all channels or in one; a lesion takes the tone
    of a nucleus too: `without = ["D2", "STN=0.5", "GPe[0]=0.25"]`."""
    replaced: bool = False
    """Whether the output lost to lesions is given back as a constant:
    `without = ["GPe"]`, `replaced = true`."""
    cut: tuple[str, ...] = ()
    """Pathways whose axons are lost, all or a fraction, in all channels or in one: what they signal
    and their tone. `cut = ["GPe->STN=0.3", "D1->SNr[0]=0.5", "ctx->D2"]`."""
    scale: tuple[str, ...] = ()
    """Pathways to scale, in all channels or in one. What is scaled is the change from the source's
    baseline_hz, not its tone: to ask what a pathway does, scale it to 0; to lose axons, cut.
    `scale = ["STN->GPe=0.5", "ctx->D1[0]=1.1"]`."""
    dopamine: float = 1.0
    """Dopamine level, 0..2; 1 is normal: `dopamine = 1.1`. At 0.1 and below macaque decides
    against its evidence, which is warned of."""
    recovered: bool = False
    """Whether every nucleus comes back to its own rate at rest, by its bias, as it does long after:
    `without = ["STN"]`, `recovered = true`."""
    rebound: tuple[str, ...] = ()
    """Nuclei that recover to rest above their old rate, by so many nats of their activity:
    `without = ["STN"]`, `rebound = ["SNr=0.5"]`."""

    def __post_init__(self) -> None:
        """Refuse one text where a list of them belongs: its letters would be taken for edits."""
        for name in ROWS:
            given = getattr(self, name)
            if isinstance(given, str):
                raise ValueError(f'{name} is a list of edits, such as ["{given}"], got {given!r}')

    def used(self) -> dict[str, Any]:
        """Return the edits that change something, by name: for provenance.

        The sentence `applied` has them in the order in which they were made.
        """
        changed = self._changed()
        return changed | ({"applied": self.text()} if changed else {})

    def text(self) -> str:
        """Return the edits that change something, in the order in which they are made."""
        return "; ".join(_text(name, value) for name, value in self._changed().items())

    def _added(self, circuit: Circuit) -> Circuit:
        """Return the circuit with the rows that are added."""
        if self.keep_rest and not self.add:
            raise ValueError("keep_rest is for rows that are added, there are none: give add")
        return circuit.add(*self.add, keep_rest=self.keep_rest)

    def notes(self) -> list[str]:
        """Return a sentence for each kind of edit that is taken for another."""
        return [SCALED] * bool(self.scale) + [AXONS_CUT] * bool(self.cut)

    def _changed(self) -> dict[str, Any]:
        changed = (f for f in fields(self) if getattr(self, f.name) != f.default)
        return {f.name: getattr(self, f.name) for f in changed}

    def check_engine(self, engine: Engine | str) -> None:
        """Raise ValueError for edits of which an engine makes no use: they would do nothing."""
        # Importing it with the package would cost time that only circuits need.
        from circuits.engines import engine_of

        chosen = engine_of(engine)
        of_cells = {"neurons": "neurons", "connections": "probability", "spread": "spread"}
        for name, field in of_cells.items():
            if getattr(self, name) and chosen.ignores(field):
                raise ValueError(f"{name} is of cells, it says nothing to the {engine} engine")
        for edit in self.change:
            field = edit.partition("=")[0].partition(".")[2].strip()
            if chosen.ignores(field):
                raise ValueError(f"{edit!r} says nothing to the {engine} engine")

    def _check_once(self) -> None:
        """Refuse a lesion or a factor that is given twice: together they would be another one."""
        for kind in ("without", "cut", "scale"):
            for one, other in combinations(_rows(self, kind), 2):
                if one.place == other.place:
                    raise overlapping(one, other)

    def apply(self, circuit: Circuit) -> Circuit:
        """Return the edited circuit.

        Raises
        ------
        ValueError
            One sentence with the edit as it was written and what is allowed.
        """
        table = circuit
        if self.neurons is not None:
            circuit = circuit.with_neurons(self.neurons)
        if self.connections is not None:
            circuit = circuit.with_connections(self.connections)
        if self.spread is not None:
            circuit = circuit.with_spread(self.spread)
        circuit = self._added(circuit).edited(*self.change)
        self._check_once()
        for edit in self.without:
            circuit = _lesioned(circuit, edit, self.replaced)
        for edit in self.cut:
            circuit = _cut(circuit, edit)
        for edit in self.scale:
            circuit = _scaled(circuit, edit)
        circuit = circuit.dopamine(self.dopamine)
        if not (self.recovered or self.rebound):
            return circuit
        return circuit.compensate(table, rebound_nats=self._rebound_nats())

    def _rebound_nats(self) -> dict[str, float]:
        """Return how far above its old rate each nucleus comes to rest, nats."""
        found: dict[str, float] = {}
        for edit in self.rebound:
            name, nats = _value(edit, None)
            if name in found:
                raise ValueError(f"{edit!r}: the rebound of {name} is given twice")
            found[name] = nats
        return found


def with_edits(edits: Edits, more: Iterable[str]) -> Edits:
    """Return edits with others, each in place of the one that edits the same place.

    Parameters
    ----------
    edits : Edits
        The edits so far.
    more : iterable of str
        Further edits of rows, as ``written`` reads them.

    Raises
    ------
    ValueError
        If two of the further edits, or one of them and one that is kept, set the same number, so
        that it would be neither's: a lesion of all channels and of one, a weight and a factor on
        it, two courses of one nucleus.
    """
    new = [row for text in more for row in _rows(written(text))]
    for one, other in combinations(new, 2):
        courses = one.of_course and other.of_course
        if one.place == other.place or (one.overlaps(other) and not courses):
            raise overlapping(one, other)
    places = {row.place for row in new}
    for old in _rows(edits):
        for row in () if old.place in places else new:
            # What changes a new row is made after it and holds.
            made_before = old.kind == "add" and not row.of_course
            if row.overlaps(old) and not made_before:
                raise overlapping(row, old)
    for row in new:
        old_rows = list(_rows(edits, row.kind))
        texts = [row.text if old.place == row.place else old.text for old in old_rows]
        if row.text not in texts:
            texts.append(row.text)
        changed: dict[str, Any] = {row.kind: tuple(texts)}
        edits = replace(edits, **changed)
    return edits


def _rows(edits: Edits, *kinds: str) -> Iterator[RowEdit]:
    """Yield the edits of which there can be several."""
    for kind in kinds or ROWS:
        yield from (RowEdit(kind, text) for text in getattr(edits, kind))


def written(edit: str, *, replaced: bool = False, recovered: bool = False) -> Edits:
    """Return the one edit that a text says, told by its form.

    ``D1->GPe weight=-0.1`` and ``striatal_FSI`` add, ``STN->GPe.delay_ms=4`` changes,
    ``STN->GPe=0.5`` scales, ``cut STN->GPe=0.5`` cuts axons, ``dopamine=0.9`` is the level,
    ``rebound SNr=0.5`` lets a nucleus recover to rest above its old rate, and ``STN``, ``STN=0.5``
    or, in one channel, ``STN[0]=0.5`` lesions.

    Parameters
    ----------
    edit : str
        The text.
    replaced : bool
        Whether a lesion's lost output is given back as a constant.
    recovered : bool
        Whether every nucleus comes back to its rate at rest.
    """
    return replace(_written(edit, replaced), recovered=recovered)


def _written(edit: str, replaced: bool) -> Edits:
    # Importing it with the package would cost time that only circuits need.
    from circuits.declaration.motifs import MOTIFS

    if edit.strip() in MOTIFS:
        return Edits(add=(edit,))
    place = tidied(edit).partition("=")[0]
    if place.startswith(REBOUND):
        return Edits(rebound=(edit.strip().removeprefix(REBOUND),))
    if place.startswith(CUT):
        return Edits(cut=(edit.strip().removeprefix(CUT),))
    if " " in place:
        return Edits(add=(edit,))
    if "." in place:
        return Edits(change=(edit,))
    if "->" in place:
        return Edits(scale=(edit,))
    if place == "dopamine":
        return Edits(dopamine=_value(edit, None)[1])
    return Edits(without=(edit,), replaced=replaced)


def _lesioned(circuit: Circuit, edit: str, replaced: bool) -> Circuit:
    name, fraction = _value(edit, 1.0)
    name, channel = channel_of(name, "GPe[0]")
    with _naming(edit):
        return circuit.lesion(name.strip(), fraction, replaced=replaced, channel=channel)


def _scaled(circuit: Circuit, edit: str) -> Circuit:
    name, factor = _value(edit, None)
    source, target, channel = _pathway(name, edit, "scale")
    with _naming(edit):
        return circuit.scale(source, target, factor, channel)


def _cut(circuit: Circuit, edit: str) -> Circuit:
    name, fraction = _value(edit, 1.0)
    source, target, channel = _pathway(name, edit, "cut")
    with _naming(edit):
        return circuit.cut(source, target, fraction, channel)


def _pathway(name: str, edit: str, kind: str) -> tuple[str, str, int | None]:
    """Split "source->target[channel]"."""
    name, channel = channel_of(name, "ctx->D1[0]")
    source, arrow, target = name.partition("->")
    if not arrow:
        raise ValueError(f'{kind} needs a pathway like "STN->GPe=0.5", got {edit!r}')
    return source.strip(), target.strip(), channel


def _naming(edit: str) -> AbstractContextManager[None]:
    """Name an edit, as it was written, in front of a ValueError about it."""
    # Importing it with the package would cost time that only circuits need.
    from circuits.declaration.row_edits import naming

    return naming(edit)


def _text(name: str, value: object) -> str:
    if value is True:
        return name
    return f"{name} {', '.join(value) if isinstance(value, tuple) else value}"


def _value(edit: str, default: float | None) -> tuple[str, float]:
    """Split "name=number"."""
    name, equals, number = edit.partition("=")
    if not equals and default is not None:
        return name.strip(), default
    try:
        return name.strip(), float(number)
    except ValueError:
        raise ValueError(f"an edit is a name, =, and a number; got {edit!r}") from None

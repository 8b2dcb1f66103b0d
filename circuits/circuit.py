"""The circuit: a table with all its edits, including those that need its fixed point."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Self

from circuits.declaration.courses import Course
from circuits.declaration.edits import VERBS, Edit, Edits, overlapping
from circuits.declaration.row_edits import NAMES, naming, new_rows
from circuits.declaration.rows import Population, Projection
from circuits.declaration.table import CircuitTable
from circuits.declaration.table_writer import digest
from circuits.declaration.table_writer import text as file_text
from circuits.declaration.verbs import EditableTable
from circuits.drawing import draw
from circuits.errors import InputError, require
from circuits.laws.homeostasis import biases
from circuits.laws.units import effect_of_nats

if TYPE_CHECKING:
    import brian2
    import numpy.typing as npt
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from circuits.engines import Brian2


class Circuit(EditableTable):
    """A complete circuit, the only input that engines read.

    It is a mapping of rows by name: ``circuit["STN"]`` is a population, ``circuit["STN->GPe"]`` a
    projection. Its fields are those of ``circuits.declaration.table.CircuitTable`` and are
    described there. Every edit is a method that returns a new circuit: ``lesion``, ``clamp``,
    ``cut``, ``scale``, ``set``, ``add``, ``dopamine``, ``compensate`` and others; ``edited`` takes
    them as text.
    """

    def __repr__(self) -> str:
        rows = (row for row in self.populations if row.spiking and not row.pooled)
        return (
            f"Circuit({self.name}: {self.channels} channels in {self.unit}, "
            f"{len(self.populations)} populations, {len(self.projections)} pathways, "
            f"{f'{len(self.courses)} courses, ' if self.courses else ''}"
            f"{sum(row.neurons for row in rows)} cells per channel, sha256 {digest(self)[:8]})"
        )

    def __str__(self) -> str:
        from circuits.show import text  # imports pandas

        return text(self)

    def _repr_html_(self) -> str:
        from circuits.show import html  # imports pandas

        return html(self)

    def plot(self, ax: Axes | None = None, *, reference: CircuitTable | None = None) -> Figure:
        """Draw the circuit: arrows excite, bars inhibit, and width follows the weight.

        Lesioned nuclei have a dashed border with the share that is left, or are hatched if all of
        them is silenced; pathways that transmit nothing are grey and dotted.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw on; by default those of a new figure.
        reference : Circuit, optional
            The circuit before its edits: a star marks each row that differs from it or is new.

        Returns
        -------
        Figure
            One panel.
        """
        return draw(self, ax, reference)

    def effect_of_nats(self, nats: float = 1.0) -> pd.DataFrame:
        """Return the effect of an input on each nucleus at rest, as ``circuits.laws.units``."""
        return effect_of_nats(self, nats)

    def to_brian2(
        self,
        drive: npt.ArrayLike,
        *,
        step_ms: float,
        seed: int,
        trial: int = 0,
        engine: Brian2 | None = None,
    ) -> brian2.Network:
        """Return the Brian2 network that the ``brian2`` engine runs, to be extended.

        ``network["STN"]`` is the group of a nucleus, channel by channel, ``network["spikes_STN"]``
        its spike monitor, and ``network["samples"]`` has the rates of all channels of all nuclei.

        Parameters
        ----------
        drive : array (trials, steps, channels), nats
            As for the engines; the first reading comes after ``engine.settle_ms`` at rest.
        step_ms : float
            Time from one reading to the next, ms.
        seed, trial : int
            Key of the noise, and number of the first trial.
        engine : Brian2, optional
            Times and monitors; by default those of ``Brian2()``, with the spikes of every nucleus.

        Raises
        ------
        InputError
            If a cell type has no Brian2 code, or the drive, a time or a name does not fit.
        """
        from circuits.engines.brian2.network import assembled
        from circuits.engines.brian2.run import in_numpy, network_of

        parts = network_of(self, drive, step_ms, seed, trial, engine).parts
        with in_numpy() as brian:
            network: brian2.Network = assembled(brian, parts)
            return network

    def to_brian2_script(
        self,
        drive: npt.ArrayLike,
        *,
        step_ms: float,
        seed: int,
        trial: int = 0,
        engine: Brian2 | None = None,
    ) -> str:
        """Return a script that imports Brian2 and NumPy only and reproduces a trial's spikes.

        Parameters and errors are those of ``to_brian2``; the drive must be of one trial.
        """
        from circuits.engines.brian2.run import network_of
        from circuits.engines.brian2.script import script

        return script(network_of(self, drive, step_ms, seed, trial, engine), seed, trial)

    def to_toml(self) -> str:
        """Return the circuit as the text of a file, which ``load_circuit`` reads."""
        return file_text(self)

    def add(self, name: str, /, *, keep_rest: bool = False, **fields: object) -> Self:
        """Return the circuit with a new nucleus, pathway or course, or with a motif.

        For example ``add("TRN", like="STN", bias_nats=-1)``, ``add("D1->GPe", weight=-0.1)``,
        ``add("dopamine", amount=0.5, to_ms=300)`` or ``add("urgency")``.

        Parameters
        ----------
        name : str
            The nucleus, ``"TRN"``, the pathway, ``"D1->GPe"`` or ``"STN->SNr NMDA"``, the quantity
            that the course changes, ``"dopamine"``, ``"STN"`` or ``"D2[0]"``, or the motif.
        keep_rest : bool
            Whether existing nuclei keep their resting rates: their biases are adjusted for the
            input that the new rows add, as in ``compensate``.
        **fields
            Fields of the row, as in ``circuits.declaration``: of a ``Population``, a
            ``Projection`` or a ``Course``, which has an ``amount``. ``like`` names a row that has
            the values of the other fields.

        Raises
        ------
        ValueError
            For a row that exists, a field that it does not have, or an invalid value.
        """
        must = 'must be a name, with fields as keywords: add("D1->GPe", weight=-0.1)'
        require(isinstance(name, str) and "=" not in name, "add", must, name)
        return self._added([name], keep_rest, fields)

    def _added(self, rows: Sequence[str], keep_rest: bool, fields: Mapping[str, object]) -> Self:
        new = new_rows(self, rows, fields)
        with naming(*rows):
            added = self.with_rows(*new)
            if not keep_rest or added == self:
                return added
            return replace(added.compensate(self), chronic=self.chronic)

    def compensate(
        self,
        reference: CircuitTable | None = None,
        *,
        rebound_nats: Mapping[str, float] | None = None,
    ) -> Self:
        """Return the circuit with the resting rate of every population restored after an edit.

        Only biases change: each compensates for the change in its population's resting input.
        ``circuits.laws.homeostasis`` has the rule. Lesions become chronic.

        Parameters
        ----------
        reference : Circuit, optional
            The circuit before the edits; by default this circuit without its lesions.
        rebound_nats : mapping from names to nats, optional
            By how much the new resting rate of a population exceeds the old one, in nats of its
            own activity.

        Raises
        ------
        ValueError
            If there is neither a reference nor a lesion, a nucleus is clamped, a population is
            unknown or cannot fire at its rate, or its channels would need different biases.
        """
        rows = [
            replace(self.population(name), bias_nats=bias)
            for name, bias in biases(self, reference, rebound_nats).items()
        ]
        edited = self._with(*rows)
        return edited if edited == edited.unlesioned else replace(edited, chronic=True)

    def edited(self, *lines: str) -> Self:
        """Return the circuit with edits given as text.

        For example ``circuit.edited("lesion STN 10%", "set STN->GPe.delay_ms 4", "dopamine 0.9")``;
        the grammar is in ``circuits.declaration.edits``. The order of the lines does not matter.

        Raises
        ------
        ValueError
            Naming the edit verbatim, and what is allowed.
        """
        edits = Edits(lines)
        added, keep_rest = edits.of("add"), bool(edits.of("keep"))
        if keep_rest and not added:
            raise InputError("'keep rest' needs an edit that adds rows: use it with 'add'", "edits")
        circuit = self._called(edits.of("neurons", "connections", "heterogeneity"))
        circuit = circuit._added([str(edit.value) for edit in added], keep_rest, {})
        circuit = circuit._set(edits.of("set"))
        circuit = circuit._called(edits.of("lesion", "clamp", "cut", "block", "scale", "dopamine"))
        if not edits.compensates:
            return circuit
        for edit in edits.of("set"):
            if edit.field == "bias_nats" and edit.row in self:  # compensation would set it again
                raise overlapping(edit, edits.of("compensate", "rebound")[0])
        rebound = {edit.row: float(edit.value) for edit in edits.of("rebound")}
        return circuit.compensate(self, rebound_nats=rebound)

    def _called(self, edits: Iterable[Edit]) -> Self:
        """Return the circuit after edits that each correspond to a method, applied in turn."""
        circuit = self
        for edit in edits:
            with naming(edit.text):
                made_by = getattr(circuit, VERBS[edit.verb].method or edit.verb)
                channel = {} if edit.channel is None else {"channel": edit.channel}
                circuit = made_by(*([edit.row] if edit.row else ()), edit.value, **channel)
        return circuit


def _of_rows() -> inspect.Signature:
    """Return the signature of ``add`` with the fields of all kinds of rows, for completion."""
    kinds = (Population, Projection, Course)
    names = {each.name: None for kind in kinds for each in fields(kind)}
    known = inspect.signature(Circuit.add)
    own = [one for one in known.parameters.values() if one.kind is not one.VAR_KEYWORD]
    more = [inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None)
            for name in ("like", *names) if name not in (*NAMES, "what")]  # fmt: skip
    return known.replace(parameters=[*own, *more])


Circuit.add.__signature__ = _of_rows()  # type: ignore[attr-defined]

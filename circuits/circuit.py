"""The circuit: a table with its edits, those included that need its fixed point."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Self

from circuits.declaration.courses import Course
from circuits.declaration.edits import VERBS, Edit, Edits
from circuits.declaration.row_edits import naming
from circuits.declaration.rows import Population, Projection
from circuits.declaration.table import CircuitTable
from circuits.declaration.table_files import digest
from circuits.declaration.verbs import EditableTable
from circuits.errors import InputError
from circuits.laws.homeostasis import balanced_weight, biases
from circuits.plots import draw, panels

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class Circuit(EditableTable):
    """A whole circuit; every engine reads this and nothing else.

    It is a mapping of its rows by name: ``circuit["STN"]`` is a population, ``circuit["STN->GPe"]``
    a projection. Its fields, each with a description, are those of
    ``circuits.declaration.table.CircuitTable``. Every edit is a method that returns a new circuit:
    ``lesion``, ``clamp``, ``cut``, ``scale``, ``set``, ``add``, ``dopamine``, ``compensate`` and
    others; ``edited`` takes them as text.
    """

    def __repr__(self) -> str:
        """Return one line: ``print(circuit)`` has the tables."""
        own = (row for row in self.populations if row.spiking and not row.pooled)
        return (
            f"Circuit({self.name}: {self.channels} channels in {self.unit}, "
            f"{len(self.populations)} populations, {len(self.projections)} pathways, "
            f"{f'{len(self.courses)} courses, ' if self.courses else ''}"
            f"{sum(row.neurons for row in own)} cells per channel, sha256 {digest(self)[:8]})"
        )

    def __str__(self) -> str:
        """Return the whole table as text, as ``bgmodel circuit show`` prints it."""
        from circuits.show import text  # pandas, only where a circuit is shown

        return text(self)

    def _repr_html_(self) -> str:
        """Return both tables, for a notebook."""
        from circuits.show import html  # pandas, only where a circuit is shown

        return html(self)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the circuit: arrows excite, bars inhibit, and width follows the weight.

        Parameters
        ----------
        ax : Axes, optional
            Drawn on and returned; a new figure unless given.
        """
        (only,) = panels(1, ax, height=4.0)
        return draw(self, only)

    def add(self, *rows: Population | Projection | Course | str, keep_rest: bool = False) -> Self:
        """Return the circuit with rows added: a nucleus, a pathway or a course of your own.

        Parameters
        ----------
        *rows : Population, Projection, Course or str
            What is added. A row may be text: ``"D1->GPe weight=-0.1 delay_ms=4"``,
            ``"TRN like=STN bias_nats=-1"``, ``"dopamine amount=0.5 to_ms=300"``, or the name of a
            motif, ``"striatal_FSI"``.
        keep_rest : bool
            Whether existing nuclei keep their resting rates: their biases make up for what the new
            rows add to their input, as in ``compensate``.
        """
        added = super().add(*rows)
        if not keep_rest or added == self:
            return added
        with naming(*(row for row in rows if isinstance(row, str))):
            return replace(added.compensate(self), chronic=self.chronic)

    def compensate(
        self,
        reference: CircuitTable | None = None,
        *,
        rebound_nats: Mapping[str, float] | None = None,
    ) -> Self:
        """Return the circuit with every population's own rate at rest as it was before an edit.

        Each population's bias makes good what the edit changed in its input at rest; nothing else
        is changed. ``circuits.laws.homeostasis`` says how, and has the same rule as dynamics.
        Lesions are chronic then.

        Parameters
        ----------
        reference : Circuit, optional
            The circuit before the edits; of a lesioned one, that without lesions.
        rebound_nats : mapping from names to nats, optional
            How far above its old rate, in nats of its own activity, a population comes to rest.

        Raises
        ------
        ValueError
            Without a reference where there is no lesion, for a nucleus that is clamped, an
            unknown population, a rate that a population cannot have, or channels that would need
            different biases.
        """
        rows = [
            replace(self.population(name), bias_nats=bias)
            for name, bias in biases(self, reference, rebound_nats).items()
        ]
        found = self._with(*rows)
        return found if found == found.unlesioned else replace(found, chronic=True)

    def balanced(self, source: str = "STN") -> Self:
        """Return the circuit whose read-out does not follow what all channels share.

        The weight from a nucleus that sums them onto the read-out is what changes; recover rates at
        rest afterwards. ``circuits.laws.homeostasis`` has the rule.

        Parameters
        ----------
        source : str
            The nucleus.

        Raises
        ------
        ValueError
            If there is no such pathway, it is none that a rule could act on, or no weight of its
            sign will do.
        """
        weight = balanced_weight(self, source)
        return self.with_projection(source, self.readout, weight=weight)

    def edited(self, *lines: str) -> Self:
        """Return the circuit with edits that are written as text.

        ``circuit.edited("lesion STN 10%", "set STN->GPe.delay_ms 4", "dopamine 0.9")``: the
        grammar is that of ``circuits.declaration.edits``. The order of the lines does not matter.

        Raises
        ------
        ValueError
            One sentence with the edit as it was written and what is allowed.
        """
        edits = Edits(lines)
        added, keep_rest = edits.of("add"), bool(edits.of("keep"))
        if keep_rest and not added:
            raise InputError("'keep rest' is for rows that are added: add one", "edits")
        circuit = self._called(edits.of("neurons", "connections", "heterogeneity"))
        circuit = circuit.add(*(str(edit.value) for edit in added), keep_rest=keep_rest)
        circuit = circuit._set(edits.of("set"))
        circuit = circuit._called(edits.of("lesion", "clamp", "cut", "scale", "dopamine"))
        if not edits.compensates:
            return circuit
        rebound = {edit.row: float(edit.value) for edit in edits.of("rebound")}
        return circuit.compensate(self, rebound_nats=rebound)

    def _called(self, edits: Iterable[Edit]) -> Self:
        """Return the circuit after edits that are made by a method each, one after another."""
        circuit = self
        for edit in edits:
            channel = {} if edit.channel is None else {"channel": edit.channel}
            with naming(edit.text):
                made_by = getattr(circuit, VERBS[edit.verb].method or edit.verb)
                circuit = made_by(*edit.arguments, **channel)
        return circuit

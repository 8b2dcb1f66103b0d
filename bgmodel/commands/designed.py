"""The command on designed trials: which theory of decisions a circuit follows."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tyro.conf import Positional

from bgmodel.commands.checks import (
    EditOption,
    Shows,
    bar,
    check_ending,
    check_whole,
    options_of,
    say_before,
    say_of_edits,
)
from bgmodel.names import CircuitName, EngineName
from bgmodel.support import files
from circuits.declaration.edits import Edits
from circuits.errors import InputError

if TYPE_CHECKING:
    from circuits.circuit import Circuit

MACAQUE = CircuitName("macaque")
POPULATION = EngineName("population")
CHANNELS = 4
"""Alternatives, where neither an option nor a file says how many."""


@dataclass(frozen=True)
class CircuitDesigned(Shows):
    """Tell which theory of decisions a circuit follows, on trials designed to tell them apart.

    The evidence has no noise: rivals stand apart from the first reading on, then the leader rises
    steadily. Printed is when the circuit decides, less its latency, less when the MSPRT at its
    gain, max-vs-next and max-vs-average do. Each theory's threshold is set with equal rivals.

    Examples: bgmodel circuit designed;
    bgmodel circuit designed spiking_msprt --engine ensemble --trials 100;
    bgmodel circuit designed mine.toml --engine algebra --thresholds 0.3 --json
    """

    circuit: Positional[CircuitName] = MACAQUE
    """Name of the table, or the path of a .toml file."""
    engine: EngineName = POPULATION
    """How the circuit is run: populations with noise, unless another engine is named."""
    edits: EditOption = field(default_factory=Edits)
    """Edits of the circuit, each in quotes: "lesion STN 10%" "dopamine 0.9"."""
    thresholds: tuple[float, ...] = (0.35, 0.25, 0.15)
    """OUT at which it decides, in the circuit's unit."""
    channels: int | None = None
    """Number of alternatives, 3 or more; 4 unless given, or that of the file."""
    trials: int = 200
    """Trials per design, each with noise of its own; an engine without noise takes one."""
    gain: float | None = None
    """The circuit's unit per nat, where that unit is not nats: designs are in the circuit's nats,
    so that there it changes nothing."""
    workers: int = 2
    """Threads of the engines that can use several; they change no byte."""
    output: Path | None = None
    """Where the table goes, .parquet or .csv."""
    seed: int = 0

    def __call__(self) -> None:
        """Run the command."""
        from bgmodel.comparison import designed
        from bgmodel.conditions import Setup
        from bgmodel.integrators.basal_ganglia import identity
        from bgmodel.integrators.deciding import sample_ms

        self._check()
        channels = self.channels
        if channels is None and not self.circuit.endswith(".toml"):
            channels = CHANNELS
        setup = Setup(
            circuit=self.circuit,
            edits=self.edits,
            engine=self.engine,
            gain=self.gain,
            seed=self.seed,
        )
        table = setup.table(channels)
        say_of_edits(self.edits)
        setup = replace(setup, gain=self._gain(table))
        every = designed.designs(table.channels)
        step_ms = every[0].evidence(1).step_ms
        model = setup.model(channels, workers=self.workers, sample_ms=sample_ms(step_ms))
        trials, readings = designed.size(model, self.thresholds, self.trials)
        given = every[0].evidence(readings, trials=trials)
        say_before("designed trials:", model.until(0.0), given, runs=len(every))
        with bar(len(every) * trials):
            found = designed.designed_circuit(model, self.thresholds, trials=trials)
        if self.output is not None:
            behind: dict[str, Any] = {"command": options_of(self, gain=model.gain)}
            behind["circuit"] = identity(table)
            files.write_table(found, self.output, seed=self.seed, **behind)
        outcomes = designed.verdicts(found).set_index("theory")["outcome"].to_dict()
        about = {"circuit": table.name, "trials": trials, "outcomes": outcomes}
        self.show(designed.text(found, table.unit), found, **about)
        if self.output is not None:
            self.note(f"{trials} trials per design -> {self.output}")

    def _gain(self, table: Circuit) -> float | None:
        """Return the gain, where it counts, and else any."""
        from circuits.declaration.table import NATS

        if self.gain is None and table.default_gain is None and table.unit == NATS:
            return 1.0
        return self.gain

    def _check(self) -> None:
        """Refuse what makes no sense, before long work starts."""
        from circuits.ignored import check_edits

        if self.output is not None:
            check_ending("output", self.output, ".parquet", ".csv")
        check_edits(self.edits, self.engine)
        check_whole(workers=self.workers, trials=self.trials)
        if not self.thresholds:
            raise InputError("thresholds must hold one number or more", "thresholds")

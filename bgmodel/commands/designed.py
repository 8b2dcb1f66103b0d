"""The command on designed trials, which tell theories of decision making apart."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from tyro.conf import OmitArgPrefixes

from bgmodel.commands.checks import (
    Shows,
    bar,
    check_ending,
    check_whole,
    made_with,
    say_before,
    say_of_edits,
)
from bgmodel.conditions import Setup
from bgmodel.support import files
from circuits.errors import InputError

if TYPE_CHECKING:
    from circuits.circuit import Circuit

CHANNELS = 4
"""Default number of alternatives."""


@dataclass(frozen=True)
class CircuitDesigned(Shows):
    """Test which theory of decisions a circuit follows, on trials designed to tell them apart.

    The evidence has no noise: competitors are separated from the first reading on, then the leader
    rises steadily. The output is the decision time of the circuit, corrected for its latency, minus
    those of the MSPRT at its gain, of max-vs-next and of max-vs-average. The threshold of each
    theory is set with equal competitors.

    Examples: bgmodel circuit designed;
    bgmodel circuit designed --circuit spiking_msprt --engine ensemble --trials 100;
    bgmodel circuit designed --circuit mine.toml --engine algebra --thresholds 0.3 --json
    """

    setup: OmitArgPrefixes[Setup] = field(default_factory=Setup)
    thresholds: tuple[float, ...] = (0.35, 0.25, 0.15)
    """Thresholds on OUT, in the circuit's unit."""
    channels: int | None = None
    """Number of alternatives, 3 or more; by default 4, or that of the file."""
    trials: int = 200
    """Trials per design, with independent noise; one for an engine without noise."""
    workers: int = 2
    """Threads, for engines that can use several; the results do not depend on it."""
    output: Path | None = None
    """File for the table, .parquet or .csv."""

    def __call__(self) -> None:
        """Run the command."""
        from bgmodel.comparison import designed
        from bgmodel.integrators.deciding import sample_ms

        self._check()
        channels = self.channels
        if channels is None and not self.setup.circuit.endswith(".toml"):
            channels = CHANNELS
        setup = self.setup
        table = setup.table(channels)
        say_of_edits(setup.edits)
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
            behind = made_with(self, model, setup=replace(setup, gain=model.gain))
            files.write_table(found, self.output, seed=setup.seed, **behind)
        outcomes = designed.verdicts(found).set_index("theory")["outcome"].to_dict()
        about = {"circuit": table.name, "trials": trials, "outcomes": outcomes}
        self.show(designed.text(found, table.unit), found, **about)
        if self.output is not None:
            self.note(f"{trials} trials per design -> {self.output}")

    def _gain(self, table: Circuit) -> float | None:
        """Return the gain if it matters, otherwise any value."""
        from circuits.declaration.table import NATS

        if self.setup.gain is None and table.default_gain is None and table.unit == NATS:
            return 1.0
        return self.setup.gain

    def _check(self) -> None:
        """Refuse invalid options before long work starts."""
        if self.output is not None:
            check_ending("output", self.output, ".parquet", ".csv")
        check_whole(workers=self.workers, trials=self.trials)
        if not self.thresholds:
            raise InputError("thresholds must hold one number or more", "thresholds")

"""The stop-signal task as a record: how stop signals are added to the trials of any task."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from bgmodel.stopping.inputs import StopSignal
from bgmodel.stopping.trials import check_delays
from bgmodel.support import toml_files
from bgmodel.support.checks import check_range, whole
from circuits.errors import InputError, require


@dataclass(frozen=True)
class StopTask(StopSignal):
    """Stop signals in a share of a task's trials, and how they reach the circuit.

    Response times are those of decisions. A motor delay would add to go times and to the
    stop-signal reaction time alike.

    Raises
    ------
    ValueError
        For a number out of range, no delays, or, with staircases, fewer than two.

    Warns
    -----
    UserWarning
        If delays look like seconds, or as for ``StopSignal``.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = toml_files.STRICT

    share: float = 0.25
    """Probability of a stop signal, 0..1."""
    delays_ms: tuple[float, ...] = (100.0, 150.0, 200.0, 250.0, 300.0, 350.0, 400.0, 450.0, 500.0)
    """Stop-signal delays from the onset of evidence, ms: each is equally likely, or, with
    staircases, a step of them."""
    staircases: int = 0
    """Number of interleaved staircases: a delay is followed by the next longer one after a
    successful stop, by the next shorter one after a failed stop. 0 draws delays at random."""
    delay_sd_ms: float = 0.0
    """Standard deviation of the delay from the signal to the nucleus, ms; no delay is below 0."""
    failures: float = 0.0
    """Probability that a signal triggers nothing, 0..1."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(0 < self.share < 1, "share", "must be between 0 and 1", self.share)
        check_range(0, 1, failures=self.failures)
        check_range(0, np.inf, delay_sd_ms=self.delay_sd_ms)
        whole("staircases", self.staircases, 0)
        delays = check_delays(self.delays_ms)
        if self.staircases and (len(delays) < 2 or not (np.diff(delays) > 0).all()):
            must = "must be two rising numbers or more with staircases"
            raise InputError.of("delays_ms", must, self.delays_ms)

    def used(self) -> dict[str, Any]:
        """Return the settings by name, for provenance; infinite times are left out."""
        return {
            name: value
            for name, value in vars(self).items()
            if not (isinstance(value, float) and np.isinf(value))
        }

    def check_ends(self, end_ms: float) -> None:
        """Raise ValueError if a signal would come after the end of the trials, ms."""
        must = f"must be before the deadline, {end_ms:g} ms"
        require(max(self.delays_ms) < end_ms, "delays_ms", must, max(self.delays_ms))

"""Simulations of the exam's tasks by one circuit: thresholds, choices and times, and rates."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from bgmodel.bootstrap import FEWEST_TRIALS
from bgmodel.comparison.thresholds import fastest_gain
from bgmodel.deciding.measures import Behaviour
from bgmodel.deciding.tradeoff import Tradeoff, decides_without_evidence
from bgmodel.evidence import Evidence
from bgmodel.exam.numbers import READINGS, ExamTask
from bgmodel.exam.tables import (
    NAMES,
    OF_TRIALS,
    STOP_DELAY_MS,
    STOP_NATS,
    Failed,
    NotApplicable,
    Tables,
    rate_rows,
    rest_rows,
)
from bgmodel.experiments.models import DecisionModel, stopped
from bgmodel.integrators.at_thresholds import behaviour_of, refined
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.stopping.inputs import StopSignal
from bgmodel.stopping.task import StopTask, decided
from bgmodel.support.seeds import stream
from bgmodel.task import Gaussian
from circuits.anatomy import is_included
from circuits.circuit import Circuit
from circuits.declaration.table import NATS
from circuits.errors import InputError, collected, quiet
from circuits.store import once

DRAWN = 4000
"""Trials that are drawn for each kind of task: a task takes the first of them, so that those with
the same number share their readings, whatever the number of trials."""
TUNING_TRIALS = 500
FOREPERIOD_MS = 500.0
MOST_MISSED = 0.5
"""Largest share of missed trials for a threshold, and for a mean time, in which they count at the
deadline."""


@contextmanager
def scored_errors() -> Iterator[None]:
    """Convert an InputError into a score of "not answered", other ValueErrors into "fails"."""
    try:
        yield
    except InputError as error:
        raise NotApplicable(str(error)) from None
    except ValueError as error:
        raise Failed(str(error)) from None


@dataclass(frozen=True)
class Simulation:
    """Simulations of tasks by one model with a seed, each computed once.

    ``share`` multiplies the usual numbers of trials; ``workers`` are threads, which do not affect
    results. Without ``motifs`` no task adds rows to the circuit.
    """

    model: DecisionModel
    tasks: dict[str, ExamTask]
    seed: int
    share: float = 1.0
    workers: int = 1
    motifs: bool = True
    cache: dict[Any, Any] = field(default_factory=dict, repr=False, init=False)
    """Results, or the reasons for their absence."""

    @cached_property
    def circuits(self) -> dict[int, Circuit]:
        """Circuits by number of alternatives, those of the tasks that can be built."""
        return self.model.circuits(sorted({task.channels for task in self.tasks.values()}))[0]

    @property
    def included(self) -> str:
        """Name of the included circuit that this is, whose rows some numbers set, or ""."""
        circuit = next(iter(self.circuits.values()))
        return circuit.name if is_included(circuit) else ""

    @once
    def circuit(self, channels: int, motifs: tuple[str, ...] = ()) -> Circuit:
        """Return the circuit for a number of alternatives; motifs need one that works in nats."""
        with scored_errors():
            circuit = self.model.circuit(channels)
            if not self.motifs or circuit.unit != NATS:
                return circuit
            return replace(
                circuit.edited(*(f"add {name}" for name in motifs)), unedited=circuit.unedited
            )

    @once
    def tuned(self, channels: int, motifs: tuple[str, ...] = ()) -> tuple[BasalGanglia, Tradeoff]:
        """Return the unedited model and its decisions on trials that are used for nothing else."""
        circuit = self.circuit(channels, motifs)
        engine = self.model.tuned(circuit, workers=self.workers)
        try:
            with quiet():
                gain = self.model.gain
                return fastest_gain(circuit, engine, self._tuning(channels), self.seed, gain)
        except ValueError as error:
            raise Failed(str(error)) from None

    def _tuning(self, channels: int) -> Evidence:
        task = Gaussian(channels, t_max=READINGS)
        return drawn(task, TUNING_TRIALS, self.seed, "tuning")

    @once
    def level(self, channels: int, accuracy: float, motifs: tuple[str, ...] = ()) -> float:
        """Return the threshold at which the unedited circuit reaches an accuracy."""
        model, swept = self.tuned(channels, motifs)
        with quiet():
            swept = refined(model, self._tuning(channels), swept, (accuracy,))
        nearest = swept.at_accuracy(accuracy)
        missed = nearest.forced.mean()
        if not swept.reaches(accuracy) or missed > MOST_MISSED:
            raise Failed(
                f"with {channels} alternatives it does not reach an accuracy of {accuracy:g} by "
                f"evidence: the nearest is {nearest.posterior.mean():.2f}, {missed:.0%} decided by "
                "the deadline"
            )
        return float(nearest.settings[0])

    def edited(self, task: ExamTask, model: BasalGanglia | None = None) -> BasalGanglia:
        """Return a model, by default the tuned one, with the edits of a task."""
        if model is None:
            model, _ = self.tuned(task.channels, task.motifs)
        if not task.edits:
            return model
        if any(line.startswith(("rebound", "compensate")) for line in task.edits):
            self._check_nats("an edit of resting rates in nats")
        try:
            with collected() as cautions:
                edited = replace(model, circuit=model.circuit.edited(*task.edits))
        except ValueError as error:
            raise NotApplicable(str(error)) from None
        if cautions:
            raise NotApplicable(cautions[0])
        return edited

    def _check_nats(self, what: str) -> None:
        if (unit := self.circuit(2).unit) != NATS:
            raise NotApplicable(f"{what} needs a circuit that works in nats, not in {unit}")

    def trials_of(self, task: str) -> pd.DataFrame:
        """Return the trials of a task, indexed by their numbers."""
        return self.trials(task).set_index("trial")

    def rates_of(self, task: str, nucleus: str, window: str, role: str) -> pd.Series:
        """Return the rate of a nucleus in each trial of a task, Hz, indexed by trial."""
        return Tables(rates=self.rates(task)).rates_of(task, nucleus, window, role)

    @once
    def trials(self, name: str) -> pd.DataFrame:
        """Return the trials of a task, with the columns of ``tables.OF_TRIALS``."""
        task = self.tasks[name]
        count = max(FEWEST_TRIALS, round(self.share * task.trials))
        if task.windows == ("rest",):
            raise NotApplicable(f"the task {name!r} has no evidence, and no decisions")
        level = self.level(task.channels, task.accuracy, task.motifs)
        model = self.edited(task)
        if task.common_nats and not model.raw:
            raise NotApplicable(
                "the mean over channels is taken from its evidence, so that it cannot tell good "
                "alternatives from bad ones"
            )
        evidence = drawn(task, count, self.seed)
        with quiet():
            behaviour = self._behaviour(task, model, evidence, level)
        premature = behaviour.decision.premature.mean()
        wait_ms = task.expectancy_ms or FOREPERIOD_MS
        if not task.edits and decides_without_evidence(
            premature, behaviour.anticipatory.mean(), wait_ms
        ):
            raise Failed(f"it decides without evidence in the task {name!r}")
        return _trial_rows(name, behaviour)

    def _behaviour(
        self, task: ExamTask, model: BasalGanglia, evidence: Evidence, level: float
    ) -> Behaviour:
        stopping = None
        with scored_errors():
            if task.stop_share:
                self._check_nats("a stop signal in nats")
                signal = StopTask(
                    share=task.stop_share, delays_ms=task.stop_delays_ms,
                    amount_nats=STOP_NATS, delay_ms=STOP_DELAY_MS,
                )  # fmt: skip
                stopping = decided(signal, model, evidence, level, stream(self.seed, "stops"))
            return behaviour_of(model, evidence, level, FOREPERIOD_MS, stopping)

    @once
    def rates(self, name: str) -> pd.DataFrame:
        """Return the rates of a task, with the columns of ``tables.OF_RATES``."""
        task = self.tasks[name]
        count = max(FEWEST_TRIALS, round(self.share * task.rate_trials))
        recorded: dict[str, Any] = {"workers": self.workers, "rates": True, "sample_ms": 5.0}
        if task.windows == ("rest",):
            self.circuit(task.channels)
            with quiet(), scored_errors():  # the gain has no effect without evidence
                model = self.model.integrator(task.channels, gain=1.0, seed=self.seed, **recorded)
                return rest_rows(task, self.edited(task, model), count)
        level = self.level(task.channels, task.accuracy, task.motifs)
        model = self.edited(task)
        evidence = drawn(task, count, self.seed)
        evidence = replace(
            evidence, log_likelihood=evidence.log_likelihood[:, : task.rate_readings]
        )
        model = replace(model, engine=model.engine.tuned(**recorded))
        if "signal" in task.windows:
            self._check_nats("a stop signal in nats")
        if task.stop_share:
            signal = StopSignal(amount_nats=STOP_NATS, delay_ms=STOP_DELAY_MS)
            with scored_errors():
                model, evidence = stopped(model, evidence, signal, task.stop_delays_ms[0])
        with quiet(), scored_errors():
            return pd.concat(rate_rows(task, model, evidence, level), ignore_index=True)

    @cached_property
    def abstract(self) -> frozenset[str]:
        """Nuclei whose rates are not those of cells."""
        rows = [row for circuit in self.circuits.values() for row in circuit.populations]
        names = {row.name for row in rows if not row.spiking}
        for name, parts in NAMES.items():
            names |= {name} if names & set(parts) else set()
        return frozenset(names)


def drawn(task: Gaussian, trials: int, seed: int, *names: str) -> Evidence:
    """Return the first trials of a task; tasks of one kind share their random numbers."""
    rng = stream(seed, "exam", f"{task.channels} {task.step_ms:g}", *names)
    ahead = stream(seed, "exam", "expectancy", *names)
    with quiet():
        return replace(task, trials=DRAWN).drawn_with(rng, ahead)[:trials]


def _trial_rows(name: str, behaviour: Behaviour) -> pd.DataFrame:
    """Return decisions as a table; responses forced by the deadline are missed."""
    decision, missed = behaviour.decision, behaviour.missed
    columns = {
        "task": name,
        "trial": np.arange(len(missed)),
        "rt_ms": np.where(missed, np.nan, decision.time_ms),
        "correct": np.where(missed, np.nan, decision.choice == decision.truth),
        "anticipatory": behaviour.anticipatory.astype(float),
        "ssd_ms": np.nan if behaviour.ssd_ms is None else behaviour.ssd_ms,
        "deadline_ms": decision.deadline_ms,
    }
    return pd.DataFrame(columns)[list(OF_TRIALS)]

"""A circuit takes the tasks of the exam: thresholds, choices and times, and rates in windows."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from bgmodel.bootstrap import FEWEST_TRIALS
from bgmodel.comparison.tuned import fastest_gain
from bgmodel.deciding.measures import Behaviour
from bgmodel.deciding.tradeoff import Tradeoff, decides_without_evidence
from bgmodel.evidence import Evidence
from bgmodel.exam.examinee import Examinee, once, refused
from bgmodel.exam.numbers import Task
from bgmodel.exam.tables import NAMES, OF_TRIALS, Failed, Tables, Unanswered
from bgmodel.exam.windows import STOP_DELAY_MS, STOP_NATS, rate_rows, rest_rows
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.deciding import behaviour_of, refined
from bgmodel.simulated_evidence import expecting, gaussian_evidence
from bgmodel.stopping.circuit import receiving
from bgmodel.stopping.inputs import StopSignal, with_stop
from bgmodel.stopping.task import StopTask, decided
from bgmodel.support.arrays import Array
from bgmodel.support.seeds import stream
from circuits.circuit import Circuit
from circuits.declaration.table import NATS
from circuits.engines import engine_of
from circuits.errors import InputError, collected, quiet

DRAWN = 4000
"""Trials that are drawn for each kind of task: a task takes the first of them, so that those with
the same number share their readings, whatever the number of trials."""
TUNING_TRIALS = 500
TUNING = "tuning"
"""Name of the stream of trials on which thresholds and gains are chosen."""
FOREPERIOD_MS = 500.0
MOST_MISSED = 0.5


@dataclass(frozen=True)
class Sitting:
    """One examinee with a seed: its models, thresholds and tables, each computed once."""

    examinee: Examinee
    tasks: dict[str, Task]
    seed: int
    share: float = 1.0
    workers: int = 1
    kept: dict[Any, Any] = field(default_factory=dict, repr=False)
    """What was computed, or why it was not."""

    @classmethod
    def of_evidence(cls, tasks: dict[str, Task], seed: int) -> Sitting:
        """Return a sitting of no circuit, which draws the evidence of tasks."""

        def nobody(channels: int) -> Circuit:
            raise Unanswered("there is no circuit")

        return cls(Examinee("nobody", nobody), tasks, seed)

    @once
    def circuit(self, channels: int) -> Circuit:
        """Return the circuit for a number of alternatives."""
        try:
            return self.examinee.build(channels)
        except InputError as error:
            raise Unanswered(str(error)) from None

    @once
    def tuned(self, channels: int) -> tuple[BasalGanglia, Tradeoff]:
        """Return the unedited model and its decisions on trials that are used for nothing else."""
        circuit = self.circuit(channels)
        engine = engine_of(self.examinee.engine_for(circuit)).tuned(workers=self.workers)
        evidence = self.drawn(Task(name="", about="", channels=channels), TUNING_TRIALS, TUNING)
        try:
            with quiet():
                return fastest_gain(circuit, engine, evidence, self.seed, self.examinee.gain)
        except ValueError as error:
            raise Failed(str(error)) from None

    @once
    def level(self, channels: int, accuracy: float) -> float:
        """Return the threshold at which the unedited circuit reaches an accuracy."""
        model, swept = self.tuned(channels)
        usual = self.drawn(Task(name="", about="", channels=channels), TUNING_TRIALS, TUNING)
        with quiet():
            swept = refined(model, usual, swept, (accuracy,))
        found = swept.at_accuracy(accuracy)
        missed = found.forced.mean()
        if not swept.reaches(accuracy) or missed > MOST_MISSED:
            raise Failed(
                f"with {channels} alternatives it does not reach an accuracy of {accuracy:g} by "
                f"evidence: the nearest is {found.posterior.mean():.2f}, {missed:.0%} decided by "
                "the deadline"
            )
        return float(found.settings[0])

    def drawn(self, task: Task, trials: int, *names: str) -> Evidence:
        """Return the first trials of a task; tasks of one kind share their random numbers."""
        rng = stream(self.seed, "exam", f"{task.channels} {task.step_ms:g}", *names)
        with quiet():
            found = gaussian_evidence(
                DRAWN, d_prime=task.d_prime, channels=task.channels, t_max=task.readings,
                step_ms=task.step_ms, conflict=task.conflict, seed=rng,
            )[:trials]  # fmt: skip
            found = replace(found, log_likelihood=found.log_likelihood + _added(task, found))
        if task.expectancy_nats:
            rng = stream(self.seed, "exam", "expectancy", *names)
            found = expecting(found, task.expectancy_nats, task.expectancy_ms, rng=rng)
        return found

    def model(self, task: Task) -> BasalGanglia:
        """Return the model of a task, edited."""
        model, _ = self.tuned(task.channels)
        if not task.edits:
            return model
        if any(line.startswith(("rebound", "compensate")) for line in task.edits):
            self._check_nats("an edit of resting rates in nats")
        try:
            with collected() as doubts:
                edited = replace(model, circuit=model.circuit.edited(*task.edits))
        except ValueError as error:
            raise Unanswered(str(error)) from None
        if doubts:
            raise Unanswered(doubts[0])
        return edited

    def _check_nats(self, what: str) -> None:
        if (unit := self.circuit(2).unit) != NATS:
            raise Unanswered(f"{what} needs a circuit that works in nats, not in {unit}")

    def _check_raw(self, task: Task, model: BasalGanglia) -> None:
        if task.common_nats and not model.raw:
            raise Unanswered(
                "the mean over channels is taken from its evidence, so that it cannot tell good "
                "alternatives from bad ones"
            )

    @once
    def trials_of(self, name: str) -> pd.DataFrame:
        """Return the trials of a task, with the columns of ``tables.OF_TRIALS``."""
        task = self.tasks[name]
        count = max(FEWEST_TRIALS, round(self.share * task.trials)) if task.trials else 0
        if not count:
            raise Unanswered(f"the task {name!r} records rates only")
        level, model = self.level(task.channels, task.accuracy), self.model(task)
        self._check_raw(task, model)
        evidence = self.drawn(task, count)
        with quiet():
            found = self._behaviour(task, model, evidence, level)
        anticipatory, premature = found.anticipatory.mean(), found.decision.premature.mean()
        wait_ms = task.expectancy_ms or FOREPERIOD_MS
        if not task.edits and decides_without_evidence(premature, anticipatory, wait_ms):
            raise Failed(f"it decides without evidence in the task {name!r}")
        return _trial_rows(name, found)

    def _behaviour(
        self, task: Task, model: BasalGanglia, evidence: Evidence, level: float
    ) -> Behaviour:
        stopping = None
        with refused():
            if task.stop_share:
                self._check_nats("a stop signal in nats")
                signal = StopTask(
                    share=task.stop_share, delays_ms=task.stop_delays_ms,
                    amount_nats=STOP_NATS, delay_ms=STOP_DELAY_MS,
                )  # fmt: skip
                stopping = decided(signal, model, evidence, level, stream(self.seed, "stops"))
            return behaviour_of(model, evidence, level, FOREPERIOD_MS, stopping)

    @once
    def rates_of(self, name: str) -> pd.DataFrame:
        """Return the rates of a task, with the columns of ``tables.OF_RATES``."""
        task = self.tasks[name]
        count = max(FEWEST_TRIALS, round(self.share * task.rate_trials))
        if task.windows == ("rest",):
            circuit = self.circuit(task.channels)
            engine = engine_of(self.examinee.engine_for(circuit))
            engine = engine.tuned(workers=self.workers, rates=True, sample_ms=5.0)
            with quiet(), refused():  # the gain has no effect without evidence
                return rest_rows(task, BasalGanglia(circuit, engine, 1.0, self.seed), count)
        level, model = self.level(task.channels, task.accuracy), self.model(task)
        evidence = self.drawn(task, count)
        evidence = replace(
            evidence, log_likelihood=evidence.log_likelihood[:, : task.rate_readings]
        )
        engine = model.engine.tuned(workers=self.workers, rates=True, sample_ms=5.0)
        model = replace(model, engine=engine)
        if "signal" in task.windows:
            self._check_nats("a stop signal in nats")
        if task.stop_share:
            signal = StopSignal(amount_nats=STOP_NATS, delay_ms=STOP_DELAY_MS)
            with refused():
                model = receiving(model, signal)
            evidence = with_stop(evidence, np.full(count, task.stop_delays_ms[0]), signal)
        with quiet(), refused():
            return pd.concat(rate_rows(task, model, evidence, level), ignore_index=True)

    @cached_property
    def abstract(self) -> frozenset[str]:
        """Nuclei whose rates are not those of cells."""
        names: set[str] = set()
        for channels in {task.channels for task in self.tasks.values()}:
            try:
                rows = self.circuit(channels).populations
            except Unanswered:
                continue
            names |= {row.name for row in rows if not row.spiking}
        for name, parts in NAMES.items():
            names |= {name} if names & set(parts) else set()
        return frozenset(names)

    def tables(self, trials: list[str], rates: list[str]) -> tuple[Tables, dict[str, Exception]]:
        """Return the tables of some tasks, and for each that was not done, why."""
        parts: dict[str, list[pd.DataFrame]] = {"trials": [], "rates": []}
        undone: dict[str, Exception] = {}
        for kind, names in (("trials", trials), ("rates", rates)):
            for name in names:
                try:
                    parts[kind].append(getattr(self, f"{kind}_of")(name))
                except (Unanswered, Failed) as reason:
                    undone[f"{kind} {name}"] = reason
        whole = {kind: pd.concat(some, ignore_index=True) for kind, some in parts.items() if some}
        return Tables(**whole, abstract=self.abstract), undone


def _added(task: Task, evidence: Evidence) -> Array:
    """Return what a task adds to each reading, (trials, 1, channels), nats.

    The mean evidence of the true channel is raised or lowered, and that of all channels together
    stays the same, as with dots of another coherence.
    """
    assert evidence.truth is not None
    true = np.arange(task.channels) == evidence.truth[:, None]
    lead = (task.coherence - 1) * task.d_prime**2 / 2
    added: Array = (lead * (true - 1 / task.channels) + task.common_nats)[:, None, :]
    return added


def _trial_rows(name: str, found: Behaviour) -> pd.DataFrame:
    """Return decisions as a table; responses forced by the deadline are missed."""
    decision, missed = found.decision, found.missed
    columns = {
        "task": name,
        "trial": np.arange(len(missed)),
        "rt_ms": np.where(missed, np.nan, decision.time_ms),
        "correct": np.where(missed, np.nan, decision.choice == decision.truth),
        "anticipatory": found.anticipatory.astype(float),
        "ssd_ms": np.nan if found.ssd_ms is None else found.ssd_ms,
        "deadline_ms": decision.deadline_ms,
    }
    return pd.DataFrame(columns)[list(OF_TRIALS)]

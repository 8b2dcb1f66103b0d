"""One record of a run: circuit, edits, engine, gain, seed, task and stopping rule.

Experiments, sweeps, comparisons, learning and the commands share it, so that each setting is
declared and checked in one place.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from bgmodel import names
from bgmodel.evidence import needed_truth
from bgmodel.integrators.sprt import threshold_from_posterior
from bgmodel.names import CircuitName, EngineName
from bgmodel.stopping.task import STREAM as SIGNALS
from bgmodel.stopping.task import StopTask, decided
from bgmodel.support import toml_files
from bgmodel.support.checks import whole
from bgmodel.support.seeds import stream
from bgmodel.task import Gaussian, Task
from bgmodel.trials.task_trials import EvidenceTable, read_once, trials_of
from circuits import DEFAULT
from circuits.checks import check_finite, check_positive, check_types
from circuits.declaration.edits import Edits
from circuits.errors import InputError, require

if TYPE_CHECKING:
    from bgmodel.deciding.decision import Decision
    from bgmodel.deciding.measures import Behaviour
    from bgmodel.evidence import Evidence
    from bgmodel.integrators.basal_ganglia import BasalGanglia
    from bgmodel.trials.named_evidence import NamedEvidence
    from circuits.circuit import Circuit

CIRCUIT = CircuitName(DEFAULT)
POSTERIOR = 0.82
"""Default stopping posterior. The default circuit's output tracks -ln P up to this posterior for
two to eight alternatives."""
STREAM = "circuit run"
"""Name of the random-number stream from which the evidence of a condition is drawn."""
ENGINE = EngineName("population")
"""Default engine: it includes spiking noise and is about fifty times as fast as spiking cells."""


@dataclass(frozen=True)
class Setup:
    """An edited circuit and its engine: everything that determines its output except the evidence.

    Raises
    ------
    ValueError
        For an unknown name, a number out of range, or an edit that the engine would ignore.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = toml_files.STRICT

    circuit: CircuitName = CIRCUIT
    """Name of the circuit, or the path of a .toml file."""
    edits: Edits = field(default_factory=Edits)
    """Differences from the table, one line each: "lesion STN 10%", "dopamine 0.9"."""
    engine: EngineName = ENGINE
    """Engine that runs the circuit: population is fast and includes the noise of finitely many
    cells; spikes simulates each of them; rate and algebra have no noise; plain and brian2 are
    slow, to be read or checked against."""
    gain: float | None = None
    """Nats in the circuit per nat of evidence, kappa (in a circuit of another unit, that unit per
    nat); if omitted the circuit's default, or the largest at which it tracks the evidence."""
    seed: int = 0
    """Seed of the noise and of randomly drawn evidence."""

    def __post_init__(self) -> None:
        # Looking up names imports all circuits and engines; command help must not need that.
        for name, default, kind in (
            ("circuit", CIRCUIT, CircuitName),
            ("engine", ENGINE, EngineName),
        ):
            value = getattr(self, name)
            if not isinstance(value, str) or value != default:
                names.check(name, value, kind)
        check_types(self, type(self).__name__)
        require(self.seed >= 0, "seed", "must be at least 0", self.seed)
        if self.gain is not None:
            check_positive(gain=self.gain)
        lines = self.edits
        many = isinstance(lines, list | tuple) and all(isinstance(line, str) for line in lines)
        listed = many or isinstance(lines, str)  # of which Edits says how it is written
        require(listed, "edits", "must be a list of lines", lines)
        object.__setattr__(self, "edits", Edits(lines))
        if self.edits:
            from circuits.differences import check_edits

            check_edits(self.edits, self.engine)

    def intact(self, channels: int | None = None) -> Circuit:
        """Return the circuit before its edits."""
        from circuits.anatomy import load_circuit

        return load_circuit(self.circuit, channels)

    def table(self, channels: int | None = None) -> Circuit:
        """Return the edited circuit, with one channel per alternative."""
        return self.intact(channels).edited(*self.edits)

    def model(
        self,
        channels: int | None = None,
        *,
        seed: int | None = None,
        workers: int | None = None,
        rates: bool | None = None,
        sample_ms: float | None = None,
    ) -> BasalGanglia:
        """Return the edited circuit as an integrator; by default with the noise of this record."""
        from bgmodel.integrators.basal_ganglia import BasalGanglia
        from circuits.engines import engine_of

        table = self.table(channels)
        engine = engine_of(self.engine).tuned(workers=workers, rates=rates, sample_ms=sample_ms)
        noise = (self.seed if seed is None else seed) if engine.noisy else None
        return BasalGanglia(table, engine, self.gain, noise)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Condition(Setup):
    """A circuit, its task and its stopping rule.

    Raises
    ------
    ValueError
        For an unknown name, a number out of range, an edit that the engine would ignore, or both a
        posterior and a threshold.
    """

    task: Task = field(default_factory=Gaussian)
    """The task: how the evidence is made."""
    posterior: float | None = None
    """Stopping posterior, in the circuit's nats; 0.82 if neither it nor a threshold is given."""
    threshold: float | None = None
    """Output (OUT) at which the circuit decides, in the circuit's unit; replaces the posterior."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(isinstance(self.task, Task), "task", "must be a task: Gaussian()", self.task)
        if self.threshold is not None:
            if self.posterior is not None:
                raise InputError("give posterior or threshold, not both", "posterior")
            check_finite(threshold=self.threshold)
        elif not isinstance(self.task, EvidenceTable):
            self.threshold_at(self.hypotheses)

    @property
    def hypotheses(self) -> int:
        """Number of alternatives, read from the evidence table if there is one."""
        return self.task.channels

    @property
    def trials(self) -> int:
        """Number of trials, read from the evidence table if there is one."""
        return self.task.trials

    def drawn(self, name: str) -> NamedEvidence:
        """Return the trials of the task, drawn from the random-number stream of that name."""
        return trials_of(self.task, self.seed, name)

    def threshold_at(self, hypotheses: int) -> float:
        """Return the output (OUT) at which the circuit decides, for a number of alternatives."""
        if self.threshold is not None:
            return self.threshold
        posterior = POSTERIOR if self.posterior is None else self.posterior
        return float(threshold_from_posterior(posterior, hypotheses))

    @property
    def stopping_posterior(self) -> float | None:
        """The posterior at which the circuit decides; None where a threshold is given."""
        if self.threshold is not None:
            return None
        return POSTERIOR if self.posterior is None else self.posterior

    @property
    def threshold_nats(self) -> float:
        """The output (OUT) at which the circuit decides."""
        return self.threshold_at(self.hypotheses)

    @property
    def stopping(self) -> str:
        """The posterior, or the threshold, at which the circuit decides, as text."""
        if self.threshold is not None:
            return f"threshold {self.threshold:g}"
        return f"{self.stopping_posterior:g}"

    @property
    def edited(self) -> Circuit:
        """The edited circuit for this task's alternatives."""
        table = self.table(self.hypotheses)
        if self.threshold is None:
            table.check_nats("a stopping posterior", "; give a threshold in its unit")
        return table

    def check(self, control: Condition | None = None) -> None:
        """Raise ValueError for errors that can be detected before a run.

        The control is by default this condition without its edits.
        """
        from bgmodel.integrators.criterion import check_threshold, gain_of

        gain_of(self.edited, self.gain)
        level = self.threshold_nats
        if control is None:
            check_threshold(self.intact(self.hypotheses), level)
        else:
            check_threshold(control.edited, control.threshold_nats)
        # An edited circuit that rests below its threshold is an outcome: it decides without
        # evidence. A threshold beyond the range of its read-out is none.
        if level < self.edited.readable_nats[0]:
            check_threshold(self.edited, level)

    def decide(self, *, workers: int = 1) -> Decision:
        """Draw the evidence and let the circuit decide, exactly as ``bgmodel circuit run`` does.

        Parameters
        ----------
        workers : int
            Number of threads, for engines that can use several; it does not affect results.
        """
        evidence = self.drawn(STREAM).evidence
        model = self.model(evidence.hypotheses, workers=workers, rates=False)
        return model.decide(evidence, self.threshold, posterior=self.stopping_posterior)

    def to_brian2_script(self, trial: int = 0) -> str:
        """Return a trial as a Brian2 script that needs no bgmodel; it runs on to its end."""
        trials = range(self.trials)
        require(trial in trials, "trial", f"must be within 0..{len(trials) - 1}", trial)
        evidence = self.drawn(STREAM).evidence
        model = self.model(evidence.hypotheses).adapted_to(evidence)
        model.check_strength(evidence)
        drive, step_ms = model.driven(evidence[trial : trial + 1])
        model.check_memory(1, drive.shape[1], step_ms)
        return model.circuit.to_brian2_script(drive, step_ms=step_ms, seed=self.seed, trial=trial)


@dataclass(frozen=True)
class Observed(Condition):
    """A condition whose behaviour is measured: choices, response times and anticipations."""

    foreperiod_ms: float = 500.0
    """Duration of the evidence-free foreperiod; responses within it count as anticipatory, ms."""
    stop: StopTask | None = None
    """Stop signals in a share of the trials; none by default."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.stop is not None and not isinstance(self.task, EvidenceTable):
            self.stop.check_ends(self.task.step_ms * self.task.t_max)
        # OUT is sampled every ms.
        whole("foreperiod_ms", self.foreperiod_ms, 1)

    def check(self, control: Condition | None = None) -> None:
        """Raise ValueError as ``Condition.check`` does, and for evidence without known truth."""
        if isinstance(self.task, EvidenceTable):
            needed_truth(read_once(self.task).evidence)
        super().check(control)

    @property
    def waited_ms(self) -> float:
        """Duration in which responses count as anticipatory: an informative foreperiod's, ms."""
        return self.task.expectancy_ms if self.task.expectancy_nats else self.foreperiod_ms

    def behaviour(
        self, model: BasalGanglia, evidence: Evidence, seed: int | None = None
    ) -> Behaviour:
        """Return the decisions of a model on evidence, at this condition's threshold."""
        from bgmodel.integrators.at_thresholds import behaviour_of

        level = self.threshold_at(evidence.hypotheses)
        if self.stop is None:
            return behaviour_of(model, evidence, level, self.foreperiod_ms)
        draws = stream(self.seed if seed is None else seed, SIGNALS)
        stopping = decided(self.stop, model, evidence, level, draws)
        return behaviour_of(model, evidence, level, self.foreperiod_ms, stopping)


def circuit_seen_from(folder: Path, name: str) -> str:
    """Return a circuit's name unchanged, or its path relative to the folder of the naming file."""
    from circuits.declaration.table_writer import is_path

    return str(folder / name) if is_path(name) else name


Asked = TypeVar("Asked", bound=Condition)


def seen_from(folder: Path, asked: Asked) -> Asked:
    """Return the contents of a file, with relative paths resolved against its folder."""
    circuit = type(asked.circuit)(circuit_seen_from(folder, asked.circuit))
    return replace(asked, circuit=circuit, task=asked.task.seen_from(folder))

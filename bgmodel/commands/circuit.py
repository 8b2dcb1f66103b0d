"""Commands on circuits: show the table, run it on evidence, export a trial."""

from __future__ import annotations

import importlib.util
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from tyro.conf import OmitArgPrefixes, Positional

from bgmodel.commands.checks import (
    Writes,
    bar,
    check_ending,
    check_whole,
    made_with,
    save_figure,
    say_before,
    say_of_edits,
)
from bgmodel.conditions import STREAM, Condition
from bgmodel.deciding.decision import Decision
from bgmodel.names import MACAQUE, CircuitName, EngineName
from bgmodel.support import files
from bgmodel.tables import trials as tables
from circuits.declaration.edits import Edits
from circuits.errors import BgmodelWarning, InputError, require

if TYPE_CHECKING:
    import pandas as pd

    from bgmodel.evidence import Evidence
    from bgmodel.integrators.basal_ganglia import BasalGanglia
    from circuits.activity import Activity
    from circuits.circuit import Circuit


@dataclass(frozen=True)
class CircuitShow(Writes):
    """Print a circuit's table, with its edits; draw it if a file is given.

    Examples: bgmodel circuit show macaque;
    bgmodel circuit show appendix_b --edits "lesion STN 50%" --drawing circuit.pdf;
    bgmodel circuit show --edits "set STN->GPe.delay_ms 4" "add D1->GPe weight=-0.1";
    bgmodel circuit show macaque --channels 4 --save mine.toml; bgmodel circuit show mine.toml
    """

    circuit: Positional[CircuitName] = MACAQUE
    """Name of the table, or the path of a .toml file."""
    channels: int | None = None
    """Number of alternatives; by default 2, or that of the file."""
    edits: Edits = field(default_factory=Edits)
    """Edits of the circuit, each in quotes: "lesion STN 10%" "dopamine 0.9"."""
    drawing: Path | None = None
    """File for a drawing, .pdf, .svg or .png."""
    save: Path | None = None
    """File to save the edited table to, .toml."""
    rest: bool = False
    """Whether to run it without evidence too, and print resting rates, their irregularity, and what
    an input of one unit means in Hz, pA and nS."""
    noise: float | None = None
    """Posterior, such as 0.85, at which to print the noise of OUT and its sources."""

    def __call__(self) -> None:
        """Run the command."""
        from circuits.anatomy import load_circuit

        if self.save is not None:
            check_ending("save", self.save, ".toml")
        table = load_circuit(self.circuit, self.channels).edited(*self.edits)
        scatter = None if self.noise is None else _scatter(table, self.noise)
        if self.drawing is not None:
            check_ending("drawing", self.drawing, ".pdf", ".svg", ".png")
            before = load_circuit(self.circuit, self.channels)
            save_figure(table.plot(reference=before), self.drawing)
        print(table)
        if edits := self.edits.text():
            print(f"\nedited, in this order: {edits}")
            say_of_edits(self.edits)
        if self.rest and not any(row.spiking for row in table.populations):
            print("\nthis circuit has no spiking cells")
        elif self.rest:
            from bgmodel.integrators.criterion import doubts
            from bgmodel.integrators.steady import resting_activity

            for said in doubts(table):
                BgmodelWarning.warn(said)
            print("\nwithout evidence, 4 trials of 5 s:")
            found = resting_activity(table, seed=0)
            print(found.to_string(index=False, float_format="{:.2f}".format))
        if self.rest:
            print(f"\nan input of 1 {table.unit.removesuffix('s')} to one nucleus at rest:")
            effects = table.effect_of_nats()
            print(effects.to_string(index=False, float_format="{:.3g}".format))
        if scatter is not None:
            print(f"\n{scatter}")
        if self.save is not None:
            from circuits.declaration.table_files import write

            print(f"\n{table.name}, {table.channels} channels -> {write(table, self.save)}")


def _scatter(table: Circuit, posterior: float) -> str:
    """Return one line on the noise of the favoured channel's OUT."""
    from bgmodel.integrators.steady import leader_drive
    from circuits.laws.spectra import out_variance

    table.check_nats("a posterior (--noise)")
    # Within the range of the read-out, and above chance.
    low = max(float(np.exp(-table.readable_nats[1])), 1 / table.channels)
    high = float(np.exp(-table.readable_nats[0]))
    require(
        low < posterior < high,
        "noise",
        f"must be a posterior that {table.name} reads, {low:.2f} to {high:.2f}",
        posterior,
    )
    if not any(row.spiking for row in table.populations):
        return "OUT has no noise: the circuit has no cells"
    odds = np.log(posterior * (table.channels - 1) / (1 - posterior))
    drive = leader_drive(odds, table.channels)[0, 0]
    variance = {k: v[0] for k, v in out_variance(table, drive).items()}
    total = sum(variance.values())
    shares = ", ".join(f"{name} {part / total:.0%}" for name, part in variance.items())
    return (
        f"at a posterior of {posterior:g} the noise of OUT is {np.sqrt(total):.3f} nats (sd, "
        f"linear theory); shares of its variance: {shares}"
    )


@dataclass(frozen=True)
class CircuitExport(Writes):
    """Write one trial as a Brian2 script that needs no bgmodel, and has the spikes of this circuit.

    The trial is that of `circuit run` with the same options, which runs on to its end.

    Examples: bgmodel circuit export trial.py --t-max 10;
    bgmodel circuit export lesioned.py --trial 3 --edits "lesion STN 10%"
    """

    output: Positional[Path]
    """File for the script, .py."""
    condition: OmitArgPrefixes[Condition] = field(
        default_factory=lambda: Condition(engine=EngineName("brian2"))
    )
    trial: int = 0
    """Number of the trial, from 0."""

    def __call__(self) -> None:
        """Run the command."""
        asked = self.condition
        check_ending("output", self.output, ".py")
        for name, only in (("engine", "brian2"), ("posterior", None), ("threshold", None)):
            given = getattr(asked, name)
            require(given == only, name, "has no effect on a script: leave it out", given)
        trials = range(asked.trials)
        require(self.trial in trials, "trial", f"must be within 0..{len(trials) - 1}", self.trial)
        evidence = asked.drawn(STREAM).evidence
        model = asked.model(evidence.hypotheses).adapted_to(evidence)
        model.check_strength(evidence)
        drive, step_ms = model.driven(evidence[self.trial : self.trial + 1])
        model.check_memory(1, drive.shape[1], step_ms)
        text = model.circuit.to_brian2_script(
            drive, step_ms=step_ms, seed=asked.seed, trial=self.trial
        )
        with files.replacing(self.output) as partial:
            partial.write_text(text, encoding="utf-8")
        print(f"trial {self.trial} of {model.circuit.name} -> {self.output}")


@dataclass(frozen=True)
class CircuitRun(Writes):
    """Run a circuit to decisions on Gaussian or tactile evidence or on your own evidence table.

    Examples: bgmodel circuit run decisions.csv --trials 100 --seed 1;
    bgmodel circuit run lesioned.csv --edits "lesion STN 10%" --engine rate
    """

    output: Positional[Path]
    """File for the table of trials, .parquet or .csv."""
    condition: OmitArgPrefixes[Condition] = field(default_factory=Condition)
    workers: int = 2
    """Threads, for engines that can use several; the results do not depend on it."""
    rates: Path | None = None
    """File for mean rates, .parquet or .csv."""
    spikes: Path | None = None
    """File for the spikes of the first trials, one row each, .parquet or .csv; these trials are run
    a second time, to their ends."""
    spike_trials: int = 10
    """Number of trials, from the first, whose spikes are written."""
    nwb: Path | None = None
    """File for spikes and rates of chosen trials, run a second time, to their ends, .nwb."""
    nwb_trials: tuple[int, ...] = (0,)
    """Numbers of these trials, from 0."""

    def __call__(self) -> None:
        """Run the command."""
        from circuits.activity import RateMeans

        self._check()
        asked = self.condition
        trials = asked.drawn(STREAM)
        evidence = trials.evidence
        say_of_edits(asked.edits)
        model = asked.model(evidence.hypotheses, workers=self.workers).adapted_to(evidence)
        posterior = asked.stopping_posterior
        threshold = model.threshold(asked.threshold, posterior)
        started = time.perf_counter()
        say_before("running", model, evidence)
        means = None if self.rates is None else RateMeans()
        with bar(evidence.trials):
            decision = model.decide(evidence, threshold, rates=means)
        # A table of evidence on an engine without noise: there is no noise.
        seed = asked.seed if asked.task.file is None or model.engine.noisy else None
        about = f"{model.circuit.name} {model.engine}"
        result = tables.trial_table(decision, trials, seed=seed, model=about)
        settled = replace(asked, gain=model.gain, posterior=posterior)
        behind = made_with(self, model, condition=settled)
        files.write_table(result, self.output, seed=seed, **behind)
        if self.rates is not None and means is not None:
            files.write_table(means.table(), self.rates, seed=seed, **behind)
        if self.spikes is not None:
            spikes = self._whole(model, evidence, 0, self.spike_trials).spike_table()
            files.write_table(spikes, self.spikes, seed=seed, **behind)
        if self.nwb is not None:
            from circuits.nwb import write_nwb

            whole = [self._whole(model, evidence, k, k + 1) for k in self.nwb_trials]
            write_nwb(whole, self.nwb, table=result.iloc[[*self.nwb_trials]])
        if asked.task.file is not None:
            print(trials.summary())
        known, seconds = evidence.truth is not None, time.perf_counter() - started
        self._say_decided(result, decision, known, seconds)

    @staticmethod
    def _whole(model: BasalGanglia, evidence: Evidence, first: int, last: int) -> Activity:
        """Return trials of a range, run to their ends, with spikes if the engine has any."""
        names = tuple(row.name for row in model.circuit.populations if row.spiking)
        model = replace(model, engine=model.engine.recording(names))
        return model.activity(evidence[first:last], first, checked=False)

    def _say_decided(
        self, result: pd.DataFrame, decision: Decision, known: bool, seconds: float
    ) -> None:
        """Print the number of decisions, their accuracy and mean time."""
        accuracy = f"accuracy {result['correct'].mean():.3f}" if known else "no truth given"
        print(
            f"{len(result)} trials, {accuracy}, mean time {np.nanmean(decision.time_ms):.0f} ms, "
            f"forced {result['forced'].sum()}, gain {decision.gain:g}, in {seconds:.1f} s -> "
            f"{self.output}"
        )

    def _check(self) -> None:
        """Raise ValueError for options that contradict each other, before long work starts."""
        from circuits.engines import engine_of

        check_ending("output", self.output, ".parquet", ".csv")
        check_whole(workers=self.workers)
        check_whole(spike_trials=self.spike_trials)
        trials, chosen = self.condition.trials, self.nwb_trials
        known = len(chosen) > 0 and all(k in range(trials) for k in chosen)
        require(known, "nwb_trials", f"must be within 0..{trials - 1}", chosen)
        if self.spikes is not None and not engine_of(self.condition.engine).spiking:
            raise InputError(
                f"the {self.condition.engine} engine has no spikes: leave --spikes out", "spikes"
            )
        tables_of = (".parquet", ".csv")
        for name, endings in (("rates", tables_of), ("spikes", tables_of), ("nwb", (".nwb",))):
            if (path := getattr(self, name)) is not None:
                check_ending(name, path, *endings)
                if name == "nwb" and importlib.util.find_spec("pynwb") is None:
                    raise ImportError('NWB needs pynwb: pip install ".[nwb]"')

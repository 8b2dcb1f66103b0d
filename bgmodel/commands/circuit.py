"""Commands on circuits: show the table, run it on evidence, export a trial."""

from __future__ import annotations

import importlib.util
import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from bgmodel.commands.options import FLAT, MANY, Edited, Workers, record
from bgmodel.commands.output import (
    TABLES,
    Files,
    Output,
    bar,
    check_ending,
    made_with,
    say_before,
    say_of_edits,
)
from bgmodel.conditions import ENGINE, STREAM, Condition
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.names import MACAQUE, CircuitName, EngineName
from bgmodel.stopping.task import StopTask
from bgmodel.support import files
from bgmodel.support.checks import whole
from bgmodel.support.references import sources_of
from bgmodel.task import Gaussian
from bgmodel.trials.named_evidence import trial_table
from circuits.activity import RateMeans
from circuits.anatomy import load_circuit
from circuits.declaration.edits import Edits
from circuits.errors import BgmodelWarning, require

BRIAN2 = EngineName("brian2")
SIGNALS = StopTask(share=0.5)
"""Stop signals that `--stop` changes."""
STOPPED = Gaussian(trials=4000, d_prime=0.35, step_ms=10.0, t_max=150)
"""The task with stop signals, unless another one is given: readings every 10 ms, so that response
times are not bound to few of them."""


def show(
    circuit: CircuitName = MACAQUE,
    /,
    *,
    channels: int | None = None,
    edits: Edited = Edits(),  # noqa: B008
    rest: bool = False,
    output: Annotated[Files, FLAT] = Files(),  # noqa: B008
) -> None:
    """Print a circuit's table, with its edits; draw it, or save it as a file to edit.

    Examples: bgmodel circuit show macaque --channels 4 --save mine.toml;
    bgmodel circuit show --edits "set STN->GPe.delay_ms 4" "add D1->GPe weight=-0.1" --plot a.pdf

    Parameters
    ----------
    circuit
        Name of the table, or the path of a .toml file.
    channels
        Number of alternatives; by default 2, or that of the file.
    rest
        Whether to run it without evidence too, and print resting rates, their irregularity, and
        what an input of one unit means in Hz, pA and nS.
    """
    output.check((".toml",), circuit=circuit)
    before = load_circuit(circuit, channels)
    table = before.edited(*edits)
    if rest:
        from bgmodel.integrators.criterion import doubts
        from bgmodel.integrators.steady import resting_activity
    print(f"{table}{sources_of([str(table)])}")
    if text := edits.text():
        print(f"\nedited, in this order: {text}")
        say_of_edits(edits, circuit=table)
    if rest and not any(row.spiking for row in table.populations):
        print("\nthis circuit has no spiking cells")
    elif rest:
        for doubt in doubts(table):
            BgmodelWarning.warn(doubt)
        print("\nwithout evidence, 4 trials of 5 s:")
        activity = resting_activity(table, seed=0)
        print(activity.to_string(index=False, float_format="{:.2f}".format))
    if rest:
        print(f"\nan input of 1 {table.unit.removesuffix('s')} to one nucleus at rest:")
        print(table.effect_of_nats().to_string(index=False, float_format="{:.3g}".format))
    output.draw(lambda: table.plot(reference=before))
    if output.save is not None:
        from circuits.declaration.table_writer import write

        print(f"\n{table.name}, {table.channels} channels -> {write(table, output.save)}")


def export(
    *,
    condition: Annotated[Condition, FLAT] = Condition(),  # noqa: B008
    trial: int = 0,
    output: Annotated[Files, FLAT] = Files(),  # noqa: B008
) -> None:
    """Write one trial as a Brian2 script that needs no bgmodel, and has the spikes of this circuit.

    The trial is that of `circuit run` with the same options, which runs on to its end.

    Example: bgmodel circuit export --save lesioned.py --trial 3 --edits "lesion STN 10%"

    Parameters
    ----------
    trial
        Number of the trial, from 0.
    """
    path = output.needed(".py", condition=condition)
    for name, usual in (("engine", ENGINE), ("posterior", None), ("threshold", None)):
        value = getattr(condition, name)
        known = value in (usual, BRIAN2)
        require(known, name, "has no effect on a script: leave it out", value)
    text = replace(condition, engine=BRIAN2).to_brian2_script(trial)
    with files.replacing(path) as partial:
        partial.write_text(text, encoding="utf-8")
    print(f"trial {trial} -> {path}")


def run(
    *,
    condition: Annotated[Condition, FLAT] = Condition(),  # noqa: B008
    stop: Annotated[
        StopTask | None, record(SIGNALS, "Stop signals in a share of the trials.")
    ] = None,
    save_rates: Path | None = None,
    save_spikes: Path | None = None,
    spike_trials: int = 10,
    save_nwb: Path | None = None,
    nwb_trials: Annotated[tuple[int, ...], MANY] = (0,),
    workers: Workers = 2,
    output: Annotated[Output, FLAT] = Output(),  # noqa: B008
) -> None:
    """Run a circuit to decisions on Gaussian or tactile evidence or on your own evidence table.

    With stop signals, prints the inhibition function (the share of responses at each delay of the
    signal) and the stop-signal reaction time, and says by which method it should be estimated.
    Without --task it then decides 4 000 trials of d' 0.35 with a reading every 10 ms; any --task
    replaces all of these.

    Examples: bgmodel circuit run --edits "lesion STN 10%" --task trials=100 --save decisions.csv;
    bgmodel circuit run --task trials=4000 d_prime=0.35 step_ms=10 t_max=150 --stop delay_ms=60

    Parameters
    ----------
    save_rates
        File for mean rates, .parquet or .csv.
    save_spikes
        File for the spikes of the first trials, one row each, .parquet or .csv; these trials are
        run a second time, to their ends.
    spike_trials
        Number of trials, from the first, whose spikes are written.
    save_nwb
        File for spikes and rates of chosen trials, run a second time, to their ends, .nwb.
    nwb_trials
        Numbers of these trials, from 0.
    """
    more: dict[str, Any]
    more = {"save_rates": save_rates, "save_spikes": save_spikes, "save_nwb": save_nwb}
    output.check(condition=condition, **more)
    whole("spike_trials", spike_trials, 1)
    if stop is not None and condition.task == Gaussian():
        condition = replace(condition, task=STOPPED)
    _check_files(condition, stop, nwb_trials, **more)
    trials = condition.drawn(STREAM)
    evidence = trials.evidence
    rates = None if stop is None else False
    model = condition.model(evidence.hypotheses, workers=workers, rates=rates).adapted_to(evidence)
    say_of_edits(condition.edits, circuit=model.circuit)
    posterior = condition.stopping_posterior
    threshold = model.threshold(condition.threshold, posterior)
    settled = replace(condition, gain=model.gain, posterior=posterior)
    started = time.perf_counter()
    say_before("running", model, evidence)
    if stop is not None:
        _stop(model, evidence, stop, threshold, settled, output)
        return
    means = None if save_rates is None else RateMeans()
    with bar(evidence.trials):
        decision = model.decide(evidence, threshold, rates=means)
    # A table of evidence on an engine without noise: there is no noise.
    seed = condition.seed if condition.task.file is None or model.engine.noisy else None
    about = f"{model.circuit.name} {model.engine}"
    result = trial_table(decision, trials, seed=seed, model=about, condition=condition.edits.text())
    behind: dict[str, Any] = {"seed": seed, **made_with(model, condition=settled)}
    if condition.task.file is not None:
        output.note(trials.summary())
    scored = "no truth given"
    if evidence.truth is not None:
        scored = f"accuracy {result['correct'].mean():.3f}"
    text = (
        f"{len(result)} trials, {scored}, mean time {np.nanmean(decision.time_ms):.0f} ms, "
        f"forced {result['forced'].sum()}, gain {decision.gain:g}, in "
        f"{time.perf_counter() - started:.1f} s"
    )
    output.show(text, result, gain=decision.gain, circuit=model.circuit.name)
    output.write(result, **behind)
    output.draw(decision.plot)
    if save_rates is not None and means is not None:
        files.write_table(means.table(), save_rates, **behind)
        output.note(f"-> {save_rates}")
    recorded = model.with_spikes()
    if save_spikes is not None:
        spikes = recorded.activity(evidence[:spike_trials], checked=False).spike_table()
        behind["command"] |= {"spike_trials": spike_trials}
        files.write_table(spikes, save_spikes, **behind)
        output.note(f"-> {save_spikes}")
    if save_nwb is not None:
        from circuits.nwb import write_nwb

        every = [recorded.activity(evidence[k : k + 1], k, checked=False) for k in nwb_trials]
        write_nwb(every, save_nwb, table=result.iloc[[*nwb_trials]])
        output.note(f"-> {save_nwb}")


def _check_files(
    condition: Condition, stop: StopTask | None, nwb_trials: tuple[int, ...], **files_by_name: Any
) -> None:
    """Raise ValueError for files that contradict other options, before long work starts."""
    from circuits.engines import engine_of

    engine, trials, task = engine_of(condition.engine), condition.trials, condition.task
    known = len(nwb_trials) > 0 and all(k in range(trials) for k in nwb_trials)
    require(known, "nwb_trials", f"must be within 0..{trials - 1}", nwb_trials)
    if stop is not None and task.file is None:
        stop.check_ends(task.step_ms * task.t_max)
    for name, path in files_by_name.items():
        if path is not None:
            require(stop is None, name, "has no effect with stop signals: leave it out", str(path))
            check_ending(name, path, *(TABLES if name != "save_nwb" else (".nwb",)))
    spikes, nwb = files_by_name["save_spikes"], files_by_name["save_nwb"]
    must = f"must be left out: the {engine.id} engine has no spikes"
    require(spikes is None or engine.spiking, "save_spikes", must, str(spikes))
    if nwb is not None and importlib.util.find_spec("pynwb") is None:
        raise ImportError('NWB needs pynwb: pip install ".[nwb]"')


def _stop(
    model: BasalGanglia, evidence: Evidence, stop: StopTask, level: float, made: Condition,
    output: Output,
) -> None:  # fmt: skip
    """Let the circuit decide with stop signals in a share of the trials."""
    from bgmodel.stopping.estimates import draw, reported

    with bar((len(stop.delays_ms) if stop.staircases else 1) * evidence.trials):
        trials = stop.decide(model, evidence, threshold=level, seed=made.seed)
    text, table, facts = reported(trials, stop)
    output.show(text, table, **facts)
    output.write(trials.to_dataframe(), made.seed, **made_with(model, condition=made, stop=stop))
    output.draw(lambda: draw(trials))

"""The best task as an experiment that runs: edits of one circuit, and predictions made before."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from bgmodel.discriminating.designs import Design, TaskInformation
from bgmodel.discriminating.information import CORRECT, MISSED, Recorded
from bgmodel.discriminating.space import Probe, Space
from bgmodel.discriminating.trials import Trials
from bgmodel.experiments.expected import Expected
from bgmodel.experiments.experiment import Experiment
from bgmodel.experiments.models import Model
from bgmodel.experiments.record import Changes
from bgmodel.names import CircuitName, EngineName
from bgmodel.stopping.task import StopTask
from bgmodel.support.arrays import Array
from circuits.anatomy import checked_circuit
from circuits.declaration.edits import Edits
from circuits.declaration.table_writer import is_path
from circuits.differences import differences
from circuits.errors import InputError, quiet

FEWEST, MOST = 400, 4000
"""Trials of an experiment per condition: four times the median that is needed, within these."""
PREDICTED = 1000
"""Trials from which changes are predicted."""
CLEAR = 3.0
"""A change is predicted if it is larger than this many standard errors."""


def planned(
    models: tuple[Model, Model],
    check: TaskInformation[Design],
    space: Space,
    median: float,
    verdict: str,
    seed: int,
    folder: str | Path = ".",
) -> Experiment:
    """Return the best task as an experiment: the second model against the first."""
    probe, design = check.design.probe, check.design
    first, second = models = models[0], edited_from(*models, channels=probe.channels)
    _check_order(models, probe)
    levels = [way.levels[0] for way in check.directions]
    if min(levels) <= 0:
        reason = "the threshold of a model is not a posterior: OUT at its decision is 0 or less"
        raise InputError(reason, "second")
    stop = None
    if probe.stop_nats:
        delays = (space.stop_delay_ms,)
        stop = StopTask(amount_nats=probe.stop_nats, share=space.share, delays_ms=delays)
    control, manipulation = (
        Changes(edits=one.edits, posterior=round(float(np.exp(-level)), 4))
        for one, level in zip(models, levels, strict=True)
    )
    trials = int(np.clip(np.ceil(4 * median), FEWEST, MOST)) if np.isfinite(median) else MOST
    # The circuit's trials end a step after the last reading.
    readings = max(1, round(design.deadline_ms / space.step_ms) - 1)
    circuit = first.source
    if is_path(circuit):
        circuit = os.path.relpath(circuit, folder)
    return Experiment(
        name=f"{second.name} against {first.name}",
        note=f"Planned by bg.discriminate: {verdict}. These are the probe trials of the best "
        f"task ({design.text()}); each condition has its matched threshold.",
        circuit=CircuitName(circuit),
        edits=Edits(probe.lines),
        engine=EngineName(first.engine or "population"),
        seed=seed + 2,
        task=space.task(probe, trials, readings),
        stop=stop,
        control=control,
        manipulation=manipulation,
        predictions=_predictions(Trials(models, space, seed, PREDICTED), check),
    )  # fmt: skip


def edited_from(first: Model, second: Model, channels: int | None = None) -> Model:
    """Return the second model as edits of the first one's circuit, before the edits of either."""
    for model in (first, second):
        if not model.source:
            reason = "an experiment changes one circuit, given by name or file"
            raise InputError(f"{reason}, which {model.name} is not", "second")
    if first.source == second.source:
        return second
    circuits = [checked_circuit(model.source, channels) for model in (first, second)]
    edits = Edits([*differences(*circuits), *second.edits])
    return replace(second, source=first.source, edits=edits)


def _check_order(models: tuple[Model, Model], probe: Probe) -> None:
    """Raise ValueError if one list of edits would not do what was done one after the other."""
    if probe.edits and any(one.edits.compensates for one in models):
        raise InputError(
            "in one list of edits compensation comes last, and would undo the manipulation "
            f"({probe.edits}) of a model that has compensated before",
            "edits",
        )


def _predictions(trials: Trials, check: TaskInformation[Design]) -> tuple[Expected, ...]:
    """Return the changes of probe trials that are clear, half of each as the least."""
    design = check.design
    with quiet():
        first, second = (
            trials.simulated(k, design.probe).at(way.levels[0], design.deadline_ms)
            for k, way in enumerate(check.directions)
        )
    made = []
    for name, (control, manipulation) in _measures(first, second, design.probe).items():
        if (size := _clear(control, manipulation)) is not None:
            way: Literal["up", "down"] = "up" if size > 0 else "down"
            made.append(Expected(name, way, float(f"{abs(size) / 2:.1g}")))
    return tuple(made)


def _measures(first: Recorded, second: Recorded, probe: Probe) -> dict[str, tuple[Array, Array]]:
    """Return the values of each measure in the trials of both models; NaN where it is undefined."""
    both = first, second
    missed = [one.choice == MISSED for one in both]
    if probe.stop_nats:
        return {"p_respond": (1.0 - missed[0], 1.0 - missed[1])}
    right = [
        np.where(gone, np.nan, m.choice == CORRECT) for gone, m in zip(missed, both, strict=True)
    ]
    times = [np.where(gone, np.nan, m.time_ms) for gone, m in zip(missed, both, strict=True)]
    return {
        "accuracy": (right[0], right[1]),
        "mean_ms": (times[0], times[1]),
        "missed": (missed[0] + 0.0, missed[1] + 0.0),
    }


def _clear(first: Array, second: Array) -> float | None:
    """Return the change from the first to the second, or None if it is within the error."""
    change = float(np.nanmean(second) - np.nanmean(first))
    errors = [np.nanstd(x) / np.sqrt(max(1, np.isfinite(x).sum())) for x in (first, second)]
    error = float(np.hypot(*errors))
    return change if abs(change) > CLEAR * error else None

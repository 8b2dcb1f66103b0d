"""The best task as an experiment that runs: edits of one circuit, and predictions made before."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from bgmodel.conditions import CircuitName
from bgmodel.discriminating.designs import Design
from bgmodel.discriminating.information import CORRECT, MISSED
from bgmodel.discriminating.models import Model
from bgmodel.discriminating.trials import Trials
from bgmodel.exam.examinee import quiet
from bgmodel.experiments.experiment import Experiment
from bgmodel.experiments.predictions import Prediction
from bgmodel.experiments.record import Changes
from bgmodel.names import EngineName
from bgmodel.stimuli import Stimuli
from bgmodel.stopping.task import StopTask
from circuits.declaration.edits import Edits
from circuits.errors import InputError

if TYPE_CHECKING:
    from bgmodel.discriminating.result import Discrimination

FEWEST, MOST = 400, 4000
"""Trials of an experiment per condition: four times the median that is needed, within these."""
CLEAR = 3.0
"""A change is predicted if it is larger than this many standard errors."""


def planned(found: Discrimination) -> Experiment:
    """Return the best task as an experiment; see ``Discrimination.experiment``."""
    first, second = found.models
    design = found.check.design
    _check_one_circuit(first, second, design)
    levels = [way.levels[0] for way in found.check.directions]
    if min(levels) <= 0:
        said = "the threshold of a model is not a posterior: OUT at its decision is 0 or less"
        raise InputError(said, "second")
    median = found.sequential["median"].max()
    trials = int(np.clip(np.ceil(4 * median), FEWEST, MOST)) if np.isfinite(median) else MOST
    probe, space = design.probe, found.space
    stop = None
    if probe.stop_nats:
        delays = (space.stop_delay_ms,)
        stop = StopTask(amount_nats=probe.stop_nats, share=space.share, delays_ms=delays)
    control, manipulation = (
        Changes(edits=one.edits, posterior=round(float(np.exp(-level)), 4))
        for one, level in zip((first, second), levels, strict=True)
    )
    path = Path(first.source)
    return Experiment(
        name=f"{second.name} against {first.name}",
        note=f"Planned by bgmodel discriminate: {found.sentence()}. These are the probe trials of "
        f"the best task ({design.text()}); each condition has its matched threshold.",
        circuit=CircuitName(path.resolve() if path.suffix == ".toml" else first.source),
        edits=Edits(probe.edits),
        engine=EngineName(first.engine),
        seed=int(found.settings["check_seed"]) + 2,
        task=Stimuli(
            channels=probe.channels, d_prime=probe.d_prime, conflict=probe.conflict, trials=trials,
            t_max=max(1, round(design.deadline_ms / space.step_ms) - 1), step_ms=space.step_ms,
        ),
        stop=stop,
        control=control,
        manipulation=manipulation,
        predictions=_predictions(found, design),
    )  # fmt: skip


def _check_one_circuit(first: Model, second: Model, design: Design) -> None:
    """Raise ValueError unless one file can hold both models."""
    if not first.source or first.source != second.source:
        raise InputError(
            f"an experiment changes one circuit, given by name or file, and {first.name} and "
            f"{second.name} are no edits of one",
            "second",
        )
    if design.probe.edits and any(one.edits.compensates for one in (first, second)):
        raise InputError(
            "in one list of edits compensation comes last, and would undo the manipulation "
            f"({'; '.join(design.probe.edits)}) of a model that has compensated before",
            "edits",
        )


def _predictions(found: Discrimination, design: Design) -> tuple[Prediction, ...]:
    """Return the changes of probe trials that the check makes clear, half of each as the least."""
    settings = found.settings
    space = found.space
    trials = Trials(found.models, space, settings["check_seed"], settings["trials"])
    with quiet():
        both = [
            trials.simulated(k, design.probe).at(way.levels[0], design.deadline_ms)
            for k, way in enumerate(found.check.directions)
        ]
    measures = (
        {"p_respond": lambda one: (one.choice != MISSED).astype(float)}
        if design.probe.stop_nats
        else {
            "accuracy": lambda one: np.where(one.choice == MISSED, np.nan, one.choice == CORRECT),
            "mean_ms": lambda one: np.where(one.choice == MISSED, np.nan, one.time_ms),
            "missed": lambda one: (one.choice == MISSED).astype(float),
        }
    )
    made = []
    for name, of in measures.items():
        if (size := _clear(of(both[0]), of(both[1]))) is not None:
            way: Literal["up", "down"] = "up" if size > 0 else "down"
            made.append(Prediction(name, way, float(f"{abs(size) / 2:.1g}")))
    return tuple(made)


def _clear(first: np.ndarray, second: np.ndarray) -> float | None:
    """Return the change from the first to the second, or None if it is within the error."""
    change = float(np.nanmean(second) - np.nanmean(first))
    error = np.hypot(
        *(np.nanstd(x) / np.sqrt(max(1, np.isfinite(x).sum())) for x in (first, second))
    )
    return change if abs(change) > CLEAR * error else None

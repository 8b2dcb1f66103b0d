"""How many more trials of recorded cells tell two encodings of them apart, from a pilot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from bgmodel.discriminating import sequential
from bgmodel.discriminating.designs import Direction, TaskInformation, row
from bgmodel.discriminating.information import Information
from bgmodel.discriminating.result import Discrimination
from bgmodel.discriminating.space import Sessions
from bgmodel.experiments.models import DecisionModel
from bgmodel.fit_trials import question
from bgmodel.fitting.cells.encoding import encoding_of
from bgmodel.fitting.cells.model import CellsLikelihood
from bgmodel.fitting.cells.sessions import FEWEST_SPIKES, RecordedSession, sessions_of
from bgmodel.fitting.optimum import optimum
from bgmodel.fitting.settings import FitSettings
from bgmodel.support.processes import shared_map
from bgmodel.support.seeds import stream
from bgmodel.trials.record import Trials
from bgmodel.trials.spikes import APART, without_silent
from circuits.arrays import Array
from circuits.errors import InputError, quiet, require

PILOTS, FEWEST_PILOTS = 10, 4
"""Simulated pilots for either encoding being true: by default, and at least."""
FEWEST_TRIALS = 50
"""Least number of trials of a session: each cell has eight numbers that are fitted."""
_Fitted = tuple[CellsLikelihood, Array]
"""The likelihood of an encoding, and the numbers of a fit."""


def told_apart(
    encodings: tuple[Any, Any], recorded: Any, *, pilots: int, least: int, seeds: tuple[int, int],
    workers: int, tell: Callable[[str], None],
) -> Discrimination:  # fmt: skip
    """Return the further trials that tell two encodings apart; see ``discriminate``."""
    likelihoods = _likelihoods(encodings, recorded)
    every = likelihoods[0].sessions
    space = Sessions(
        tuple(each.names[0].rpartition(APART)[0] or "all" for each in every),
        tuple(len(each.names) for each in every), tuple(len(each.trials) for each in every),
    )  # fmt: skip
    for name, count in zip(space.session, space.trials, strict=True):
        must = f"must have {FEWEST_TRIALS} trials or more of each session (Trials.where chooses)"
        require(count >= FEWEST_TRIALS, "recorded", must, f"{count} of {name}")
    copies = int(np.ceil(least / (pilots * sum(space.trials))))
    tell(f"fits to the recorded trials: {space.text()}")
    with quiet():
        fits = [(one, optimum(one).vector) for one in likelihoods]
    tell(f"fits to simulated pilots: {pilots} for either encoding being true")
    jobs = [(k, number, copies, seeds) for k in (0, 1) for number in range(pilots)]
    with shared_map(workers, fits) as over_jobs:
        made = np.array(over_jobs(_gained, jobs))
    # By encoding, pilot, and set: one for the information, one for simulated experiments.
    gained = made.reshape(2, pilots, *made.shape[1:])

    def informed(part: Sessions, some: Any) -> TaskInformation[Sessions]:
        first, second = (Direction(_information(x[:, 0][..., some])) for x in gained)
        return TaskInformation(part, (first, second))

    check, groups, rows = informed(space, slice(None)), likelihoods[0].groups, []
    for name, direction, x in zip(encodings, check.directions, gained, strict=True):
        rng = stream(seeds[1] + 1, "recorded", name, "experiments")
        needed = sequential.needed(direction.information, _quantile(pilots))
        rows.append({"truth": name, **needed, **_experiments(x[:, 1], rng, needed["median"])})
    settings = {
        "recorded": recorded.checksum, "pilots": pilots, "check_trials": least, "seed": seeds[0],
        "check_seed": seeds[1], "recording": None, "left_out": [], "refused": [],
    }  # fmt: skip
    table = pd.DataFrame([row(informed(x, groups == k)) for k, x in enumerate(space.each())])
    models = DecisionModel(encodings[0]), DecisionModel(encodings[1])
    return Discrimination(models, space, table, check, sequential.confirmed(rows), (), settings)


def _likelihoods(encodings: tuple[Any, Any], recorded: Any) -> list[CellsLikelihood]:
    """Return both encodings of recorded trials; ValueError if they can't be fitted."""
    must = "must be trials with spikes of cells, as from bg.read_trials(..., spikes=...)"
    spikes = recorded.spikes if isinstance(recorded, Trials) else None
    if spikes is None:
        raise InputError.of("recorded", must, recorded)
    people = recorded.people()
    require(len(people) == 1, "recorded", "must be trials of one participant", people)
    must, identities = "must be an encoding of cells, such as 'exponential' or 'macaque D1'", []
    for argument, name in zip(("first", "second"), encodings, strict=True):
        require(isinstance(name, str), argument, must, name)
        identities.append(encoding_of(name, argument).identity())
    if identities[0] == identities[1]:
        reason = f"{encodings[0]} and {encodings[1]} are one model: nothing tells them apart"
        raise InputError(reason, "second")
    # Simulated cells are never left out, however few their spikes.
    trials = replace(recorded, spikes=without_silent(spikes, FEWEST_SPIKES))
    one = question(FitSettings(), trials, encodings)
    made: list[Any] = [one.likelihoods(name)[people[0]] for name in encodings]
    return made


def _gained(fits: list[_Fitted], k: int, number: int, copies: int, seeds: tuple[int, int]) -> Array:
    """Return the log density of new trials by the fit of encoding k to a pilot, less the other's.

    Encoding k is true. Two sets, (2, copies, trials), nats.
    """
    name = fits[k][0].model.name

    def new(seed: int, *path: object) -> tuple[RecordedSession, ...]:
        return simulated(fits[k], stream(seed, "recorded", name, number, *path))

    with quiet():
        pilot = new(seeds[0], "pilot")
        fitted = [(one, optimum(replace(one, sessions=pilot)).vector) for one, _ in fits]
        pairs = [[new(seed, copy) for copy in range(copies)] for seed in (seeds[1], seeds[1] + 1)]
        return np.array([[apart(fitted[k], fitted[1 - k], x) for x in each] for each in pairs])


def simulated(fit: _Fitted, rng: np.random.Generator) -> tuple[RecordedSession, ...]:
    """Return the sessions of a fit with new choices and spikes of the same cells."""
    return sessions_of(fit[0].simulated(fit[1], rng), fewest=0)


def apart(first: _Fitted, second: _Fitted, sessions: tuple[RecordedSession, ...]) -> Array:
    """Return the difference of the log densities of each trial under two fits, (trials,), nats."""
    one, other = (replace(x, sessions=sessions).each(vector) for x, vector in (first, second))
    return np.asarray(one - other)


def _information(gained: Array) -> Information:
    """Return the information of a trial, from (pilots, copies, trials)."""
    means = gained.mean(axis=(1, 2))
    error = float(means.std(ddof=1) / np.sqrt(len(means)))
    weights = np.full(gained.size, 1 / gained.size)
    return Information(float(means.mean()), error, gained.ravel(), weights)


def _quantile(pilots: int) -> float:
    """Return half of a 95 % interval in standard errors: a few pilots have Student's t."""
    from scipy.special import stdtrit

    return float(stdtrit(pilots - 1, 0.975))


def _experiments(gained: Array, rng: np.random.Generator, median: float) -> dict[str, float]:
    """Return the outcome of simulated experiments, each after one of the pilots."""
    if not np.isfinite(median):
        return dict.fromkeys(sequential.OF_EXPERIMENTS, np.nan)
    repeats, done = -(-sequential.REPEATS // len(gained)), []
    for x in gained.reshape(len(gained), -1):
        done.append(sequential.experiments([x], [np.arange(x.size)], [1.0], rng, repeats=repeats))
    ended, right = (np.concatenate(each) for each in zip(*done, strict=True))
    return sequential.outcome(ended, right)

"""Search for the task that tells two models apart with the fewest trials, and check it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict, replace
from inspect import signature
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd

from bgmodel import names
from bgmodel.discriminating.designs import TaskDesign, TaskInformation, informed, row
from bgmodel.discriminating.information import Recording
from bgmodel.discriminating.recorded import FEWEST_PILOTS, PILOTS, told_apart
from bgmodel.discriminating.result import Discrimination
from bgmodel.discriminating.sequential import again, simulated_experiments
from bgmodel.discriminating.space import (
    OF_CIRCUITS,
    Place,
    Probe,
    Space,
    check_space,
    search,
    split,
)
from bgmodel.discriminating.trials import PairedTrials
from bgmodel.experiments.models import DecisionModel, model_of
from bgmodel.integrators.criterion import gain_of
from bgmodel.integrators.sprt import Integrator
from bgmodel.names import EngineName
from bgmodel.simulated_evidence import gaussian_evidence
from bgmodel.support.checks import whole
from bgmodel.trials.record import Trials as Recorded
from circuits.circuit import Circuit
from circuits.errors import EditWarning, InputError, quiet, require

SEED, CHECK_SEED = 99_101, 99_201
"""Default seeds of the search and of the check of the best task. Simulated experiments have the
one after that of the check, and a planned experiment the one after that."""
MOST_TRIALS = 1_000_000
"""Most trials of each kind, and most kinds of trials."""
ROUNDING = 1e-9
"""Difference of outputs that is rounding error, nats."""
Tell = Callable[[str], None]


def discriminate(
    first: Circuit | Integrator | str | Path,
    second: Circuit | Integrator | str | Path | None = None,
    *,
    first_edits: Iterable[str] = (),
    second_edits: Iterable[str] = (),
    space: Space | str | Path | None = None,
    thresholds: Literal["matched", "free"] = "matched",
    non_decision: Literal["same", "free"] | None = None,
    recording: Recording | None = None,
    recorded: Recorded | None = None,
    pilots: int = PILOTS,
    trials: int = 1000,
    check_trials: int = 10_000,
    evaluations: int = 64,
    seed: int = SEED,
    check_seed: int = CHECK_SEED,
    engine: str = "population",
    workers: int = 1,
    tell: Tell = lambda _: None,
) -> Discrimination:
    """Search for the task that tells two models apart with the fewest trials.

    Parameters
    ----------
    first, second : str, path, Circuit or Integrator
        A circuit, by name, as a file or as an object, or a test: "msprt" or a name of
        ``BASELINES``. By default the second is the first, with other edits. With ``recorded``,
        encodings of ``fit``, such as "exponential" or "macaque D1".
    first_edits, second_edits : sequence of str
        Edits of the circuits, as in ``Circuit.edited``.
    space : Space or path, optional
        The tasks; by default the shipped space.
    thresholds : {"matched", "free"}
        Each model's threshold is the one at which it has the task's accuracy in plain trials, since
        nobody's threshold is known beforehand and an accuracy can be trained. "free": the rival of
        the true model has the threshold at which it is hardest to tell from it.
    non_decision : {"same", "free"}, optional
        Whether both models have one non-decision time, or the rival of the true one that at which
        it is hardest to tell apart. By default free if one model alone is a test: tests have no
        latency, so that their times would differ by that of the circuit.
    recording : Recording, optional
        Cells of a nucleus whose spikes are counted in each trial, as a third measure.
    recorded : Trials, optional
        A pilot: trials of one person, from ``read_trials`` with spikes of cells. The result
        is then the number of further trials of the same cells and clicks, in the sessions of the
        pilot in proportion to their trials, that tell two encodings of these cells apart. Options
        of tasks and circuits have no place with it.
    pilots : int
        Number of simulated pilots with ``recorded``, for either encoding being true, at least 4.
    trials, check_trials : int
        Trials of each kind in the search and in the check, at least 200. With ``recorded``,
        ``check_trials`` is the least number of new trials for either encoding being true.
    evaluations : int
        Most kinds of probe trials that are simulated in the search.
    seed, check_seed : int
        Seeds of the search, and of the check of its best task. With ``recorded``, of the pilots
        and of the new trials.
    engine : str
        Engine of circuits.
    workers : int
        Threads, or processes with ``recorded``; results do not depend on them.
    tell : function
        Called with a text on the progress.

    Raises
    ------
    ValueError
        For an unknown name, identical models, a circuit without nats, an invalid space, equal
        seeds, if no task of the space can be run, or if recorded trials have no spikes or are too
        few.

    Warns
    -----
    EditWarning
        If a number of alternatives or a manipulation of the space does not fit both circuits; it
        is left out.

    Notes
    -----
    Information per trial is the Kullback-Leibler divergence of choices, response times and counts
    of recorded spikes, binned by quantiles; by the data processing inequality it is a lower bound
    on what they tell without bins. The best task is simulated again with another seed, because
    the best of many noisy estimates is too good.

    With ``recorded`` both encodings are fitted to the recorded trials. Each in turn is the truth:
    pilots are simulated, both encodings are fitted to each, and information per trial is the
    mean difference of their log densities of choice and spikes in new trials.
    """
    require(callable(tell), "tell", "must be a function", tell)
    _check_numbers(trials, check_trials, evaluations, pilots, seed, check_seed)
    whole("workers", workers, 1)
    if recorded is not None:
        options = {
            "first_edits": first_edits, "second_edits": second_edits, "space": space,
            "thresholds": thresholds, "non_decision": non_decision, "recording": recording,
            "trials": trials, "evaluations": evaluations, "engine": engine,
        }  # fmt: skip
        for name, value in options.items():
            by_default = signature(discriminate).parameters[name].default
            same = isinstance(value, type(by_default)) and value == by_default
            require(same, name, "must not be given with recorded", value)
        encodings = first, first if second is None else second
        return told_apart(
            encodings, recorded, pilots=pilots, least=check_trials, seeds=(seed, check_seed),
            workers=workers, tell=tell,
        )  # fmt: skip
    models = (
        model_of(first, first_edits, engine, argument="first"),
        model_of(first if second is None else second, second_edits, engine, argument="second"),
    )
    _check_words(thresholds, non_decision, engine)
    space, left_out = _within(check_space(space), models)
    _check_recording(recording, models, space)
    one_test = sum(model.test is not None for model in models) == 1
    free_time = non_decision == "free" or (non_decision is None and one_test)
    searched = PairedTrials(models, space, seed, trials, thresholds == "free", workers, recording)
    with quiet():
        tasks, refused = _searched(searched, free_time, evaluations, tell)
        best = max(tasks, key=lambda task: task.low)
        tell(f"check of the best task: {best.design.text()}")
        check = again(searched, best.design, check_seed, check_trials, free_time)
        sequential = simulated_experiments(searched, check, check_seed + 1, check_trials)
        same = tuple(n for n in space.channels if same_rule(*models, channels=n))
    settings = {
        "thresholds": thresholds, "non_decision": "free" if free_time else "same",
        "trials": trials, "check_trials": check_trials, "seed": seed, "check_seed": check_seed,
        "engine": engine, "recording": recording and asdict(recording), "left_out": left_out,
        "refused": refused,
    }  # fmt: skip
    table = pd.DataFrame([row(task) for task in tasks])
    return Discrimination(models, space, table, check, sequential, same, settings)


def _check_words(thresholds: object, non_decision: object, engine: str) -> None:
    """Raise ValueError for a word that is none of those allowed."""
    names.check("engine", engine, EngineName)
    for name, value, known in (
        ("thresholds", thresholds, ("matched", "free")),
        ("non_decision", non_decision, ("same", "free", None)),
    ):
        allowed = isinstance(value, str | None) and value in known
        require(allowed, name, f"must be {' or '.join(known[:2])}", value)


def _check_numbers(
    trials: int, check_trials: int, evaluations: int, pilots: int, seed: int, check_seed: int
) -> None:
    """Raise ValueError for too few trials, or seeds that are not apart."""
    must = f"must be at most {MOST_TRIALS}"
    for name, count, least in (
        ("trials", trials, 200),
        ("check_trials", check_trials, 200),
        ("evaluations", evaluations, 1),
        ("pilots", pilots, FEWEST_PILOTS),
    ):
        require(whole(name, count, least) <= MOST_TRIALS, name, must, count)
    first = whole("check_seed", check_seed, 0)
    # Simulated experiments and the planned one have the next two.
    apart = whole("seed", seed, 0) not in range(first, first + 3)
    require(apart, "check_seed", "and the next two must differ from seed", check_seed)


def _check_recording(
    recording: Recording | None, models: tuple[DecisionModel, DecisionModel], space: Space
) -> None:
    """Raise ValueError unless the cells are in both models, and the window within trials."""
    if recording is None:
        return
    must = 'must be a Recording, such as Recording("STN")'
    require(isinstance(recording, Recording), "recording", must, recording)
    for model in models:
        if model.test is not None:
            raise InputError(f"{model.name} is a test, which has no nuclei to record", "nucleus")
        for channels in space.channels:
            recording.check(model.circuit(channels))
    last = recording.window_ms[1]
    must = f"must end within the trials, which end after {space.longest_ms:g} ms"
    require(last <= space.longest_ms, "window_ms", must, last)


def _within(space: Space, models: tuple[DecisionModel, DecisionModel]) -> tuple[Space, list[str]]:
    """Return the part of a space in which both models can be run, and what is left out."""
    space, left_out = _built(space, models)
    for channels in space.channels:
        for model in models:
            _check(model, channels)
        if models[0].key(channels) == models[1].key(channels):
            raise InputError(
                f"{models[0].name} and {models[1].name} are one model: nothing tells them apart",
                "second",
            )
    if any(model.test is not None for model in models):
        reduced = space.of_tests()
        left_out += [n for n in OF_CIRCUITS if getattr(space, n) != getattr(reduced, n)]
        return reduced, left_out
    for text in filter(None, space.edits):
        try:
            for model in models:
                _check(model, space.channels[0], split(text))
        except ValueError as error:
            EditWarning.warn(f"{text!r} is left out of the space: {error}")
            space, left_out = space.without(text), [*left_out, text]
    return space, left_out


def _check(model: DecisionModel, channels: int, edits: Iterable[str] = ()) -> None:
    """Raise ValueError if the circuit cannot be edited, or does not work in nats."""
    if model.test is None:
        circuit = model.circuit(channels).edited(*edits)
        circuit.check_nats("a comparison at matched thresholds", ": give a circuit in nats")
        gain_of(circuit)


def _built(space: Space, models: tuple[DecisionModel, DecisionModel]) -> tuple[Space, list[str]]:
    """Return a space with the numbers of alternatives of both circuits, and what is left out.

    A circuit in a file has one number of alternatives.
    """
    errors: dict[int, ValueError] = {}
    for model in models:
        if model.test is None:
            errors |= model.circuits(space.channels)[1]
    kept = tuple(channels for channels in space.channels if channels not in errors)
    if not kept:
        raise errors[space.channels[0]]
    for channels, error in errors.items():
        EditWarning.warn(f"{channels} alternatives are left out of the space: {error}")
    return replace(space, channels=kept), [f"channels {channels}" for channels in errors]


def same_rule(first: DecisionModel, second: DecisionModel, *, channels: int) -> bool:
    """Whether two tests are one rule at different thresholds, for a number of alternatives.

    They are if the output of one increases with that of the other over all alternatives, readings
    and trials: each threshold of one then has a threshold of the other with the same decisions, so
    that no choices and times tell them apart. It is checked on every output of 200 trials.
    """
    if first.test is None or second.test is None:
        return False
    evidence = gaussian_evidence(200, channels=channels, t_max=40, seed=0)
    one, other = (np.ravel(test.run(evidence).out_nats) for test in (first.test, second.test))
    return bool((np.diff(other[np.argsort(one)]) >= -ROUNDING).all())


def _searched(
    trials: PairedTrials, free_time: bool, evaluations: int, tell: Tell
) -> tuple[list[TaskInformation[TaskDesign]], list[str]]:
    """Return the information gained by each task, and the reasons for skipping others."""
    axes = trials.space.axes()
    tasks: list[TaskInformation[TaskDesign]] = []
    refused: list[str] = []

    def score(place: Place) -> float:
        probe = Probe(**{name: axes[name][k] for name, k in zip(axes, place, strict=True)})
        tell(probe.text())
        try:
            here = list(informed(trials, probe, free_time))
        except ValueError as error:
            refused.append(f"{probe.text()}: {error}")
            return -np.inf
        tasks.extend(here)
        return max((task.low for task in here), default=-np.inf)

    sizes = [len(values) for values in axes.values()]
    search(sizes, score, evaluations=evaluations, seed=trials.seed)
    if not tasks:
        why = refused[0] if refused else "no accuracy is reached by both models"
        raise InputError(f"no task of the space can be run: {why}", "space")
    return tasks, refused

"""Simulated people who learn pairs of items, with known parameters."""

from __future__ import annotations

import numpy as np

from bgmodel.learning.values.diffusion import draw
from bgmodel.learning.values.models import ValueModel, model_of
from bgmodel.learning.values.people import PairTrials
from bgmodel.support.arrays import Array, Integers
from bgmodel.support.checks import whole
from bgmodel.support.seeds import stream
from circuits.errors import InputError

PAIRS = (("AB", 0.8, 0.2), ("CD", 0.7, 0.3), ("EF", 0.6, 0.4))
"""Pairs with the probabilities of a reward of both items, as in the built-in set."""


def simulated(
    model: ValueModel | str, fitted: Array, *, trials: int = 60, seed: int
) -> list[PairTrials]:
    """Return the choices, times and rewards of simulated people.

    Parameters
    ----------
    model : ValueModel or str
        A model with a learner.
    fitted : array (people, parameters)
        Their parameters on the scale of a fit.
    trials : int
        Number of trials of each of the three pairs, which take turns.
    seed : int
        Each person has a separate random stream.

    Raises
    ------
    ValueError
        If the model has no learner.
    """
    model = model_of(model)
    if model.learner is None:
        raise InputError.of("model", "must have a learner, whose choices are rewarded", model.name)
    trials, people = whole("trials", trials, 2), len(fitted)
    values = {name: each[:, None] for name, each in model.natural(fitted).items()}
    learner = model.made({name: each[:, 0] for name, each in values.items()})
    rngs = [stream(seed, "person", k) for k in range(people)]
    uniform = np.stack([rng.random((trials, 5, len(PAIRS))) for rng in rngs], axis=2)
    state, last = learner.start((people, len(PAIRS))), np.zeros((people, len(PAIRS)))
    response = np.empty((trials, people, len(PAIRS)), dtype=int)
    rt_s, reward = np.empty(response.shape), np.empty(response.shape)
    for k in range(trials):
        learned = learner.values(state)
        drift = values["scale"] * (learned[..., 1] - learned[..., 0])
        start = values["stickiness"] * values["bound"] * last
        response[k], rt_s[k] = _drawn(values, drift, start, uniform[k, :4])
        reward[k] = _rewarded(response[k], uniform[k, 4])
        chosen = np.stack([1 - response[k], response[k]], axis=-1)
        state, last = learner.learn(state, chosen, reward[k]), 2.0 * response[k] - 1
    names, pair = tuple(name for name, *_ in PAIRS), np.tile(np.arange(len(PAIRS)), trials)
    return [
        PairTrials(pair, response[:, k].ravel(), rt_s[:, k].ravel(), reward[:, k].ravel(), names)
        for k in range(people)
    ]


def _drawn(
    values: dict[str, Array], drift: Array, start: Array, uniform: Array
) -> tuple[Integers, Array]:
    """Return responses and times of one trial of each pair, (people, pairs)."""
    shape = drift.shape
    of_all = [np.broadcast_to(values[name], shape).ravel() for name in ("bound", "non_decision_s")]
    chosen, rt_s = draw(drift.ravel(), of_all[0], start.ravel(), of_all[1], uniform.reshape(4, -1))
    return chosen.reshape(shape), rt_s.reshape(shape)


def _rewarded(response: Integers, uniform: Array) -> Array:
    better, worse = (np.array([each[k] for each in PAIRS]) for k in (1, 2))
    return np.asarray(uniform < np.where(response == 1, better, worse), dtype=np.float64)

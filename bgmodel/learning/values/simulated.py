"""Simulated people who learn pairs of items, with known parameters."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from bgmodel.learning.values.diffusion import draw
from bgmodel.learning.values.models import ValueModel, model_of
from bgmodel.support.arrays import Array, Integers
from bgmodel.support.checks import whole
from bgmodel.support.seeds import stream
from bgmodel.trials.record import Trials
from circuits.errors import require

PAIRS = (("AB", 0.8, 0.2), ("CD", 0.7, 0.3), ("EF", 0.6, 0.4))
"""Pairs with the probabilities of a reward of both items, as in the built-in set."""


def simulated(
    model: ValueModel | str, values: Mapping[str, Array], *, trials: int = 60, seed: int
) -> Trials:
    """Return the choices, times and rewards of simulated people, named by numbers from 0.

    ``values`` are their parameters, (people,) each. Three pairs of ``trials`` trials take turns.
    Each person has a separate random stream.
    """
    model, trials = model_of(model), whole("trials", trials, 2)
    names = {each.name for each in model.parameters}
    require(names == set(values), "values", f"must be {', '.join(sorted(names))}", list(values))
    columns = {name: np.asarray(each, dtype=np.float64)[:, None] for name, each in values.items()}
    learner, people = model.made(columns), len(columns["bound"])
    rngs = [stream(seed, "person", k) for k in range(people)]
    uniform = np.stack([rng.random((trials, 5, len(PAIRS))) for rng in rngs], axis=2)
    state, last = learner.start((people, len(PAIRS))), np.zeros((people, len(PAIRS)))
    response = np.empty((people, trials, len(PAIRS)), dtype=np.int8)
    rt_s, reward = np.empty(response.shape), np.empty(response.shape)
    for k in range(trials):
        learned = learner.values(state)
        drift = columns["scale"] * (learned[..., 1] - learned[..., 0])
        start = columns["stickiness"] * columns["bound"] * last
        chosen, rt_s[:, k] = _drawn(columns, drift, start, uniform[k, :4])
        response[:, k], reward[:, k] = chosen, _rewarded(chosen, uniform[k, 4])
        state = learner.learn(state, np.stack([1 - chosen, chosen], axis=-1), reward[:, k])
        last = np.asarray(2.0 * chosen - 1)
    pair = np.tile([name for name, *_ in PAIRS], people * trials)
    who = np.repeat(np.arange(people), trials * len(PAIRS)).astype(str)
    held = pd.DataFrame({"pair": pair})
    answers = rt_s.ravel(), response.ravel()
    return Trials(who, *answers, None, held, source="simulated", reward=reward.ravel())


def _drawn(
    values: dict[str, Array], drift: Array, start: Array, uniform: Array
) -> tuple[Integers, Array]:
    """Return responses and times of one trial of each pair, (people, pairs)."""
    shape = drift.shape
    of_all = [np.broadcast_to(values[name], shape).ravel() for name in ("bound", "t0_s")]
    chosen, rt_s = draw(drift.ravel(), of_all[0], start.ravel(), of_all[1], uniform.reshape(4, -1))
    return chosen.reshape(shape), rt_s.reshape(shape)


def _rewarded(response: Integers, uniform: Array) -> Array:
    better, worse = (np.array([each[k] for each in PAIRS]) for k in (1, 2))
    return np.asarray(uniform < np.where(response == 1, better, worse), dtype=np.float64)

"""One posterior of a group, drawn by this package's sampler, by NumPyro's NUTS and by plain Gibbs.

Simulated people decide by the sequential test; all five parameters that a fit of it leaves free
are fitted in a hierarchy. NUTS has the same prior, and the density of the diffusion at each time
where ours are of bins; an integral of 21 nodes over non-decision times makes both agree. Plain
Gibbs moves each person's parameters by a random walk whose steps have the covariance of the
Gaussian approximation, and then draws the group. Seconds are CPU time of one thread from the data
to the last draw, without compilation. Needs the extra ``compare``.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from bgmodel import stream
from bgmodel.fitting.algorithms import GapModel
from bgmodel.fitting.hierarchy.approximation import Person, estimates, started
from bgmodel.fitting.hierarchy.chains import CHAINS, agreement
from bgmodel.fitting.hierarchy.group import FREEDOM, SPREAD, Scale, priors_of
from bgmodel.fitting.hierarchy.group_fit import fit_group
from bgmodel.fitting.hierarchy.sampler import Draws, Sampler
from bgmodel.fitting.likelihood import Likelihood, likelihood_of
from bgmodel.support.processes import local_map
from circuits.arrays import Array
from circuits.errors import require
from figures.data.decided import decided_by_test, responses
from figures.pieces import Made, Piece, Score

SCORING_SEED = 70_301
"""Of people and their trials, and of the chains of NUTS and Gibbs."""
PEOPLE, EACH = 10, 30
"""Number of people, and of each one's trials at each strength."""
STRENGTHS = (0.032, 0.128, 0.512)
FREE = ("sensitivity", "bound", "t0_s", "t0_sd_s", "lapse")
MEANS = np.array([15.0, 0.65, 0.35, 0.06, 0.02])
SDS = np.array([3.0, 0.1, 0.04, 0.01, 0.005])
"""Of the parameters over people."""
WARM, KEPT = {"NUTS": 250, "Gibbs": 300}, {"NUTS": 250, "Gibbs": 2000}
"""Draws of each chain that are left out and kept."""
SHORT, SMALL, TERMS, NODES = 0.3, 2, 4, 21
"""Time, in units of the squared separation, below which the series for short times is used, its
terms on either side, those of the other series, and nodes of the integral over non-decision
times."""
SMALLEST = 10
"""Trials at each strength in the run that compiles."""
OURS = "this package"


def likelihoods(trials: int) -> dict[str, Likelihood]:
    """Return the likelihood of each person's trials."""
    made = {}
    for number in range(PEOPLE):
        rng = stream(SCORING_SEED, "people", number)
        values = dict(zip(FREE, rng.normal(MEANS, SDS).tolist(), strict=True))
        decided = decided_by_test(values, STRENGTHS, trials, rng)
        design = responses(values, STRENGTHS, decided, rng)
        require((design.observed.response >= 0).all(), "trials", "must all be decided", number)
        made[f"{number:02d}"] = likelihood_of(GapModel(), design, free=FREE)
    return made


def by_ours(people: dict[str, Likelihood]) -> tuple[list[Draws], float]:
    """Return chains of this package's sampler and their CPU time, s."""
    begun = time.process_time()
    chains = fit_group(people, workers=1).chains
    return chains, time.process_time() - begun


def by_gibbs(people: dict[str, Likelihood]) -> tuple[list[Draws], float]:
    """Return chains of plain Gibbs sampling and their CPU time, s."""
    begun = time.process_time()
    every = list(people.values())
    first = estimates(every, 1)
    scale = Scale.of(every[0].freedom, np.median(first, axis=0))
    each = [Person(one, scale) for one in every]
    group, expansion = started(local_map(each), scale.to(first), np.zeros(len(FREE), bool))
    highest, prior = scale.to(scale.high), priors_of(every[0].freedom, scale)
    mean = np.minimum(group.mean, highest)
    group = replace(group, mean=mean, highest=highest, prior=prior)
    sampler, size = Sampler(each, expansion), len(FREE)
    covariance = np.linalg.inv(expansion.precision + np.diag(1 / group.variance))
    steps = 2.4 / np.sqrt(size) * np.linalg.cholesky(covariance)
    chains = []
    for number in range(CHAINS):
        rng, kept = stream(SCORING_SEED, "Gibbs", number), []
        state = sampler.first(group, rng)
        for sweep in range(WARM["Gibbs"] + KEPT["Gibbs"]):
            away = np.einsum("pij,pj->pi", steps, rng.normal(size=state.scaled.shape))
            asked, spread = state.scaled + away, 2 * state.group.variance
            gain = log = sampler.logs(asked)
            for x, sign in ((asked, -1), (state.scaled, 1)):
                gain = gain + sign * ((x - state.group.mean) ** 2 / spread).sum(axis=1)
            taken = np.log(rng.uniform(size=len(each))) < gain - state.log
            scaled = np.where(taken[:, None], asked, state.scaled)
            state = replace(state, scaled=scaled, log=np.where(taken, log, state.log))
            state = replace(state, group=state.group.drawn(scaled, rng))
            if sweep >= WARM["Gibbs"]:
                sd = np.sqrt(state.group.variance)
                kept.append((state.group.mean, sd, scaled, state.log))
        mean, sd, scaled, log = (np.array(part) for part in zip(*kept, strict=True))
        chains.append(Draws(mean, sd, scaled, log))
    return chains, time.process_time() - begun


def log_likelihood(people: dict[str, Likelihood], scale: Scale) -> Any:
    """Return JAX's function of everyone's parameters on the scale: log likelihoods, (people,)."""
    import jax.numpy as jnp

    seen = [one.design.observed for one in people.values()]
    cell, response, rt_s = (
        jnp.array([getattr(one, name) for one in seen]) for name in ("cell", "response", "rt_s")
    )
    strength = (jnp.array(STRENGTHS)[cell] * jnp.where(response == 1, 1.0, -1.0))[..., None]
    nodes, weights = np.polynomial.hermite_e.hermegauss(NODES)
    weights = weights / weights.sum()
    end_s = seen[0].grid.bins * seen[0].grid.width_s
    k, odd = jnp.arange(-SMALL, SMALL + 1) * 2 + 0.5, jnp.arange(TERMS) * 2 + 1

    def passage(time_s: Any, apart: Any, drift: Any) -> Any:
        """Return the density at the upper of two bounds, 1/s, from the middle between them."""
        time_s = jnp.maximum(time_s, 1e-9)
        u = (time_s / apart**2)[..., None]
        short = (k * jnp.exp(-(k**2) / (2 * u)) / jnp.sqrt(2 * jnp.pi * u**3)).sum(-1)
        waves = odd * jnp.exp(-((odd * jnp.pi) ** 2) * u / 2) * jnp.sin(odd * jnp.pi / 2)
        still = jnp.where(u[..., 0] < SHORT, short, jnp.pi * waves.sum(-1)) / apart**2
        return still * jnp.exp(drift * apart / 2 - drift**2 * time_s / 2)

    def logs(scaled: Any) -> Any:
        natural = jnp.minimum(scale.low + scale.unit * jnp.logaddexp(0.0, scaled), scale.high)
        sensitivity, bound, t0_s, t0_sd_s, lapse = (natural[:, n, None, None] for n in range(5))
        time_s = rt_s[..., None] - t0_s - t0_sd_s * nodes
        density = jnp.where(time_s > 0, passage(time_s, 2 * bound, sensitivity * strength), 0.0)
        share = lapse[..., 0]
        answered = (1 - share) * (density * weights).sum(-1) + share / 2 / end_s
        return jnp.log(answered).sum(-1)

    return logs


def by_nuts(people: dict[str, Likelihood]) -> tuple[list[Draws], float]:
    """Return chains of NumPyro's NUTS and their CPU time without compilation, s."""
    import jax
    import jax.numpy as jnp
    import numpyro
    import numpyro.distributions as dist
    from numpyro.infer import MCMC, NUTS

    numpyro.enable_x64()
    every = list(people.values())
    scale = Scale.of(every[0].freedom, np.median(estimates(every, 1), axis=0))
    logs, highest, size = log_likelihood(people, scale), scale.to(scale.high), len(FREE)

    def model() -> None:
        flat, positive = dist.constraints.real, dist.constraints.positive
        mean = numpyro.sample("mean", dist.ImproperUniform(flat, (), (size,)))
        inside = jnp.where(mean > highest, -np.inf, -jnp.logaddexp(0.0, -mean))
        sd = numpyro.sample("sd", dist.ImproperUniform(positive, (), (size,)))
        tails = -(FREEDOM + 1) / 2 * jnp.log1p(sd**2 / (FREEDOM * SPREAD**2))
        scores = numpyro.sample("scores", dist.Normal().expand((PEOPLE, size)).to_event(2))
        scaled = numpyro.deterministic("scaled", mean + sd * scores)
        numpyro.factor("rest", (inside + tails).sum() + logs(scaled).sum())

    mcmc = MCMC(NUTS(model), num_warmup=WARM["NUTS"], num_samples=KEPT["NUTS"], progress_bar=False)
    mcmc.run(jax.random.PRNGKey(SCORING_SEED))  # compiles
    chains, begun = [], time.process_time()
    for number in range(1, CHAINS + 1):
        mcmc.run(jax.random.PRNGKey(SCORING_SEED + number))
        mean, sd, scaled = (
            np.asarray(mcmc.get_samples()[name]) for name in ("mean", "sd", "scaled")
        )
        chains.append(Draws(mean, sd, scaled, np.zeros(scaled.shape[:2])))
    return chains, time.process_time() - begun


SAMPLERS = {OURS: by_ours, "NUTS of NumPyro": by_nuts, "plain Gibbs": by_gibbs}


def sampled(name: str, trials: int) -> pd.DataFrame:
    """Return a sampler's mean, with its error, of each number of the group."""
    if name != "NUTS of NumPyro":
        SAMPLERS[name](likelihoods(SMALLEST))  # compiles
    chains, cpu_s = SAMPLERS[name](likelihoods(trials))
    agreed = agreement(chains)
    draws: Array = np.concatenate([np.hstack([each.mean, each.sd]) for each in chains])
    rows = pd.DataFrame({"number": [f"{of} of {x}" for of in ("mean", "sd") for x in FREE]})
    error = draws.std(axis=0) / np.sqrt(agreed.effective[: draws.shape[1]])
    rows = rows.assign(mean=draws.mean(axis=0), error=error, rhat=agreed.rhat.max())
    return rows.assign(sampler=name, effective=agreed.effective.min(), cpu_s=cpu_s)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield a piece per sampler."""
    trials = EACH // 4 if fast else EACH
    for name in SAMPLERS:
        total = PEOPLE * trials * len(STRENGTHS)
        yield Piece("samplers", name, total, 300, partial(sampled, name, trials))


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return all numbers, with their distance from ours in standard errors."""
    table = made["samplers"]
    ours = table[table["sampler"] == OURS].set_index("number")
    there = ours.loc[table["number"]].reset_index()
    table["z"] = (table["mean"] - there["mean"]) / np.hypot(table["error"], there["error"])
    table.loc[table["sampler"] == OURS, "z"] = 0.0
    return {"numbers": ("samplers", table)}


SCORE = Score("samplers", SCORING_SEED, (), pieces, tables, circuit="")

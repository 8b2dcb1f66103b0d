"""Learning a level of dopamine, or a criterion, from reward; its cost, and decisions with it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.bootstrap import RESAMPLES, check_resamples, interval, resampled
from bgmodel.comparison.matched import MOST_FORCED
from bgmodel.deciding.tradeoff import Tradeoff, tradeoff
from bgmodel.evidence import Evidence
from bgmodel.integrators.at_thresholds import CIRCUIT, decide_at_thresholds, without_noise_alone
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import deciding_thresholds, rest_out
from bgmodel.integrators.sprt import Msprt
from bgmodel.learning.dopamine import THRESHOLD_NATS, decide_at_levels, playable_levels
from bgmodel.learning.reinforce import (
    GaussianPolicy,
    Learned,
    Learner,
    LevelOutcomes,
    learn,
)
from bgmodel.support.seeds import stream
from circuits.arrays import Array
from circuits.engines import Engine, engine_of
from circuits.errors import DeadlineWarning, InputError, LearningWarning, quiet, require

LAST_SHARE = 0.08
"""Final exploration, sd as a share of the range of levels; tuned on seed 1002. With less, an
optimum near the edge is found too late; with more, one at a bend of the curve is missed."""
LEVEL, CRITERION = "level", "log odds of the criterion"
"""What reward may move in a circuit: the level of dopamine, or the posterior at which it decides,
as log odds, on which the threshold on OUT depends: ``ln(1 + exp(-log odds))``."""
LEVELS, CRITERIA = 16, 40
"""Number of levels and of criteria at which a circuit decides every trial."""
SUREST_NATS = 1e-3
"""Lowest OUT that is a criterion, a posterior of 0.999, where a circuit can be read down to 0."""
WEIGHTS = 10_000_000
"""Most bootstrap weights in memory; many trials have fewer resamples, at least 200."""
WORSE, LEAST = 2.0, 0.1
"""Regret beyond that of the start, in per cent, from which learning made decisions worse; and the
least by which it must be lower for anything to have been learned."""
RESOLVED = 0.02
"""Largest share of the cost to which the trials may leave the best level open."""
DIFFERENT = "the trials for learning and those for scoring differ by more than chance"


def level_outcomes(
    model: BasalGanglia,
    evidence: Evidence,
    levels: npt.ArrayLike,
    threshold_nats: float = THRESHOLD_NATS,
) -> LevelOutcomes:
    """Return the outcomes of a circuit's decisions at each level of dopamine.

    Raises if the deadline decides most trials at every level, and warns if it does so at some.
    """
    decided = decide_at_levels(model, evidence, levels, threshold_nats)
    outcomes = LevelOutcomes.of(decided, evidence)
    check_decided(outcomes)
    return outcomes


def check_decided(outcomes: LevelOutcomes) -> None:
    """Warn of levels at which the deadline decides most trials; ValueError if it does so at all."""
    late = outcomes.forced > MOST_FORCED
    if late.all():
        reason = "the deadline decides most trials at every level: give more readings"
        raise InputError(reason, "evidence")
    if late.any():
        DeadlineWarning.warn(
            f"the deadline decides most trials at {late.sum()} of {len(late)} levels"
        )


def learn_level(
    outcomes: LevelOutcomes,
    *,
    xi: float,
    start_level: float,
    runs: int,
    seed: int,
    name: object,
    learner: Learner | None = None,
) -> Learned:
    """Learn the level of dopamine from reward, in several independent runs.

    In the result ``played`` is the level of each trial, ``mean_played`` the tonic level, and
    ``prediction_error`` phasic dopamine, readings. Exploration ends at ``LAST_SHARE``.
    """
    low, high = float(outcomes.levels[0]), float(outcomes.levels[-1])
    must = f"must be within {low:.3f}..{high:.3f}"
    require(low <= start_level <= high, "start_level", must, start_level)
    require(runs >= 1, "runs", "must be >= 1", runs)
    # Runs of one name are paired: all starts have the same trials and perturbations.
    trials = [stream(seed, "dopamine", name, run, "trials") for run in range(runs)]
    explored = [stream(seed, "dopamine", name, run, "explored") for run in range(runs)]
    return learn(
        outcomes.environment(xi, trials),
        start_level,
        rngs=explored,
        policy=GaussianPolicy(bounds=(low, high), last_share=LAST_SHARE),
        learner=learner,
    )


def regret(level: npt.ArrayLike, fresh: LevelOutcomes, xi: float) -> Array:
    """Return excess costs of levels as a share of the least; NaN outside those of ``fresh``."""
    best = fresh.best(xi)[1]
    return (best - fresh.expected(level, xi)) / abs(best)


def scored_runs(
    ends: npt.ArrayLike,
    fresh: LevelOutcomes,
    *,
    xi: float,
    start_level: float,
    first: LevelOutcomes | None = None,
) -> pd.DataFrame:
    """Score the level learned by each run, (runs,), on trials not used for learning.

    One row per run; reward and regret are NaN outside the levels of ``fresh``. ``first`` are
    outcomes that include the start, if ``fresh`` does not.
    """
    learned = np.asarray(ends, dtype=np.float64)
    inside = (learned >= fresh.levels[0]) & (learned <= fresh.levels[-1])
    best_level, best_reward = fresh.best(xi)
    return pd.DataFrame(
        {
            "run": np.arange(len(learned)),
            "learned_level": learned,
            "reward": np.where(inside, fresh.expected(learned, xi), np.nan),
            "regret": np.where(inside, regret(learned, fresh, xi), np.nan),
            "start_level": start_level,
            "start_regret": float(regret(start_level, first or fresh, xi)),
            "best_level": best_level,
            "best_reward": best_reward,
        }
    )


@dataclass(frozen=True, repr=False)
class CircuitLearned:
    """What a circuit has learned from reward, scored on trials that were not used for learning."""

    model: BasalGanglia  # at the gain fitted to the evidence
    learned: Learned
    outcomes: LevelOutcomes
    fresh: LevelOutcomes
    xi: float  # cost of an error, readings
    start: float
    what: str  # LEVEL or CRITERION
    groups: npt.ArrayLike | None = None  # of the fresh trials, for bootstrap.resampled

    @property
    def value(self) -> float:
        """The learned level or criterion, mean over runs."""
        return float(self.learned.learned.mean())

    @property
    def threshold_nats(self) -> float:
        """The threshold on OUT of a learned criterion."""
        require(self.what == CRITERION, "what", f"must be {CRITERION!r}", self.what)
        return float(threshold_of(self.value))

    @cached_property
    def regrets(self) -> pd.DataFrame:
        """Return regrets with 95 % bootstrap intervals, per cent of the least cost.

        Rows "learned" (mean over runs), "start" and "change" (learned minus start); columns value,
        low and high.
        """
        count = min(RESAMPLES, max(200, WEIGHTS // self.fresh.trials))
        weights = resampled(self.fresh.trials, count, stream(0, "regret"), self.groups)
        start, *ends = (
            self.fresh.regrets(float(level), self.xi, weights)
            for level in (self.start, *self.learned.learned)
        )
        learned = np.mean(ends, axis=0)
        regrets = {"learned": learned, "start": start, "change": learned - start}
        rows = {name: interval(values) for name, values in regrets.items()}
        return pd.DataFrame.from_dict(rows, orient="index", columns=["value", "low", "high"])

    @cached_property
    def cautions(self) -> list[str]:
        """What limits the result, one sentence per cause; usually empty."""
        return [text for text in (self._worse_or_unresolved(), self._edge()) if text]

    def _worse_or_unresolved(self) -> str:
        (regret, *_), (start, *_), (worse, least, most) = self.regrets.to_numpy()
        trials = self.outcomes.trials
        weights = resampled(trials, 200, stream(0, "unresolved"))[1:]
        doubt = self.outcomes.unresolved(self.xi, weights)
        few = (
            f"{trials} trials tell the best {self.what} only to {doubt:.1%} of the least cost, "
            f"because few are errors and each costs {self.xi:g} readings: give about "
            f"{100 * np.ceil(trials * doubt / RESOLVED / 100):.0f}"
        )
        if least > 0 and worse > WORSE:
            costs = self.outcomes.expected([self.value, self.start], self.xi)
            lost = "the runs did not find the best level for their trials: give more episodes"
            why = lost if costs[0] < costs[1] else few if doubt > RESOLVED else DIFFERENT
            return (
                f"learning ended worse than it began, with a regret of {regret:.1f} % "
                f"after {start:.1f} %: {why}"
            )
        if doubt <= RESOLVED and most > -LEAST and regret > WORSE:
            return (
                f"learning had no effect: the regret of {regret:.1f} % does not differ from that "
                f"at the start, {start:.1f} %: give more episodes, or another start"
            )
        return few if doubt > RESOLVED else ""

    def _edge(self) -> str:
        edge = self.fresh.at_edge(self.xi)
        if not edge:
            return ""
        of_level = self.what == LEVEL
        late = (edge == "lower") == of_level  # at low levels of dopamine decisions are late
        low, high = self.fresh.levels[[0, -1]]
        cure = f"; give a {'higher' if late else 'lower'} posterior, which moves the range"
        return (
            f"the best {self.what} is the {edge} end of those that {self.model.circuit.name} can "
            f"use, {low:.3f} to {high:.3f}: at this cost of an error it would pay to decide "
            f"{'later' if late else 'sooner'} still{cure if of_level else ''}"
        )


def learn_in_circuit(
    model: BasalGanglia,
    evidence: Evidence,
    fresh: Evidence,
    *,
    what: str = LEVEL,
    levels: npt.ArrayLike | None = None,
    threshold_nats: float = THRESHOLD_NATS,
    xi: float = 50.0,
    start: float | None = None,
    runs: int = 10,
    seed: int = 0,
    learner: Learner | None = None,
    groups: npt.ArrayLike | None = None,
) -> CircuitLearned:
    """Learn the level of dopamine of a circuit, or the criterion at which it decides, from reward.

    The circuit decides every trial at every level; the learner samples levels and draws the reward
    from those decisions. By default levels are those at which the circuit decides by evidence, not
    by noise, and the start is that of the earliest decisions. ``fresh`` trials score the result;
    both kinds have the gain that fits those of learning.
    """
    require(what in (LEVEL, CRITERION), "what", f"must be {LEVEL!r} or {CRITERION!r}", what)
    model = model.adapted_to(evidence)
    if levels is None:
        known = what == LEVEL
        levels = playable_levels(model, LEVELS, threshold_nats) if known else criteria(model)
    if what == LEVEL:
        run = partial(level_outcomes, levels=levels, threshold_nats=threshold_nats)
    else:
        run = partial(criterion_outcomes, levels=levels)
    outcomes = run(model, evidence)
    with quiet():  # what is to be said of the fresh trials has been said of the others
        scored = run(replace(model, seed=(model.seed or 0) + 1), fresh)
    begun = float(outcomes.levels[-1 if what == LEVEL else 0]) if start is None else start
    learned = learn_level(
        outcomes, xi=xi, start_level=begun, runs=runs, seed=seed, name="learn", learner=learner
    )
    result = CircuitLearned(model, learned, outcomes, scored, xi, begun, what, groups)
    for caution in result.cautions:
        LearningWarning.warn(caution)
    return result


def threshold_of(log_odds: npt.ArrayLike) -> Array:
    """Return the thresholds on OUT, nats, of criteria given as log odds of their posterior."""
    return np.logaddexp(0.0, -np.asarray(log_odds, dtype=np.float64))


def criteria(model: BasalGanglia) -> Array:
    """Return log odds, rising, at which evidence decides, and neither noise nor rest."""
    low, high = model.circuit.readable_nats
    ends = min(high, rest_out(model.circuit)), max(low, SUREST_NATS)
    first, last = -np.log(np.expm1(ends))
    falling = threshold_of(np.linspace(first, last, CRITERIA))
    usable = without_noise_alone(model, deciding_thresholds(model.circuit, falling))
    return np.asarray(-np.log(np.expm1(usable)))


def criterion_outcomes(
    model: BasalGanglia, evidence: Evidence, levels: npt.ArrayLike
) -> LevelOutcomes:
    """Return the outcomes of a circuit's decisions at each criterion, log odds that rise."""
    decided = decide_at_thresholds(model, evidence, threshold_of(levels), decoder_tau_ms=None)
    rising = LevelOutcomes.of(decided[CIRCUIT], evidence)
    outcomes = LevelOutcomes(
        np.asarray(levels, dtype=np.float64), rising.correct[::-1], rising.steps[::-1],
        rising.forced[::-1],
    )  # fmt: skip
    check_decided(outcomes)
    return outcomes


TEST, POPULATIONS, SPIKES = "test", "circuit, populations", "circuit in spikes"
"""Who decides."""


def decide_as_learned(
    learned: CircuitLearned,
    evidence: Evidence,
    *,
    gaps: tuple[float, float] | None = None,
    engine: Engine | str = "spikes",
    groups: npt.ArrayLike | None = None,
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> pd.DataFrame:
    """Let a circuit decide at its learned threshold, in spikes too, and the test at its gap.

    All decide the same trials, which were not used for learning; ``gaps`` are the learned and the
    best gap of the test, nats. One row per decider and measure, with 95 % bootstrap intervals:
    criterion (nats of OUT), accuracy, readings, cost (duration plus ``xi`` per error), regret and
    above_test (excess cost over the best criterion and over the test, per cent). The best criterion
    is that of the trials of learning, so that regret can fall below 0 by chance.
    """
    require(learned.what == CRITERION, "learned", "must be a learned criterion", learned.what)
    check_resamples(resamples, groups)
    decisions: dict[str, tuple[Tradeoff, float, float]] = {}
    if gaps is not None:
        learned_nats, best = (float(Msprt.threshold(gap)) for gap in gaps)
        swept = tradeoff(Msprt().run(evidence), evidence, _falling(learned_nats, best))
        decisions[TEST] = swept, learned_nats, best
    learned_nats = learned.threshold_nats
    best = float(threshold_of(learned.outcomes.best(learned.xi)[0]))
    for who, run in ((POPULATIONS, learned.model.engine), (SPIKES, engine_of(engine))):
        model = replace(learned.model, engine=run)
        levels = _falling(learned_nats, best)
        swept = decide_at_thresholds(model, evidence, levels, decoder_tau_ms=None)[CIRCUIT]
        decisions[who] = swept, learned_nats, best
    weights = resampled(evidence.trials, resamples, stream(seed, "bootstrap"), groups)
    parts = {who: _measures(*one, evidence, learned.xi, weights) for who, one in decisions.items()}
    rows = []
    for who, part in parts.items():
        if TEST in parts and who != TEST:
            part["above_test"] = 100 * (part["cost"] / parts[TEST]["cost"] - 1)
        rows += [(who, name, *interval(values)) for name, values in part.items()]
    return pd.DataFrame(rows, columns=["who", "measure", "value", "low", "high"])


def _measures(
    swept: Tradeoff, threshold: float, best: float, evidence: Evidence, xi: float, weights: Array
) -> dict[str, Array]:
    """Return the measures of decisions at a threshold, one value per row of weights."""
    outcomes = LevelOutcomes.of(swept, evidence)
    k, top = (int(np.abs(outcomes.levels - each).argmin()) for each in (threshold, best))
    share = weights / weights.sum(axis=1, keepdims=True)
    cost, least = (-share @ outcomes.rewards(xi)[each] for each in (k, top))
    return {
        "criterion": np.full(len(weights), threshold),
        "accuracy": share @ outcomes.correct[k],
        "readings": share @ outcomes.steps[k],
        "cost": cost,
        "regret": 100 * (cost / least - 1),
    }


def _falling(*levels: float) -> Array:
    return np.unique(levels)[::-1]

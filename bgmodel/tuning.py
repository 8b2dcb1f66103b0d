"""Tuning of a circuit: an optimiser over free directions, with the exam's numbers as data.

A circuit of the family of OUT = -ln P moves within it (``circuits.laws.members``), so that no
number is met by giving up what the circuit computes; the weights that follow are set on the way.
Numbers that are held out, and seeds that tune nothing, show what the tuning is worth.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from bgmodel.exam.exam import Exam
from bgmodel.exam.measures import Estimate
from bgmodel.exam.numbers import Number
from bgmodel.exam.record import scored
from bgmodel.exam.tables import NotApplicable, rows_of
from bgmodel.experiments.expected import AGREES, UNANSWERED
from bgmodel.experiments.models import DecisionModel, model_of
from bgmodel.support.checks import check_range, whole
from bgmodel.support.saved import Facts
from bgmodel.support.tables import Readable
from circuits.arrays import Array
from circuits.circuit import Circuit
from circuits.dynamics.fixed_point import resting_hz
from circuits.errors import DataWarning, require
from circuits.laws.family import failures
from circuits.laws.members import directions, moved

TUNING_SEED, SCORING_SEEDS = 51_001, (98_101, 98_102, 98_103)
"""Default seeds of tuning and of scoring."""
UNMET = 10.0
"""Loss of a number that a circuit does not answer, or whose direction it lacks, about |z| = 150."""
NEAR = 0.001
"""Relative changes of place and loss below which the search ends."""
IMPOSSIBLE = 1e6
"""Loss of a point at which there is no circuit, such as one where a weight has the wrong sign."""
TUNED, HELD_OUT = "tuned", "held out"
BEFORE, AFTER = "before", "after"


@dataclass(frozen=True, repr=False)
class Tuning(Facts):
    """A tuned circuit and its scores."""

    model: DecisionModel  # the tuned circuit; ``model.circuit(channels)`` builds it
    values: dict[str, float]  # of the free directions
    # One row per number, seed and circuit: id, part ("tuned" or "held out"), circuit ("before" or
    # "after"), seed, use ("tuning" or "scoring"), published, value, z, outcome.
    table: pd.DataFrame
    evaluations: int  # how many circuits were tried

    def facts(self) -> dict[str, str]:
        """Return the values, and the numbers that agree before and after."""
        facts = {name: f"{value:.4g}" for name, value in self.values.items()}
        for row in self.summary().to_dict("records"):
            agree = f"{row[BEFORE]:.3g} -> {row[AFTER]:.3g} of {row['numbers']} agree"
            facts[f"{row['part']} ({row['use']})"] = agree
        return facts

    def summary(self) -> pd.DataFrame:
        """Return how many numbers agree, on average over seeds, by part and by use of the seed.

        The numbers of the tuning seed that agree after tuning, less those of the scoring seeds, are
        the winner's curse.
        """
        agrees = self.table.assign(agrees=self.table["outcome"] == AGREES)
        each = agrees.groupby(["part", "use", "circuit", "seed"])["agrees"].sum()
        wide = each.groupby(["part", "use", "circuit"]).mean().unstack("circuit").reset_index()
        counts = self.table.groupby("part")["id"].nunique()
        return Readable(wide.assign(numbers=wide["part"].map(counts)).rename_axis(columns=None))


def tune(
    circuit: Circuit | str | Path,
    numbers: Iterable[str],
    free: Mapping[str, tuple[float, float]],
    *,
    held_out: Iterable[str],
    exam: Exam | None = None,
    seed: int = TUNING_SEED,
    scoring_seeds: Sequence[int] = SCORING_SEEDS,
    share: float = 1.0,
    evaluations: int = 200,
    workers: int = 1,
) -> Tuning:
    """Move a circuit along free directions until it agrees with numbers; score it elsewhere.

    The loss is the sum over numbers of weight times ``ln(1 + z^2)``, so that one number out of
    reach does not outweigh the others. Resting rates come from the fixed point, spectra from linear
    theory, and behaviour from populations. Powell's method (1964) minimises it, from the circuit's
    present values: most numbers depend on few directions, which it follows one by one.

    Parameters
    ----------
    circuit : str, path or Circuit
        A name or a file, which is built for each number of alternatives, or a circuit.
    numbers : sequence of str
        Ids of the numbers that are met, such as "rest.stn".
    free : mapping
        Free directions, each with its lowest and highest value:
        ``{"SNr.baseline_hz": (0, 60), "Sigma0": (1.5, 3)}``. In a circuit of the family they are
        names of ``circuits.laws.members.directions``; in others any field of a row.
    held_out : sequence of str
        Ids of the numbers that are only scored.
    exam : Exam, optional
        The numbers and tasks; by default those that ship.
    seed, scoring_seeds : int, sequence of int
        Seed of tuning, and seeds of scoring, which must differ from it.
    share : float
        Share of the usual numbers of trials.
    evaluations : int
        Largest number of circuits to try.
    workers : int
        Threads; results do not depend on them.

    Returns
    -------
    Tuning
        The circuit, and its scores on all seeds before and after.

    Raises
    ------
    InputError
        For an id that is unknown, given twice, or both tuned and held out; without held-out
        numbers or free directions; for a seed that both tunes and scores; for an unknown
        direction; or if the circuit answers none of the numbers.
    """
    exam = Exam.shipped() if exam is None else exam
    lists = {TUNED: list(numbers), HELD_OUT: list(held_out)}
    _check_ids(exam, lists)
    whole("evaluations", evaluations, 1)
    check_range(0.05, 10, share=share)
    apart = len(scoring_seeds) > 0 and seed not in scoring_seeds
    require(apart, "scoring_seeds", "must be one or more that differ from seed", scoring_seeds)
    base = model_of(circuit)
    asked = {name: exam.of(ids) for name, ids in lists.items()}
    _warn_of_same(asked)
    lows, highs, start = _box(base, free, asked[TUNED])
    answers = _scores(base, asked[TUNED], seed, share, workers, closed=True)
    silent = [str(row["id"]) for row in answers if row["outcome"] == UNANSWERED]
    must = f"must be answered by {base.name}, which answers none of these"
    require(len(silent) < len(answers), "numbers", must, silent)
    if silent:
        DataWarning.warn(f"{base.name} does not answer {', '.join(silent)}: they tune nothing")
    tried = 0

    def at(point: Array) -> DecisionModel:
        return _moved(base, dict(zip(free, map(float, lows + point * (highs - lows)), strict=True)))

    def loss(point: Array) -> float:
        nonlocal tried
        tried += 1
        try:
            return _loss(_scores(at(point), asked[TUNED], seed, share, workers, closed=True))
        except ValueError:
            return IMPOSSIBLE

    from scipy.optimize import minimize  # slow to import

    bounds = [(0.0, 1.0)] * len(free)
    options = {"maxfev": evaluations, "xtol": NEAR, "ftol": NEAR}
    minimum = minimize(loss, start, method="Powell", bounds=bounds, options=options)
    best = at(minimum.x)
    parts = []
    for use, seeds in (("tuning", [seed]), ("scoring", scoring_seeds)):
        for one in seeds:
            for name, part in asked.items():
                for when, model in ((BEFORE, base), (AFTER, best)):
                    rows = pd.DataFrame(_scores(model, part, one, share, workers))
                    kept = rows[["id", "published", "value", "z", "outcome"]]
                    parts.append(kept.assign(part=name, circuit=when, seed=one, use=use))
    values = dict(zip(free, map(float, lows + minimum.x * (highs - lows)), strict=True))
    return Tuning(best, values, pd.concat(parts, ignore_index=True), tried)


def _check_ids(exam: Exam, lists: Mapping[str, list[str]]) -> None:
    known = {one.id for one in exam.numbers}
    arguments = {TUNED: "numbers", HELD_OUT: "held_out"}
    for name, ids in lists.items():
        field = arguments[name]
        require(len(ids) > 0, field, "must name one or more numbers of the exam", ids)
        for one in ids:
            require(one in known, field, f"must be among {', '.join(sorted(known))}", one)
        twice = sorted({one for one in ids if ids.count(one) > 1})
        require(not twice, field, "must name each number once", twice)
    both = sorted({*lists[TUNED]} & {*lists[HELD_OUT]})
    require(not both, "held_out", "must not be among the numbers that are tuned", both)


def _warn_of_same(asked: Mapping[str, Exam]) -> None:
    """Warn of held-out numbers that are values of what is tuned, and so test nothing else."""
    tuned = {(one.measure, *sorted(one.of.items())): one.id for one in asked[TUNED].numbers}
    for one in asked[HELD_OUT].numbers:
        if same := tuned.get((one.measure, *sorted(one.of.items()))):
            DataWarning.warn(
                f"{one.id} is held out, but asks for what {same} is tuned to: the circuit has one "
                "value of both, so that it tests nothing else"
            )


def _moved(base: DecisionModel, values: dict[str, float]) -> DecisionModel:
    """Return a model whose circuits have other values of free directions."""

    def build(channels: int) -> Circuit:
        circuit = base.circuit(channels)
        if not failures(circuit):
            return moved(circuit, values)
        for name, value in values.items():
            circuit = circuit.set(name, value)
        return replace(circuit, unedited=None)

    return DecisionModel(f"{base.name}, tuned", build, base.engine, base.gain)


def _box(
    base: DecisionModel, free: Mapping[str, tuple[float, float]], exam: Exam
) -> tuple[Array, Array, Array]:
    """Return the ends of the free directions, and the circuit's place between them, 0 to 1."""
    require(len(free) > 0, "free", "must name one or more free directions", list(free))
    tasks = exam.tasks.values()
    circuit = next(iter(base.circuits(sorted({task.channels for task in tasks}))[0].values()))
    present = {one.name: one.value for one in directions(circuit)} if not failures(circuit) else {}
    start = []
    for name, ends in free.items():
        low, high = ends
        require(low < high, "free", "must have two ends that rise", tuple(ends), owner=name)
        if present:
            require(name in present, "free", "must be free directions of the circuit", name)
        else:
            row, _, field = name.rpartition(".")
            kinds = {f.name: f.type for f in fields(circuit[row])} if row in circuit else {}
            real = kinds.get(field) == "float"
            require(real, "free", "must be real fields of rows, such as SNr.baseline_hz", name)
        value = present[name] if present else float(getattr(circuit[row], field))
        if not low <= value <= high:
            DataWarning.warn(
                f"{name} of {base.name}, {value:g}, lies outside {low:g} to {high:g}: the search "
                "begins at the nearest end, and what it finds may be worse"
            )
        start.append(np.clip((value - low) / (high - low), 0, 1))
    box = np.array([*free.values()], dtype=np.float64)
    return box[:, 0], box[:, 1], np.array(start)


def _scores(
    model: DecisionModel, exam: Exam, seed: int, share: float, workers: int, *, closed: bool = False
) -> list[dict[str, Any]]:
    """Return the rows of an exam; with ``closed`` resting rates are those of the fixed point."""
    rest = [n for n in exam.numbers if n.measure == "rate" and n.of["window"] == "rest"]
    rest = rest if closed else []
    others = [one.id for one in exam.numbers if one not in rest]
    rows = [scored(one, "", _resting(model, one, exam)) for one in rest]
    if others:
        taken = exam.of(others).take(model, seed=seed, share=share, workers=workers)
        rows += [{str(k): v for k, v in row.items()} for row in taken.table.to_dict("records")]
    return rows


def _resting(model: DecisionModel, number: Number, exam: Exam) -> Estimate | NotApplicable:
    """Return a resting rate at the fixed point, Hz."""
    nucleus = str(number.of["nucleus"])
    rates = resting_hz(model.circuit(exam.tasks[str(number.of["task"])].channels))
    known = [rates[name] for name in rows_of(nucleus, rates)]
    if not known:
        return NotApplicable(f"there are no rates of {nucleus}")
    return Estimate(float(np.mean(known)), 0.0, 0)


def _loss(rows: list[dict[str, Any]]) -> float:
    """Return the sum over numbers of weight times ln(1 + z^2)."""
    total = 0.0
    for row in rows:
        z = float(row["z"])
        unmet = 0.0 if row["outcome"] == AGREES else UNMET
        total += float(row["weight"]) * (np.log1p(z**2) if np.isfinite(z) else unmet)
    return total

"""The law of a deadline: a comparison gives the same values if trials may last longer."""

import warnings
from dataclasses import dataclass, replace

import numpy as np

from bgmodel import BasalGanglia, compare, gaussian_evidence, stream
from circuits.anatomy import load_circuit
from circuits.errors import BgmodelWarning
from tests.helpers import cues

MEASURES = ("agreement", "agreement_chance", "pearson_r", "extra_ms", "accuracy_gap", "forced")
KEYS = ["model", "reference", "accuracy", "measure"]
NEGLIGIBLE = 0.002
"""Largest share of trials decided by the deadline for which the law must hold."""
TRIALS = 200
ROUNDING = 1e-4


@dataclass(frozen=True)
class DeadlineTask:
    """A random task; ``readings`` are the shorter and the longer deadline."""

    kind: str
    engine: str
    channels: int
    d_prime: float
    readings: tuple[int, int]
    seed: int

    @classmethod
    def drawn(cls, seed):
        """Draw a task whose shorter deadline comes late."""
        rng = stream(seed, "deadlines")
        d_prime = float(np.exp(rng.uniform(np.log(0.7), np.log(3))))
        short = int(rng.uniform(30, 45) / d_prime**2) + 10
        readings = short, int(short * rng.uniform(1.3, 2.5)) + 1
        kind = str(rng.choice(["gaussian", "gaussian", "cues"]))
        channels = 2 if kind == "cues" else int(rng.integers(2, 5))
        engine = str(rng.choice(["algebra", "rate", "population"], p=[0.1, 0.45, 0.45]))
        return cls(kind, engine, channels, d_prime, readings, seed)

    def evidence(self):
        """Return the evidence until the longer deadline."""
        if self.kind == "gaussian":
            options = {"d_prime": self.d_prime, "channels": self.channels, "seed": self.seed}
            return gaussian_evidence(TRIALS, t_max=self.readings[1], **options)
        return cues(TRIALS, self.readings[1], self.d_prime, self.seed)


def compared(task):
    """Return the measures under both deadlines, one row per model, reference and accuracy.

    Rows are those at whose accuracy the shorter deadline decides next to nothing for any model.
    """
    evidence = task.evidence()
    model = BasalGanglia(load_circuit("macaque", task.channels), task.engine, seed=task.seed)
    tables = []
    for readings in task.readings:
        part = replace(evidence, log_likelihood=evidence.log_likelihood[:, :readings])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", BgmodelWarning)
            table = compare(model, part, baselines=["max vs average"], resamples=200).table
        rows = table[table["measure"].isin(MEASURES)]
        tables.append(rows)
    both = tables[0].merge(tables[1], on=KEYS, suffixes=("_short", "_long"))
    late = both[both["measure"] == "forced"].groupby("accuracy")["value_short"].max()
    return both[~(both["accuracy"].map(late) > NEGLIGIBLE)]


def changed(both):
    """Return the rows that break the law: known under one deadline, or outside both intervals.

    That of 200 trials which all agree has no width, so that one interval may hold the other value.
    """
    value = {at: both[f"value_{at}"] for at in ("short", "long")}
    outside = [
        (value[other] < both[f"low_{at}"] - ROUNDING)
        | (value[other] > both[f"high_{at}"] + ROUNDING)
        for at, other in (("short", "long"), ("long", "short"))
    ]
    unknown = value["short"].notna() != value["long"].notna()
    return both[unknown | (outside[0] & outside[1])]

"""Tables of evidence, and what a plain reading of them decides."""

import numpy as np
import pandas as pd
from hypothesis import strategies as st

NAMES = ("left", "right", "up", "a b", "1", "S1", "näher", "x.y")
IDS = [
    lambda n, rng: rng.permutation(10 * n)[:n],
    lambda n, rng: np.array([f"s{k:04d}" for k in rng.permutation(n)], dtype=object),
    lambda n, rng: np.array([f"{k:05d}" for k in range(n)], dtype=object),
    lambda n, rng: rng.permutation(n) + 0.5,
]
EXTRA = {
    "block": [0, 1, 2],
    "rt": [0.125, 2.0, 0.301],
    "condition": ["easy", "hard"],
    "response": ["NA", "x", ""],
    "model": ["m1", "m2"],
    "participant_id": ["p1", "p2"],
}

OWN = ["block", "condition", "participant_id", *(f"given_{n}" for n in ("rt", "response", "model"))]
"""The same in a result."""


@st.composite
def tables(draw):
    """Draw a valid table: unequal trials, ids and columns of any kind, rows in any order."""
    rng = np.random.default_rng(draw(st.integers(0, 2**31)))
    trials, most = draw(st.integers(1, 24)), draw(st.integers(1, 14))
    names = draw(st.lists(st.sampled_from(NAMES), min_size=2, max_size=5, unique=True))
    lengths = rng.integers(1, most + 1, trials) if draw(st.booleans()) else np.full(trials, most)
    of = np.repeat(np.arange(trials), lengths)
    table = pd.DataFrame({"trial": draw(st.sampled_from(IDS))(trials, rng)[of]})
    table["step"] = np.concatenate([np.arange(n) for n in lengths]) + draw(st.integers(0, 1))
    scale = draw(st.sampled_from([0.0, 0.3, 1.0, 4.0]))
    for name in names:
        table[f"ll_{name}"] = rng.normal(0, scale, len(of)) + 0.0
    extra = draw(st.lists(st.sampled_from(list(EXTRA)), max_size=4, unique=True))
    for name in extra:
        table[name] = rng.choice(EXTRA[name], trials)[of]
    if draw(st.booleans()):
        table["truth"] = rng.choice(names, trials)[of]
    if draw(st.booleans()):
        table["eye_x"] = rng.normal(0, 1, len(of))
    if draw(st.booleans()):
        table = table.sample(frac=1, random_state=rng)
    return table[draw(st.permutations(list(table)))].reset_index(drop=True)


WRONG = [
    lambda table: table.drop(columns="step"),
    lambda table: table.drop(columns="trial"),
    lambda table: table.head(0),
    lambda table: pd.concat([table, table.tail(1)]),
    lambda table: table.assign(step=table["step"] + 5),
    lambda table: table.assign(ll_more=np.where(table.index == 0, "much", "1")),
    lambda table: table.assign(ll_more=np.where(table.index == 0, np.inf, 1)),
    lambda table: table.assign(trial=table["trial"].astype("object").where(table.index > 0)),
    lambda table: table.assign(truth="nobody"),
    lambda table: table.assign(LL_more=0.0),
    lambda table: table.assign(row=1),
]
"""What makes a table wrong; the tests of `bgmodel.trials.evidence_table` have more of it."""


def write(table, path):
    """Write a table as a user has it."""
    table.to_csv(path, index=False) if path.suffix == ".csv" else table.to_parquet(path)


def trials_of(table):
    """Return id and rows by step of every trial, in order of first appearance."""
    groups = table.groupby([*table.columns.intersection(["participant_id"]), "trial"], sort=False)
    return [(rows["trial"].iloc[0], rows.sort_values("step")) for _, rows in groups]

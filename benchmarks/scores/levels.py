"""Levels of dopamine as thresholds, scored: make score.

Figure D2 on a seed that tuned nothing: the posterior at each level of dopamine, and accuracy in
equal time beside the MSPRT and the MSPRT at the circuit's gain.
"""

from __future__ import annotations

import argparse

import numpy as np
import pandas as pd

from benchmarks import OUT
from bgmodel.comparison.levels import levels_against_msprt
from bgmodel.files import write_table

SCORING_SEED = 40_007
ASKED = (0.75, 0.99)
"""Posteriors that dopamine should span."""
NOISE = 0.02
"""Where more responses than this share come before the first reading, noise decides."""


def summary(found: pd.DataFrame) -> pd.DataFrame:
    """Return, for each circuit, the posteriors spanned and the gaps at those that are asked."""
    rows = []
    index = ["channels", "engine", "level"]
    known, premature = (
        found[found["measure"] == name].set_index(index)["value"]
        for name in ("criterion", "premature")
    )
    known = known[premature.loc[known.index] <= NOISE]
    gaps = found[found["measure"] == "accuracy_gap"]
    for (channels, engine), part in known.groupby(level=[0, 1]):
        inside = part.index[part.between(*ASKED)]
        row = {
            "N": channels,
            "engine": engine,
            "lowest": part.min(),
            "highest": part.max(),
            "monotone": bool(np.all(np.diff(part.sort_index()) < 0)),
        }
        for name, these in gaps.groupby("reference"):
            of = these.set_index(index).loc[inside]
            # A time that the test's curve does not reach is no gap of 0.
            worst = of.loc[of["value"].abs().fillna(np.inf).idxmax()]
            within = of[["low", "high"]].abs().max(axis=1) <= 0.01
            text = f"{worst['value']:+.4f} [{worst['low']:+.4f}, {worst['high']:+.4f}]"
            row[f"worst gap to {name}"] = text
            row[f"intervals within .01, {name}"] = f"{within.sum()} of {len(of)}"
        rows.append(row)
    return pd.DataFrame(rows)


def main() -> None:
    """Score both circuits and engines."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=2000)
    given = parser.parse_args()
    OUT.mkdir(exist_ok=True)
    found = levels_against_msprt(SCORING_SEED, given.trials)
    write_table(found, OUT / "knob.csv", seed=SCORING_SEED, trials=given.trials)
    print(summary(found).round(3).T.to_string(header=False))


if __name__ == "__main__":
    main()

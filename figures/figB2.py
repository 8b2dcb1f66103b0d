"""Figure B2: decision times of the MSPRT by gain on its evidence (B&G, figure 3B)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.figure import Figure

from bgmodel.support.files import read_table
from figures.common import Settings, bars, key, run, say_if_older, where

AVERAGE = "max vs average"
"""The score's name for the limit of low gain."""
NEXT = "MSPRTb"
ALTERNATIVES = 10


def draw(settings: Settings, over_gain: Path, times: Path, *, output: Path) -> Figure:
    """Draw mean times by gain, with the limits of low and high gain."""
    table, others = read_table(over_gain), read_table(times)
    limits = {
        "limit of low gain: max vs average": where(table, model=AVERAGE),
        "limit of high gain: MSPRTb, max vs next": where(
            others, model=NEXT, alternatives=ALTERNATIVES
        ),
    }
    swept = table[table["model"] != AVERAGE]
    swept = swept.assign(gain=pd.to_numeric(swept["model"])).sort_values("gain")
    figure, ax = plt.subplots(figsize=(4.6, 3.4))
    for (label, row), colour in zip(limits.items(), ("C1", "C4"), strict=True):
        ax.axhspan(row["time_ms_low"].item(), row["time_ms_high"].item(), color=colour, alpha=0.15)
        ax.axhline(row["time_ms"].item(), color=colour, lw=1, ls="--", label=label)
    style: dict[str, Any] = {"color": "C0", "marker": "o", "ms": 3.5, "lw": 1}
    bars(ax, swept["gain"], swept, "time_ms", label="MSPRT", **style)
    ax.axvline(1, color="0.7", lw=0.8, ls=":", zorder=0)
    ax.set(xscale="log", xlabel="gain relative to the exact test",
           ylabel="mean time at 1 % errors (ms)")  # fmt: skip
    ax.set_title("ten alternatives", loc="left")
    key(figure, ax, ncols=1)
    say_if_older(figure, over_gain, times)
    return figure


if __name__ == "__main__":
    run(draw=draw)

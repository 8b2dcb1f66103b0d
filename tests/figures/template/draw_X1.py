"""Figure X1: the number."""

from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from bgmodel.support.files import read_table
from figures.common import Settings


def draw(settings: Settings, numbers: Path, *, output: Path) -> Figure:
    """Draw the number as a bar."""
    figure, ax = plt.subplots()
    ax.bar([0], read_table(numbers)["value"])
    return figure

"""The command that shows the whole chain on one page."""

from __future__ import annotations

from pathlib import Path

from bgmodel.commands.output import Files, say
from bgmodel.support import files


def demo(*, seed: int = 1, plot: Path = Path("demo.png"), force: bool = False) -> None:
    """Decide on shipped taps by spikes and by the optimal test, and let reward set the threshold.

    Example: bgmodel demo

    Parameters
    ----------
    seed
        Seed of the evidence and of the noise of cells.
    plot
        File for the picture, .png, .pdf or .svg.
    force
        Overwrite an existing picture.
    """
    Files(plot=plot, force=force).check(())
    say("decisions of some 40 000 spiking cells")
    from bgmodel.demo import demo as shown
    from bgmodel.demo import draw

    chain = shown(seed)
    files.save_figure(draw(chain), plot)
    print(chain.summary())
    print(f"-> {plot}")

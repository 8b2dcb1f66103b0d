"""The command that shows the whole chain on one page."""

from __future__ import annotations

from pathlib import Path

from bgmodel.commands.output import Files, say


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
    output = Files(plot=plot, force=force)
    output.check(())
    say("decisions of some 40 000 spiking cells")
    from bgmodel import demo as whole

    chain = whole.demo(seed)
    print(chain.summary())
    output.draw(lambda: whole.draw(chain))

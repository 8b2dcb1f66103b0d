"""The command that computes and shows one decision."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from bgmodel.commands.checks import Writes, check_ending, save_figure, say
from circuits.errors import require


@dataclass(frozen=True)
class DemoRun(Writes):
    """Compute, draw and explain one decision of the spiking circuit and of the optimal test.

    Example: bgmodel demo
    """

    drawing: Positional[Path] = Path("demo.png")
    """File for the picture, .png, .pdf or .svg."""
    seed: int = 1
    """Seed of the evidence and of the noise of cells."""
    alternatives: int = 3
    """Number of alternatives."""

    def __call__(self) -> None:
        """Run the command."""
        check_ending("drawing", self.drawing, ".png", ".pdf", ".svg")
        require(self.alternatives >= 2, "alternatives", "must be at least 2", self.alternatives)
        say("one decision of several thousand spiking cells")
        from bgmodel.demo import demo, draw

        found = demo(self.seed, self.alternatives)
        figure = draw(found)
        save_figure(figure, self.drawing)
        print(found.summary())
        print(f"-> {self.drawing}")

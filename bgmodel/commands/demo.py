"""The command that shows one decision, computed on the spot."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from bgmodel.commands.checks import Writes, check_ending, say
from bgmodel.support.files import replacing
from circuits.errors import require


@dataclass(frozen=True)
class DemoRun(Writes):
    """One decision of the spiking circuit beside the optimal test, computed, drawn and explained.

    Example: bgmodel demo
    """

    drawing: Positional[Path] = Path("demo.png")
    """Where the picture goes, .png, .pdf or .svg."""
    seed: int = 1
    """Of the evidence and of the noise of cells."""
    alternatives: int = 3
    """Number of alternatives."""

    def __call__(self) -> None:
        """Run the command."""
        check_ending("drawing", self.drawing, ".png", ".pdf", ".svg")
        require(self.alternatives >= 2, "alternatives", "must be at least 2", self.alternatives)
        say("one decision of some thousands of spiking cells")
        from bgmodel.demo import demo, draw

        found = demo(self.seed, self.alternatives)
        figure = draw(found)
        with replacing(self.drawing) as partial:
            figure.savefig(partial, dpi=150, format=self.drawing.suffix[1:])
        print(found.summary())
        print(f"-> {self.drawing}")

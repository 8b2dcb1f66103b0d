"""The command that writes the page with sliders."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from bgmodel.commands.checks import Writes, check_ending
from bgmodel.names import MACAQUE, CircuitName


@dataclass(frozen=True)
class PageWrite(Writes):
    """Write one HTML file with sliders: lesions, dopamine, threshold, conflict.

    It needs no server and no net: open it in a browser. A table's file holds one number of
    alternatives, and so does its page. Examples: bgmodel page; bgmodel page mine.html --circuit
    mine.toml
    """

    output: Positional[Path] = Path("circuit.html")
    """Where the page goes, .html."""
    circuit: CircuitName = MACAQUE
    """Name of the table, or the path of a .toml file."""

    def __call__(self) -> None:
        """Run the command."""
        from bgmodel.web.page import write_page

        check_ending("output", self.output, ".html")
        write_page(self.circuit, self.output)
        print(f"-> {self.output}: open it in a browser")

"""Cell types, one per file: they turn the input of a channel into spikes or a rate.

``cell`` defines the interface. To add a cell type, write a frozen dataclass decorated with
``@register`` and import it before a table uses it.
"""

from circuits.cells.adex import AdEx
from circuits.cells.cell import CELLS, BrianText, Cell, Line, Response, register
from circuits.cells.lif import Lif
from circuits.cells.phase import Phase
from circuits.cells.rate import Rate

__all__ = [
    "CELLS", "AdEx", "BrianText", "Cell", "Lif", "Line", "Phase", "Rate", "Response", "register",
]  # fmt: skip

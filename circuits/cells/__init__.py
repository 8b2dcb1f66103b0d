"""Cell types, one a file: what turns the input of a channel into spikes or a rate.

``cell`` says what is asked of a type. A type of your own is one more file: a frozen dataclass under
``@register``, imported before a table uses it.
"""

from circuits.cells.adex import AdEx
from circuits.cells.cell import CELLS, BrianText, Cell, Line, Response, register
from circuits.cells.lif import Lif
from circuits.cells.phase import Phase
from circuits.cells.rate import Rate

__all__ = [
    "CELLS",
    "AdEx",
    "BrianText",
    "Cell",
    "Lif",
    "Line",
    "Phase",
    "Rate",
    "Response",
    "register",
]

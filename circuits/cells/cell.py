"""The interface of cell types, and their registry.

An input ``x`` arrives in nats. A population's row maps it to a rate by its *line*
``rate_hz = baseline_hz + gain_hz_per_nat * f(x)``. A cell that hears "hz" fires at that rate by
construction; one that hears "nats" turns x into a membrane potential, which determines its spikes.

Each cell type implements the methods below. A method that it does not implement raises an error
that names the type and the method; there are no fallbacks. How it spikes is stated in one of two
ways: by the quantiles of its intervals if it is a *renewal* cell, or else by its state and a tick.
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple, NoReturn, TypeVar

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array
from circuits.checks import (
    check_finite,
    check_free,
    check_kind,
    check_positive,
    check_range,
    check_types,
)
from circuits.errors import InputError, require

Constants = dict[str, Any]

HEARS = ("nats", "hz")
_RESERVED = (
    "i j N t dt xi pi e inf nats hz word cell block key block_x block_hz own own_x x dt_s "
    "filter_decay baseline_hz gain_hz_per_nat word_ticks settle_ticks sample_ticks out_decay onset "
    "reading t_in_timesteps lastspike not_refractory rate_hz ones single fused exponential chosen "
    "clip exp log sqrt abs int tick_key byte_counts"
)
RESERVED = frozenset(_RESERVED.split())
"""Names reserved by the generated Brian2 code."""


class Line(NamedTuple):
    """A population's line at inputs (S,): rate (Hz), slope (Hz/nat), curvature (Hz/nat^2)."""

    hz: Array
    slope: Array
    curvature: Array


class Response(NamedTuple):
    """Response of a cell to a small fluctuation of its input; each field broadcasts to (S, F)."""

    # Hz/nat: modulation of the rate per nat of modulation; complex if it lags
    gain: npt.NDArray[Any]
    bend: Array  # Hz/nat^2: change of the mean rate per unit of input variance
    spectrum: Array  # Hz: two-sided power of a cell's spikes without fluctuations


class BrianText(NamedTuple):
    """A cell's tick as Brian2 code, using the names of its ``state`` and its ``constants``.

    Parameters
    ----------
    tick : str
        Code of one tick. It may use ``nats`` or ``hz``, depending on ``hears``, and ``dt_s``;
        ``ones(word, t_in_timesteps)``, the number of ones among 8 random bits, mean 4, variance 2;
        and ``single``, ``fused``, ``exponential`` of ``circuits.cells.single`` with
        ``chosen(test, yes, no)``.
    spike, reset : str
        Condition for a spike, and code that runs after it.
    """

    tick: str
    spike: str
    reset: str


@dataclasses.dataclass(frozen=True)
class Cell:
    """Base class of cell types: frozen dataclasses of constants with the methods below.

    Attributes
    ----------
    spikes : bool
        Whether it spikes; if not, it transmits the rate of its line.
    hears : str
        "nats", the input, which the cell filters itself; or "hz", the rate of its line.
    state : tuple of str
        State variables of a spiking cell that is no renewal cell.
    of_rates : tuple of str
        Constants that also affect rates, not only spikes.
    longest_tick_ms : float
        Longest tick, ms, with which its rate and the irregularity of its spikes are as stated.
    brian : BrianText
        Its tick as Brian2 code.
    """

    spikes: ClassVar[bool] = True
    hears: ClassVar[str] = "hz"
    state: ClassVar[tuple[str, ...]] = ()
    of_rates: ClassVar[tuple[str, ...]] = ()
    longest_tick_ms: ClassVar[float] = 0.1
    brian: ClassVar[BrianText | None] = None

    @property
    def kind(self) -> str:
        """Name of the type in tables and edits; a key of ``CELLS``."""
        return type(self).__name__

    @property
    def lowest_hz(self) -> float:
        """Lowest rate that its line may take, Hz."""
        return 0.0

    @classmethod
    def renewal(cls) -> bool:
        """Return whether its spikes are a renewal process; the first factor acts on its rate."""
        return cls.spikes and cls.interval_quantiles is not Cell.interval_quantiles

    # ---- laws

    def membrane_ms(self) -> float:
        """Return the time constant with which the rate follows its input; 0 if it hears a rate."""
        if self.hears == "hz":
            return 0.0
        return self.lacks("membrane_ms", "the rate engine (and stability)")

    def rate_hz(self, x: Array, line_hz: Array) -> Array:
        """Return the stationary rate, Hz, at steady inputs x (S,), nats: the cell's f-I curve."""
        if self.hears == "hz":
            return line_hz
        return self.lacks("rate_hz", 'laws="cells" (and "finite")')

    def response(self, x: Array, line: Line, frequency_hz: Array) -> Response:
        """Return the response to small fluctuations about inputs x (S,), at frequencies (F,)."""
        return self.lacks("response", 'laws="finite"')

    def varied(self, factors: Array) -> tuple[Cell, float]:
        """Return the cell with the factors (3,) of ``constants``, and a factor on its rate."""
        return self.lacks("varied", "the population engine, where cells differ,")

    # ---- spikes

    def interval_quantiles(self, probability: Array) -> Array:
        """Return quantiles of its intervals at probabilities (P,) in (0, 1); their mean is 1.

        Intervals are in expected spikes: those of a steady rate r are 1/r times as long.
        """
        return self.lacks("interval_quantiles", "engines that spike")

    def constants(self, factors: Array, dt_ms: float) -> Constants:
        """Return the constants of a tick by name, in single precision: the arguments of ``begin``.

        Parameters
        ----------
        factors : array (3,) or (3, neurons)
            Factors on the cells' constants, for heterogeneity; see ``ticks.cell_factors``.
        dt_ms : float
            One tick.
        """
        return self.lacks("constants", "engines that spike")

    begin: ClassVar[Callable[..., tuple[Any, ...]] | None] = None
    """``(uniform, *constants) -> state``: the initial state, from a number in [0, 1)."""
    tick: ClassVar[Callable[..., tuple[Any, ...]] | None] = None
    """``(heard, ones, *state, *constants) -> (fired, *state)``, in words of ``cells.single``.

    ``heard`` is its input in nats, or its expected number of spikes per tick, in double precision.
    NumPy runs it on arrays, the compiled engine on one cell: no branches, no literals.
    """

    def lacks(self, answer: str, user: str) -> NoReturn:
        """Raise the error for a method that this type does not implement."""
        name = type(self).__name__
        raise InputError(f"{user} needs {name}.{answer}, and {name} cells do not have it", "cell")


CELLS: dict[str, type[Cell]] = {}
"""All cell types by name."""

C = TypeVar("C", bound=type[Cell])


def register(kind: C) -> C:
    """Register a cell type in ``CELLS``: a class decorator, above ``@dataclass(frozen=True)``.

    Raises
    ------
    ValueError
        If it is not a frozen dataclass derived from ``Cell``, ``hears`` is unknown, it spikes but
        has neither intervals nor a state, or both, or the name is taken by another type.
    """
    name = check_kind(kind, Cell, "a cell type")
    must = f"must be one of {', '.join(HEARS)}"
    require(kind.hears in HEARS, "hears", must, kind.hears, owner=name)
    ticking = kind.spikes and not kind.renewal()
    rate = ticking or kind.hears == "hz"
    must = "must be hz for renewal cells, and where cells do not spike"
    require(rate, "hears", must, kind.hears, owner=name)
    state = not ticking or (kind.state and isinstance(kind.state, tuple))
    must = "must be a tuple of the variables' names where cells spike by a tick"
    require(state, "state", must, kind.state, owner=name)
    twice = kind.renewal() and kind.tick is not None
    require(not twice, "tick", "must be None for renewal cells", kind.tick, owner=name)
    check_free(name, kind, CELLS, "a cell type")
    CELLS[name] = kind
    return kind


def check_cell(owner: str, cell: object) -> None:
    """Raise ValueError if the cell of a population's row is not of a registered type."""
    must = f"must be one of {', '.join(CELLS)}, or of a type entered by circuits.cells.register"
    require(type(cell) in CELLS.values(), "cell", must, cell, owner=owner)
    if isinstance(cell, Cell):
        allowed = cell.lowest_hz == 0 or (cell.lowest_hz == -np.inf and not cell.spikes)
        must = f"of {cell.kind} must be 0, or -inf where it does not spike"
        require(allowed, "lowest_hz", must, cell.lowest_hz, owner=owner)


def check_constants(cell: Cell, *above_0: str) -> None:
    """Raise ValueError unless a spiking cell's constants are finite, and those named above 0."""
    owner, constants = f"the {cell.kind} cell", vars(cell)
    check_types(cell, owner)
    check_finite(owner=owner, **constants)
    check_positive(owner=owner, **{name: constants[name] for name in above_0})
    check_range(0, np.inf, owner=owner, refractory_ms=constants["refractory_ms"])


def constant_names(kind: type[Cell]) -> tuple[str, ...]:
    """Return the names of a type's constants, in the order in which its functions take them."""
    blank, name = object.__new__(kind), kind.__name__
    begin = blank.begin or blank.lacks("begin", "engines that spike")
    tick = blank.tick or blank.lacks("tick", "engines that spike")
    names = tuple(inspect.signature(begin).parameters)[1:]
    taken = tuple(inspect.signature(tick).parameters)[2:]
    if taken != kind.state + names:
        must = f"must take heard, ones, state and the constants of {name}.begin, {', '.join(names)}"
        raise InputError(f"{name}.tick {must}; it takes {', '.join(taken)}", "tick")
    if taken_by_engines := RESERVED & {*kind.state, *names}:
        reason = f"{name}: an engine's own names can't be those of a variable or a constant"
        raise InputError(f"{reason}: {', '.join(sorted(taken_by_engines))}", "state")
    for what, function in (("begin", begin), ("tick", tick)):
        if numbers := _bare_numbers(function):
            must = "must be constants, or global names of np.float32, to be rounded alike"
            reason = f"{name}.{what} holds the numbers {', '.join(map(str, numbers))}: they {must}"
            raise InputError(reason, what)
    constants, one = [np.float32(1)] * len(names), np.float32(1)
    with np.errstate(all="ignore"):
        begun = begin(np.float64(0.5), *constants)
        moved = tick(np.float64(0.5), one, *[one] * len(kind.state), *constants)
    for what, returned, wanted in (("begin", begun, 0), ("tick", moved, 1)):
        if len(returned) != wanted + len(kind.state):
            wants = ", ".join(("whether it fires",) * wanted + kind.state)
            reason = f"{name}.{what} must return {wants}; it returns {len(returned)} values"
            raise InputError(reason, what)
    return names


def _bare_numbers(function: Callable[..., Any]) -> list[float]:
    """Return plain Python numbers among a function's literals and global names."""
    code, outside = function.__code__, function.__globals__
    held = [*code.co_consts, *(outside.get(name) for name in code.co_names)]
    return [value for value in held if type(value) in (int, float, bool)]


def tick_constants(cell: Cell, factors: Array, dt_ms: float) -> Constants:
    """Return a cell's constants in the order in which ``begin`` and ``tick`` take them."""
    name, constants = type(cell).__name__, cell.constants(factors, dt_ms)
    names = constant_names(type(cell))
    if set(constants) != set(names):
        must = f"must give what {name}.begin takes, {', '.join(names)}"
        raise InputError(f"{name}.constants {must}; it gives {', '.join(constants)}", "constants")
    owner = f"{name}.constants"
    for constant, value in constants.items():
        kind = np.asarray(value).dtype
        must = "must be in single precision, np.float32"
        require(kind == np.float32, constant, must, kind, owner=owner)
        require(np.isfinite(value).all(), constant, "must be finite", value, owner=owner)
    return {constant: constants[constant] for constant in names}

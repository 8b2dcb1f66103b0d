"""Cell types in the compiled engine.

Renewal cells of any type run through ``trains``. Of the others, those of the included circuits have
dedicated loops (``lanes``), one entry of ``ENTRIES`` each; any other type runs through ``loops``,
which compiles the type's ``tick`` unchanged. That loop is called by its address, so that the kernel
does not have to be recompiled.

Only single precision is accepted: other numbers would be rounded here but not by NumPy.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numba
import numpy as np
from numba import types
from numba.cpython.unsafe.tuple import tuple_setitem
from numba.extending import overload

from circuits.cells import Cell, Lif, single
from circuits.cells.cell import constant_names
from circuits.dynamics.ticks import ALL_ALIKE
from circuits.engines.compiling import OPTIONS
from circuits.engines.spikes import kernel, lanes


@overload(single.single, strict=False)
def _single(x):
    return lambda x: np.float32(x)


@overload(single.fused, strict=False)
def _fused(a, b, c):
    return (lambda a, b, c: lanes.fused(a, b, c)) if _singles(a, b, c) else None


@overload(single.choose, strict=False)
def _choose(test, yes, no):
    return (lambda test, yes, no: lanes.choose(test, yes, no)) if _singles(yes, no) else None


@overload(single.exponential, strict=False)
def _exponential(x):
    return (lambda x: lanes.exp32(x)) if _singles(x) else None


def _singles(*kinds):
    """Whether all are single precision; others would be rounded here but not by NumPy."""
    return all(kind == types.float32 for kind in kinds)


def kept(x: Any) -> Any:
    """Return a variable of a cell, which must be single precision to avoid implicit rounding."""
    return x


@overload(kept)
def _kept_single(x):
    return (lambda x: x) if _singles(x) else None


def truth(x: Any) -> Any:
    """Return whether a cell fires, which must be a boolean: other numbers have more bits."""
    return x


@overload(truth)
def _truth(x):
    return (lambda x: x) if x == types.boolean else None


Columns = dict[str, float]
"""Fields of a block's record."""


class CompiledCell(NamedTuple):
    """How the compiled engine runs a cell type."""

    kind: int  # code of the loops
    # the fields of a block's record from (cell, dt_ms), for identical cells
    columns: Callable[[Any, float], Columns] = lambda cell, dt_ms: {}
    # rows (5, neurons) of ``Plan.constants`` from (cell, factors, dt_ms), for loops that read them
    varied: Callable[[Any, Any, float], Any] | None = None


def _lif_columns(cell: Lif, dt_ms: float) -> Columns:
    constants = cell.constants(ALL_ALIKE, dt_ms)
    names = ("rest", "slope", "noise_step", "threshold")
    return {name: constants[name] for name in names} | {
        "membrane_decay": constants["decay"],
        "refractory": -float(lanes.WAIT) * float(constants["held"]),
    }


def _lif_varied(cell: Lif, factors: Any, dt_ms: float) -> Any:
    constants = cell.constants(factors, dt_ms)
    return [constants[name] for name in ("decay", "rest", "slope", "noise_step", "unit")]


ENTRIES: dict[type[Cell], CompiledCell] = {
    Lif: CompiledCell(kernel.LIF, _lif_columns, _lif_varied),
}
_UNIT, _RENEWAL = CompiledCell(kernel.RATE), CompiledCell(kernel.RENEWAL)


def _general_columns(cell: Cell, dt_ms: float) -> Columns:
    made = loops(type(cell))
    return {"advance": made.advance.address, "place": made.place.address}


GENERAL = CompiledCell(kernel.GENERAL, _general_columns)
"""Entry of every type with a tick but without dedicated loops."""


def entry(cell: Cell) -> CompiledCell:
    """Return the entry of a cell; by exact type, as a subclass may have another tick."""
    if cell.renewal():
        return _RENEWAL
    return ENTRIES.get(type(cell), GENERAL if cell.spikes else _UNIT)


# ---- types without dedicated loops: their own tick, compiled unchanged


class Loops(NamedTuple):
    """A cell type's compiled loops, called by address: keep a reference while they are used."""

    advance: Any
    place: Any


ADVANCE = types.void(
    types.CPointer(types.float32),  # state: variable after variable
    types.CPointer(types.float32),  # constants: one after the other
    types.int64,  # from a cell's variable or constant to the next
    types.CPointer(types.uint32),  # noise
    types.CPointer(types.float64),  # heard: tick after tick
    types.int64,  # from a cell's input to that of the next tick
    types.int64,  # cells
    types.int64,  # ticks
    types.CPointer(types.uint8),  # marks
)
PLACE = types.void(
    types.CPointer(types.float32),
    types.CPointer(types.float32),
    types.int64,
    types.uint64,
    types.int64,
)


def loops(kind: type[Cell]) -> Loops:
    """Compile a cell type's ``tick`` and ``begin``, once per process, which takes seconds."""
    functions = (kind.tick, kind.begin)
    if functions not in _LOOPS:
        _LOOPS[functions] = _compiled_loops(kind)
    return _LOOPS[functions]


_LOOPS: dict[tuple[Any, Any], Loops] = {}
"""Compiled loops by ``tick`` and ``begin``, so that a type whose functions change is recompiled."""


def _compiled_loops(kind: type[Cell]) -> Loops:
    count, size = len(constant_names(kind)), len(kind.state)
    tick, begin = (numba.njit(**OPTIONS)(function) for function in (kind.tick, kind.begin))
    for_c = {name: value for name, value in OPTIONS.items() if name != "nogil"}
    try:
        return Loops(
            numba.cfunc(ADVANCE, **for_c)(_advance(tick, size, count)),
            numba.cfunc(PLACE, **for_c)(_place(begin, size, count)),
        )
    except numba.errors.NumbaError as error:
        raise ValueError(
            f"{kind.__name__}.tick and .begin must be compiled: they may use +, -, *, comparisons, "
            "constants of np.float32 and the functions of circuits.cells.single, on numbers in "
            f"single precision, and say by one truth whether a cell fires ({_reason(error)})"
        ) from error


@numba.njit(inline="always")
def _gathered(values: Any, like: Any, stride: int, i: int) -> Any:
    """Return a cell's numbers, one from each row, as a tuple like another."""
    for k in range(len(like)):
        like = tuple_setitem(like, k, values[k * stride + i])
    return like


def _advance(tick: Callable[..., Any], size: int, count: int) -> Callable[..., None]:
    """Return the loop that advances cells through ticks; arguments as in ``ADVANCE``."""
    no_state, no_constants = (np.float32(0),) * size, (np.float32(0),) * count

    def advance(
        state: Any, constants: Any, stride: int, noise: Any, heard: Any, width: int, cells: int,
        ticks: int, marks: Any,
    ) -> None:  # fmt: skip
        for t in range(ticks):
            for i in range(cells):
                inputs = (heard[t * width + i], lanes.ones_at(noise[i], t))
                old = _gathered(state, no_state, stride, i)
                moved = tick(*(inputs + old + _gathered(constants, no_constants, stride, i)))
                fires = truth(moved[0])
                marks[i] |= fires << t
                new = moved[1:]
                for k in range(size):
                    state[k * stride + i] = kept(new[k])

    return advance


def _place(begin: Callable[..., Any], size: int, count: int) -> Callable[..., None]:
    """Return the loop that sets the state of cells at the start of a trial; as in ``PLACE``."""
    no_constants = (np.float32(0),) * count

    def place(state: Any, constants: Any, stride: int, key: int, cells: int) -> None:
        for i in range(cells):
            uniform = (lanes.word32(i, key) * 2.0**-32,)
            begun = begin(*(uniform + _gathered(constants, no_constants, stride, i)))
            for k in range(size):
                state[k * stride + i] = kept(begun[k])

    return place


def _reason(error: Exception) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return next((line for line in lines if "No implementation" in line), lines[0])

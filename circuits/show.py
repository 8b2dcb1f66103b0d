"""A circuit's tables as text for the terminal and as HTML for notebooks."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Mapping
from contextlib import suppress
from html import escape
from typing import Any

import pandas as pd

from circuits.cells import Cell
from circuits.declaration.courses import DOPAMINE
from circuits.declaration.rows import Population, Projection
from circuits.declaration.table import NATS, CircuitTable
from circuits.dynamics.fixed_point import off_nats, resting_hz
from circuits.laws.family import failures
from circuits.laws.members import loop

ASSUMED = "assumed"
"""Source shown for rows without a citation."""
WIDTH = 100
"""Characters of a line of text."""


def nuclei(circuit: CircuitTable, resting: Mapping[str, float]) -> pd.DataFrame:
    """Return the populations as a table: one row per nucleus, units in the column names."""
    unit = circuit.unit.removesuffix("s")
    rows = [
        {
            "nucleus": p.name,
            "cell": p.cell.kind,
            "channels": circuit.channels_of(p.name),
            "cells": p.neurons if p.spiking else 0,
            "releases": p.transmitter,
            "rest_hz": resting.get(p.name, math.nan),
            "baseline_hz": p.baseline_hz,
            f"gain_hz_per_{unit}": p.gain_hz_per_nat,
            "f": p.transfer,
            f"bias_{circuit.unit}": p.bias_nats,
            "tau_ms": p.tau_ms,
            "receptor": p.receptor,
            "heterogeneity": p.heterogeneity,
            "intact": _intact(p),
            "source": _source(p),
        }
        for p in circuit.populations
    ]
    return _dropping(pd.DataFrame(rows), receptor="", heterogeneity=0.0, intact="1")


def pathways(circuit: CircuitTable) -> pd.DataFrame:
    """Return the projections as a table: one row per pathway, units in the column names."""
    rows = [
        {
            "pathway": f"{p.source} -> {p.target}",
            "synapse": p.synapse,
            "reaches": p.pattern,
            "weight": p.weight,
            "delay_ms": p.delay_ms,
            "tau_ms": p.tau_ms,
            "probability": p.probability,
            "by_channel": " ".join(f"{factor:g}" for factor in p.factors),
            "intact": _intact(p),
            "f": p.transfer,
            "receptor": p.receptor,
            "source": _source(p),
        }
        for p in circuit.projections
    ]
    usual = {"probability": 1.0, "intact": "1", "f": "linear"}
    return _dropping(pd.DataFrame(rows), synapse="", by_channel="", receptor="", **usual)


def courses(circuit: CircuitTable) -> pd.DataFrame:
    """Return the courses as a table, one row each."""
    rows = [
        {
            "course": row.what,
            "amount": row.amount,
            "of": "level" if row.what == DOPAMINE else circuit.unit,
            **{name: getattr(row, name) for name in ("from_ms", "to_ms", "rise_ms", "decay_ms")},
            **{name: getattr(row, name) for name in ("rate_hz", "pulse_ms")},
            "source": row.cite or ASSUMED,
        }
        for row in circuit.courses
    ]
    return _dropping(pd.DataFrame(rows), rate_hz=0.0, pulse_ms=0.0)


def text(circuit: CircuitTable) -> str:
    """Return the whole circuit as one page of text; sources follow the table of their rows."""
    head, tables, foot = _page(circuit)
    before, after = (_wrapped(part.splitlines()) for part in (head, foot))
    return "\n\n".join([before, *map(_text, tables), after])


def html(circuit: CircuitTable) -> str:
    """Return the page of ``text`` as HTML."""
    head, tables, foot = _page(circuit)
    shown = [table.to_html(index=False, border=0, float_format="{:.4g}".format) for table in tables]
    around = [f"<p>{escape(part).replace(chr(10), '<br>')}</p>" for part in (head, foot)]
    return "\n".join([around[0], *shown, around[1]])


def _page(circuit: CircuitTable) -> tuple[str, list[pd.DataFrame], str]:
    resting: dict[str, float] = {}  # without a resting state
    with suppress(ValueError):
        resting = resting_hz(circuit)
    tables = [nuclei(circuit, resting), pathways(circuit)]
    if circuit.courses:
        tables.append(courses(circuit))
    return _head(circuit, resting), tables, constants(circuit)


def _head(circuit: CircuitTable, resting: Mapping[str, float]) -> str:
    low, high = circuit.range_nats
    at_rest = f"S = {circuit.reference_nats:.3g} nats"
    if circuit.unit != NATS:
        at_rest = f"in {circuit.unit}, not nats: no posterior follows from OUT; "
        at_rest += f"{circuit.rest_drive:.3g}"
    gain, most, lead = circuit.default_gain, circuit.max_lead_nats, ""
    if math.isfinite(most):
        lead = f"; follows a lead of up to {most:g} {circuit.unit} of drive per 100 ms"
    default = "no default gain" if gain is None else f"default gain {gain:g} per nat of evidence"
    return (
        f"{circuit.name}: {circuit.about}\n"
        f"{circuit.channels} channels, evidence into {circuit.input}, OUT from {circuit.readout}, "
        f"{'exact' if circuit.exact else 'not exact'}\n"
        f"{at_rest} at rest, works from {low:.3g} to {high:.3g}; OUT is readable "
        f"from {circuit.readable_nats[0]:.3g} to {circuit.readable_nats[1]:.3g}{lead}\n"
        f"{_drive(circuit)}, drive gain "
        f"{circuit.drive_gain:g}, read-out filter {circuit.readout_tau_ms:g} ms; {default}"
        f"{_off(circuit)}{_family(circuit)}{_outside(circuit, resting)}"
    )


def _off(circuit: CircuitTable) -> str:
    """Return a line on the error of OUT at the fixed point; empty if the unit is not nats."""
    if circuit.unit != NATS:
        return ""
    try:
        low, high = off_nats(circuit)
        text = f"{low:+.3f} to {high:+.3f} with equal competitors"
        if circuit.channels > 2:
            low, high = off_nats(circuit, 1)
            text += f", {low:+.3f} to {high:+.3f} with one competitor and the others far behind"
    except ValueError as error:
        text = f"not known ({error})"
    return f"\nerror of OUT at the fixed point, OUT + ln P where OUT is readable, nats: {text}"


def _family(circuit: CircuitTable) -> str:
    if circuit.unit != NATS:
        return ""
    if fails := failures(circuit):
        return "\nnot in the family of OUT = -ln P:" + "".join(f"\n  {text}" for text in fails)
    free = ", ".join(f"{name} {value:.3g}" for name, value in loop(circuit).items())
    return f"\nin the family of OUT = -ln P: {free}"


def _outside(circuit: CircuitTable, resting: Mapping[str, float]) -> str:
    rows = []
    for row in circuit.populations:
        hz = resting.get(row.name, math.nan)
        low, high = row.published_hz or (-math.inf, math.inf)
        if hz < low or hz > high:
            rows.append(f"{row.name} {hz:.3g} ({low:.3g} to {high:.3g})")
    return f"\nresting rates outside the published range, Hz: {', '.join(rows)}" if rows else ""


def _drive(circuit: CircuitTable) -> str:
    if not circuit.centred:
        return "each channel driven by its own evidence"
    most = circuit.max_deficit_nats
    apart = "" if math.isinf(most) else f", at most {most:g} apart"
    return f"drives less their mean over channels{apart}"


def constants(circuit: CircuitTable) -> str:
    """Return the constants of each cell, one line per cell with the nuclei that use it."""
    per_unit = f"_per_{circuit.unit.removesuffix('s')}"
    owners: dict[Cell, list[str]] = {}
    for p in circuit.populations:
        owners.setdefault(p.cell, []).append(p.name)
    return "\n".join(
        f"{', '.join(names)}: {cell.kind}"
        + "".join(
            f", {name.replace('_per_nat', per_unit)} {value:g}"
            for name, value in vars(cell).items()
        )
        for cell, names in owners.items()
    )


def _text(table: pd.DataFrame) -> str:
    """Return a table as text, words aligned left and numbers right."""
    numbers = table.drop(columns="source")
    words: dict[str, Any] = {}
    for name, column in list(numbers.items()):
        if not pd.api.types.is_numeric_dtype(column):
            left = f"{{:<{max(column.str.len().max(), len(str(name)))}}}".format
            numbers = numbers.rename(columns={name: left(name)})
            words[left(name)] = left
    lines = numbers.to_string(index=False, float_format="{:.4g}".format, formatters=words)
    rows = table.groupby("source", sort=False)[str(table.columns[0])].agg(", ".join)
    sources = _wrapped(f"  {names}: {source}" for source, names in rows.items())
    return "\n".join([*(line.rstrip() for line in lines.splitlines()), "", sources])


def _wrapped(lines: Iterable[str]) -> str:
    return "\n".join(textwrap.fill(line, WIDTH, subsequent_indent="    ") for line in lines)


def _source(row: Population | Projection) -> str:
    return "; ".join(filter(None, (row.cite, row.cite_more))) or ASSUMED


def _intact(p: Population | Projection) -> str:
    left = [p.intact * part for part in p.intact_by_channel or (1.0,)]
    clamped = isinstance(p, Population) and p.clamped
    return " ".join(f"{part:g}" for part in left) + (", clamped" if clamped else "")


def _dropping(table: pd.DataFrame, **defaults: object) -> pd.DataFrame:
    silent = [name for name, value in defaults.items() if (table[name] == value).all()]
    return table.drop(columns=silent)

"""Export of activity as Neurodata Without Borders (NWB), for tools that read recordings."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from circuits.activity import Activity
from circuits.declaration.table_writer import digest
from circuits.errors import require
from circuits.show import text
from circuits.store import replacing

COLUMNS = {"population": "nucleus", "channel": "alternative", "neuron": "cell of its channel"}
# A simulation has no date; with a fixed one the same run gives the same file.
START = datetime(2000, 1, 1, tzinfo=UTC)
NOBODY = {
    "species": "http://purl.obolibrary.org/obo/NCBITaxon_32644",  # "unidentified"
    "age": "P0D/",  # unknown: from 0 days on
    "sex": "U",
    "description": "A simulated circuit, not an animal: species, age and sex are unknown.",
}
"""The subject of a simulation, in the format's words for what is unknown."""
OF_INTERVALS = ("id", "start_time", "stop_time", "tags", "timeseries")
"""The format's own columns of a trial table."""
Trial = tuple[Activity, int]
"""An activity, and the index of a trial in it."""


def write_nwb(
    activity: Activity | Sequence[Activity],
    path: str | Path,
    *,
    trials: Sequence[int] | None = None,
    table: pd.DataFrame | None = None,
) -> None:
    """Write trials: a unit per cell with its spike times, a time series per nucleus, a trial table.

    Trials follow each other without the time at rest: each starts at the onset of its evidence. The
    activity is of one engine, circuit and clock; ``trials`` are indices in order, by default all;
    ``table`` has further columns of the trial table, such as decisions, one row for each trial
    written. The .nwb file is written completely or not at all.
    """
    try:
        from pynwb import NWBHDF5IO, NWBFile
        from pynwb.file import Subject
    except ImportError as error:
        raise ImportError('NWB needs pynwb: pip install ".[nwb]"') from error
    parts = [activity] if isinstance(activity, Activity) else activity
    every = [(part, k) for part in parts for k in range(len(part.output_nats))]
    chosen = range(len(every)) if trials is None else trials
    known = len(chosen) > 0 and all(k in range(len(every)) for k in chosen)
    require(known, "trials", f"must be within 0..{len(every) - 1}", trials)
    fits = table is None or len(table) == len(chosen)
    require(fits, "table", f"must have one row for each of {len(chosen)} trials", table)
    picked = [every[k] for k in chosen]
    columns = {"trial": [part.about.get("first_trial", 0) + k for part, k in picked]}
    first, circuit = picked[0][0], picked[0][0].circuit
    about = {"engine": first.engine, **first.about, "trials": columns["trial"]}
    identity = json.dumps([digest(circuit), about], sort_keys=True, default=str)
    done = hashlib.sha256(identity.encode())
    for part, k in picked:  # the same circuit and seed on another task
        done.update(np.ascontiguousarray(part.output_nats[k]).tobytes())
    key = done.hexdigest()[:32]
    file = NWBFile(
        session_description=f"simulation of {circuit.name}, not a recording",
        identifier=key,
        session_id=key[:8],
        session_start_time=START,
        experiment_description=circuit.about or circuit.name,
        keywords=["simulation", "basal ganglia"],
        subject=Subject(subject_id=circuit.name, **NOBODY),
        notes=json.dumps(about, sort_keys=True, default=str),
        protocol=text(circuit),
    )
    time_ms = first.time_ms
    apart_ms = float(time_ms[1] - time_ms[0]) if len(time_ms) > 1 else float(time_ms[0]) or 1.0
    _add_rates(file, picked, apart_ms)
    trial_ms = len(time_ms) * apart_ms
    _add_units(file, picked, trial_ms)
    if table is not None:
        columns |= {_name(str(name)): _values(table[name]) for name in table}
    for name in columns:
        file.add_trial_column(name, f"{name}, as in tables of trials")
    for n, values in enumerate(zip(*columns.values(), strict=True)):
        ends_s = {"start_time": n * trial_ms / 1000, "stop_time": (n + 1) * trial_ms / 1000}
        file.add_trial(**ends_s, **dict(zip(columns, values, strict=True)))
    with replacing(path) as partial, NWBHDF5IO(str(partial), "w") as out:
        out.write(file)


def _name(name: str) -> str:
    plain = re.sub(r"[/:]", "_", name)
    return f"given_{plain}" if plain in OF_INTERVALS else plain


def _values(column: pd.Series[Any]) -> list[Any]:
    """Return a column as the format takes it: numbers, with NaN for none, or text."""
    if column.dtype.kind not in "biuf":
        return [*column.fillna("").astype(str)]
    return [*(column.astype(np.float64) if column.hasnans else column)]


def _add_rates(file: Any, trials: Sequence[Trial], apart_ms: float) -> None:
    from pynwb import TimeSeries

    first = trials[0][0]
    series = {f"{n} rate": ([a.rates_hz[n][k] for a, k in trials], "Hz") for n in first.rates_hz}
    series["OUT"] = ([a.output_nats[k] for a, k in trials], first.circuit.unit)
    for name, (data, unit) in series.items():
        file.add_acquisition(
            TimeSeries(
                name=name,
                data=np.concatenate(data),
                unit=unit,
                starting_time=first.time_ms[0] / 1000,
                rate=1000 / apart_ms,
                description="one column per channel; the trials of the trial table in turn",
            )
        )


def _add_units(file: Any, trials: Sequence[Trial], trial_ms: float) -> None:
    from pynwb.misc import Units

    first = trials[0][0]
    for name in first.spikes or {}:
        if file.units is None:
            dt_s = first.about["dt_ms"] / 1000
            file.units = Units(name="units", description="simulated cells", resolution=dt_s)
            for column, about_it in COLUMNS.items():
                file.add_unit_column(column, about_it)
        spikes = [(a.spikes or {})[name].query(f"trial == {k}") for a, k in trials]
        late_ms = np.repeat(np.arange(len(spikes)) * trial_ms, [len(part) for part in spikes])
        table = pd.concat(spikes)
        table["time_ms"] += late_ms
        by_cell = table.sort_values("time_ms").groupby(["channel", "neuron"])["time_ms"]
        times = by_cell.apply(np.asarray).to_dict()
        cells = first.circuit.population(name).neurons
        for place in np.ndindex(first.circuit.channels_of(name), cells):
            # Silent cells are units too, otherwise mean rates would be too high.
            when = np.asarray(times.get(place, np.empty(0))) / 1000
            channel, neuron = place
            file.add_unit(spike_times=when, population=name, channel=channel, neuron=neuron)

"""Activity as Neurodata Without Borders, for the tools that read recordings."""

from __future__ import annotations

import hashlib
import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from circuits.activity import Activity
from circuits.declaration.table_files import digest
from circuits.errors import require
from circuits.show import text

COLUMNS = {"population": "nucleus", "channel": "alternative", "neuron": "cell of its channel"}
# A simulation has no date; a fixed one keeps the same run the same file.
START = datetime(2000, 1, 1, tzinfo=UTC)


def write_nwb(activity: Activity, path: str | Path, *, trial: int = 0) -> None:
    """Write one trial: a unit a cell with its spike times, and a time series of rates a nucleus.

    Parameters
    ----------
    activity : Activity
        From an engine; spikes are written if they were kept.
    path : path
        Ends in .nwb; written whole or not at all.
    trial : int
        Which trial.

    Raises
    ------
    ImportError
        If pynwb is missing.
    ValueError
        If there is no such trial.
    """
    try:
        from pynwb import NWBHDF5IO, NWBFile
    except ImportError as error:
        raise ImportError('NWB needs pynwb: pip install ".[nwb]"') from error
    trials = len(activity.output_nats)
    require(0 <= trial < trials, "trial", f"must be 0..{trials - 1}", trial)
    about = {"engine": activity.engine, "trial": trial, **activity.about}
    identity = json.dumps([digest(activity.circuit), about], sort_keys=True, default=str)
    file = NWBFile(
        session_description=f"simulation of {activity.circuit.name}, not a recording",
        identifier=hashlib.sha256(identity.encode()).hexdigest()[:32],
        session_start_time=START,
        notes=json.dumps(about, sort_keys=True, default=str),
        protocol=text(activity.circuit),
    )
    _add_rates(file, activity, trial)
    _add_units(file, activity, trial)
    path = Path(path)
    beside = path.with_name(f".part-{path.stem}.nwb")
    try:
        with NWBHDF5IO(str(beside), "w") as out:
            out.write(file)
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


def _add_rates(file: Any, activity: Activity, trial: int) -> None:
    """Add a time series of rates per nucleus, and OUT."""
    from pynwb import TimeSeries

    time_s = activity.time_ms / 1000
    series = {f"{name} rate": (rates[trial], "Hz") for name, rates in activity.rates_hz.items()}
    series["OUT"] = (activity.output_nats[trial], activity.circuit.unit)
    for name, (data, unit) in series.items():
        file.add_acquisition(
            TimeSeries(
                name=name,
                data=np.asarray(data),
                unit=unit,
                timestamps=time_s,
                description="one column a channel; time from the onset of evidence",
            )
        )


def _add_units(file: Any, activity: Activity, trial: int) -> None:
    """Add the spike times of each cell."""
    for name, table in (activity.spikes or {}).items():
        if file.units is None:
            for column, about_it in COLUMNS.items():
                file.add_unit_column(column, about_it)
        here = table[table["trial"] == trial].sort_values("time_ms")
        times = here.groupby(["channel", "neuron"])["time_ms"].apply(np.asarray).to_dict()
        cells = activity.circuit.population(name).neurons
        for place in np.ndindex(activity.circuit.channels_of(name), cells):
            # A silent cell is a unit too, or mean rates would come out too high.
            when = np.asarray(times.get(place, np.empty(0))) / 1000
            channel, neuron = place
            file.add_unit(spike_times=when, population=name, channel=channel, neuron=neuron)

"""Export of activity as Neurodata Without Borders (NWB), for tools that read recordings."""

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
# A simulation has no date; with a fixed one the same run gives the same file.
START = datetime(2000, 1, 1, tzinfo=UTC)


def write_nwb(activity: Activity, path: str | Path, *, trial: int = 0) -> None:
    """Write one trial: one unit per cell with its spike times, one time series per nucleus.

    Parameters
    ----------
    activity : Activity
        Result of an engine; spikes are written if they were recorded.
    path : path
        Ends in .nwb; the file is written completely or not at all.
    trial : int
        Index of the trial.

    Raises
    ------
    ImportError
        If pynwb is missing.
    ValueError
        If the trial does not exist.
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
    partial = path.with_name(f".part-{path.stem}.nwb")
    try:
        with NWBHDF5IO(str(partial), "w") as out:
            out.write(file)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


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
            # Silent cells are units too, otherwise mean rates would be too high.
            when = np.asarray(times.get(place, np.empty(0))) / 1000
            channel, neuron = place
            file.add_unit(spike_times=when, population=name, channel=channel, neuron=neuron)

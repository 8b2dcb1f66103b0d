"""The result type shared by all engines.

Pandas is imported where a table is made: decisions alone do not need it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from circuits import plots
from circuits.arrays import Array
from circuits.declaration.table import NATS, CircuitTable
from circuits.dynamics.wiring import Wiring
from circuits.errors import InputError, RangeWarning, require

if TYPE_CHECKING:
    import pandas as pd
    import xarray
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Activity:
    """The simulated activity of a circuit.

    Samples of a trial are NaN after it was dropped.
    """

    circuit: CircuitTable
    time_ms: Array  #: (ticks,) times of the samples, ms from the onset of evidence.
    #: (trials, ticks, channels) of each population: those of its surviving cells, 0 without any;
    #: spikes are counted between consecutive samples. Empty if the engine did not record rates.
    rates_hz: Mapping[str, npt.NDArray[np.floating]]
    #: (trials, ticks, channels) OUT: the read-out's rate, low-pass filtered and decoded.
    output_nats: Array
    engine: str  #: Name of the engine.
    #: For each spiking population, one row per spike: trial, channel, neuron, time_ms.
    spikes: dict[str, pd.DataFrame] | None = None
    #: Seed, tick and other metadata to be stored with the data.
    about: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def from_blocks(
        cls,
        wiring: Wiring,
        rates: npt.NDArray[Any] | None,
        time_ms: Array,
        *,
        engine: str,
        output_hz: Array | None = None,
        output_nats: Array | None = None,
        spikes: Mapping[str, pd.DataFrame] | None = None,
        **other: Any,
    ) -> Activity:
        """Build from rates (trials, ticks, blocks); the read-out is decoded from ``output_hz``.

        If ``rates`` is None, no rates are stored, and ``output_hz`` or ``output_nats`` is required.
        """
        circuit = wiring.circuit
        if output_nats is None:
            if output_hz is None:
                assert rates is not None
                output_hz = rates[..., wiring.span_of(circuit.readout)]
            output_nats = wiring.activity(output_hz, circuit.readout)
        by_name = {
            row.name: wiring.recorded(row.name, rates)
            for row in circuit.populations
            if rates is not None
        }
        left = {
            name: rows[np.isnan(wiring.held_hz[wiring.span_of(name)])[rows["channel"]]]
            for name, rows in (spikes or {}).items()
        }
        return cls(
            circuit=circuit,
            time_ms=np.asarray(time_ms, dtype=np.float64),
            rates_hz=by_name,
            output_nats=output_nats,
            engine=engine,
            spikes=left or None,
            **other,
        )

    def __repr__(self) -> str:
        trials, ticks, channels = self.output_nats.shape
        spikes = sum(map(len, self.spikes.values())) if self.spikes else "no recorded"
        low, high = (float(np.min(self.time_ms)), float(np.max(self.time_ms)))
        return (
            f"Activity({self.circuit.name} on {self.engine}: {trials} trials x {ticks} ticks x "
            f"{channels} channels, {low:g} to {high:g} ms, mean OUT "
            f"{np.nanmean(self.output_nats):.3g} {self.circuit.unit}, rates of "
            f"{len(self.rates_hz)} nuclei, {spikes} spikes)"
        )

    def _repr_html_(self) -> str:
        import pandas as pd

        pairs = self.rates_hz.items()
        means = {name: pd.Series(np.nanmean(rates, axis=(0, 1))) for name, rates in pairs}
        table = pd.DataFrame(means).rename_axis("channel").T.rename_axis("mean rate, Hz")
        page = table.to_html(border=0, float_format="{:.4g}".format, na_rep="")
        return f"<p>{escape(repr(self))}</p>\n{page if means else ''}"

    def plot(
        self, trial: int = 0, *, threshold: float | None = None, smooth_ms: float = 20.0
    ) -> Figure:
        """Draw one trial: rates and recorded spikes of each nucleus, and OUT.

        A row per nucleus, a line per channel (a pooled nucleus is grey), and OUT below. If spikes
        were recorded, rasters of up to 48 cells per nucleus are on the left. The first crossing of
        a threshold on OUT is marked. ``smooth_ms`` is the standard deviation of the Gaussian kernel
        that smooths rates; 0 draws them as recorded. The read-out's OUT is never smoothed.
        """
        if not self.rates_hz:
            reason = f"the {self.engine} engine recorded no rates: run it again with rates=True"
            raise InputError(reason, "rates")
        trials = len(self.output_nats)
        require(trial in range(trials), "trial", f"must be within 0..{trials - 1}", trial)
        spikes = self.spikes or {}
        return plots.activity(
            self.time_ms,
            {name: values[trial] for name, values in self.rates_hz.items()},
            self.output_nats[trial],
            unit=self.circuit.unit,
            spikes={name: rows[rows["trial"] == trial] for name, rows in spikes.items()},
            threshold=threshold,
            smooth_ms=smooth_ms,
        )

    def to_xarray(self) -> xarray.Dataset:
        """Return labelled rates and output, as in ``.rate_hz.sel(nucleus="STN", channel=0)``.

        The variables are ``rate_hz`` (nucleus, trial, time_ms, channel), Hz, if rates were
        recorded, and ``output`` (trial, time_ms, channel), in the circuit's unit. The rate of a
        pooled nucleus is repeated in every channel.
        """
        import xarray  # optional dependency

        channels = np.arange(self.circuit.channels)
        trials = np.arange(len(self.output_nats))
        axes = {"trial": trials, "time_ms": self.time_ms, "channel": channels}
        output = xarray.DataArray(self.output_nats, axes, attrs={"units": self.circuit.unit})
        dataset = xarray.Dataset({"output": output}, attrs={"circuit": self.circuit.name})
        if self.rates_hz:
            shape = self.output_nats.shape
            rates = np.stack([np.broadcast_to(each, shape) for each in self.rates_hz.values()])
            labels = {"nucleus": list(self.rates_hz), **axes}
            dataset["rate_hz"] = xarray.DataArray(rates, labels, attrs={"units": "Hz"})
        return dataset

    def decoded_nats(self, name: str) -> Array:
        """Return the activity of a population, nats (trials, ticks, channels)."""
        row = self.circuit.population(name)
        rates = np.asarray(self.rates_hz[name], dtype=np.float64)
        return (rates - row.baseline_hz) / row.gain_hz_per_nat

    def spectrum(
        self, name: str, *, from_ms: float = 0.0, segment_ms: float = 1000.0
    ) -> tuple[Array, Array]:
        """Return the power spectrum of a population's rate, averaged over channels (Welch 1967).

        The first array is the frequencies (F,), Hz, whose resolution is the inverse of
        ``segment_ms``; the second the one-sided density (F,), Hz^2 / Hz, averaged over trials and
        segments. For independent Poisson cells it is twice the rate divided by their number.
        Samples before ``from_ms`` are left out.
        """
        # Importing scipy.signal takes half a second, so it is done only here.
        from scipy.signal import welch

        late = self.time_ms > from_ms
        rates = np.asarray(self.rates_hz[name], dtype=np.float64)[:, late].mean(axis=2)
        apart_ms = float(self.time_ms[1] - self.time_ms[0])
        length = round(segment_ms / apart_ms)
        require(
            length <= rates.shape[1],
            "segment_ms",
            f"must be at most the time recorded after from_ms, {rates.shape[1] * apart_ms:g} ms",
            segment_ms,
        )
        frequency, power = welch(rates, fs=1000 / apart_ms, nperseg=length, axis=1)
        return frequency, power.mean(axis=0)

    def spike_table(self) -> pd.DataFrame:
        """Return all recorded spikes, with columns population, trial, channel, neuron, time_ms."""
        if not self.spikes:
            such = 'with a spiking engine, such as engine=Spikes(spikes=("STN",))'
            reason = f"the {self.engine} engine recorded no spikes: name the populations to record"
            raise InputError(f"{reason} {such}", "spikes")
        import pandas as pd

        parts = [table.assign(population=name) for name, table in self.spikes.items()]
        spikes = pd.concat(parts, ignore_index=True)
        return spikes[["population", *(name for name in spikes if name != "population")]]


class RateMeans:
    """Running means of rates over batches of trials, which need not be in memory together."""

    def __init__(self) -> None:
        self._sums: dict[str, Array] = {}
        self._counts: dict[str, Array] = {}
        self._time_ms: Array = np.zeros(0)

    def add(self, activity: Activity) -> None:
        """Add trials of the same circuit and clock; NaNs (dropped trials) are ignored."""
        self._time_ms = activity.time_ms
        for name, values in activity.rates_hz.items():
            summed, counted = np.nansum(values, axis=0), np.isfinite(values).sum(axis=0)
            self._sums[name] = self._sums.get(name, 0.0) + summed.astype(np.float64)
            self._counts[name] = self._counts.get(name, 0) + counted

    def table(self) -> pd.DataFrame:
        """Return the means as a table: one row per population, channel and time."""
        import pandas as pd

        parts = []
        for name, total in self._sums.items():
            ticks, channels = total.shape
            mean = total / np.where(self._counts[name] > 0, self._counts[name], np.nan)
            columns = {
                "population": name,
                "channel": np.tile(np.arange(channels), ticks),
                "time_ms": np.repeat(self._time_ms, channels),
                "rate_hz": mean.ravel(),
            }
            parts.append(pd.DataFrame(columns))
        return pd.concat(parts, ignore_index=True)


def spike_table(
    trial: npt.ArrayLike, channel: npt.ArrayLike, neuron: npt.ArrayLike, tick: Any, dt_ms: float
) -> pd.DataFrame:
    """Return spikes in the format of ``Activity.spikes``; tick 0 is the first with evidence."""
    import pandas as pd

    time_ms = (np.asarray(tick) + 1) * dt_ms
    names = {"trial": trial, "channel": channel, "neuron": neuron}
    columns = {name: np.asarray(value, dtype=np.int64) for name, value in names.items()}
    return pd.DataFrame(columns | {"time_ms": time_ms})


def spike_tables(
    wiring: Wiring, names: Sequence[str], spikes: Sequence[npt.NDArray[Any]], dt_ms: float
) -> dict[str, pd.DataFrame] | None:
    """Return spikes in the format of ``Activity.spikes``; None if ``names`` is empty.

    ``spikes`` has an array (spikes, 3) per trial: block, cell and tick of each.
    """
    trial = np.repeat(np.arange(len(spikes)), [len(rows) for rows in spikes])
    block, neuron, tick = np.concatenate(spikes).T
    tables = {}
    for name in names:
        here = np.isin(block, wiring.blocks_of(name))
        channel = wiring.channel[block[here]]
        tables[name] = spike_table(trial[here], channel, neuron[here], tick[here], dt_ms)
    return tables or None


def checked_drive(circuit: CircuitTable, drive: npt.ArrayLike) -> Array:
    """Return the drive as an array (trials, steps, columns), nats; ValueError if it is invalid.

    The columns of ``circuit.more_inputs`` are 0 where only the channels are given.
    """
    try:
        # One layout in memory: for each of them compiled loops would be compiled anew.
        values = np.asarray(drive, dtype=np.float64, order="C")
    except (TypeError, ValueError):
        raise InputError.of("drive", "must be an array of numbers, nats", drive) from None
    if values.ndim != 3 or 0 in values.shape[:2]:
        raise InputError.of("drive", "must be (trials, steps, channels)", values.shape)
    missing = circuit.columns - values.shape[2]
    if missing and missing == len(circuit.more_inputs):
        values = np.pad(values, ((0, 0), (0, 0), (0, missing)))
    if values.shape[2] != circuit.columns:
        count, has = values.shape[2], f"{circuit.name} has {circuit.channels} channels"
        load = f"load it with {count}, load_circuit(..., {count})"
        raise InputError(f"the drive has {count} hypotheses, {has}: {load}", "drive")
    if not np.isfinite(values).all():
        reason = "drive must be finite: a hypothesis that is ruled out would need -inf nats"
        raise InputError(reason, "drive")
    return values


def total_nats(circuit: CircuitTable, drive: Array) -> Array:
    """Return ``S = ln sum exp y`` of a drive (..., channels), nats."""
    circuit.check_nats("S = ln sum exp y")
    # One channel after the other: NumPy is slow along a last axis of a few numbers.
    channels = list(np.moveaxis(drive[..., : circuit.channels], -1, 0))
    top = reduce(np.maximum, channels)
    total = top + np.log(sum(np.exp(channel - top) for channel in channels))
    above: Array = circuit.reference_nats + total - np.log(circuit.channels)
    return above


def warn_beyond_range(circuit: CircuitTable, drive: Array) -> None:
    """Warn once if ``S``, or the input of a circuit without nats, leaves the circuit's range."""
    if warning := beyond_range(circuit, drive):
        RangeWarning.warn(warning)


def beyond_range(circuit: CircuitTable, drive: Array) -> str:
    """Return a warning for a drive that leaves the circuit's range, or "" if it stays inside."""
    in_nats = circuit.unit == NATS
    own = drive[..., : circuit.channels]
    nats = total_nats(circuit, drive) if in_nats else circuit.rest_drive + own
    low, high = circuit.range_nats
    if nats.min() >= low and nats.max() <= high:
        return ""
    where = ", where S = ln sum exp of the inputs" if in_nats else ""
    common, gain = "", " or a lower gain"
    if not circuit.centred:
        common = ": outside that range, input common to all channels does not cancel"
        gain = ", a lower gain, or each reading minus its mean over hypotheses"
    return (
        f"{'S' if in_nats else 'the input'} runs from {nats.min():.2f} to {nats.max():.2f} "
        f"{circuit.unit}, {circuit.name} works from {low:.3g} to {high:.3g}{where}{common}; "
        f"give weaker evidence{gain}"
    )

"""Figure A2: conflict (a competitor with nearly as much evidence as the true channel) and STN."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.figure import Figure

from bgmodel import stream
from bgmodel.bootstrap import RESAMPLES, interval, resampled
from bgmodel.comparison.matched import matched_measures
from bgmodel.comparison.thresholds import MSPRT_AT_GAIN, msprt_tradeoffs
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from bgmodel.integrators.deciding import CIRCUIT, decide_at_thresholds, thresholds_about
from bgmodel.simulated_evidence import gaussian_evidence
from bgmodel.support.files import read_table, write_table
from circuits.anatomy import DEFAULT, load_circuit
from circuits.circuit import Circuit
from circuits.dynamics.fixed_point import resting_hz
from circuits.engines import Population, engine_of
from figures.common import BRIEF_MS, Settings, bars, letter, off, run, where

CHANNELS, CONFLICT = 4, 0.9
D_PRIMES = {1.0: "C0", 0.5: "C1"}
NUCLEI = {"STN": "C0", "GPe": "C1", "SNr": "C2"}
STEP_MS, SAMPLE_MS, READINGS = 50.0, 5.0, 12
WINDOW_MS = (150.0, 600.0)
"""Averaging window of rates, after the onset."""
OLD = "spiking_msprt"
"""The circuit whose evidence has its mean over channels subtracted."""
GAINS = (0.0, 0.4, 0.8, 1.25)
"""Gains of the fast cortical inhibition; at 0 its cells are held at their resting rate."""
DEFAULT_GAIN = GAINS[-1]
AT = 0.90
DECIDED = {2: (0.5, 120), 4: (1.0, 40)}
"""By number of alternatives: d' and readings of the evidence on which decisions are compared."""
FALL_NATS, FALL_STEPS, BEFORE_STEPS = -1.0, 30, 10
LINEAR, EXACT = "linear", "exact"


def with_fast(gain: float, channels: int = CHANNELS) -> Circuit:
    """Return the default circuit with a gain of cortical inhibition, all resting rates kept."""
    table = load_circuit(DEFAULT, channels)
    if not gain:
        return table.clamp("ctx_inh")
    tone = table.population("ctx").bias_nats
    tone += (gain + table.projection("ctx_inh", "ctx").weight) * table.rest_drive
    table = table.with_projection("ctx_inh", "ctx", weight=-gain)
    return table.with_population("ctx", bias_nats=tone)


def circuits() -> dict[str, Circuit]:
    """Return the circuits by name: the default with each gain of inhibition, and the old one."""
    return {f"{gain:g}": with_fast(gain) for gain in GAINS} | {OLD: load_circuit(OLD, CHANNELS)}


SHOWN = {f"{DEFAULT_GAIN:g}": "default", "0": "ctx_inh held", OLD: OLD}
"""Circuits that are also run in spikes, and whose time courses are drawn."""
COLOURS = dict(zip(SHOWN, ("C0", "C4", "C3"), strict=True))


def conflicting(settings: Settings, conflict: float, d_prime: float, trials: int) -> Evidence:
    """Draw evidence; conflict changes only one channel's mean."""
    given: dict[str, Any] = {"d_prime": d_prime, "t_max": READINGS, "step_ms": STEP_MS}
    rng = stream(settings.seed, "figA2", f"{d_prime:g}")
    return gaussian_evidence(trials, channels=CHANNELS, conflict=conflict, seed=rng, **given)


def rates(settings: Settings, *, output: Path) -> None:
    """Measure the effect of conflict on rates, with populations, spikes and in theory."""
    parts = []
    for d_prime in D_PRIMES:
        for name, table in circuits().items():
            parts.append(rise(settings, name, table, "population", d_prime))
            if d_prime == 1 and name in SHOWN:
                parts.append(rise(settings, name, table, "ensemble", d_prime))
        parts.append(ceiling(settings, d_prime))
    write_table(pd.concat(parts), output, seed=settings.seed, settings=settings)


def rise(
    settings: Settings, name: str, table: Circuit, engine: str, d_prime: float
) -> pd.DataFrame:
    """Return the rise of each nucleus' mean rate with conflict, in per cent.

    Returns
    -------
    DataFrame
        Columns circuit, engine, d_prime, nucleus, time_ms (NaN for the mean of the window),
        mean_ms (averaging time of the rate), value, low, high (the rise and its 95 % interval over
        trials), and both rates, plain_hz and conflict_hz. Time courses only for STN.
    """
    chosen = engine_of(engine, settle_ms=BRIEF_MS, sample_ms=SAMPLE_MS)
    trials = settings.circuit_trials // 2 if chosen.spiking else 2 * settings.circuit_trials
    weights = resampled(trials, RESAMPLES, stream(settings.seed, "bootstrap"))
    model = BasalGanglia(table, chosen, gain_of(table), settings.seed)
    found: list[dict[str, npt.NDArray[np.float64]]] = []
    for conflict in (0.0, CONFLICT):
        shown = conflicting(settings, conflict, d_prime, trials)
        seen: dict[str, list[npt.NDArray[np.float64]]] = {nucleus: [] for nucleus in NUCLEI}
        for _, activity, _ in model.batches(shown):
            time_ms = activity.time_ms
            for nucleus, hz in seen.items():
                # Averaged over the channels of the nucleus; trials stay separate.
                hz.append(activity.rates_hz[nucleus].mean(axis=2).astype(np.float64))
        found.append({nucleus: np.concatenate(hz) for nucleus, hz in seen.items()})
    window = (time_ms >= WINDOW_MS[0]) & (time_ms <= WINDOW_MS[1])
    rows = []
    for nucleus in NUCLEI:
        plain, with_competitor = (one[nucleus] for one in found)
        means = [weights @ hz[:, window].mean(axis=1) / trials for hz in (plain, with_competitor)]
        pairs = [(np.nan, np.ptp(WINDOW_MS), *means)]
        if nucleus == "STN" and d_prime == 1:
            for mean_ms in (SAMPLE_MS, STEP_MS):
                pairs += course(plain, with_competitor, weights, mean_ms)
        for t, mean_ms, before, after in pairs:
            ends = interval(100 * (after / before - 1))
            rows.append((name, engine, d_prime, nucleus, t, mean_ms, *ends, before[0], after[0]))
    columns = ["circuit", "engine", "d_prime", "nucleus", "time_ms", "mean_ms"]
    columns += ["value", "low", "high"]
    return pd.DataFrame(rows, columns=[*columns, "plain_hz", "conflict_hz"])


def course(
    plain: npt.NDArray[np.float64],
    with_competitor: npt.NDArray[np.float64],
    weights: npt.NDArray[np.float64],
    mean_ms: float,
) -> list[tuple[float, float, npt.NDArray[np.float64], npt.NDArray[np.float64]]]:
    """Return the centre and length of each span, and both rates for weights of trials (B,)."""
    pairs = []
    for k, first in enumerate(range(0, plain.shape[1], per := round(mean_ms / SAMPLE_MS))):
        means = [hz[:, first : first + per].mean(axis=1) for hz in (plain, with_competitor)]
        both = [weights @ hz / len(hz) for hz in means]
        pairs.append(((k + 0.5) * mean_ms, mean_ms, *both))
    return pairs


def ceiling(settings: Settings, d_prime: float) -> pd.DataFrame:
    """Return the rise of STN, per cent, if none of the common mode were cancelled.

    S is the log of the channels' mean exponential. STN's sum answers ``ln Sigma = S - w G`` with
    ``G = Sigma - ln Sigma``: a nat of S raises it by 1 / (1 + L) at rest, L = w (Sigma - 1)
    (linear), and by less where Sigma is above its rest (exact). No delays, no noise.
    """
    table, trials = load_circuit(DEFAULT, CHANNELS), 2 * settings.circuit_trials
    share = -table.projection("GPe", "STN").weight
    stn = table.population("STN").gain_hz_per_nat
    rest = CHANNELS * resting_hz(table)["STN"] / stn
    sigma = np.linspace(0.01, 20 * rest, 20_000)
    needed = np.log(sigma) + share * (sigma - np.log(sigma))
    needed -= np.interp(rest, sigma, needed)
    # Each reading is held until the next one.
    held = (np.arange(*WINDOW_MS, SAMPLE_MS) // STEP_MS).astype(int)
    nats, sums = [], []
    for conflict in (0.0, CONFLICT):
        y = gain_of(table) * conflicting(settings, conflict, d_prime, trials).own_totals[:, held]
        s = np.log(np.exp(y).mean(axis=2))
        nats.append(s.mean(axis=1))
        sums.append(np.interp(s, needed, sigma).mean(axis=1))
    weights = resampled(trials, RESAMPLES, stream(settings.seed, "bootstrap")) / trials
    loop = share * (rest - 1)
    values = {
        LINEAR: weights @ (nats[1] - nats[0]) / (1 + loop),
        EXACT: weights @ sums[1] / (weights @ sums[0]) - 1,
    }
    rows = [(kind, "theory", d_prime, "STN", *interval(100 * v)) for kind, v in values.items()]
    columns = ["circuit", "engine", "d_prime", "nucleus", "value", "low", "high"]
    return pd.DataFrame(rows, columns=columns)


def frontier(settings: Settings, *, output: Path) -> None:
    """Measure the effect of each gain on OUT after a common fall, and on decision times."""
    rows: list[tuple[object, ...]] = []
    for gain in GAINS:
        fall = fall_of_out(with_fast(gain))
        rows.append((gain, CHANNELS, "fall_nats", fall, fall, fall))
        for channels, (d_prime, readings) in DECIDED.items():
            given: dict[str, Any] = {"d_prime": d_prime, "t_max": readings, "step_ms": STEP_MS}
            rng = stream(settings.seed, "figA2", "decisions", channels)
            trials = 4 * settings.circuit_trials
            shown = gaussian_evidence(trials, channels=channels, seed=rng, **given)
            table = with_fast(gain, channels)
            kappa = gain_of(table)
            engine = Population(settle_ms=BRIEF_MS, sample_ms=2.0)
            model = BasalGanglia(table, engine, kappa, settings.seed)
            test = msprt_tradeoffs(shown, kappa)[MSPRT_AT_GAIN]
            levels = thresholds_about(test, 0.95)
            own = decide_at_thresholds(model, shown, levels, decoder_tau_ms=None)[CIRCUIT]
            rng = stream(settings.seed, "bootstrap")
            found = matched_measures(test, own, rng=rng, accuracies=(AT,)).set_index("measure")
            row = found.loc["pearson_r", ["value", "low", "high"]]
            rows.append((gain, channels, "pearson_r", *row))
    columns = ["gain", "channels", "measure", "value", "low", "high"]
    write_table(pd.DataFrame(rows, columns=columns), output, seed=settings.seed, settings=settings)


def fall_of_out(table: Circuit) -> float:
    """Return the lowest OUT after all channels fall by a nat at rest, above rest, without noise."""
    drive = np.zeros((1, FALL_STEPS, table.channels))
    drive[0, BEFORE_STEPS:] = FALL_NATS
    model = BasalGanglia(table, Population(noise=False), 1.0)
    found = model.run_drive(drive, STEP_MS)
    out, after = found.output_nats[0, :, 0], found.time_ms >= BEFORE_STEPS * STEP_MS
    return float(out[after].min() - out[~after][-1])


def draw(settings: Settings, rated: Path, decided: Path, *, output: Path) -> Figure:
    """Draw the rise by gain of inhibition and by nucleus, over time, and the trade-offs."""
    table, traded = read_table(rated), read_table(decided)
    figure = plt.figure(figsize=(7.4, 5.0))
    axes = figure.subplots(2, 3)
    window = table[table["time_ms"].isna()]
    _gains(axes[0, 0], window)
    _nuclei(axes[0, 1], window[window["d_prime"] == 1])
    courses = table[table["time_ms"].notna() & (table["engine"] == "population")]
    _courses(axes[0, 2], courses)
    _added(axes[1, 0], courses)
    _fall(axes[1, 1], window, traded)
    _times(axes[1, 2], window, traded)
    letter(axes[0, 0], "a  STN, by fast inhibition")
    letter(axes[0, 1], "b  nuclei, d' = 1")
    letter(axes[0, 2], "c  STN over time, d' = 1")
    letter(axes[1, 0], "d  rise of STN over time, d' = 1")
    letter(axes[1, 1], "e  versus common fall")
    letter(axes[1, 2], "f  versus decision times")
    return figure


def _gains(ax: Any, table: pd.DataFrame) -> None:
    """Show STN's rise against the gain of inhibition, and to the right in the old circuit."""
    stn, old = where(table, nucleus="STN"), GAINS[-1] + 0.4
    ax.axhline(0, color="0.8", lw=0.8, zorder=0)
    for d_prime, colour in D_PRIMES.items():
        rows, spikes, theory = (
            where(stn, d_prime=d_prime, engine=engine)
            for engine in ("population", "ensemble", "theory")
        )
        fast = rows[rows["circuit"] != OLD]
        given: dict[str, Any] = {"fmt": "o", "ms": 3.5, "color": colour, "lw": 1}
        x = fast["circuit"].astype(float)
        bars(ax, x, fast, ls="-", label=f"d' = {d_prime:g}", **given)
        bars(ax, [old], where(rows, circuit=OLD), **given)
        x = pd.Series([old if name == OLD else float(name) for name in spikes["circuit"]])
        bars(ax, np.add(x, 0.06), spikes, **given | {"fmt": "s", "mfc": "w", "ms": 4})
        for kind, style, label in ((LINEAR, "--", "rise of S / (1 + L)"), (EXACT, ":", "exact")):
            level = theory.loc[theory["circuit"] == kind, "value"].item()
            ax.plot([-0.1, old + 0.1], [level, level], color=colour, lw=0.9, ls=style)
            if d_prime == 1:
                ax.text(old + 0.1, level + 0.7, label, fontsize=7, ha="right", color=colour)
    ax.plot([], [], "o", ms=3.5, color="0.4", label="populations")
    ax.plot([], [], "s", ms=4, color="0.4", mfc="w", label="spikes")
    ax.set_xticks([*GAINS, old], [*(f"{gain:g}" for gain in GAINS), "old"])
    ax.set(xlabel="gain of the fast inhibition of cortex", ylabel="rise of rate with conflict (%)")
    ax.set_ylim(top=1.4 * stn["high"].max())
    ax.legend(loc="upper right", ncols=2, columnspacing=1, handlelength=1.4)


def _nuclei(ax: Any, table: pd.DataFrame) -> None:
    """Show the rise of each nucleus, by circuit and engine."""
    ax.axhline(0, color="0.8", lw=0.8, zorder=0)
    for k, (nucleus, colour) in enumerate(NUCLEI.items()):
        shown = (("population", "o", colour, 0.0, nucleus), ("ensemble", "s", "w", 0.07, None))
        for engine, mark, fill, beside, label in shown:
            rows = where(table, nucleus=nucleus, engine=engine)
            rows = rows.set_index("circuit").loc[list(SHOWN)]
            x = np.arange(len(SHOWN)) + 0.2 * (k - 1) + beside
            style: dict[str, Any] = {"fmt": mark, "ms": 3.5, "lw": 0.8, "color": colour}
            bars(ax, x, rows, mfc=fill, label=label, **style)
    # A name breaks at its blank, or after an underscore.
    names = (n.replace(" ", "\n") if " " in n else n.replace("_", "_\n") for n in SHOWN.values())
    ax.set_xticks(range(len(SHOWN)), list(names))
    ax.set(ylabel="rise of rate with conflict (%)")
    ax.legend(loc="upper right")


def _courses(ax: Any, table: pd.DataFrame) -> None:
    """Show STN's rate over time, without and with conflict."""
    for name, label in SHOWN.items():
        for mean_ms, lw in ((SAMPLE_MS, 0.4), (STEP_MS, 1.4)):
            rows = where(table, circuit=name, mean_ms=mean_ms)
            for column, style in (("plain_hz", "-"), ("conflict_hz", "--")):
                ax.plot(rows["time_ms"], rows[column], color=COLOURS[name], lw=lw, ls=style)
        ax.plot([], [], color=COLOURS[name], label=label)
    for style, label in (("-", "no conflict"), ("--", f"conflict {CONFLICT:g}")):
        ax.plot([], [], color="0.4", ls=style, lw=1, label=label)
    ax.set(xlabel="time from the onset (ms)", ylabel="mean rate of STN (Hz)")
    ax.set_ylim(top=ax.get_ylim()[0] + 1.5 * np.ptp(ax.get_ylim()))
    ax.legend(loc="upper left", ncols=1)


def _added(ax: Any, table: pd.DataFrame) -> None:
    """Show the effect of conflict on STN over time, with its interval; shaded, the window."""
    ax.axvspan(*WINDOW_MS, color="0.93", lw=0, zorder=0)
    ax.axhline(0, color="0.7", lw=0.8, zorder=0)
    for name, label in SHOWN.items():
        rows, colour = where(table, circuit=name, mean_ms=STEP_MS), COLOURS[name]
        ax.plot(rows["time_ms"], rows["value"], color=colour, lw=1, label=label)
        ax.fill_between(rows["time_ms"], rows["low"], rows["high"], color=colour, lw=0, alpha=0.25)
    ax.set(xlabel="time from the onset (ms)", ylabel="rise of rate with conflict (%)")
    ax.set_ylim(top=1.5 * table.loc[table["mean_ms"] == STEP_MS, "high"].max())
    ax.legend(loc="upper left")


def _rises(window: pd.DataFrame) -> pd.DataFrame:
    """Return STN's rise with populations, d' = 1, one row per gain in the order of ``GAINS``."""
    rows = where(window, nucleus="STN", d_prime=1, engine="population")
    rows = rows[rows["circuit"] != OLD]
    return rows.set_index(rows["circuit"].astype(float)).loc[list(GAINS)]


def _fall(ax: Any, window: pd.DataFrame, traded: pd.DataFrame) -> None:
    """Show STN's rise against the fall of OUT when all channels fall."""
    rises = _rises(window)
    fall = where(traded, measure="fall_nats").set_index("gain").loc[list(GAINS)]
    bars(ax, fall["value"], rises, fmt="o-", ms=3.5, lw=1, color="k")
    _named(ax, fall["value"], rises["value"])
    ax.set(xlabel="lowest OUT after -1 nat (nats)", ylabel="rise of STN (%)")


def _times(ax: Any, window: pd.DataFrame, traded: pd.DataFrame) -> None:
    """Show STN's rise against the correlation of decision times with the MSPRT's."""
    rises = _rises(window)
    for (channels, (d_prime, _)), colour in zip(DECIDED.items(), ("C2", "C5"), strict=True):
        r = where(traded, measure="pearson_r", channels=channels).set_index("gain").loc[list(GAINS)]
        style: dict[str, Any] = {"fmt": "o-", "ms": 3.5, "lw": 1, "color": colour}
        label = f"N = {channels}, d' = {d_prime:g}"
        ax.errorbar(r["value"], rises["value"], off(rises), off(r), label=label, **style)
    # Both have the same rises.
    _named(ax, r["value"], rises["value"])
    ax.set(xlabel="r of decision times", ylabel="rise of STN (%)")
    ax.set_ylim(top=1.35 * rises["high"].max())
    ax.legend(loc="upper right")


def _named(ax: Any, x: pd.Series, y: pd.Series) -> None:
    """Label each point with its gain."""
    for gain in GAINS:
        ax.annotate(f"{gain:g}", (x[gain], y[gain]), (4, 3), textcoords="offset points", fontsize=7)


if __name__ == "__main__":
    run(rates=rates, frontier=frontier, draw=draw)

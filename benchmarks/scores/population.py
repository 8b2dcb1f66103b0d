"""The population engine versus spikes, on scoring seeds: python -m benchmarks.scores.population.

Both decide on the same evidence with independent noise; the difference is compared with that
between two noise seeds of spikes, which no engine can fall below. No constant of the population
engine was fitted to spikes, and the seeds are held out. Before the evidence both are at rest for a
second, because spikes start from a burst that takes about as long to decay. Figure P2 is drawn from
the tables.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy.signal import welch
from scipy.stats import ks_2samp

from benchmarks.scores.pieces import Made, Piece, Score, main
from bgmodel import stream
from bgmodel.deciding.tradeoff import Tradeoff
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from bgmodel.integrators.deciding import CIRCUIT, decide_at_thresholds
from bgmodel.simulated_evidence import gaussian_evidence
from circuits.activity import Activity
from circuits.anatomy import DEFAULT, load_circuit
from circuits.circuit import Circuit
from circuits.engines import engine_of, run

SCORING_SEED = 50_001
OTHER_SEED, POPULATION_SEED = SCORING_SEED + 1, SCORING_SEED + 2
STEP_MS, SETTLE_MS = 50.0, 1000.0
POSTERIORS = (0.8, 0.85, 0.9, 0.95)
D_PRIMES = {2: (0.35, 0.5, 0.8), 4: (0.35, 0.5, 0.8), 8: (0.35, 0.5, 0.8)}
READINGS = {0.35: 120, 0.5: 80, 0.8: 40}
"""Most readings of a trial, by d': nearly all decide."""
EDITS: dict[str, Callable[[Circuit], Circuit]] = {
    "STN -10 %": lambda table: table.lesion("STN", 0.1),
    "STN -20 %": lambda table: table.lesion("STN", 0.2),
    "GPe -10 %": lambda table: table.lesion("GPe", 0.1),
    "dopamine 0.5": lambda table: table.dopamine(0.5),
    "dopamine 0.9": lambda table: table.dopamine(0.9),
    "dopamine 1.2": lambda table: table.dopamine(1.2),
    "a third of the cells": lambda table: table.with_neurons_times(1 / 3),
    "three times the cells": lambda table: table.with_neurons_times(3),
}
EDITED, EDITED_AT, EDITED_D_PRIME = (2, 4), 0.9, 0.5
"""Alternatives, posterior and d' of the edits."""
BANDS_HZ = ((4, 8), (8, 13), (13, 20), (20, 30), (30, 45), (45, 70), (70, 100))
SIZES = (0.1, 0.3, 1.0, 3.0)
"""Numbers of cells, relative to the table, for which the noise of OUT is measured."""
HELD_NATS = (0.0, 0.6, 1.2)
SPIKES, AGAIN, POPULATION = "spikes", "spikes, another seed", "population"
TIMES = ("mean_ms", "sd_ms")
DECISIONS = {2: 600, 4: 300, 8: 100}
EDIT_TRIALS = {2: 300, 4: 150}
HELD_TRIALS = 300
"""Trials, by alternatives: as many as half an hour allows, for a spiking trial is of 7 000 cells a
channel. With a fifth of those of held evidence the power of a band scatters by up to a fifth."""
SECONDS = {2: 0.3, 4: 0.4, 8: 0.8}
"""CPU time of a trial of decisions on three engines, about, by alternatives."""
ENGINES = {
    SPIKES: ("ensemble", SCORING_SEED),
    AGAIN: ("ensemble", OTHER_SEED),
    POPULATION: ("population", POPULATION_SEED),
}


def evidence(channels: int, d_prime: float, trials: int) -> Evidence:
    """Draw the evidence of one condition."""
    rng = stream(SCORING_SEED, "population", str(channels), str(d_prime))
    given = {"d_prime": d_prime, "t_max": READINGS[d_prime], "step_ms": STEP_MS}
    return gaussian_evidence(trials, channels=channels, seed=rng, **given)


def decided(table: Circuit, shown: Evidence, name: str, workers: int) -> Tradeoff:
    """Let a circuit decide on an engine, at every posterior."""
    engine, seed = ENGINES[name]
    chosen = engine_of(engine, workers=workers, settle_ms=SETTLE_MS)
    model = BasalGanglia(table, chosen, gain_of(table), seed)
    thresholds = -np.log(POSTERIORS)
    return decide_at_thresholds(model, shown, thresholds, decoder_tau_ms=None)[CIRCUIT]


def _measures(found: Tradeoff, truth: npt.NDArray[Any], k: int) -> dict[str, float]:
    times, right = found.time_ms[k], found.choice[k] == truth
    quantiles = dict(zip(("q10", "q50", "q90"), np.quantile(times, (0.1, 0.5, 0.9)), strict=True))
    return {
        "accuracy": right.mean(),
        "forced": found.forced[k].mean(),
        "mean_ms": times.mean(),
        "sd_ms": times.std(),
        **quantiles,
    }


def _beside(found: Tradeoff, other: Tradeoff, k: int) -> dict[str, float]:
    return {
        "ks": float(ks_2samp(found.time_ms[k], other.time_ms[k]).statistic),
        "r": float(np.corrcoef(found.time_ms[k], other.time_ms[k])[0, 1]),
        "same_choice": float((found.choice[k] == other.choice[k]).mean()),
    }


def decisions(channels: int, d_prime: float, trials: int, workers: int) -> pd.DataFrame:
    """Return accuracy and times of each engine, and how far each lies from spikes."""
    rows, shown = [], evidence(channels, d_prime, trials)
    assert shown.truth is not None
    found = {
        name: decided(load_circuit(DEFAULT, channels), shown, name, workers) for name in ENGINES
    }
    for k, threshold in enumerate(found[SPIKES].settings):
        for name, own in found.items():
            of = {"channels": channels, "d_prime": d_prime}
            of |= {"posterior": float(np.exp(-threshold)), "engine": name}
            beside = _beside(own, found[SPIKES], k)
            rows.append(of | _measures(own, shown.truth, k) | beside)
    return pd.DataFrame(rows)


def edits(channels: int, trials: int, workers: int) -> pd.DataFrame:
    """Return the change of accuracy and time by each edit, in spikes and by populations."""
    rows, table = [], load_circuit(DEFAULT, channels)
    shown = evidence(channels, EDITED_D_PRIME, trials)
    k = sorted(POSTERIORS).index(EDITED_AT)
    for name in (SPIKES, POPULATION):
        intact = decided(table, shown, name, workers)
        for edit, of in EDITS.items():
            found = decided(of(table), shown, name, workers)
            later = found.time_ms[k] - intact.time_ms[k]
            right = (found.choice[k] == shown.truth) * 1.0 - (intact.choice[k] == shown.truth)
            se = [values.std() / np.sqrt(trials) for values in (right, later)]
            rows.append(
                {"channels": channels, "edit": edit, "engine": name}
                | {"accuracy_gained": right.mean(), "later_ms": later.mean()}
                | {"accuracy_se": se[0], "later_se_ms": se[1]}
            )
    return pd.DataFrame(rows)


def _held(table: Circuit, nats: float, trials: int, name: str, workers: int) -> Activity:
    """Run a circuit under held evidence: one channel ahead, the others behind."""
    engine, seed = ENGINES[name]
    ahead = nats * np.where(np.arange(table.channels) == 0, 1.0, -1 / (table.channels - 1))
    return run(
        table,
        np.broadcast_to(ahead, (trials, 4, table.channels)),
        engine=engine,
        step_ms=500.0,
        settle_ms=SETTLE_MS,
        seed=seed,
        workers=workers,
    )


def rates(trials: int, workers: int) -> pd.DataFrame:
    """Return mean rates, power by band and scatter of OUT under held evidence."""
    rows = []
    for channels in (2, 4):
        for nats in HELD_NATS:
            for name in ENGINES:
                table = load_circuit(DEFAULT, channels)
                activity = _held(table, nats, trials, name, workers)
                of = {"channels": channels, "nats": nats, "engine": name, "size": 1.0}
                rows += [of | one for one in _spectra(activity, table)]
                scatter = float(activity.output_nats[:, 500:].std(axis=(0, 1))[0])
                rows.append(of | {"what": "OUT", "measure": "sd_nats", "value": scatter})
    for size in SIZES:
        for name in ENGINES:
            few = max(6, round(trials * min(1, 1 / size)))
            activity = _held(
                load_circuit(DEFAULT, 2).with_neurons_times(size), 0.0, few, name, workers
            )
            scatter = float(activity.output_nats[:, 500:].std(axis=(0, 1))[0])
            of = {"channels": 2, "nats": 0.0, "engine": name, "size": size}
            rows.append(of | {"what": "OUT by size", "measure": "sd_nats", "value": scatter})
    return pd.DataFrame(rows)


def _spectra(activity: Activity, table: Circuit) -> Iterator[dict[str, Any]]:
    for row in table.populations:
        if not row.spiking:
            continue
        late = np.asarray(activity.rates_hz[row.name][:, 500:], dtype=np.float64)
        yield {"what": row.name, "measure": "hz", "value": float(late[..., 0].mean())}
        at, power = welch(late.mean(axis=2), fs=1000, nperseg=500, axis=1)
        for low, high in BANDS_HZ:
            inside = (at >= low) & (at < high)
            value = float(power.mean(axis=0)[inside].mean())
            yield {"what": row.name, "measure": f"{low}-{high} Hz", "value": value}


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return the distance from spikes of decisions, edits, the power of rates, and the scatter."""
    rows = []
    for (channels, d_prime), part in made["decisions"].groupby(["channels", "d_prime"]):
        by = part.set_index(["posterior", "engine"]).unstack("engine")
        both = [SPIKES, AGAIN]
        off = {name: by[name][POPULATION] / by[name][both].mean(axis=1) - 1 for name in TIMES}
        wrong = by["accuracy"][POPULATION] - by["accuracy"][both].mean(axis=1)
        rows.append(
            {"channels": channels, "d_prime": d_prime, "accuracy_off": wrong.abs().max()}
            | {f"{name}_off": values.abs().max() for name, values in off.items()}
            | {"ks_above": (by["ks"][POPULATION] - by["ks"][AGAIN]).max()}
            | {"r_below": (by["r"][AGAIN] - by["r"][POPULATION]).max()}
            | {"forced": part["forced"].max()}
        )
    edited = made["edits"].pivot(index=["channels", "edit"], columns="engine")
    edited.columns = [f"{column}_{engine}" for column, engine in edited.columns]
    order = [(n, edit) for n in sorted(set(made["edits"]["channels"])) for edit in EDITS]
    power, scatter = of_rates(made["rates"])
    return {
        "decisions": ("decisions", pd.DataFrame(rows)),
        "edits": ("edits", edited.loc[order].reset_index()),
        "power": ("rates", power),
        "scatter": ("rates", scatter),
    }


def of_rates(found: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the misfit of power spectra to those of spikes, and the scatter of OUT by size."""
    index = ["channels", "nats", "size", "what", "measure"]
    wide = found.set_index([*index, "engine"])["value"].unstack("engine").reset_index()
    wide = wide.rename(columns={AGAIN: "again"})
    bands = wide[wide["measure"].str.contains("-") & (wide[SPIKES] > 1e-4)]
    off = {name: (bands[name] / bands[SPIKES] - 1).abs() for name in (POPULATION, "again")}
    power = {"pairs": len(bands)}
    for name, values in off.items():
        power |= {f"{name}_median": values.median(), f"{name}_most": values.max()}
    scatter = wide[wide["what"] == "OUT by size"].sort_values("size")
    return pd.DataFrame([power]), scatter[["size", SPIKES, "again", POPULATION]]


def draw(made: Made, folder: Path) -> None:
    """Draw figure P2."""
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(2, 3, figsize=(11, 6.4))
    _draw_decisions(made["decisions"], panels[0])
    _draw_edits(made["edits"], panels[1, 0])
    _draw_rates(made["rates"], panels[1, 1], panels[1, 2])
    figure.tight_layout()
    for ending in ("pdf", "png"):
        figure.savefig(folder / f"figP2.{ending}", dpi=150)


COLOURS = {AGAIN: "0.6", POPULATION: "#cc3311"}


def _draw_decisions(found: pd.DataFrame, panels: Any) -> None:
    by = found.set_index(["channels", "d_prime", "posterior", "engine"]).unstack("engine")
    shown = {"accuracy": "accuracy", "mean_ms": "mean time, ms", "sd_ms": "sd of times, ms"}
    for panel, (column, label) in zip(panels, shown.items(), strict=True):
        for name, colour in COLOURS.items():
            panel.plot(by[column][SPIKES], by[column][name], "o", ms=4, color=colour, label=name)
        ends = [by[column].min().min(), by[column].max().max()]
        panel.plot(ends, ends, lw=0.8, color="k", zorder=0)
        panel.set_xlabel(f"{label}: spikes")
        panel.set_ylabel("other")
    panels[0].legend(frameon=False, fontsize=8)


def _draw_edits(found: pd.DataFrame, panel: Any) -> None:
    by = found.set_index(["channels", "edit", "engine"]).unstack("engine")["later_ms"]
    errors = found.set_index(["channels", "edit", "engine"]).unstack("engine")["later_se_ms"]
    for channels, marker in zip(by.index.unique(0), "os", strict=False):
        own, se = by.loc[channels], 2 * errors.loc[channels]
        panel.errorbar(own[SPIKES], own[POPULATION], se[POPULATION], se[SPIKES], fmt=marker, ms=4,
                       color=COLOURS[POPULATION], lw=0.8, label=f"N = {channels}")  # fmt: skip
    ends = [by.min().min(), by.max().max()]
    panel.plot(ends, ends, lw=0.8, color="k", zorder=0)
    panel.set_xlabel("later by an edit, ms: spikes")
    panel.set_ylabel("population")
    panel.legend(frameon=False, fontsize=8)


def _draw_rates(found: pd.DataFrame, spectra: Any, sizes: Any) -> None:
    power = found[found["measure"].str.contains("-") & (found["what"] != "OUT")]
    by = power.set_index(["channels", "nats", "what", "measure", "engine"])["value"].unstack(
        "engine"
    )
    bands = [f"{low}-{high} Hz" for low, high in BANDS_HZ]
    place = by.index.get_level_values("measure").map(bands.index)
    for shift, (name, colour) in zip((-0.1, 0.1), COLOURS.items(), strict=True):
        spectra.plot(place + shift, by[name] / by[SPIKES], ".", ms=3, color=colour)
    spectra.axhline(1, lw=0.8, color="k", zorder=0)
    spectra.set_xticks(range(len(bands)), [band.removesuffix(" Hz") for band in bands], fontsize=7)
    spectra.set_xlabel("band, Hz")
    spectra.set_ylabel("power of a nucleus, over that of spikes")
    spectra.set_ylim(0.5, 1.5)
    grown = found[found["what"] == "OUT by size"]
    for name in ENGINES:
        own = grown[grown["engine"] == name].sort_values("size")
        sizes.loglog(
            own["size"], own["value"], "o-", ms=4, color=COLOURS.get(name, "k"), label=name
        )
    sizes.set_xlabel("cells, over the table's")
    sizes.set_ylabel("sd of OUT at rest, nats")
    sizes.legend(frameon=False, fontsize=8)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield a piece per condition of decisions, per number of alternatives of edits, and rates.

    There is no coarse form: on few trials two seeds of spikes differ by more than the engines.
    """
    if fast:
        return
    for channels, d_primes in D_PRIMES.items():
        many = DECISIONS[channels]
        for d_prime in d_primes:
            made = partial(decisions, channels, d_prime, many, workers)
            name = f"N = {channels}, d' {d_prime:g}"
            yield Piece("decisions", name, many, SECONDS[channels] * many, made)
    for channels in EDITED:
        many = EDIT_TRIALS[channels]
        made = partial(edits, channels, many, workers)
        yield Piece("edits", f"N = {channels}", many, 5 * SECONDS[channels] * many, made)
    many = HELD_TRIALS
    yield Piece("rates", "held evidence", many, 1.7 * many, partial(rates, many, workers))


SCORE = Score("population", SCORING_SEED, tuple(D_PRIMES), pieces, tables, draw, circuit=DEFAULT)

if __name__ == "__main__":
    main(SCORE)

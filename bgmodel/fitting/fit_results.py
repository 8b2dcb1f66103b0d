"""Results of fits to several people or models, their report, and their folder of files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from bgmodel.fitting.cautions import finer
from bgmodel.fitting.hierarchy.group_fit import GroupFit
from bgmodel.fitting.hierarchy.labels import legend
from bgmodel.fitting.likelihood import Likelihood
from bgmodel.fitting.model_comparison import ModelComparison
from bgmodel.fitting.parameters import told_priors
from bgmodel.fitting.person_fit import Fit
from bgmodel.fitting.quantiles import residuals, too_few
from bgmodel.fitting.settings import FitSettings
from bgmodel.support import __version__
from bgmodel.support.files import (
    check_new,
    check_writable,
    checksum,
    is_result,
    provenance,
    read_provenance,
    recorded,
    save_figure,
    write_table,
)
from bgmodel.support.saved import Facts, packed, unpacked
from bgmodel.support.tables import Readable
from circuits.arrays import Arrays
from circuits.errors import InputError
from circuits.store import Entry, safe

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WORST = 5
"""Number of residuals in the report of a fit."""
Drawn = Callable[[], "Figure"]


@dataclass(frozen=True, repr=False)
class Fits(Facts):
    """Fits of one or several models to each participant."""

    fits: dict[str, dict[str, Fit]]  # by model and participant
    comparison: ModelComparison | None = None  # if it was asked for

    @property
    def people(self) -> list[str]:
        """Names of the participants."""
        return list(next(iter(self.fits.values())))

    def facts(self) -> dict[str, str]:
        """Return participants, models, and how well these predict, if they were compared."""
        facts = {"participants": ", ".join(self.people), "models": ", ".join(self.fits)}
        return facts | ({} if self.comparison is None else self.comparison.facts())

    def parameters(self) -> pd.DataFrame:
        """Return ``Fit.parameters`` of each participant and model, fixed ones as ``held``.

        With the log likelihood, its error due to simulated trials, and the number of trials left
        out.
        """
        return self._joined(_parameters)

    def cells(self) -> pd.DataFrame:
        """Return ``Fit.cells`` of each participant and model."""
        return self._joined(Fit.cells)

    def _joined(self, table_of: Callable[[Fit], pd.DataFrame]) -> pd.DataFrame:
        parts = []
        for who in self.people:
            for name, fits in self.fits.items():
                parts.append(table_of(fits[who]))
                parts[-1].insert(0, "participant", who)
                parts[-1].insert(1, "model", name)
        return pd.concat(parts, ignore_index=True)

    def tables(self) -> dict[str, pd.DataFrame]:
        """Return ``parameters()`` and ``cells()``, by name."""
        return {"parameters": self.parameters(), "cells": self.cells()}

    def summary(self) -> pd.DataFrame:
        """Return the parameters with their errors and intervals, as a table to read."""
        table = self.parameters().set_index(["participant", "model", "parameter"]).round(4)
        shown = ["value", "standard_error", "low", "high", "at_bound", "held"]
        return Readable(table[shown].dropna(axis="columns", how="all"))

    def to_dataframe(self) -> pd.DataFrame:
        """Return ``parameters()``."""
        return self.parameters()

    def figures(self) -> dict[str, Drawn]:
        """Return what draws each participant, by the name of a file."""
        return {safe(who): partial(self.plot, who) for who in self.people}

    def plot(self, who: str | None = None) -> Figure:
        """Draw the data of a participant, by default the first, with every model; see ``Fit``."""
        who = self.people[0] if who is None else who
        fits = {name: each[who] for name, each in self.fits.items()}
        cells = {name: fit.cells() for name, fit in fits.items()}
        peaks = {name: (fit.optimum.likelihood, fit.optimum.vector) for name, fit in fits.items()}
        likelihood = next(iter(peaks.values()))[0]
        trials = likelihood.design.choices
        source = "" if trials is None else f"{trials.source}, "
        return likelihood.draw(cells, peaks, f"{source}{who}")


def _parameters(fit: Fit) -> pd.DataFrame:
    """Return the numbers of a fit, and those that it held, with its log likelihood."""
    likelihood = fit.optimum.likelihood
    held = pd.Series(likelihood.freedom.held, dtype=float)
    more = pd.DataFrame({"parameter": held.index, "value": held.to_numpy()})
    more = more.assign(at_bound=False, held=True)
    return pd.concat([fit.parameters().assign(held=False), more], ignore_index=True).assign(
        log_likelihood=fit.optimum.log_likelihood,
        log_likelihood_simulation_error=fit.simulation.log_likelihood,
        left_out=likelihood.design.left_out,
    )


def fit_entry(
    folder: Path | None, title: str, key: Any, likelihood: Likelihood
) -> Entry[tuple[Fit, list[str]]]:
    """Return the place of a fit and its warnings; the likelihood is not stored, but made again."""

    def pack(kept: tuple[Fit, list[str]]) -> Arrays:
        width_s = kept[0].optimum.likelihood.design.grid.width_s
        optimum = replace(kept[0].optimum, likelihood=None)  # type: ignore[arg-type]
        return packed((replace(kept[0], optimum=optimum), kept[1], width_s))

    def unpack(arrays: Arrays) -> tuple[Fit, list[str]]:
        fit, cautions, width_s = unpacked(arrays)
        fitted = likelihood
        while fitted.design.grid.width_s > width_s:  # bins that a fit has made narrower
            fitted = finer(fitted)
        return replace(fit, optimum=replace(fit.optimum, likelihood=fitted)), cautions

    return Entry(folder, __version__, key, pack, unpack, title)


def report(fit: Fit, name: str) -> str:
    """Return priors, trade-offs, errors and residuals of a fit as text; ``name`` begins lines."""
    names, cells = fit.directions.names, fit.cells()
    cosines = pd.DataFrame(fit.directions.cosines, names, names).round(2)
    priors, error_nats = told_priors(fit.priors), fit.simulation.log_likelihood
    lines = [f"\n{name}: {priors}"] if priors else []
    lines += [f"\n{name}: parameter trade-offs (cosine similarity)", cosines.to_string()]
    if error_nats:
        lines.append(f"{name}: log likelihood {fit.optimum.log_likelihood:.1f}, with a simulation "
                     f"error of {error_nats:.1f} nats")  # fmt: skip
    in_whole_ms = dict.fromkeys(("data_ms", "model_ms", "residual_ms"), 0)
    worst = residuals(cells)[:WORST].round({**in_whole_ms, "se_ms": 1, "z": 1})
    if len(worst):
        lines.append(f"\n{name}: largest differences between quantiles of data and model")
        lines.append(worst.to_string(index=False, float_format="{:g}".format))
    lines += filter(None, [too_few(cells)])
    if fit.posterior is not None and fit.posterior.long_enough:
        lines.append(f"{name}: effective sample size {fit.posterior.effective:.0f}")
    return "\n".join(lines)


@dataclass(frozen=True, repr=False)
class GroupFits(Facts):
    """Fits of one or several models to a group of people, with distributions of the group."""

    fits: dict[str, GroupFit]  # by model
    comparison: ModelComparison | None = None  # if it was asked for

    @property
    def people(self) -> list[str]:
        """Names of the participants."""
        return next(iter(self.fits.values())).people

    def facts(self) -> dict[str, str]:
        """Return each model's group, and how well they predict, if they were compared."""
        facts = {name: repr(fit) for name, fit in self.fits.items()}
        return facts | ({} if self.comparison is None else self.comparison.facts())

    def tables(self) -> dict[str, pd.DataFrame]:
        """Return each table of ``GroupFit``, of all models, by name; empty ones are left out."""
        tables = {
            "group": self.to_dataframe(),
            "people": self._joined(GroupFit.to_dataframe),
            "people_cells": self._joined(GroupFit.cells),
            "group_effects": self.effects(),
            "group_correlations": self.correlations(),
        }
        return {name: table for name, table in tables.items() if not table.empty}

    def _joined(self, table_of: Callable[[GroupFit], pd.DataFrame]) -> pd.DataFrame:
        every = [table_of(fit).assign(model=name) for name, fit in self.fits.items()]
        table: pd.DataFrame = pd.concat(every, ignore_index=True)
        table.insert(0, "model", table.pop("model"))
        return table

    def effects(self) -> pd.DataFrame:
        """Return ``GroupFit.effects`` of each model."""
        return self._joined(lambda fit: fit.effects().reset_index())

    def correlations(self) -> pd.DataFrame:
        """Return ``GroupFit.correlations`` of each model."""
        return self._joined(lambda fit: fit.correlations().reset_index())

    def summary(self) -> pd.DataFrame:
        """Return the parameters of each model's group, with effects, priors and correlations."""
        table = self.to_dataframe().set_index(["model", "parameter"]).round(4)
        return Readable(table).with_note(self.notes())

    def notes(self) -> str:
        """Return effects of predictors, a legend, priors and correlations as text."""
        effects = self.effects()
        notes = [] if effects.empty else [effects.round(4).to_string(index=False)]
        every = [name for fit in self.fits.values() for name in fit.parameters]
        notes.append(legend(every, signed=not effects.empty))
        notes += [f"{name}, {fit.notes()}" for name, fit in self.fits.items() if fit.notes()]
        return "\n\n".join(notes)

    def to_dataframe(self) -> pd.DataFrame:
        """Return ``GroupFit.summary`` of each model."""
        return self._joined(lambda fit: fit.summary().reset_index())

    def figures(self) -> dict[str, Drawn]:
        """Return what draws each model's parameters, and its cells, by the name of a file."""
        drawn: dict[str, Drawn] = {}
        for name, fit in self.fits.items():
            drawn |= {stem(name): fit.plot, f"{stem(name)} cells": fit.plot_cells}
        return drawn

    def plot(self, model: str | None = None) -> Figure:
        """Draw the parameters of a model, by default the first; see ``GroupFit.plot``."""
        return next(iter(self.fits.values())).plot() if model is None else self.fits[model].plot()


def stem(model: str) -> str:
    """Return the name of a model, which may be a .toml file, as part of the name of a file."""
    return Path(model).stem if model.endswith(".toml") else model


EACH = ("parameters", "cells")
GROUP = ("group", "people", "people_cells", "group_effects", "group_correlations")
"""Tables of fits to each participant, and of hierarchical fits."""
COMPARISON = "comparison"
"""Table, and figure, of the comparison of models."""
ESTIMATES = "estimates.csv"
"""Table of estimates without a model, such as SSRT by integration, for trials that have any."""
UNSHARED = ("evidence", "participant", "draws", "compare", "seed")
"""Settings that fits in one folder need not share, or that are recorded in another way."""


def settings_shared(asked: FitSettings, data: str, trials: str) -> dict[str, Any]:
    """Return the settings that all fits in a folder share, with data and the hash of its trials."""
    shared = {each.name for each in fields(asked)} - {*UNSHARED}
    options = {name: recorded(getattr(asked, name)) for name in sorted(shared)}
    if asked.rt_window is not None:
        # As text, since JSON has no infinity.
        options["rt_window"] = [f"{time:g}" for time in asked.rt_window]
    simulated = {"simulated_trials": options.pop("trials"), "simulation_seed": asked.seed}
    known = asked.evidence
    if isinstance(known, str | Path):
        options["evidence"] = checksum(known)
    return {"data": data, "trials": trials, **simulated, **options, "bgmodel": __version__}


@dataclass(frozen=True)
class FitFolder:
    """A folder for the tables of all fits of one command, with what they were made with."""

    path: Path
    shared: dict[str, Any]  # settings
    participants: list[str]
    models: list[str]
    circuits: dict[str, str]  # hash of the circuit of each model that has one
    seed: int = 0

    def check(
        self, names: tuple[str, ...], force: bool = False, estimates: pd.DataFrame | None = None
    ) -> None:
        """Raise ValueError if it can't be written, or holds other fits than these, unless by force.

        Files that no table of a fit accounts for are not written over, tables not even by force.
        Estimates without a model are written, if there are any.
        """
        check_writable(self.path)
        files = {*(f"{name}.csv" for name in names), *_drawn(self._made)}
        files |= {f"{COMPARISON}.png"} if COMPARISON in names else set()
        files |= {ESTIMATES} if estimates is not None else set()
        ours, other = set[str](), set[str]()
        for name in (*EACH, *GROUP, COMPARISON, Path(ESTIMATES).stem):
            if is_result(path := self.path / f"{name}.csv"):
                before = read_provenance(path)["parameters"]
                ours |= {path.name, f"{name}.png", *_drawn(before)}
                differing = self._differing(before)
                other |= differing if name in names else differing & {"trials"}
        for path in (self.path / name for name in sorted(files)):
            table = path.suffix == ".csv"
            if path.exists() and path.name not in ours and (table or not force):
                way = "give another folder" + ("" if table else ", or --force to overwrite it")
                reason = f"{str(path)!r} exists and is not a result of a fit: {way}"
                raise InputError(reason, "folder")
            check_new(path, force=True)
        if other and not force:
            too = "fit it too, " if other <= {"participant", "model"} else ""
            raise InputError(
                f"{str(self.path)!r} holds fits that differ in {', '.join(sorted(other))}: {too}"
                "give another folder, or --force to overwrite their tables",
                "folder",
            )
        if estimates is not None:
            write_table(estimates, self.path / ESTIMATES, seed=self.seed, **self.shared)

    def write(self, fits: Fits | GroupFits, note: Callable[[str], None]) -> None:
        """Write tables, figures and draws."""
        tables, figures = fits.tables(), fits.figures()
        if fits.comparison is not None:
            tables[COMPARISON] = fits.comparison.to_dataframe()
            figures[COMPARISON] = fits.comparison.plot
        for name, table in tables.items():
            write_table(table, self.path / f"{name}.csv", seed=self.seed, **self._made)
        for name, draw in figures.items():
            try:
                save_figure(draw(), self.path / f"{name}.png")
            except InputError as error:
                note(f"{name}: no figure, {error}")
        if isinstance(fits, GroupFits):
            for name, fit in fits.fits.items():
                fit.to_netcdf(self.path / f"{stem(name)}.nc")

    @property
    def _made(self) -> dict[str, Any]:
        """What the tables of fits record."""
        made = {name: getattr(self, name) for name in ("participants", "models", "circuits")}
        return {**self.shared, **made}

    def _differing(self, made: dict[str, Any]) -> set[str]:
        """Return the names of settings with other values in a table's record, and of lost rows."""
        before = dict(made)
        circuits, now = before.pop("circuits", {}), provenance(**self.shared)["parameters"]
        lost = {
            "participant": {*before.pop("participants", [""])} - {*self.participants},
            "model": {*before.pop("models", [""])} - {*self.models},
            "circuit": {name for name, sha in self.circuits.items()
                        if circuits.get(name, sha) != sha},
        }  # fmt: skip
        names = {name for name in {*before, *now} if before.get(name) != now.get(name)}
        return names | {name for name, some in lost.items() if some}


def _drawn(made: dict[str, Any]) -> set[str]:
    """Return the names of figures and draws of the fits of a table, by its record."""
    if made.get("people") not in ("hierarchical", "correlated"):
        return {f"{safe(who)}.png" for who in made.get("participants", ())}
    ends = (".png", " cells.png", ".nc")
    return {f"{stem(name)}{end}" for name in made.get("models", ()) for end in ends}

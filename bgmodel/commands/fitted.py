"""Fits to each participant: stored, reported, drawn and gathered."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bgmodel.commands.output import plain, recorded, save_figure, say, stages
from bgmodel.support import files
from bgmodel.support.arrays import Array
from bgmodel.support.saved import packed, unpacked
from bgmodel.version import __version__
from circuits.errors import InputError, collected
from circuits.store import Entry, safe

if TYPE_CHECKING:
    import pandas as pd

    from bgmodel.fitting.fit import Fit
    from bgmodel.fitting.likelihood import Likelihood
    from bgmodel.fitting.model_comparison import ModelComparison
    from bgmodel.trials.record import Trials

TABLES = ("parameters.csv", "cells.csv")
WORST = 5
"""Number of residuals that are printed for each fit."""


class Piece(NamedTuple):
    """Tables of one finished fit, as from ``fit.Fit``, and its warnings, one per row."""

    parameters: pd.DataFrame
    cells: pd.DataFrame
    cautions: pd.DataFrame


def entry_of(folder: Path, title: str, key: dict[str, Any]) -> Entry[Piece]:
    """Return the place of a finished fit in a folder of results."""
    return Entry(folder / "pieces", __version__, key, packed, unpacked, title)


@dataclass(frozen=True)
class Kept:
    """Fits in a folder; finished ones are not repeated.

    Parameters
    ----------
    folder : path
        Folder for all results.
    seed : int
        Seed of the simulated trials, part of the tables' provenance.
    asked : dict
        Options shared by all fits in the folder, part of the tables' provenance.
    circuits : dict of str to str
        Hash of each model's circuit, if it has one; fits of the same name must share it.
    posterior : bool
        Whether to draw from the posterior.
    note : function
        Prints a line.
    """

    folder: Path
    seed: int
    asked: Mapping[str, Any]
    circuits: Mapping[str, str]
    posterior: bool
    note: Callable[[str], None]

    def check(self, force: bool) -> None:
        """Raise ValueError if the folder can't be written, or holds results to be preserved.

        Parameters
        ----------
        force : bool
            Whether results of another command may be overwritten.
        """
        files.check_writable(self.folder)
        for path in (self.folder / name for name in TABLES):
            if path.exists() and not files.is_result(path):
                reason = f"{str(path)!r} exists and is not a result of a fit: give another folder"
                raise InputError(reason, "folder")
        other = sorted({each for name in TABLES for each in self._differs(name)})
        if other and not force:
            raise InputError(
                f"{str(self.folder)!r} holds fits with another {', '.join(other)}: give another "
                "folder, or --force to overwrite their tables",
                "folder",
            )

    def _before(self, table: str) -> dict[str, Any]:
        """Return the parameters of an existing table; an empty dict without a table."""
        there = self.folder / table
        return files.read_provenance(there)["parameters"] if files.is_result(there) else {}

    def _differs(self, table: str) -> list[str]:
        """Return the names of options with other values in an existing table."""
        before = self._before(table)
        if not before:
            return []
        circuits = before.pop("circuits", {})
        now = files.provenance(**self.asked)["parameters"]
        differing = {name for name in {*before, *now} if before.get(name) != now.get(name)}
        if any(circuits.get(name, sha) != sha for name, sha in self.circuits.items()):
            differing.add("circuit")
        return sorted(differing)

    def person(self, who: str, some: Trials, asked: Mapping[str, Likelihood]) -> list[Piece]:
        """Return the fits of one participant, by name of the model, and draw them."""
        pieces = {name: self._one(who, some, name, each) for name, each in asked.items()}
        cells = {name: piece.cells for name, piece in pieces.items()}
        peaks = {name: (each, _peak(pieces[name])) for name, each in asked.items()}
        figure = next(iter(asked.values())).draw(cells, peaks, f"{some.source}, {who}")
        save_figure(figure, self.folder / f"{safe(who)}.png")
        return list(pieces.values())

    def _one(self, who: str, some: Trials, name: str, likelihood: Likelihood) -> Piece:
        """Return the tables of one fit, read from its files or computed."""
        from bgmodel.fitting.likelihood import identity_of

        key: dict[str, Any] = {
            "participant": who,
            "data": some.checksum,
            "model": recorded(identity_of(likelihood.model)),
            "free": likelihood.freedom.names,
            "values": [each.start for each in likelihood.freedom.parameters],
            "priors": likelihood.freedom.priors,
            "window_s": [f"{time:g}" for time in likelihood.design.observed.window_s],
            "left_out": likelihood.design.left_out,
            "posterior": self.posterior,
        }
        entry = entry_of(self.folder, f"{who} {plain(name)}", key)
        piece = entry.get()
        if piece is not None:
            self.note(f"{who}, {name}: already done")
        else:
            piece = self._fitted(who, name, likelihood)
            entry.put(piece)
        _warn(who, name, piece)
        return piece

    def _fitted(self, who: str, name: str, likelihood: Likelihood) -> Piece:
        """Fit a model to one participant, and report the fit."""
        import pandas as pd

        from bgmodel.fitting.fit import fit_likelihood

        with stages(f"{who}, {name}") as tell, collected() as cautions:
            fit = fit_likelihood(likelihood, draws=self.posterior, tell=tell)
        self._say(who, name, fit)
        held = pd.Series(likelihood.freedom.held, dtype=float)
        more = pd.DataFrame({"parameter": held.index, "value": held.to_numpy()})
        more = more.assign(at_bound=False, held=True)
        numbers = pd.concat([fit.parameters().assign(held=False), more], ignore_index=True)
        said_so = pd.DataFrame({"caution": cautions}, dtype=str)
        piece = Piece(numbers, fit.cells(), said_so)
        piece.parameters["log_likelihood"] = fit.optimum.log_likelihood
        piece.parameters["log_likelihood_simulation_error"] = fit.simulation.log_likelihood
        piece.parameters["left_out"] = likelihood.design.left_out
        for table in (piece.parameters, piece.cells):
            table.insert(0, "participant", who)
            table.insert(1, "model", name)
        return piece

    def _say(self, who: str, name: str, fit: Fit) -> None:
        """Report identifiability, simulation error and the effective number of samples."""
        import pandas as pd

        from bgmodel.fitting.parameters import told_priors

        names = fit.directions.names
        cosines = pd.DataFrame(fit.directions.cosines, names, names).round(2)
        priors = told_priors(fit.priors)
        if priors:
            self.note(f"\n{who}, {name}: {priors}")
        self.note(f"\n{who}, {name}: parameter trade-offs (cosine similarity)")
        self.note(cosines.to_string())
        error_nats = fit.simulation.log_likelihood
        if error_nats:
            self.note(
                f"{who}, {name}: log likelihood {fit.optimum.log_likelihood:.1f}, with a "
                f"simulation error of {error_nats:.1f} nats"
            )
        self._say_residuals(who, name, fit.cells())
        drawn = fit.posterior
        if drawn is not None and drawn.long_enough:
            self.note(f"{who}, {name}: effective sample size {drawn.effective:.0f}")

    def _say_residuals(self, who: str, name: str, cells: pd.DataFrame) -> None:
        """Report where quantiles of correct and wrong times miss those of the model most."""
        from bgmodel.fitting.quantiles import residuals, too_few

        in_whole_ms = dict.fromkeys(("data_ms", "model_ms", "residual_ms"), 0)
        worst = residuals(cells)[:WORST].round({**in_whole_ms, "se_ms": 1, "z": 1})
        if len(worst):
            self.note(f"\n{who}, {name}: largest differences between quantiles of data and model")
            self.note(worst.to_string(index=False, float_format="{:g}".format))
        few = too_few(cells)
        if few:
            self.note(few)

    def compare(
        self, fitted: Sequence[Sequence[Piece]], likelihoods: Mapping[str, Mapping[str, Likelihood]]
    ) -> str:
        """Compare the models by cross-validation, write table and figure, and return the text.

        Parameters
        ----------
        fitted : sequence of sequences of Piece
            The fits of each participant, in the order of ``likelihoods``.
        likelihoods : dict of str to dict of str to Likelihood
            Likelihood of each participant's trials under each model.
        """
        from bgmodel.fitting.model_comparison import crossvalidated

        optima: dict[str, dict[str, Any]] = {}
        for (who, models), pieces in zip(likelihoods.items(), fitted, strict=True):
            for (name, likelihood), piece in zip(models.items(), pieces, strict=True):
                optima.setdefault(name, {})[who] = (likelihood, _peak(piece))
        scores = crossvalidated(optima, tell=say)
        write_comparison(scores, self.folder, self.seed, {**self.asked, "circuits": self.circuits})
        return scores.summary()

    def gather(self, made: Sequence[Piece]) -> pd.DataFrame:
        """Write the tables of all fits, keeping earlier ones of others, and return the first.

        Parameters
        ----------
        made : sequence of Piece
            The fits.
        """
        import pandas as pd

        tables: list[tuple[pd.DataFrame, dict[str, str]]] = []
        parts = ([piece.parameters for piece in made], [piece.cells for piece in made])
        for name, some in zip(TABLES, parts, strict=True):
            table, circuits = pd.concat(some, ignore_index=True), dict(self.circuits)
            known = self._before(name)
            if known and not self._differs(name):
                before = _as_written(self.folder / name, table)
                circuits |= known["circuits"]
                who = ["participant", "model"]
                ours = pd.MultiIndex.from_frame(table[who].astype(str))
                others = ~pd.MultiIndex.from_frame(before[who].astype(str)).isin(ours)
                table = pd.concat([before[others], table], ignore_index=True)
            tables.append((table, circuits))
        for name, (table, circuits) in zip(TABLES, tables, strict=True):
            asked = {**self.asked, "circuits": circuits}
            files.write_table(table, self.folder / name, seed=self.seed, **asked)
        return tables[0][0]


def write_comparison(
    comparison: ModelComparison, folder: Path, seed: int, asked: Mapping[str, Any]
) -> None:
    """Write the table and the figure of a comparison of models."""
    files.write_table(comparison.to_dataframe(), folder / "comparison.csv", seed=seed, **asked)
    save_figure(comparison.plot(), folder / "comparison.png")


def _warn(who: str, name: str, piece: Piece) -> None:
    """Print the warnings of a fit, also of an earlier one."""
    for caution in piece.cautions["caution"]:
        say(f"{who}, {name}: {caution}")


def _as_written(path: Path, like: pd.DataFrame) -> pd.DataFrame:
    """Return a table of earlier fits; columns that are text in the new one stay text."""
    import pandas as pd

    texts = [name for name in like if pd.api.types.is_string_dtype(like[name])]
    none = {str(name): [""] for name in like if name not in texts}
    kinds = dict.fromkeys(texts, str)
    return pd.read_csv(path, dtype=kinds, keep_default_na=False, na_values=none)


def _peak(piece: Piece) -> Array:
    """Return the fitted parameters of a piece."""
    table = piece.parameters
    return np.asarray(table.loc[~table["held"].astype(bool), "value"], dtype=float)

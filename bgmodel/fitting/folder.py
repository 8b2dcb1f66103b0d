"""A folder of fits: their tables, figures and draws, all of one question."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import pandas as pd

from bgmodel.fitting.settings import FitSettings
from bgmodel.fitting.several import Fits, GroupFits, stem
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
from bgmodel.version import __version__
from circuits.errors import InputError

EACH = ("parameters", "cells")
GROUP = ("group", "people", "people_cells", "group_effects", "group_correlations")
"""Tables of fits to each participant, and of hierarchical fits."""
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
    """A folder whose tables share settings and, for models of one name, circuits."""

    path: Path
    shared: dict[str, Any]  # settings
    circuits: dict[str, str]  # hash of the circuit of each model that has one
    seed: int = 0

    def check(
        self, names: tuple[str, ...], force: bool = False, estimates: pd.DataFrame | None = None
    ) -> None:
        """Raise ValueError if it can't be written, or holds other tables, unless by force.

        Estimates without a model are written, if there are any.
        """
        check_writable(self.path)
        if estimates is not None:
            check_new(self.path / ESTIMATES, force=is_result(self.path / ESTIMATES))
        other = set()
        for path in (self.path / f"{name}.csv" for name in names):
            if path.exists() and not is_result(path):
                reason = f"{str(path)!r} exists and is not a result of a fit: give another folder"
                raise InputError(reason, "folder")
            other |= self._differing(path)
        if other and not force:
            raise InputError(
                f"{str(self.path)!r} holds fits with another {', '.join(sorted(other))}: give "
                "another folder, or --force to overwrite their tables",
                "folder",
            )
        if estimates is not None:
            write_table(estimates, self.path / ESTIMATES, seed=self.seed, **self.shared)

    def write(self, fits: Fits | GroupFits, note: Callable[[str], None]) -> None:
        """Write tables, figures and draws; rows of other fits to the same question stay."""
        figures = fits.figures()
        for name, table in fits.tables().items():
            self.add(name, table)
        if fits.comparison is not None:
            made = {**self.shared, "circuits": self.circuits}
            table = fits.comparison.to_dataframe()
            write_table(table, self.path / "comparison.csv", seed=self.seed, **made)
            figures["comparison"] = fits.comparison.plot
        for name, draw in figures.items():
            try:
                save_figure(draw(), self.path / f"{name}.png")
            except InputError as error:
                note(f"{name}: no figure, {error}")
        if isinstance(fits, GroupFits):
            for name, fit in fits.fits.items():
                fit.to_netcdf(self.path / f"{stem(name)}.nc")

    def add(self, name: str, table: pd.DataFrame) -> None:
        """Write a table with the rows of other people and models that its file has."""
        path, circuits = self.path / f"{name}.csv", self.circuits
        if is_result(path) and not self._differing(path):
            # Columns that are text in the new table stay text.
            texts = [column for column in table if pd.api.types.is_string_dtype(table[column])]
            none = {str(column): [""] for column in table if column not in texts}
            before = pd.read_csv(path, dtype=dict.fromkeys(texts, str), keep_default_na=False,
                                 na_values=none)  # fmt: skip
            # A group is fitted as a whole.
            who = ["participant", "model"] if name in EACH else ["model"]
            ours = pd.MultiIndex.from_frame(table[who].astype(str))
            others = ~pd.MultiIndex.from_frame(before[who].astype(str)).isin(ours)
            table = pd.concat([before[others], table], ignore_index=True)
            circuits = {**read_provenance(path)["parameters"]["circuits"], **circuits}
        write_table(table, path, seed=self.seed, **self.shared, circuits=circuits)

    def _differing(self, path: Path) -> set[str]:
        """Return the names of settings with other values in an existing table."""
        if not is_result(path):
            return set()
        before = read_provenance(path)["parameters"]
        circuits, now = before.pop("circuits", {}), provenance(**self.shared)["parameters"]
        names = {name for name in {*before, *now} if before.get(name) != now.get(name)}
        changed = any(circuits.get(name, sha) != sha for name, sha in self.circuits.items())
        return names | ({"circuit"} if changed else set())

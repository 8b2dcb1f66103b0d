"""Sweeps in Python: reading, running, and results as tables, arrays and a figure."""

from __future__ import annotations

import re
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files as resources
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import pandas as pd

from bgmodel.support.checks import path_of
from bgmodel.support.files import (
    check_writable,
    is_result,
    provenance,
    provenance_path,
    read_provenance,
    recorded,
    save_figure,
    write_table,
)
from bgmodel.support.processes import end_if_imported, processes
from bgmodel.support.saved import Facts
from bgmodel.support.tables import Readable
from bgmodel.sweeps import shards as stored
from bgmodel.sweeps.outcome import draw, gathered, measured
from bgmodel.sweeps.plan import Plan, Point, Shard, read_plan
from circuits.declaration.table_writer import identity
from circuits.errors import BgmodelWarning, InputError, require, shown

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure


OUTCOME = "outcome.csv"
FIGURES = (".pdf", ".png")
"""Endings of figure files."""
PART = re.compile(r"(\d+)/(\d+)")
NAMED = 3
"""Largest number of points named in a caution."""


@dataclass(frozen=True)
class Sweep:
    """A plan, and the folder to which paths in it are relative.

    Parameters
    ----------
    plan : Plan
        What is run, and what changes.
    folder : Path
        Folder of the plan's file.
    """

    plan: Plan
    folder: Path = Path()

    @staticmethod
    def template() -> str:
        """Return a whole file of a sweep, to start from, as text."""
        return (resources("bgmodel.sweeps") / "template.toml").read_text(encoding="utf-8")

    @classmethod
    def from_toml(cls, file: str | Path) -> Sweep:
        """Read the TOML file of a sweep.

        Raises
        ------
        ValueError
            With the key, the value given and what is allowed.
        """
        path = path_of(file, "file")
        return cls(read_plan(path), path.parent)

    @cached_property
    def points(self) -> list[Point]:
        """Every point; ValueError for a key or a value that has no effect there."""
        return self.plan.all_points(self.folder)

    @cached_property
    def shards(self) -> list[Shard]:
        """The units of computation and storage; points may share a shard."""
        every = (shard for point in self.points for shard in point.shards())
        return list({shard.name: shard for shard in every}.values())

    def part(self, text: str = "1/1") -> list[Shard]:
        """Return the shards of the K-th of N parts, as "K/N"."""
        match = PART.fullmatch(text)
        k, n = (int(match[1]), int(match[2])) if match else (0, 0)
        require(1 <= k <= n, "part", "must be K/N with K in 1..N, as 3/40", text)
        return self.shards[k - 1 :: n]

    def status(self, folder: str | Path, part: str | None = None) -> tuple[str, list[Shard]]:
        """Return how much of a sweep, or of a part, is done, as text, and the other shards."""
        folder = path_of(folder, "folder")
        states = {shard: stored.state(shard, folder) for shard in self.part(part or "1/1")}
        missing = [shard for shard, state in states.items() if state != "done"]
        damaged = list(states.values()).count("damaged")
        again = f", {damaged} damaged, computed again" if damaged else ""
        done = f"shards: {len(states)}, {len(states) - len(missing)} done{again}"
        return f"points: {len(self.points)}; {done}; folder: {folder}", missing

    def compute(self, folder: str | Path, *, workers: int = 1, part: str | None = None) -> None:
        """Compute and store missing shards; of part "K/N" if it is given, for your own jobs.

        An outcome of another sweep in the folder is removed: nothing shows that it is another one.
        """
        end_if_imported()
        folder = path_of(folder, "folder")
        self.check(folder)
        with ExitStack() as stack:
            stack.enter_context(stored.at_work(folder, alone=part is None))
            self._remove_outdated(folder)
            _, missing = self.status(folder, part)
            if workers > 1:
                stored.compute_all(missing, folder, stack.enter_context(processes(workers)))
            else:
                for shard in missing:
                    stored.compute(shard, folder)

    def run(self, folder: str | Path | None = None, *, workers: int = 1) -> SweepOutcome:
        """Compute every missing point, and return the measures of all.

        Parameters
        ----------
        folder : path, optional
            Where shards are kept, and ``outcome.csv`` and its figure written, as by ``bgmodel
            sweep``: existing shards are not computed again. By default none is kept.
        workers : int
            Number of processes; the results do not depend on it. With more than one, a script needs
            ``if __name__ == "__main__"``.

        Raises
        ------
        ValueError
            If a key has no effect at a point, or another sweep is running in the folder.

        Warns
        -----
        UserWarning
            For each remark on points, as the command prints it, and each key without effect.
        """
        if folder is None:
            with TemporaryDirectory() as empty:
                self.compute(Path(empty), workers=workers)
                return self._gathered(Path(empty))
        place = path_of(folder, "folder")
        self.compute(place, workers=workers)
        outcome = self._gathered(place)
        write_table(outcome.table, place / OUTCOME, **self._behind())
        if len(self.plan.axes) <= 2:
            figure = outcome.plot()
            for ending in FIGURES:
                save_figure(figure, place / f"outcome{ending}")
        return outcome

    def _gathered(self, folder: Path) -> SweepOutcome:
        """Return the measures of all points, and warn of remarks on them."""
        tables = [measured(point, folder) for point in self.points]
        outcome = SweepOutcome(self.plan, gathered(self.plan, tables))
        for caution in outcome.cautions():
            BgmodelWarning.warn(caution)
        return outcome

    def _behind(self) -> dict[str, Any]:
        """Return the provenance of the outcome."""
        circuits = [identity(point.edited)["sha256"] for point in self.points]
        return {"seed": self.plan.seed, "sweep": recorded(self.plan), "circuits": circuits}

    def check(self, folder: str | Path) -> None:
        """Raise ValueError for a folder without room, or with other files of the same names."""
        folder = path_of(folder, "folder")
        check_writable(folder)
        stored.check_room(self.points, folder)
        output = folder / OUTCOME
        paths = [path for path in (output, *map(output.with_suffix, FIGURES)) if path.exists()]
        made_from = read_provenance(output)["parameters"] if is_result(output) else {}
        if paths and "sweep" not in made_from:
            reason = "was not made by a sweep: move it, or give another folder"
            raise InputError(f"{str(paths[0])!r} {reason}", "folder")

    def _remove_outdated(self, folder: Path) -> None:
        """Remove table and figure of another sweep, which a part or a stopped sweep would keep."""
        output = folder / OUTCOME
        if not output.is_file():
            return
        made, now = read_provenance(output), provenance(**self._behind())
        if any(made.get(name) != now[name] for name in ("parameters", "seed")):
            BgmodelWarning.warn(
                f"{output} is of another sweep: it is removed, with its figure; shards are kept"
            )
            # Remove the table last: while it exists, its figure is known to be that of a sweep.
            for path in (*map(output.with_suffix, FIGURES), output, provenance_path(output)):
                path.unlink(missing_ok=True)


@dataclass(frozen=True, repr=False)
class SweepOutcome(Facts):
    """The results of a sweep.

    Parameters
    ----------
    plan : Plan
        The plan of the sweep.
    table : DataFrame
        As from ``outcome.gathered``: one column per key that changes, then measure, value, low and
        high (95 % interval), trials, remark.
    """

    plan: Plan
    table: pd.DataFrame

    def facts(self) -> dict[str, str]:
        """Return the varied keys, the number of points, and their number of trials."""
        axes = self.plan.axes
        return {
            "points": f"{len(self.plan.each)}",
            "over": ", ".join(axes),
            "circuit": self.plan.circuit,
            "engine": self.plan.engine,
            "trials": f"{self.table['trials'].max()} per point",
        }

    def cautions(self) -> list[str]:
        """Return each remark on measures that are shown, with the points that have it."""
        axes = list(self.plan.axes)
        points = self.table.drop_duplicates(subset=axes)
        remarks = self.table[self.table["measure"].isin(self.plan.show)]
        remarks = remarks[remarks["remark"] != ""].drop_duplicates(subset=[*axes, "remark"])
        texts = []
        for text, some in remarks.groupby("remark", sort=False):
            names = [
                ", ".join(f"{axis} = {shown(value)}" for axis, value in zip(axes, row, strict=True))
                for row in some[axes].head(NAMED).itertuples(index=False)
            ]
            more = "; ..." if len(some) > NAMED else ""
            texts.append(
                f"at {len(some)} of {len(points)} points ({'; '.join(names)}{more}): {text}"
            )
        return texts

    def summary(self) -> pd.DataFrame:
        """Return the measures that the plan shows, one row per point."""
        chosen = self.table[self.table["measure"].isin(self.plan.show)]
        axes = list(self.plan.axes)
        wide = chosen.pivot(index=axes, columns="measure", values="value")
        # In the order of the plan, and only its points.
        wide = wide.reindex(chosen.set_index(axes).index.unique())
        return Readable(wide[list(self.plan.show)].round(3))

    def to_dataframe(self) -> pd.DataFrame:
        """Return ``table``."""
        return self.table

    def to_xarray(self) -> xarray.Dataset:
        """Return one array per measure, with the keys that change and ``of`` as dimensions.

        ``of`` is "value", "low" or "high", the two ends of the 95 % interval:
        ``found.accuracy.sel(of="value")``. Keys become names: ``lesion_STN``, ``task_channels``.
        """
        axes = list(self.plan.axes)
        long = self.table.melt([*axes, "measure"], ["value", "low", "high"], "of", "number")
        wide = long.set_index([*axes, "of", "measure"])["number"].unstack("measure")
        dataset = wide.to_xarray().rename({key: re.sub(r"\W+", "_", key) for key in axes})
        return dataset.reindex(of=["value", "low", "high"])

    def plot(self) -> Figure:
        """Draw the measures that the plan shows, over one key or two.

        Lines have 95 % intervals (bootstrap over trials); a grid of more than four values of both
        keys is a map without intervals. An asterisk marks a point with a remark in the table.
        """
        return draw(self.plan, self.table)

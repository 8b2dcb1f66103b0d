"""The explorer in a notebook."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import platformdirs

from bgmodel.experiments.experiment import Experiment
from bgmodel.explorer.state import ExplorerState, of_circuit, opened
from circuits.circuit import Circuit
from circuits.declaration.table_writer import digest, write
from circuits.errors import InputError

NEEDS = 'the explorer needs Panel: pip install "bgmodel[explore]"'


def explore(what: Circuit | Experiment | str | Path = "") -> Any:
    """Return the interactive explorer, which a notebook shows.

    ``bgmodel explore`` shows the same page in the browser.

    Parameters
    ----------
    what : Circuit, Experiment, str or path
        A circuit or an experiment: the object, its name, its .toml file, or a link from the
        explorer; by default the macaque circuit. A circuit that is not in a file is written to the
        user's cache folder, so that the experiment's file can name it.

    Returns
    -------
    panel.viewable.Viewable
        The page; its attribute ``explorer`` has the current ``state``.

    Raises
    ------
    ValueError
        For an unknown name or an invalid circuit or experiment.
    ImportError
        Without Panel: ``pip install "bgmodel[explore]"``.
    """
    try:
        import panel as pn
    except ImportError as error:
        raise ImportError(NEEDS) from error
    from bgmodel.explorer.page import Explorer

    state = state_of(what)
    pn.extension(inline=True)  # scripts from the package, since there may be no network
    explorer: Any = Explorer(state, later=lambda call: pn.state.execute(call))
    layout = explorer.layout()
    layout.explorer = explorer
    return layout


def state_of(what: Circuit | Experiment | str | Path) -> ExplorerState:
    """Return the state of a circuit or an experiment, given as an object, by name, file or link."""
    if isinstance(what, Experiment):
        return ExplorerState(what)
    if isinstance(what, Circuit):
        return of_circuit(str(_written(what)))
    if not isinstance(what, (str, Path)):
        must = "must be a circuit, an experiment, a name or a .toml file"
        raise InputError.of("what", must, type(what).__name__)
    return opened(what)


def _written(circuit: Circuit) -> Path:
    """Write a circuit to the cache folder, in a folder named by its hash, and return the path."""
    folder = platformdirs.user_cache_path("bgmodel") / "explored" / digest(circuit)[:16]
    return Path(write(circuit, folder / f"{re.sub(r'[^A-Za-z0-9_-]+', '_', circuit.name)}.toml"))

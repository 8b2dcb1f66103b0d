"""Old names: importing one raises a sentence with the new one.

A line of ``MOVED`` is an old module, or an old name inside a module, and where it is now. Add a
line here (or in ``bgmodel/moved.py``) and one in CHANGELOG.md for everything that is renamed.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from functools import partial
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType

MOVED = {
    "circuits.algebra": "circuits.engines.algebra (rest, solve, wired: circuits.fixed_point)",
    "circuits.brian_layout": "circuits.engines.brian2.layout",
    "circuits.brian_network": "circuits.engines.brian2.network",
    "circuits.brian_noise": "circuits.engines.brian2.noise",
    "circuits.brian_standalone": "circuits.engines.ensemble.run (Brian2's C++ program is gone)",
    "circuits.brian_text": "circuits.engines.brian2.text",
    "circuits.compiling": "circuits.engines.compiling",
    "circuits.ensemble": "circuits.engines.ensemble.run",
    "circuits.firing": "circuits.laws.firing",
    "circuits.fluctuation": "circuits.laws.fluctuation",
    "circuits.kernel": "circuits.engines.ensemble.kernel",
    "circuits.lanes": "circuits.engines.ensemble.lanes",
    "circuits.mean_field": "circuits.laws.mean_field",
    "circuits.plan": "circuits.engines.ensemble.plan",
    "circuits.rate": "circuits.engines.population",
    "circuits.records": "circuits.engines.ensemble.records",
    "circuits.response": "circuits.laws.response",
    "circuits.spectra": "circuits.laws.spectra",
    "circuits.spiking": "circuits.engines.brian2.run",
    "circuits.stability": "circuits.laws.stability",
    "circuits.ticks.jitter": "circuits.cells.Phase.constants",
    "circuits.ticks.lif_tick": "circuits.cells.Lif.constants",
    "circuits.ticks.refractory_ticks": "circuits.checks.whole_ticks",
    "circuits.wiring.ticks": "circuits.checks.whole_ticks",
}
"""Old dotted name: the new one."""


class _Finder(MetaPathFinder):
    """Finder that stops the import of an old name."""

    def __init__(self) -> None:
        self.moved: dict[str, str] = {}
        self.holders: set[str] = set()

    def add(self, moved: Mapping[str, str]) -> None:
        """Know more old names."""
        self.moved |= moved
        self.holders |= {old.rpartition(".")[0] for old in moved}
        for name in self.holders & set(sys.modules):
            self._answer(sys.modules[name])

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if name in self.moved:
            raise ImportError(f"{name} is now {self.moved[name]}", name=name)
        if name not in self.holders:
            return None
        spec = PathFinder.find_spec(name, path, target)
        if spec is not None and spec.loader is not None:
            self._watch(spec.loader)
        return spec

    def _watch(self, loader: Loader) -> None:
        """Let a module that held old names answer for them, once it is loaded."""
        load = loader.exec_module

        def exec_module(module: ModuleType) -> None:
            load(module)
            self._answer(module)

        loader.exec_module = exec_module  # type: ignore[method-assign]

    def _answer(self, module: ModuleType) -> None:
        """Let a module answer for the old names that it held."""
        vars(module).setdefault("__getattr__", partial(self._missing, module.__name__))

    def _missing(self, module: str, name: str) -> None:
        old = f"{module}.{name}"
        if old in self.moved:
            raise ImportError(f"{old} is now {self.moved[old]}", name=old)
        raise AttributeError(f"module {module!r} has no attribute {name!r}")


_FINDER = _Finder()


def tell(moved: Mapping[str, str]) -> None:
    """Raise an ImportError with the new name wherever one of these old ones is imported."""
    if _FINDER not in sys.meta_path:
        sys.meta_path.insert(0, _FINDER)
    _FINDER.add(moved)

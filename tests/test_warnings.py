"""Warnings in threads: each is seen once, by whom it is for, and the process's filters stay."""

import ast
import threading
import warnings
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import pytest

from bgmodel.experiments.experiment import Experiment
from bgmodel.explorer.panels import MEASURES, Memory, panels
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.simulated_evidence import gaussian_evidence
from circuits.errors import RangeWarning
from tests.explorer.helpers import small
from tests.helpers import ROOT

MODEL = BasalGanglia("macaque", "population", 1.0, seed=1)
STRONG = gaussian_evidence(4, d_prime=3.0, t_max=10, seed=1)
"""Evidence that the circuit cannot track, so that every decision on it warns once."""
WAIT_S = 300
FILTERS = {"catch_warnings", "simplefilter", "filterwarnings", "resetwarnings", "showwarning"}
"""What changes the filters of the whole process, so that no thread may use it."""
ALONE = {"bgmodel/tactile/networks.py", "circuits/compiled_code.py"}
"""The module that silences another library, in a command that starts no thread; and the one that
keeps another library from doing so."""
DIRECT = {"circuits/errors.py", "circuits/store.py"}
"""Modules that issue warnings themselves: that of the machine has no category of the package."""
CELL = "MODEL.decide(STRONG, posterior=0.8)"


@contextmanager
def process():
    """Yield all warnings that the process issues; afterwards its filters are as before."""
    with warnings.catch_warnings(record=True) as issued:
        warnings.simplefilter("default")
        before = list(warnings.filters), warnings.showwarning
        yield issued
        assert (list(warnings.filters), warnings.showwarning) == before
        warnings.warn("of another library", UserWarning, stacklevel=1)
        assert str(issued.pop().message) == "of another library"


def decide():
    """Decide on evidence that is too strong, in a cell: Python shows a warning of its line once."""
    exec(compile(CELL, "<cell>", "exec"), {"MODEL": MODEL, "STRONG": STRONG})


def test_overlapping_runs_of_two_threads_leave_the_filters_as_they_were(monkeypatch):
    """The first to begin ends first: filters that each restores would be those of the other."""
    run = BasalGanglia.run_drive
    begun, both, ended = threading.Event(), threading.Event(), threading.Event()

    def overlapping(self, *arguments, **named):
        if begun.is_set():
            both.set()
            assert ended.wait(WAIT_S)
        else:
            begun.set()
            assert both.wait(WAIT_S)
        return run(self, *arguments, **named)

    monkeypatch.setattr(BasalGanglia, "run_drive", overlapping)
    monkeypatch.setattr(BasalGanglia, "warn_of_noise", lambda *_: None)
    with process() as issued, ThreadPoolExecutor(2) as pool:
        first = pool.submit(decide)
        assert begun.wait(WAIT_S)
        second = pool.submit(decide)
        first.result(WAIT_S)
        ended.set()
        second.result(WAIT_S)
    assert [one.category for one in issued] == [RangeWarning, RangeWarning]


def test_a_warning_is_an_error_in_a_thread_if_a_user_says_so():
    with warnings.catch_warnings(), ThreadPoolExecutor(1) as pool:
        warnings.simplefilter("error", RangeWarning)
        with pytest.raises(RangeWarning):
            pool.submit(decide).result(WAIT_S)


def test_a_cell_that_runs_while_the_explorer_computes_keeps_its_warning(monkeypatch):
    run, begun, decided, shown = Experiment.run, threading.Event(), threading.Event(), []

    def during(self, **named):
        begun.set()
        assert decided.wait(WAIT_S)
        return run(self, **named)

    monkeypatch.setattr(Experiment, "run", during)
    state = small("macaque", "algebra")
    with process() as issued:
        thread = threading.Thread(target=lambda: shown.append(next(panels(state, Memory()))))
        thread.start()
        assert begun.wait(WAIT_S)
        decide()
        assert [one.category for one in issued] == [RangeWarning]
        decided.set()
        thread.join(WAIT_S)
        assert len(issued) == 1
    assert [(panel.name, panel.warnings) for panel in shown] == [(MEASURES, ())]


def changes_filters(text):
    """Whether a module uses what changes the filters; in texts and comments it may be named."""
    if not any(name in text for name in FILTERS):
        return False
    nodes = list(ast.walk(ast.parse(text)))
    attributes = {node.attr for node in nodes if isinstance(node, ast.Attribute)}
    names = {node.id for node in nodes if isinstance(node, ast.Name)}
    return bool((attributes | names) & FILTERS)


def modules():
    """Return the text of every module of the packages, by its path from the root."""
    paths = [path for of in ("bgmodel", "circuits") for path in (ROOT / of).rglob("*.py")]
    return {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in paths}


def test_no_module_of_the_packages_changes_the_filters_of_the_process():
    assert {name for name, text in modules().items() if changes_filters(text)} == ALONE
    assert changes_filters("from warnings import catch_warnings\nwith catch_warnings(): pass")


def test_all_warnings_of_the_package_pass_one_place():
    assert {name for name, text in modules().items() if "warnings.warn(" in text} == DIRECT

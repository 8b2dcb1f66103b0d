"""Fixtures of tests of several modules."""

import gc

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from bgmodel import Msprt, first_crossing
from bgmodel.learning.dopamine import THRESHOLD_NATS, decide_at_levels
from bgmodel.simulated_evidence import separated_evidence
from bgmodel.support.seeds import stream
from bgmodel.trials.named_evidence import NamedEvidence, trial_table
from tests.cpu_times import LONG, SLOW, listed, named
from tests.helpers import GOOD, run
from tests.levels import LEVELS, MODEL, SEED

# A test gives one result, however busy the machine is: examples have no time limit, nor has drawing
# them, and each run tries the same.
settings.register_profile(
    "bgmodel", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("bgmodel")


def pytest_configure(config):
    """Let no page, experiment or test attach an input to the trials of one truth alone."""
    config.addinivalue_line("filterwarnings", "error::circuits.errors.ConfoundWarning")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Mark the tests that were measured to be slow, and leave long ones to ``make validate``."""
    names = {"slow": listed(SLOW), "validate": listed(LONG)}
    for item in items:
        for marker, some in names.items():
            if named(item.nodeid) in some:
                item.add_marker(marker)


@pytest.fixture(scope="module", autouse=True)
def frozen_modules():
    """Exempt all that is loaded from garbage collection, which took a fifth of the CPU time.

    Brian2 and Bokeh collect after each run, a third of a second with all modules loaded.
    """
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="module")
def brief_search():
    """Search for optima with fewer points: tests/fitting/test_optimum.py has the usual search.

    Still to a fiftieth of a nat, far below what a test of fits tells apart.
    """
    from bgmodel.fitting import optimum

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(optimum, "POPULATION", 8)
        patch.setattr(optimum, "TOLERANCE_NATS", 0.02)
        yield


@pytest.fixture(scope="module")
def no_check_of_noise():
    """Run no trials without evidence before those of spiking cells: only a warning needs them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bgmodel.integrators.basal_ganglia.BasalGanglia.warn_of_noise", _nothing)
        yield


def _nothing(*_):
    pass


@pytest.fixture
def refusal(capsys):
    """Return a function that runs a command that must fail, and returns its stderr."""

    def refused(*arguments):
        capsys.readouterr()
        assert run(*arguments) == 2
        printed = capsys.readouterr().err
        assert all(line.startswith("bgmodel: ") for line in printed.splitlines()), printed
        return printed

    return refused


@pytest.fixture
def experiment_file(tmp_path):
    """Write an experiment's file that is right; return its path."""
    path = tmp_path / "in" / "small.toml"
    path.parent.mkdir()
    path.write_text(GOOD)
    return path


@pytest.fixture
def decided_trials():
    """Return a table of decided trials, some of them undecided."""
    evidence = separated_evidence(20, 5, 1.0, rng=stream(1, "tables"), hypotheses=3)
    decision = first_crossing(Msprt().run(evidence), 0.05, forced=False)
    return trial_table(decision, NamedEvidence(evidence, list("abc")), model="msprt", seed=1)


@pytest.fixture(scope="session")
def level_evidence():
    """Return the evidence that a circuit decides at several levels of dopamine."""
    return separated_evidence(150, 60, 1 / np.sqrt(2), rng=stream(SEED, "knob"), step_ms=50.0)


@pytest.fixture(scope="session")
def swept(level_evidence):
    """Return decisions at seven levels of dopamine."""
    return decide_at_levels(MODEL, level_evidence, LEVELS[:7], THRESHOLD_NATS)

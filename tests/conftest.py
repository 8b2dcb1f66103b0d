"""Fixtures of tests of several modules."""

import numpy as np
import pytest

from bgmodel import Msprt, first_crossing
from bgmodel.dopamine import THRESHOLD_NATS, decide_at_levels
from bgmodel.evidence import gaussian_evidence
from bgmodel.seeds import stream
from bgmodel.tables.trials import Trials, trial_table
from tests.helpers import GOOD
from tests.levels import LEVELS, MODEL, SEED


@pytest.fixture
def small(tmp_path):
    path = tmp_path / "in" / "small.toml"
    path.parent.mkdir()
    path.write_text(GOOD)
    return path


@pytest.fixture
def trials():
    evidence = gaussian_evidence(20, 5, 1.0, rng=stream(1, "tables"), hypotheses=3)
    decision = first_crossing(Msprt().run(evidence), 0.05, forced=False)
    return trial_table(decision, Trials(evidence, list("abc")), model="msprt", seed=1)


@pytest.fixture(scope="module")
def evidence():
    return gaussian_evidence(150, 60, 1 / np.sqrt(2), rng=stream(SEED, "knob"), step_ms=50.0)


@pytest.fixture(scope="module")
def swept(evidence):
    return decide_at_levels(MODEL, evidence, LEVELS[:7], THRESHOLD_NATS)

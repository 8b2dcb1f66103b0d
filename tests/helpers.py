"""What tests of several modules use: a command, evidence, a table, an experiment's file."""

import importlib
import json
import shlex
import subprocess
import warnings
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bgmodel.cli import main
from bgmodel.deciding.decision import Decision
from bgmodel.deciding.measures import Behaviour
from bgmodel.evidence import Evidence
from bgmodel.support.seeds import stream
from circuits.errors import InputError

ROOT = Path(__file__).parents[1]
GOOD = """
name = "a lesion"
published = "faster, more errors"
source = "nobody"
note = "a test"
engine = "algebra"
seed = 3
circuit = "spiking_msprt"
[task]
trials = 120
t_max = 40
[manipulation]
edits = ["lesion STN 20%"]
[[predictions]]
measure = "mean_ms"
direction = "down"
at_least = 20
"""
"""An experiment's file that is right, and soon run."""


def prose(page):
    """Return the text of a page; of a notebook, that of its Markdown cells."""
    text = page.read_text(encoding="utf-8")
    if page.suffix != ".ipynb":
        return text
    cells = json.loads(text)["cells"]
    return "\n\n".join("".join(c["source"]) for c in cells if c["cell_type"] == "markdown")


def run(*arguments):
    """Run a command of `bgmodel`; return its exit status."""
    return main([str(a) for a in arguments])


def program_run(*arguments, **options):
    """Run a program to its end; return its status and what it printed."""
    settings = {"capture_output": True, "text": True, "check": False} | options
    return subprocess.run([*map(str, arguments)], **settings)


def words(line):
    """Return the words of a part of a command line, as a shell reads them."""
    return shlex.split(line)


def imported(dotted):
    """Return the module, or what a module holds, of a dotted name."""
    try:
        return importlib.import_module(dotted)
    except ModuleNotFoundError:
        module, _, name = dotted.rpartition(".")
        return getattr(imported(module), name)


def some_evidence(trials=300, steps=20, hypotheses=3, seed=5, **kwargs):
    rng = stream(seed, "test")
    values = rng.normal(0, 0.7, (trials, steps, hypotheses))
    truth = np.arange(trials) % hypotheses
    values[np.arange(trials), :, truth] += 0.4
    return Evidence(values, truth, **kwargs)


def cues(trials, readings, nats, seed=1):
    """Return evidence of cues of one strength for either side: sums are on a lattice."""
    rng, truth = stream(seed, "cues"), np.arange(trials) % 2
    shows = rng.random((trials, readings)) < 1 / (1 + np.exp(-nats))
    side = np.where(shows, truth[:, None], 1 - truth[:, None])
    values = nats * ((side[:, :, None] == np.arange(2)) - 0.5)
    return Evidence(values, truth, step_ms=50.0, baseline=0.0)


def long_table(evidence, truth=True):
    n, t, h = evidence.log_likelihood.shape
    names = [f"ll_{i}" for i in "abc"[:h]]
    frame = pd.DataFrame(evidence.log_likelihood.reshape(n * t, h), columns=names)
    frame.insert(0, "trial", np.repeat(np.arange(n), t))
    frame.insert(1, "step", np.tile(np.arange(t), n))
    if truth:
        frame["truth"] = np.repeat(np.array(list("abc"))[evidence.truth], t)
    return frame


def behaving(choice, times, truth, missed=0, channels=2):
    """Return the behaviour of choices and times, ms; the deadline forces the last `missed`."""
    trials = len(truth)
    forced = np.arange(trials) >= trials - missed
    never, times = np.zeros(trials, bool), np.asarray(times, dtype=float)
    decision = Decision(np.asarray(choice), times, forced, never, 50.0, times, np.asarray(truth))
    return Behaviour(decision, np.full(trials, 0.9), never, channels)


@contextmanager
def refused(wanted):
    """Assert an error of the field that comes first in `wanted`; words after it are in its text.

    It has one line.
    """
    field, _, words = wanted.partition(" ")
    with pytest.raises(InputError, match=words or None) as caught:
        yield caught
    assert caught.value.field == field
    assert "\n" not in str(caught.value)


def refusing(*rows, of=lambda call: call()):
    """Return a test that what comes first in each row is `refused` with what comes second."""

    @pytest.mark.parametrize(("asked", "says"), rows)
    def test(asked, says):
        with refused(says):
            of(asked)

    return test


def doubting(*rows):
    """Return a test that what comes last in each row warns: category and words; or of nothing."""

    @pytest.mark.parametrize(("category", "says", "asked"), rows)
    def test(category, says, asked):
        with pytest.warns(category, match=says) if category else unwarned():
            asked()

    return test


@contextmanager
def unwarned():
    """Assert that there are no warnings."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def told(call, *arguments, **named):
    """Return all that a call warns of, as texts."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        call(*arguments, **named)
    return [str(one.message) for one in caught]

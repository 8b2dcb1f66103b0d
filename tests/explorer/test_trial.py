"""One trial of a circuit, and its drawing."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from bgmodel.explorer import drawing
from bgmodel.explorer.panels import NAMES, Memory, _trial
from bgmodel.explorer.trial import WITHOUT_EVIDENCE, Shown, one_trial
from circuits.declaration.courses import Course
from tests.explorer.helpers import small

TICKS = np.arange(0.0, 300.0)
SHOWN = Shown(
    TICKS, {"D1": np.ones((300, 2)), "STN": np.ones((300, 2))}, np.ones((300, 2)), {}, None,
    0.3, "nats", 0, 0, 299.0,
)  # fmt: skip


def shown(*edits, name="bogacz_gurney"):
    """Return a trial of the control and of the manipulation of a small state."""
    state = small(name, "rate", *edits)
    evidence = Memory().evidence(state).evidence
    return [one_trial(condition, evidence, 0) for condition in state.experiment.conditions]


def boxes(ax):
    """Return left, right, top and bottom of what is shaded, in the units of the axes."""
    extents = [one.get_paths()[0].get_extents() for one in ax.collections]
    return [(box.x0, box.x1, box.y0, box.y1) for box in extents]


def drawn(*courses):
    """Return what is shaded in the lanes of a trial with courses."""
    ax = Figure().add_subplot()
    drawing._events(ax, replace(SHOWN, courses=courses))
    return boxes(ax)


def test_the_window_of_a_course_is_shaded_in_the_lane_of_its_nucleus():
    (box,) = drawn(Course("STN", 0.5, 100.0, 200.0))
    assert box == pytest.approx((100.0, 200.0, 1.0, 1.0 + drawing.LANE))
    (box,) = drawn(Course("D1[0]", -2.0, 50.0))
    assert box == pytest.approx((50.0, 299.0, 0.0, drawing.LANE))
    assert len(drawn(Course("dopamine", 0.2, 0.0, 100.0))) == 2
    assert drawn() == []


def test_a_trial_that_is_decided_before_the_first_reading_is_decided_without_evidence():
    control, edited = shown("set SNr.bias_nats -9")
    assert (control.premature, edited.premature) == (False, True)
    assert WITHOUT_EVIDENCE in edited.sentence()
    assert WITHOUT_EVIDENCE not in control.sentence()


def panel(memory, *edits):
    """Return the panel's words and its figure."""
    (shown,) = _trial(small("bogacz_gurney", "algebra", *edits), memory)
    return shown.text, shown.svg


def test_the_control_is_below_the_manipulation_and_is_run_once(monkeypatch):
    runs, memory = [], Memory()

    def counted(condition, *arguments):
        runs.append(condition)
        return one_trial(condition, *arguments)

    monkeypatch.setattr("bgmodel.explorer.panels.one_trial", counted)
    text, svg = panel(memory)
    assert f"{NAMES[0]}:" not in svg + text
    for edit in ("lesion STN 10%", "lesion STN"):
        text, svg = panel(memory, edit)
        assert svg.index(f"{NAMES[1]}: spikes") < svg.index(f"{NAMES[0]}: spikes")
        assert f"{NAMES[0]}: Chose" in text
    assert len(runs) == 3


def test_a_course_is_named_in_words():
    text, svg = panel(Memory(), "add STN amount=0.1 from_ms=50 to_ms=80", "add dopamine amount=0.1")
    assert "STN +0.1 from 50 to 80 ms" in text
    assert "dopamine +0.1 from 0 ms on" in text
    assert ">Course<" in svg

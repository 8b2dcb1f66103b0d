"""One trial of a circuit, and its drawing."""

from bgmodel.explorer.panels import NAMES, Memory, _trial
from bgmodel.explorer.trial import WITHOUT_EVIDENCE, one_trial
from tests.explorer.helpers import small


def shown(*edits, name="bogacz_gurney"):
    """Return a trial of the control and of the manipulation of a small state."""
    state = small(name, "rate", *edits)
    evidence = Memory().evidence(state).evidence
    return [one_trial(condition, evidence, 0) for condition in state.experiment.conditions]


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

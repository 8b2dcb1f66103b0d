"""The circuit as the explorer shows it: rows as the controls offer them, a trial, its drawing."""

from bgmodel.explorer import circuit
from bgmodel.explorer.circuit import WITHOUT_EVIDENCE, one_trial
from bgmodel.explorer.panels import NAMES, Memory, _trial
from circuits.declaration.edits import VERBS, parsed
from tests.explorer.helpers import small


def test_every_kind_of_edit_has_an_example_that_is_one():
    assert {parsed(line).verb for line in circuit.EXAMPLES} == set(VERBS)


def test_an_amount_writes_replaces_and_removes_its_line():
    state = circuit.with_amount(small(), "lesion", "STN", 12.5)
    assert state.edits == ("lesion STN 12.5%",)
    assert circuit.amount(state, "lesion", "STN") == 12.5
    state = circuit.with_amount(state, "scale", "STN->GPe", 0.5)
    state = circuit.with_amount(state, "lesion", "STN", 20.0)
    assert state.edits == ("lesion STN 20%", "scale STN->GPe 0.5")
    assert circuit.with_amount(state, "lesion", "STN", 0.0).edits == ("scale STN->GPe 0.5",)
    assert circuit.amount(state, "cut", "STN->GPe") == 0.0
    assert circuit.amount(state, "scale", "GPe->STN") == 1.0


def test_values_can_be_set_again_as_they_are_shown():
    state = small()
    for name in (*circuit.names(state)["Nuclei"], "STN->GPe"):
        for field, value in circuit.values(state.circuit.row(name)).items():
            if value and field not in ("cell", "cite", "published_hz"):
                state.circuit.edited(f"set {name}.{field} {value}")


def test_a_table_has_the_values_of_the_control_where_they_differ():
    def control(state, name):
        return circuit.table(state, name).set_index("Field")["Control"]

    state = small("macaque", "algebra", "set STN.cite mine", "add D1->GPe weight=-0.1 delay_ms=4")
    assert control(state, "STN")["cite"] == small().circuit.row("STN").cite
    assert (control(small(), "STN") == "").all()
    assert (control(state, "D1->GPe") == "none").all()


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

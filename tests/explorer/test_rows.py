"""Rows of the circuit as the controls offer them."""

from bgmodel.explorer import rows
from circuits.declaration.edits import VERBS, parsed
from tests.explorer.helpers import small


def test_every_kind_of_edit_has_an_example_that_is_one():
    assert {parsed(line).verb for line in rows.EXAMPLES} == set(VERBS)


def test_an_amount_writes_replaces_and_removes_its_line():
    state = rows.with_amount(small(), "lesion", "STN", 12.5)
    assert state.edits == ("lesion STN 12.5%",)
    assert rows.amount(state, "lesion", "STN") == 12.5
    state = rows.with_amount(state, "scale", "STN->GPe", 0.5)
    state = rows.with_amount(state, "lesion", "STN", 20.0)
    assert state.edits == ("lesion STN 20%", "scale STN->GPe 0.5")
    assert rows.with_amount(state, "lesion", "STN", 0.0).edits == ("scale STN->GPe 0.5",)
    assert rows.amount(state, "cut", "STN->GPe") == 0.0
    assert rows.amount(state, "scale", "GPe->STN") == 1.0


def test_values_can_be_set_again_as_they_are_shown():
    state = small()
    for name in (*rows.names(state)["Nuclei"], "STN->GPe"):
        for field, value in rows.values(state.circuit.row(name)).items():
            if value and field not in ("cell", "cite", "published_hz"):
                state.circuit.edited(f"set {name}.{field} {value}")


def test_a_table_has_the_values_of_the_control_where_they_differ():
    def control(state, name):
        return rows.table(state, name).set_index("Field")["Control"]

    state = small("macaque", "algebra", "set STN.cite mine", "add D1->GPe weight=-0.1 delay_ms=4")
    assert control(state, "STN")["cite"] == small().circuit.row("STN").cite
    assert (control(small(), "STN") == "").all()
    assert (control(state, "D1->GPe") == "none").all()

"""As many alternatives as a circuit reads, and one more, which it refuses with the number."""

import pytest

from bgmodel.integrators.criterion import rest_out
from circuits.anatomy import CIRCUITS, load_circuit
from circuits.laws.stability import growth
from tests.helpers import run

LIMITED = [name for name in CIRCUITS if load_circuit(name).most_channels < 100]


def test_every_circuit_of_cells_states_its_limit():
    assert {"macaque", "spiking_msprt", "humphries"} <= set(LIMITED)


@pytest.mark.parametrize("name", LIMITED)
def test_at_its_most_alternatives_a_circuit_rests_where_it_reads(name):
    table = load_circuit(name, load_circuit(name).most_channels)
    low, high = table.readable_nats
    # A row's line may end a hundredth of a nat before the rest of many channels.
    assert low < rest_out(table) < high + 0.01
    assert growth(table).real < 0


@pytest.mark.parametrize("name", LIMITED)
def test_one_more_is_refused_with_the_number(name, tmp_path, monkeypatch, capsys):
    most = load_circuit(name).most_channels
    sentence = f"{name} takes at most {most} alternatives, got {most + 1}"
    with pytest.raises(ValueError, match=sentence):
        load_circuit(name, most + 1)
    monkeypatch.chdir(tmp_path)
    for command in (["circuit", "run"], ["compare"]):
        assert run(*command, "--circuit", name, "--task", f"channels={most + 1}") == 2
        assert capsys.readouterr().err.strip() == f"bgmodel: {sentence}"

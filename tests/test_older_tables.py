"""A figure says by itself that its table was made with another circuit than today's."""

import json

import matplotlib.pyplot as plt
import pandas as pd
import pytest

from circuits.anatomy import DEFAULT, load_circuit
from circuits.declaration.table_writer import identity
from figures.common import OLDER, older, say_if_older
from figures.rooms import METADATA, read_metadata, write
from tests.helpers import told


@pytest.fixture
def table(tmp_path):
    """Return a table as a score writes it, with today's circuits."""
    made_with = {str(n): identity(load_circuit(DEFAULT, n)) for n in (2, 4)}
    path = tmp_path / "found.csv"
    write(pd.DataFrame({"value": [1.0]}), path, seed=1, trials=10, circuits=made_with)
    return path


def with_another_hash(path, channels="2"):
    """Change the hash of a table's circuit."""
    every = read_metadata(path.parent)
    every[path.stem]["parameters"]["circuits"][channels]["sha256"] = "0" * 64
    path.with_name(METADATA).write_text(json.dumps(every))


def written(figure):
    """Return all words that stand under a figure."""
    words = [figure.get_supxlabel(), *(each.get_title().get_text() for each in figure.legends)]
    return " ".join(words)


@pytest.mark.parametrize("channels", [None, "2", "4"])
@pytest.mark.parametrize("legend", [False, True])
def test_a_table_of_another_circuit_is_said_under_the_figure_and_of_todays_nothing(
    table, channels, legend
):
    if channels:
        with_another_hash(table, channels)
    figure, ax = plt.subplots()
    ax.plot([0, 1], label="a line")
    if legend:
        figure.legend(loc="outside lower center")
    texts = told(say_if_older, figure, table)
    plt.close(figure)
    assert older(table) == bool(channels)
    assert [OLDER in text for text in texts] == [True] * bool(channels)
    assert (f"{OLDER}: found.csv" in written(figure)) == bool(channels)
    assert channels or written(figure).strip() == ""

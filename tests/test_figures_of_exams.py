"""Figure E1 shows every answer of every circuit, and the shares of domains."""

import numpy as np
import pandas as pd
from matplotlib.patches import Rectangle

from circuits.anatomy import DEFAULT
from figures.common import FAST
from figures.exam import draw_E1 as figE1
from figures.rooms import table_path, write


def cells(ax):
    return [patch for patch in ax.patches if isinstance(patch, Rectangle)]


def texts(ax):
    return [text.get_text() for text in ax.texts if text.get_text()]


def test_figure_e1_has_a_cell_per_answer_and_per_domain(tmp_path):
    numbers, domains = table_path("exam_numbers"), table_path("exam_domains")
    figure = figE1.draw(FAST, numbers, domains, output=tmp_path)
    table, scores = pd.read_csv(numbers), pd.read_csv(domains)
    answers, shares = figure.axes[:2]
    first = table[table["sitting"] == table["sitting"].min()]
    assert len(cells(answers)) == len(first)
    assert len(cells(shares)) == len(scores[["domain", "examinee"]].drop_duplicates())
    columns = [label.get_text() for label in answers.get_xticklabels()]
    assert columns[0] == DEFAULT
    assert set(columns) == set(table["examinee"])


def test_figure_e1_writes_z_scores_signs_and_the_range_over_seeds(tmp_path):
    rows = [
        ("macaque", 1, "a", 3.2, "disagrees"), ("macaque", 1, "b", np.nan, "agrees"),
        ("macaque", 1, "c", 250.0, "disagrees"), ("macaque", 1, "d", np.nan, "fails"),
    ]  # fmt: skip
    names = ["examinee", "sitting", "id", "z", "outcome"]
    numbers = pd.DataFrame(rows, columns=names).assign(domain="one", set_by="predicted")
    shares = {"examinee": "macaque", "domain": "one", "sitting": [1, 2], "share": [0.25, 0.5]}
    paths = [tmp_path / "numbers.csv", tmp_path / "domains.csv"]
    for path, table in zip(paths, (numbers, pd.DataFrame(shares)), strict=True):
        write(table, path, seed=1, circuits={})
    figure = figE1.draw(FAST, *paths, output=tmp_path)
    assert texts(figure.axes[0]) == ["+3", "✓", "≫"]
    assert texts(figure.axes[1]) == ["0.25\n0.50"]

"""Tables to read hide no column, however narrow the terminal."""

import ast
import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bgmodel.support.tables import MOST_ROWS, Readable
from tests.helpers import ROOT

NAME = st.from_regex(r"[a-z]{3,16}", fullmatch=True)
NAMES = st.lists(NAME, min_size=1, max_size=24, unique=True)


def columns_in(text):
    """Return the words of the headers of a printed table, which pandas may print in parts."""
    return set(re.findall(r"\b[a-z]{3,16}\b", text))


@given(names=NAMES, rows=st.integers(1, MOST_ROWS))
@settings(max_examples=25)
@pytest.mark.parametrize("columns", [40, 80, 200])
def test_every_column_and_row_is_printed_in_lines_of_the_terminal(columns, names, rows):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", str(columns))
        table = Readable(0.125, index=range(rows), columns=names)
        printed = repr(table)
        assert columns_in(printed) == {*names}
        assert printed.count("0.125") == rows * len(names)
        assert max(map(len, printed.splitlines())) <= columns


def returned(tree):
    """Yield what each method that returns a table to read returns, with its name."""
    methods = [part for node in tree.body if isinstance(node, ast.ClassDef) for part in node.body]
    for node in methods:
        wanted = getattr(node, "name", "") in ("summary", "verdicts", "published")
        if wanted and ast.unparse(node.returns) == "pd.DataFrame":
            yield node.name, ast.unparse(node.body[-1])


def test_every_summary_is_a_table_to_read():
    summaries = [
        (path.stem, name, last)
        for path in sorted((ROOT / "bgmodel").rglob("*.py"))
        for name, last in returned(ast.parse(path.read_text()))
    ]
    assert len(summaries) > 10
    assert [each for each in summaries if not each[2].startswith("return Readable(")] == []

"""Tables to read hide no column, however narrow the terminal."""

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bgmodel.support.tables import MOST_ROWS, Readable

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

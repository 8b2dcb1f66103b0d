"""The script that puts single faults in: only what it draws changes, and it always does."""

import ast
from pathlib import Path

from tests.validation.faults import drawn, edited

ROOT = Path(__file__).parents[1]


def test_a_place_written_anew_leaves_the_module_as_it_was_and_a_fault_does_not():
    """Of statements over many lines too: else no test would be seen to pass without the fault."""
    over_lines = 0
    for path, (_, place, new) in drawn(ROOT, 1, 100):
        source = (ROOT / path).read_text()
        was = ast.dump(ast.parse(source))
        assert ast.dump(ast.parse(edited(source, place, place))) == was
        assert ast.dump(ast.parse(edited(source, place, new))) != was
        over_lines += isinstance(place, ast.stmt) and "\n" in ast.unparse(place)
    assert over_lines

"""Random inputs as users type, edit and write them, and what makes one of them wrong."""

import re

from hypothesis import strategies as st

CHOICE = re.compile(r"«([^«»]*)»")
RANGE = re.compile(r"(-?[\d.]+)\.\.([\d.]+)")


def numbers(low, high):
    """Return numbers with few digits between two limits, both included."""
    return st.floats(low, high).map(lambda number: round(number, 4))


@st.composite
def filled(draw, text):
    """Draw a text: of "«a|b»" one part, of "1..5" a whole number, of "0.1..5" any number."""
    while CHOICE.search(text):
        text = CHOICE.sub(lambda choice: draw(st.sampled_from(choice[1].split("|"))), text)

    def number(limits):
        integral = "." not in limits[1] + limits[2]
        low, high = map(int if integral else float, limits.groups())
        return str(draw(st.integers(low, high) if integral else numbers(low, high)))

    return RANGE.sub(number, text)

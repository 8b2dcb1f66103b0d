"""Text can be read on its background: a contrast of 4.5 or more, as WCAG 2.2 (level AA) asks."""

import re

import pytest

from bgmodel.explorer.style import CHIP, NOTICE, PAGE, PANEL

BACKGROUNDS = ("#ffffff", "#f4f5f7", "#eef4f9")
"""Those of cards, of the page and of buttons that remove an edit."""
RULES = re.findall(r"([^{}]+)\{([^{}%]*)\}", CHIP + NOTICE + PAGE + PANEL)
COLOURED = [(where.strip(), rule) for where, rule in RULES if re.search(r"(?<![-\w])color:", rule)]


def luminance(colour):
    """Return the relative luminance of WCAG 2.2 of #rgb or #rrggbb."""
    digits = colour.lstrip("#")
    digits = "".join(2 * d for d in digits) if len(digits) == 3 else digits
    parts = [int(digits[k : k + 2], 16) / 255 for k in (0, 2, 4)]
    linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one, other):
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_contrast_is_that_of_known_pairs():
    assert contrast("#000", "#ffffff") == pytest.approx(21)
    assert contrast("#777777", "#fff") == pytest.approx(4.48, abs=0.01)


@pytest.mark.parametrize(("where", "rule"), COLOURED)
def test_text_can_be_read(where, rule):
    colour = re.search(r"(?<![-\w])color:\s*(#\w+)", rule)[1]
    own = re.search(r"background:\s*(#\w+)", rule)
    for background in [own[1]] if own else BACKGROUNDS:
        assert contrast(colour, background) >= 4.5, where


def test_there_are_rules_with_colours():
    assert len(COLOURED) > 8

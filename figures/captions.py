"""The captions of all figures: ``captions.toml``, with the numbers of a run filled in."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, fields
from pathlib import Path

from figures.common import Settings

CAPTIONS = Path(__file__).with_name("captions.toml")


@dataclass(frozen=True)
class Caption:
    """The caption of one figure in parts; MyST Markdown, without line breaks."""

    title: str
    """A few words."""
    question: str
    """The question that the figure answers, in a neuroscientist's words."""
    caption: str
    """Panels (``**a**``), marks, numbers of trials and intervals."""
    answer: str
    """The figure's answer to the question."""
    command: str
    """The command that draws it."""


def captions(settings: Settings) -> dict[str, Caption]:
    """Return the caption of each figure, by the name of its script, in the order of the file.

    Parameters
    ----------
    settings : Settings
        The numbers to fill in.

    Raises
    ------
    KeyError
        If a placeholder is not a field of ``Settings``.
    TypeError
        If a figure has a missing or an extra key.
    """
    numbers = {field.name: _shown(getattr(settings, field.name)) for field in fields(settings)}
    every = tomllib.loads(CAPTIONS.read_text(encoding="utf-8"))
    return {
        name: Caption(**{key: _line(text, numbers) for key, text in texts.items()})
        for name, texts in every.items()
    }


def _line(text: str, numbers: dict[str, str]) -> str:
    return " ".join(text.split()).format_map(numbers)


def _shown(value: float | tuple[float, ...]) -> str:
    """Return one or more numbers as text, with thousands separated and no trailing zeros."""
    if isinstance(value, tuple):
        return ", ".join(map(_shown, value))
    # No-break spaces keep a number on one line.
    return f"{value:,}".replace(",", "\u202f") if isinstance(value, int) else f"{value:g}"

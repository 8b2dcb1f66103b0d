"""Options that several commands have."""

from __future__ import annotations

from typing import Annotated

import tyro

from circuits.declaration.edits import Edits

EditOption = Annotated[
    Edits,
    tyro.conf.arg(
        name="edit",
        help='Edits of the circuit, each in quotes: "lesion STN 10%" "dopamine 0.9".',
    ),
]
"""Edits of a circuit: one option, followed by a line for each."""

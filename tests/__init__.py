"""Tests: one file per module of the packages, in the same folders; what spans modules lies here."""

import pytest

# What helpers assert is shown as what tests assert.
pytest.register_assert_rewrite("tests.circuits.spiking", "tests.strategies")

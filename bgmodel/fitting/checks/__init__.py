"""Checks of a fitted model: data that differ from it, slow trials, and warnings."""

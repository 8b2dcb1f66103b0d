"""Fits of stop-signal data: one stop process that participants share."""

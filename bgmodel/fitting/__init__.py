"""Fits of models, the sequential test or a circuit, to choice and response-time data."""

"""Fits on known evidence: each trial has its readings, and models answer for each of them."""

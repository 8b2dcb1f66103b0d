"""Spikes of recorded cells and choices in one likelihood, over the noise of a sum of clicks."""

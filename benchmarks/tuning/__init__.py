"""Tuning of the spiking circuits, on seeds not used for scores."""

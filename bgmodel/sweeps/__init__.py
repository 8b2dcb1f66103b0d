"""Sweeps: a circuit and a task, with some of their numbers varied over a grid or a list."""

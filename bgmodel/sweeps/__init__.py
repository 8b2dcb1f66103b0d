"""Sweeps: one circuit and one task with some of their numbers changed, over a grid or a list."""

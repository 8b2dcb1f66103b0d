"""Stopping: the stop-signal task, its ideal observer, estimators, and a circuit that withholds."""

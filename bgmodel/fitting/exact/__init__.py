"""Tests whose choices and times have a density in closed form."""

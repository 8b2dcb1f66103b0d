"""Tests: one file per module of the packages, in the same folders; what spans modules lies here."""

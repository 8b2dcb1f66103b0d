"""The version, in one place: pyproject.toml and every result's provenance read it from here."""

__version__ = "0.4.0"

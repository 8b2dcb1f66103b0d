"""Tactile front end: from skin and contact, via sensor and decoder, to Evidence."""

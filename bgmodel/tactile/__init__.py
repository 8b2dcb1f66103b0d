"""The tactile front end: skin, contact, sensor, decoder; it ends in Evidence."""

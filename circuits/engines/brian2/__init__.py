"""The Brian2 engine: networks generated from the table."""

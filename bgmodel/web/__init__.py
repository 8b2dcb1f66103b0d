"""A page with sliders: one circuit in one HTML file, solved by the reader's browser."""

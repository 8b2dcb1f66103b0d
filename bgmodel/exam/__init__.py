"""An exam for circuits: published numbers, and a circuit's value of each."""

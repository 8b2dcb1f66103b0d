"""An exam that any circuit can take: published numbers, and what a circuit answers to each."""

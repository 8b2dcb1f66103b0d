"""Performance of the model on held-out seeds."""
